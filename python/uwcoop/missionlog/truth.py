"""The truth of a mission to and from the topics below `/truth`, which no navigator is fed from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import LogError
from uwcoop.missionlog.copies import ODOMETRY, set_body_twist, set_yaw
from uwcoop.missionlog.labelled import Arrays, Labelled
from uwcoop.missionlog.messages import Layout, Records, layout, set_stamps, split, stamps
from uwcoop.missionlog.model import MissionLog
from uwcoop.missionlog.topics import Recorded, Stream, frame_id, namespaces, read_topic

if TYPE_CHECKING:
    from numpy.typing import NDArray

DIMENSIONS = {
    "position_m": ("vehicle", "time", "axis"),
    "depth_m": ("vehicle", "time"),
    "yaw_rad": ("vehicle", "time"),
    "current_mps": ("vehicle", "time", "axis"),
}
"""Variables of the truth; `position_m` is there always, the others where they are known."""

_YAW = "uwcoop_msgs/msg/Heading"
_CURRENT = "geometry_msgs/msg/TwistStamped"


def types(names: Sequence[str]) -> dict[str, str]:
    """Message type of every topic that `decode_truth` reads, for these namespaces."""
    kinds = {"odometry": ODOMETRY, "yaw": _YAW, "current": _CURRENT}
    return {f"/truth/{name}/{suffix}": msgtype for name in names for suffix, msgtype in kinds.items()}


def truth_time_ns(truth: Arrays) -> NDArray[np.int64]:
    """The truth's times in nanoseconds, (time,).

    Raises:
        LogError: a time that is not a whole number of nanoseconds, and would not come back from a file as it
        is.
    """
    seconds = truth["time"].to_numpy().astype(np.float64)
    t_ns = np.round(seconds * 1e9).astype(np.int64)
    wrong = np.flatnonzero(t_ns / 1e9 != seconds)
    if wrong.size:
        raise LogError(f"truth: time {float(seconds[wrong[0]])!r} s is not a whole number of nanoseconds")
    return t_ns


def describe(log: MissionLog) -> dict[str, Any] | None:
    """What the topics do not say: which variables there are, and their attributes; None: no truth."""
    if log.truth is None:
        return None
    names = [str(name) for name in log.truth.variables]
    return {
        "variables": [str(name) for name in log.truth.data_vars],
        "coordinates": {
            str(name): log.truth[name].values.tolist() for name in log.truth.coords if name != "time"
        },
        "attributes": dict(log.truth.attrs),
        "units": {name: dict(log.truth[name].attrs) for name in names},
        "times": int(log.truth.sizes["time"]),
    }


def encode_truth(log: MissionLog) -> Iterator[Stream]:
    """`/truth/{namespace}/odometry`, `yaw` and `current` of each vehicle."""
    if log.truth is None:
        return
    t_ns = truth_time_ns(log.truth)
    values = {
        str(name): variable.transpose(*DIMENSIONS[str(name)]).to_numpy()
        for name, variable in log.truth.data_vars.items()
    }
    for vehicle, namespace in enumerate(namespaces(log.vehicles)):
        mine = {name: array[vehicle] for name, array in values.items()}
        unknown = np.full(t_ns.size, np.nan)
        yaw, depth = mine.get("yaw_rad", unknown), mine.get("depth_m", unknown)
        prefix = f"/truth/{namespace}"
        records = _odometry_layout(namespace).blank(t_ns.size)
        set_stamps(records, t_ns)
        position = np.column_stack([mine["position_m"], -depth])
        for axis, column in zip("xyz", position.T, strict=True):
            records[f"pose.pose.position.{axis}"] = column
        set_yaw(records, "pose.pose.orientation", yaw)
        set_body_twist(records, t_ns, yaw, position)
        yield Stream(f"{prefix}/odometry", ODOMETRY, t_ns, split(records))
        if "yaw_rad" in mine:
            records = _map_layout(_YAW).blank(t_ns.size)
            set_stamps(records, t_ns)
            records["yaw_rad"] = yaw
            yield Stream(f"{prefix}/yaw", _YAW, t_ns, split(records))
        if "current_mps" in mine:
            records = _map_layout(_CURRENT).blank(t_ns.size)
            set_stamps(records, t_ns)
            records["twist.linear.x"], records["twist.linear.y"] = mine["current_mps"].T
            yield Stream(f"{prefix}/current", _CURRENT, t_ns, split(records))


def decode_truth(recorded: Recorded, names: Sequence[str], about: Mapping[str, Any]) -> Labelled:
    """The truth as `describe` states it, from recorded topics.

    Raises:
        LogError: a topic missing, out of order, of another length, or with other times than the first
        vehicle's.
    """
    count = int(about["times"])
    values: dict[str, list[NDArray[np.float64]]] = {str(name): [] for name in about["variables"]}
    t_ns: NDArray[np.int64] | None = None
    for namespace in names:
        odometry = read_topic(recorded, f"/truth/{namespace}/odometry", _odometry_layout(namespace), count)
        parts = {
            "position_m": _columns(odometry, "pose.pose.position.x", "pose.pose.position.y"),
            "depth_m": -odometry["pose.pose.position.z"],
        }
        times = [stamps(odometry)]
        if "yaw_rad" in values:
            yaw = read_topic(recorded, f"/truth/{namespace}/yaw", _map_layout(_YAW), count)
            parts["yaw_rad"] = yaw["yaw_rad"]
            times.append(stamps(yaw))
        if "current_mps" in values:
            current = read_topic(recorded, f"/truth/{namespace}/current", _map_layout(_CURRENT), count)
            parts["current_mps"] = _columns(current, "twist.linear.x", "twist.linear.y")
            times.append(stamps(current))
        t_ns = times[0] if t_ns is None else t_ns
        if any(not np.array_equal(other, t_ns) for other in times):
            raise LogError(
                f"/truth/{namespace}: its topics do not share their times with the other vehicles'"
            )
        for name, column in values.items():
            column.append(parts[name])
    assert t_ns is not None
    units = about["units"]
    coordinates = {"time": t_ns / 1e9, **about["coordinates"]}
    return Labelled(
        {name: (DIMENSIONS[name], np.stack(column), units.get(name, {})) for name, column in values.items()},
        {name: (name, np.asarray(column), units.get(name, {})) for name, column in coordinates.items()},
        about["attributes"],
    )


def _odometry_layout(namespace: str) -> Layout:
    child = frame_id("base_link", namespace)
    return layout(ODOMETRY, {"header.frame_id": "map", "child_frame_id": child})


def _map_layout(msgtype: str) -> Layout:
    return layout(msgtype, {"header.frame_id": "map"})


def _columns(records: Records, *paths: str) -> NDArray[np.float64]:
    return np.column_stack([records[path] for path in paths])
