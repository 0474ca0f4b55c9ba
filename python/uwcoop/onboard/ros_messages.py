"""ROS 2 messages to and from what a node says, by the log's table of topics; no ROS is needed here.

A message is any object with the fields of its type as attributes: `rclpy`'s and `rosbags`' classes alike. Stamps, and
`measured_ns` and `transmit_ns` within a message, are UNIX time, a mission's are since its epoch.
"""

from __future__ import annotations

import math
from functools import reduce
from typing import Any

import numpy as np

from uwcoop.missionlog.topics import EVENT_TOPICS, At, frame_id
from uwcoop.onboard.messages import Message, MessageError

__all__ = ["event_message_of", "fill_diagnostic", "fill_estimate", "stamp_ns"]

SECOND_NS = 1_000_000_000
UNOBSERVED_M2 = 1e12
_TIMES = ("measured_ns", "transmit_ns")
_OK, _WARN = 0, 1  # diagnostic_msgs/msg/DiagnosticStatus


def stamp_ns(stamp: Any) -> int:
    """A `builtin_interfaces/msg/Time` as ns."""
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)


def event_message_of(kind: str, namespace: str, message: Any, vehicle: int, epoch_ns: int) -> Message:
    """The event of a message on `/{namespace}/{suffix}` of `EVENT_TOPICS[kind]`.

    Raises:
        MessageError: another frame than the table's, or a value that is not finite where the table has a number.
    """
    topic = EVENT_TOPICS[kind]
    header = message if topic.msgtype == "std_msgs/msg/Header" else message.header
    frame = frame_id(topic.frame, namespace)
    if header.frame_id != frame:
        raise MessageError(f"{kind}: frame_id is {header.frame_id[:40]!r}: must be {frame!r}")
    found: Message = {
        "type": "event", "t_ns": stamp_ns(header.stamp) - epoch_ns, "vehicle": vehicle, "kind": kind,
    }  # fmt: skip
    for name, places in topic.places.items():
        values = [_value(message, place) for place in places]
        if any(value != values[0] for value in values if not _is_nan(value)):
            raise MessageError(f"{kind}: {name} is {values[0]} in one place and {values[1]} in another")
        value = values[0]
        if isinstance(value, float) and not math.isfinite(value):
            if kind != "acoustic_fix" or not math.isnan(value):
                raise MessageError(f"{kind}: {name} is {value}: must be finite")
            value = None  # not measured
        found[name] = value - epoch_ns if name in _TIMES else value
    return found


def fill_estimate(message: Any, estimate: Message, epoch_ns: int) -> bool:
    """Fill a `geometry_msgs/msg/PoseWithCovarianceStamped` in the frame `map`.

    False without a position: then nothing is filled. Axes that are not estimated have the variance 1e12.
    """
    east_m, north_m = estimate["mean_m"]
    if east_m is None or None in estimate["covariance_m2"]:
        return False
    _set_stamp(message.header, estimate["t_ns"] + epoch_ns)
    message.header.frame_id = "map"
    pose = message.pose.pose
    pose.position.x, pose.position.y, pose.position.z = east_m, north_m, 0.0
    yaw_rad = 0.0 if estimate["yaw_rad"] is None else estimate["yaw_rad"]
    pose.orientation.x = pose.orientation.y = 0.0
    pose.orientation.z, pose.orientation.w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = np.reshape(estimate["covariance_m2"], (2, 2))
    for axis in range(2, 6):
        covariance[axis, axis] = UNOBSERVED_M2
    message.pose.covariance = covariance.ravel()
    return True


def fill_diagnostic(message: Any, status: Any, diagnostic: Message, name: str, epoch_ns: int) -> None:
    """Fill a `diagnostic_msgs/msg/DiagnosticArray` with one status, of a node's `diagnostic`."""
    _set_stamp(message.header, diagnostic["t_ns"] + epoch_ns)
    message.header.frame_id = ""
    # rclpy's field of type byte takes bytes, rosbags' an integer.
    level = _WARN if diagnostic["raised"] else _OK
    status.level = bytes([level]) if isinstance(status.level, bytes) else level
    status.name, status.hardware_id = f"{name}: {diagnostic['alarm']}", name
    status.message, status.values = diagnostic["text"], []
    message.status = [status]


def _set_stamp(header: Any, t_ns: int) -> None:
    header.stamp.sec, header.stamp.nanosec = divmod(t_ns, SECOND_NS)


def _value(message: Any, place: At) -> Any:
    value = reduce(getattr, place.path.split("."), message)
    if place.item is not None:
        value = value[place.item]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    number = float(value)
    if place.form == "negated":
        return -number
    if place.form == "squared":
        return math.sqrt(number) if number >= 0 else math.nan
    return number


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)
