"""Which topic, type and fields carry each kind of event, and event tables to and from messages.

A vehicle index never travels in a sensor message: the topic's namespace says whose it is. A standard
deviation travels as the variance that ROS expects: in binary floating point `sqrt(s * s)` gives `s` back
exactly unless the square leaves the range of float64 (Boldo, "Stupid is as stupid does", 2015), and such a
sigma is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from uwcoop.errors import LogError
from uwcoop.missionlog.messages import Layout, Records, layout, set_stamps, split, stamps
from uwcoop.missionlog.model import EVENT_COLUMNS, Columns, MissionLog, columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

Recorded = Mapping[str, Sequence[bytes]]
"""Topic -> messages in the order of the file."""


@dataclass(frozen=True)
class Stream:
    """The messages of one topic: type, mission times (N,) and CDR bytes (N)."""

    topic: str
    msgtype: str
    t_ns: NDArray[np.int64]
    messages: Sequence[bytes]


class At(NamedTuple):
    """Where in a message a column's value lies: path, item of an array, and what was done to it."""

    path: str
    item: int | None = None
    form: Literal["same", "negated", "squared"] = "same"


@dataclass(frozen=True)
class EventTopic:
    """`/{namespace}/{suffix}` of one event kind; every place of a column is written, the first is read."""

    suffix: str
    msgtype: str
    frame: Literal["map", "base_link"]
    places: Mapping[str, tuple[At, ...]]
    constants: Mapping[At, float] = field(default_factory=dict)
    earlier: str = ""
    """Message type with fewer fields that earlier logs hold; what it lacks is NaN."""


_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_IMU = "sensor_msgs/msg/Imu"
_UPRIGHT = {At("pose.pose.orientation.w"): 1.0}
_UNOBSERVED_M2 = 1e12
# On the diagonal of a 6 x 6 covariance (x, y, z, roll, pitch, yaw): the axes that a message knows nothing of.
_ONLY_Z = {**_UPRIGHT, **{At("pose.covariance", 7 * i): _UNOBSERVED_M2 for i in (0, 1, 3, 4, 5)}}
_ONLY_XY = {**_UPRIGHT, **{At("pose.covariance", 7 * i): _UNOBSERVED_M2 for i in (2, 3, 4, 5)}}

EVENT_TOPICS: dict[str, EventTopic] = {
    "motion": EventTopic(
        "commanded_velocity", "geometry_msgs/msg/TwistStamped", "map",
        {"velocity_e_mps": (At("twist.linear.x"),), "velocity_n_mps": (At("twist.linear.y"),)},
    ),
    "odometry": EventTopic(
        "odometry_increment", "uwcoop_msgs/msg/OdometryIncrement", "base_link",
        {
            "forward_m": (At("forward_m"),), "left_m": (At("left_m"),),
            "yaw_change_rad": (At("yaw_change_rad"),),
            "cov_ff": (At("covariance", 0),), "cov_fl": (At("covariance", 1), At("covariance", 3)),
            "cov_fy": (At("covariance", 2), At("covariance", 6)), "cov_ll": (At("covariance", 4),),
            "cov_ly": (At("covariance", 5), At("covariance", 7)), "cov_yy": (At("covariance", 8),),
        },
    ),
    "water_depth": EventTopic(
        "water_depth", _POSE, "map",
        {
            "water_depth_m": (At("pose.pose.position.z", form="negated"),),
            "sigma_m": (At("pose.covariance", 14, "squared"),),
        },
        _ONLY_Z,
    ),
    "depth": EventTopic(
        "depth", _POSE, "map",
        {
            "depth_m": (At("pose.pose.position.z", form="negated"),),
            "sigma_m": (At("pose.covariance", 14, "squared"),),
        },
        _ONLY_Z,
    ),
    "heading": EventTopic(
        "heading", "uwcoop_msgs/msg/Heading", "map",
        {"yaw_rad": (At("yaw_rad"),), "sigma_rad": (At("sigma_rad"),)},
    ),
    "turn_rate": EventTopic(
        "turn_rate", _IMU, "base_link",
        {
            "yaw_rate_radps": (At("angular_velocity.z"),),
            "sigma_radps": (At("angular_velocity_covariance", 8, "squared"),),
        },
        # -1 is how sensor_msgs/Imu says that it holds no estimate.
        {
            At("orientation.w"): 1.0, At("orientation_covariance", 0): -1.0,
            At("linear_acceleration_covariance", 0): -1.0,
        },
    ),
    "ground_velocity": EventTopic(
        "ground_velocity", "geometry_msgs/msg/TwistWithCovarianceStamped", "base_link",
        {
            "forward_mps": (At("twist.twist.linear.x"),), "left_mps": (At("twist.twist.linear.y"),),
            "sigma_mps": (At("twist.covariance", 0, "squared"), At("twist.covariance", 7, "squared")),
        },
        {At("twist.covariance", 7 * i): _UNOBSERVED_M2 for i in (2, 3, 4, 5)},
    ),
    "fix": EventTopic(
        "fix", _POSE, "map",
        {
            "e_m": (At("pose.pose.position.x"),), "n_m": (At("pose.pose.position.y"),),
            "cov_ee_m2": (At("pose.covariance", 0),),
            "cov_en_m2": (At("pose.covariance", 1), At("pose.covariance", 6)),
            "cov_nn_m2": (At("pose.covariance", 7),),
        },
        _ONLY_XY,
    ),
    "acoustic_fix": EventTopic(
        "acoustic_fix", "uwcoop_msgs/msg/AcousticFix", "base_link",
        {name: (At(name),) for name in EVENT_COLUMNS["acoustic_fix"]},
        earlier="uwcoop_msgs/msg/AcousticFixWithoutDepth",
    ),
    "water_velocity": EventTopic(
        "water_velocity", "geometry_msgs/msg/TwistWithCovarianceStamped", "base_link",
        {
            "forward_mps": (At("twist.twist.linear.x"),), "left_mps": (At("twist.twist.linear.y"),),
            "sigma_mps": (At("twist.covariance", 0, "squared"), At("twist.covariance", 7, "squared")),
        },
        {At("twist.covariance", 7 * i): _UNOBSERVED_M2 for i in (2, 3, 4, 5)},
    ),
    "beacon_range": EventTopic(
        "beacon_range", "uwcoop_msgs/msg/BeaconRange", "base_link",
        {name: (At(name),) for name in EVENT_COLUMNS["beacon_range"]},
    ),
    "usbl": EventTopic(
        "usbl", "uwcoop_msgs/msg/UsblPosition", "map",
        {
            "measured_ns": (At("measured_ns"),), "e_m": (At("e_m"),), "n_m": (At("n_m"),),
            "cov_ee_m2": (At("covariance", 0),), "cov_en_m2": (At("covariance", 1), At("covariance", 2)),
            "cov_nn_m2": (At("covariance", 3),),
        },
    ),
    "landed": EventTopic("landed", "std_msgs/msg/Header", "base_link", {}),
    "lifted_off": EventTopic("lifted_off", "std_msgs/msg/Header", "base_link", {}),
    "role_taken": EventTopic(
        "role_taken", "uwcoop_msgs/msg/RoleTaken", "base_link", {"landmark": (At("landmark"),)}
    ),
}  # fmt: skip
"""The tables' home: what is read back. Copies for tooling are made in `copies`."""


def namespaces(vehicles: Sequence[str]) -> tuple[str, ...]:
    """A valid, unique ROS namespace for each vehicle: its name, anything but letters and digits as `_`."""
    taken: list[str] = []
    for name in vehicles:
        base = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
        base = base if base[:1].isalpha() else f"v{base}"
        candidate, number = base, 1
        while candidate in taken:
            number += 1
            candidate = f"{base}_{number}"
        taken.append(candidate)
    return tuple(taken)


def types(names: Sequence[str]) -> dict[str, str]:
    """Message type of every topic that `decode` reads, for these namespaces."""
    return {f"/{name}/{topic.suffix}": topic.msgtype for name in names for topic in EVENT_TOPICS.values()}


def frame_id(frame: str, namespace: str) -> str:
    """`map`, the local ENU frame, or the vehicle's own frame (REP 105)."""
    return frame if frame == "map" else f"{namespace}/{frame}"


def encode(log: MissionLog) -> Iterator[Stream]:
    """The event tables of the log as streams of messages, one for each kind and vehicle.

    Raises:
        LogError: a standard deviation whose square is outside float64.
    """
    names = namespaces(log.vehicles)
    for kind, topic in EVENT_TOPICS.items():
        table = log.events.get(kind)
        if table is None:
            continue
        for vehicle, namespace in enumerate(names):
            rows = np.flatnonzero(table["vehicle"] == vehicle)
            mine = {name: column[rows] for name, column in table.items()}
            records = _event_layout(topic, namespace).blank(rows.size)
            set_stamps(records, mine["t_ns"])
            for place, value in topic.constants.items():
                _put(records, place, value)
            for name, places in topic.places.items():
                for place in places:
                    _put(records, place, mine[name])
                    _refuse_lost_bits(kind, name, place, records, mine[name], log.vehicles[vehicle])
            yield Stream(f"/{namespace}/{topic.suffix}", topic.msgtype, mine["t_ns"], split(records))


def decode(recorded: Recorded, names: Sequence[str], rows: Mapping[str, int]) -> dict[str, Columns]:
    """The event tables that `rows` names, from recorded topics, each sorted by (time, vehicle).

    Args:
        names: namespace of each vehicle.
        rows: event kind -> number of rows that the file states.

    Raises:
        LogError: an unknown kind, a message of another layout, stamps out of order, rows missing.
    """
    tables: dict[str, Columns] = {}
    for kind, count in rows.items():
        if kind not in EVENT_TOPICS:
            raise LogError(f"table {kind!r} is unknown: the log was written by a newer version")
        tables[kind] = _decode_events(EVENT_TOPICS[kind], kind, recorded, names)
        refuse_missing(kind, len(tables[kind]["t_ns"]), count)
    return tables


def read_topic(recorded: Recorded, topic: str, shape: Layout, count: int | None = None) -> Records:
    """The topic's messages as records, in the order of the file, which must be the order of their stamps.

    Raises:
        LogError: a message of another layout, stamps out of order, or not the `count` that the log states.
    """
    messages = recorded.get(topic, ())
    if count is not None:
        refuse_missing(topic, len(messages), count)
    try:
        records = shape.read(messages)
    except LogError as error:
        raise LogError(f"{topic}: {error}") from error
    t_ns = stamps(records)
    back = np.flatnonzero(np.diff(t_ns) < 0)
    if back.size:
        at = int(back[0]) + 1
        raise LogError(
            f"{topic} is out of order: message {at} stamped {t_ns[at] / 1e9:.9f} s "
            f"follows one stamped {t_ns[at - 1] / 1e9:.9f} s"
        )
    return records


def refuse_missing(name: str, have: int, stated: int) -> None:
    """Raise `LogError` unless as many messages were found as the log states."""
    if have != stated:
        raise LogError(f"{name} holds {have} messages, the log states {stated}")


def _decode_events(topic: EventTopic, kind: str, recorded: Recorded, names: Sequence[str]) -> Columns:
    spec = {"t_ns": "i8", "vehicle": "i8", **EVENT_COLUMNS[kind]}
    parts: list[Columns] = []
    for vehicle, namespace in enumerate(names):
        records = _read_events(topic, recorded, namespace)
        unknown = np.full(records.size, np.nan)
        part: dict[str, Any] = {
            name: _get(records, places[0]) if _holds(records, places[0]) else unknown
            for name, places in topic.places.items()
        }
        parts.append(
            columns(spec, t_ns=stamps(records), vehicle=np.full(records.size, vehicle), **part),
        )
    joined = {name: np.concatenate([part[name] for part in parts]) for name in spec}
    order = np.lexsort((joined["vehicle"], joined["t_ns"]))
    return {name: column[order] for name, column in joined.items()}


def _read_events(topic: EventTopic, recorded: Recorded, namespace: str) -> Records:
    name = f"/{namespace}/{topic.suffix}"
    try:
        return read_topic(recorded, name, _event_layout(topic, namespace))
    except LogError:
        if not topic.earlier:
            raise
        try:
            return read_topic(recorded, name, _event_layout(replace(topic, msgtype=topic.earlier), namespace))
        except LogError:
            pass
        raise


def _holds(records: Records, place: At) -> bool:
    return place.path in (records.dtype.names or ())


def _event_layout(topic: EventTopic, namespace: str) -> Layout:
    path = "frame_id" if topic.msgtype == "std_msgs/msg/Header" else "header.frame_id"
    return layout(topic.msgtype, {path: frame_id(topic.frame, namespace)})


def _put(records: Records, place: At, values: Any) -> None:
    if place.form == "negated":
        values = -values
    elif place.form == "squared":
        with np.errstate(over="ignore", under="ignore"):
            values = values * values
    if place.item is None:
        records[place.path] = values
    else:
        records[place.path][:, place.item] = values


def _get(records: Records, place: At) -> NDArray[Any]:
    values: NDArray[Any] = records[place.path]
    if place.item is not None:
        values = values[:, place.item]
    if values.dtype == np.uint8:
        return np.asarray(values != 0)
    if place.form == "negated":
        return np.asarray(-values)
    if place.form == "squared":
        # A negative variance becomes NaN and is refused as such by `validate`.
        with np.errstate(invalid="ignore"):
            return np.asarray(np.sqrt(values))
    return values


def _refuse_lost_bits(
    kind: str, name: str, place: At, records: Records, column: NDArray[Any], vehicle: str
) -> None:
    if place.form != "squared":
        return
    lost = np.flatnonzero(_get(records, place).view(np.int64) != column.view(np.int64))
    if lost.size:
        raise LogError(
            f"{kind}: {name} {column[lost[0]]} of vehicle {vehicle!r} cannot be stored as a variance: "
            "it must be 0 or between 1e-150 and 1e150"
        )
