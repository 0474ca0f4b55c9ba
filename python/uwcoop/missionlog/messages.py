"""The ROS 2 messages of a log on disk: definitions, and their CDR bytes as NumPy records.

Standard types come from rosbags' type store; `uwcoop_msgs` is defined here. A message whose strings and
sequences have a known length has a fixed layout, so a whole topic is one structured array: a column is
written or read with one assignment and keeps every bit. The layouts are derived from the same field
definitions that travel in the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from uwcoop.errors import LogError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rosbags.typesys.store import Typestore

Records = np.ndarray[Any, np.dtype[np.void]]

_PACKAGE = "uwcoop_msgs/msg/"
_RULE = "=" * 80 + "\n"
_INDEX = "# position in the team of /mission, from 0"

DEFINITIONS: dict[str, str] = {
    "Mission": """\
# Who takes part, in the order of every vehicle index in this package.
std_msgs/Header header
string name
string[] vehicles
# ROS namespace of each vehicle
string[] namespaces
""",
    "OdometryIncrement": """\
# Displacement since the previous message of the topic, in the body frame at its start (REP 103).
std_msgs/Header header
float64 forward_m
float64 left_m
# counter-clockwise
float64 yaw_change_rad
# row by row: forward, left, yaw
float64[9] covariance
""",
    "Heading": """\
# Yaw, counter-clockwise from east (REP 103); a quaternion would not give its last bits back.
std_msgs/Header header
float64 yaw_rad
# standard deviation; 0 in the truth
float64 sigma_rad
""",
    "RoleTaken": """\
std_msgs/Header header
# true: the vehicle serves as a landmark from now on; false: it moves
bool landmark
""",
    "AcousticFix": f"""\
# Mutual positioning with one peer, completed at the stamp; NaN: not measured.
std_msgs/Header header
{_INDEX}
int32 peer
# launch of the request, nanoseconds of mission time
int64 transmit_ns
# slant range from the two-way travel time
float64 range_m
# direction of the peer from the vehicle, and of the vehicle from the peer
float64 own_bearing_rad
float64 peer_bearing_rad
# depth of the peer below the surface, metres, as its reply tells it
float64 peer_depth_m
""",
    "AcousticFixWithoutDepth": f"""\
# Of earlier logs, not written any more: mutual positioning with one peer, completed at the stamp; NaN: not measured.
std_msgs/Header header
{_INDEX}
int32 peer
# launch of the request, nanoseconds of mission time
int64 transmit_ns
# slant range from the two-way travel time
float64 range_m
# direction of the peer from the vehicle, and of the vehicle from the peer
float64 own_bearing_rad
float64 peer_bearing_rad
""",
    "BeaconRange": """\
# Range to a beacon at a known place; the stamp is when it was told.
std_msgs/Header header
# arrival of the signal, nanoseconds of mission time: the range is to where the vehicle was then
int64 measured_ns
# place of the beacon in the local ENU frame, metres, and its depth below the surface
float64 beacon_e_m
float64 beacon_n_m
float64 beacon_depth_m
# slant range and its standard deviation, metres
float64 range_m
float64 sigma_m
# true: from the travel time one way, in which the difference of the clocks stands
bool one_way
""",
    "UsblPosition": """\
# Position by an ultra-short baseline; the stamp is when it was told.
std_msgs/Header header
# nanoseconds of mission time: where the vehicle was then
int64 measured_ns
# local ENU frame, metres
float64 e_m
float64 n_m
# row by row: east, north
float64[4] covariance
""",
    "AcousticSlot": f"""\
# A transmit slot of the TDMA schedule; the stamp is the time of launch.
std_msgs/Header header
{_INDEX}
int32 sender
# what fits before the guard time, in whole frames
int64 capacity_bytes
""",
    "AcousticPoll": f"""\
# Two-way ranging: a request for what is sent in a slot; the stamp is the launch of the request.
std_msgs/Header header
{_INDEX}
int32 sender
# who asks, and alone gets the range
int32 poller
# launch of the slot's packet, nanoseconds of mission time
int64 tol_ns
int64 poll_bytes
# what the answer carries beside the packet
int64 reply_bytes
# time that the request occupies the channel, nanoseconds
int64 air_time_ns
# whether it was heard; if not, the slot stays silent
bool answered
""",
    "AcousticOpportunity": f"""\
# One possible arrival of what is sent in a slot; the stamp is the time of launch. Frame k of a packet
# arrives when draws[k] < survive_probability, so every packet, whatever its length, meets the same losses.
std_msgs/Header header
{_INDEX}
int32 sender
int32 receiver
# measured arrival of the signal's start in the receiver's clock, nanoseconds of mission time
int64 toa_ns
float64 survive_probability
# uniform in [0, 1), one for each frame
float64[] draws
""",
    "AcousticReception": f"""\
# A packet that did arrive; the stamp is the end of decoding.
std_msgs/Header header
{_INDEX}
int32 sender
int32 receiver
# launch, and measured arrival of the signal's start, nanoseconds of mission time
int64 tol_ns
int64 toa_ns
uint8[] payload
""",
}
"""`uwcoop_msgs`: name -> definition, as embedded in the file."""


@cache
def typestore() -> Typestore:
    """Standard ROS 2 types plus `uwcoop_msgs`.

    Jazzy's definitions; on the wire the standard types used here are the same from Foxy to Lyrical.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in DEFINITIONS.items():
        store.register(get_types_from_msg(definition, _PACKAGE + name))
    return store


def definition(msgtype: str) -> str:
    """The full definition of a message type with all it depends on, as schema encoding `ros2msg` wants it."""
    text: str = typestore().generate_msgdef(msgtype, ros_version=2)[0]
    own = DEFINITIONS.get(msgtype.removeprefix(_PACKAGE)) if msgtype.startswith(_PACKAGE) else None
    return text if own is None else own + "".join(_RULE + part for part in text.split(_RULE)[1:])


@dataclass(frozen=True)
class Layout:
    """CDR bytes of one topic's messages as a structured dtype; fields are named by their path in the message.

    `fixed` holds what every message of the topic repeats: encapsulation, strings, lengths.
    """

    dtype: np.dtype[np.void]
    fixed: Mapping[str, int | bytes]

    def blank(self, count: int) -> Records:
        """`count` messages with zeros in every field that is not fixed."""
        records = np.zeros(count, dtype=self.dtype)
        for name, value in self.fixed.items():
            records[name] = value
        return records

    def read(self, messages: Sequence[bytes]) -> Records:
        """The messages as records, (len(messages),).

        Raises:
            LogError: a message of another length or with other fixed parts.
        """
        size = self.dtype.itemsize
        for number, message in enumerate(messages):
            if len(message) != size:
                raise LogError(f"message {number} has {len(message)} bytes, its definition needs {size}")
        records = np.frombuffer(b"".join(messages), dtype=self.dtype)
        for name, value in self.fixed.items():
            wrong = np.flatnonzero(records[name] != value)
            if wrong.size:
                found = records[name][wrong[0]].item()
                raise LogError(f"message {wrong[0]} has {name} {found!r}, not {value!r}")
        return records


def layout(
    msgtype: str, strings: Mapping[str, str] | None = None, counts: Mapping[str, int] | None = None
) -> Layout:
    """Layout of a message type with these strings and sequence lengths, by path; empty where not given."""
    walk = _Walk(strings or {}, counts or {})
    walk.message(msgtype, "")
    spec = {
        "names": ["encapsulation", *walk.names],
        "formats": ["<u4", *walk.formats],
        "offsets": [0, *(_ENCAPSULATION_BYTES + at for at in walk.offsets)],
        "itemsize": _ENCAPSULATION_BYTES + walk.position,
    }
    dtype: np.dtype[np.void] = np.dtype(spec)  # type: ignore[call-overload]
    return Layout(dtype, {"encapsulation": _LITTLE_ENDIAN, **walk.fixed})


_ENCAPSULATION_BYTES = 4
_LITTLE_ENDIAN = 0x0100  # bytes 00 01 00 00: plain CDR, little-endian
_FORMATS = {
    "bool": "u1", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "<i2", "uint16": "<u2",
    "int32": "<i4", "uint32": "<u4", "int64": "<i8", "uint64": "<u8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip


class _Walk:
    """Places the fields of a message one after the other, each aligned to its own size (CDR rule)."""

    def __init__(self, strings: Mapping[str, str], counts: Mapping[str, int]) -> None:
        self.strings, self.counts = strings, counts
        self.position = 0
        self.names: list[str] = []
        self.formats: list[Any] = []
        self.offsets: list[int] = []
        self.fixed: dict[str, int | bytes] = {}

    def message(self, msgtype: str, prefix: str) -> None:
        from rosbags.interfaces import Nodetype

        for name, (kind, detail) in typestore().fielddefs[msgtype][1]:
            path = prefix + name
            if kind == Nodetype.NAME:
                self.message(str(detail), path + ".")
            elif kind == Nodetype.BASE:
                self.base(path, cast("tuple[str, int]", detail)[0])
            else:
                (_, (element, _)), length = cast("tuple[tuple[int, tuple[str, int]], int]", detail)
                if kind == Nodetype.SEQUENCE:
                    length = self.counts.get(path, 0)
                    self.place(path + ".count", "<u4", 4)
                    self.fixed[path + ".count"] = length
                if length:
                    form = np.dtype(_FORMATS[element])
                    self.place(path, (form, (length,)), form.itemsize, length)

    def base(self, path: str, kind: str) -> None:
        if kind != "string":
            form = np.dtype(_FORMATS[kind])
            self.place(path, form, form.itemsize)
            return
        text = self.strings.get(path, "").encode()
        self.place(path + ".length", "<u4", 4)
        self.place(path, f"S{len(text) + 1}", 1, len(text) + 1)
        self.fixed[path + ".length"] = len(text) + 1
        self.fixed[path] = text

    def place(self, name: str, form: Any, size: int, count: int = 1) -> None:
        self.position += -self.position % size
        self.names.append(name)
        self.formats.append(form)
        self.offsets.append(self.position)
        self.position += size * count


def split(records: Records) -> list[bytes]:
    """One bytes object for each record."""
    size, content = records.dtype.itemsize, records.tobytes()
    return [content[at : at + size] for at in range(0, len(content), size)]


def set_stamps(records: Records, t_ns: NDArray[np.int64]) -> None:
    """Write mission times as `builtin_interfaces/Time` into the records' header."""
    prefix = _stamp(records)
    records[prefix + "sec"], records[prefix + "nanosec"] = np.divmod(t_ns, 1_000_000_000)


def stamps(records: Records) -> NDArray[np.int64]:
    """Mission times of the records' headers, nanoseconds, (N,)."""
    prefix = _stamp(records)
    seconds: NDArray[np.int64] = records[prefix + "sec"].astype(np.int64)
    return np.asarray(seconds * 1_000_000_000 + records[prefix + "nanosec"])


def _stamp(records: Records) -> str:
    names = records.dtype.names
    return "header.stamp." if names is not None and "header.stamp.sec" in names else "stamp."
