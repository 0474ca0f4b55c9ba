"""Tracks as a ROS 2 bag (MCAP), which Foxglove, Rerun and ROS tools open.

| topic | type | what |
|---|---|---|
| `/{navigator}/{vehicle}/pose` | geometry_msgs/PoseStamped | position in `map` (east, north, up), yaw |
| `/{navigator}/{vehicle}/odometry` | nav_msgs/Odometry | the same with its covariance |
| `/{navigator}/{vehicle}/navsat` | sensor_msgs/NavSatFix | latitude, longitude, covariance; where the origin is known |

The truth is under `/truth`. Stamps are UTC where the epoch is known, else seconds since the start.
"""

from __future__ import annotations

from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.missionlog.container import zstd_available
from uwcoop.missionlog.copies import ODOMETRY, set_body_twist, set_yaw
from uwcoop.missionlog.messages import Layout, Records, definition, layout, set_stamps, split
from uwcoop.missionlog.topics import Stream, namespaces
from uwcoop.report.export.routes import Route, Routes
from uwcoop.report.export.tables import yaw_or_course

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["write_mcap"]

_POSE, _NAV_SAT_FIX = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/NavSatFix"
_UNKNOWN_M2 = 1e9
"""Variance of what is not estimated."""


def write_mcap(routes: Routes, path: Path) -> None:
    """Write all routes, in the order of time."""
    from mcap.writer import CompressionType, Writer

    streams = _all_streams(routes)
    with path.open("wb") as file:
        compression = CompressionType.ZSTD if zstd_available() else CompressionType.NONE
        writer = Writer(file, compression=compression)
        writer.start(profile="ros2", library="uwcoop")
        about = {"mission": routes.mission, "counterfactual": routes.note}
        writer.add_metadata("uwcoop_tracks", {key: text for key, text in about.items() if text})
        schemas: dict[str, int] = {}
        queues = []
        for stream in streams:
            if stream.msgtype not in schemas:
                text = definition(stream.msgtype).encode()
                schemas[stream.msgtype] = writer.register_schema(stream.msgtype, "ros2msg", text)
            channel = writer.register_channel(stream.topic, "cdr", schemas[stream.msgtype])
            count = len(stream.messages)
            queues.append(
                zip(stream.t_ns.tolist(), [channel] * count, range(count), stream.messages, strict=True)
            )
        for t_ns, channel, row, message in merge(*queues):
            writer.add_message(channel, t_ns, message, t_ns, row)
        writer.finish()  # type: ignore[no-untyped-call]


def _all_streams(routes: Routes) -> list[Stream]:
    start_ns = 0 if routes.epoch is None else round(routes.epoch.timestamp() * 1e6) * 1000
    navigators, vehicles = (
        dict(zip(names, namespaces(names), strict=True))
        for names in (
            list(dict.fromkeys(route.navigator for route in routes.routes)),
            list(dict.fromkeys(route.vehicle for route in routes.routes)),
        )
    )
    return [
        stream
        for route in routes.routes
        for stream in _streams(route, start_ns, f"{navigators[route.navigator]}/{vehicles[route.vehicle]}")
    ]


def _streams(route: Route, start_ns: int, name: str) -> list[Stream]:
    t_ns = start_ns + np.round(route.time_s * 1e9).astype(np.int64)
    position = np.column_stack([route.position_m, -route.depth_m])
    streams = [
        _poses(f"/{name}/pose", route, t_ns, position),
        _odometry(f"/{name}/odometry", route, t_ns, position, name),
    ]
    if route.latitude_deg is not None and route.longitude_deg is not None:
        streams.append(_navsat(f"/{name}/navsat", route, t_ns, name))
    return streams


def _blank(shape: Layout, t_ns: NDArray[np.int64]) -> Records:
    records = shape.blank(len(t_ns))
    set_stamps(records, t_ns)
    return records


def _place(records: Records, path: str, route: Route, position: NDArray[np.float64]) -> None:
    for axis, column in zip("xyz", position.T, strict=True):
        records[f"{path}.position.{axis}"] = column
    set_yaw(records, f"{path}.orientation", yaw_or_course(route))


def _poses(topic: str, route: Route, t_ns: NDArray[np.int64], position: NDArray[np.float64]) -> Stream:
    records = _blank(layout(_POSE, {"header.frame_id": "map"}), t_ns)
    _place(records, "pose", route, position)
    return Stream(topic, _POSE, t_ns, split(records))


def _odometry(
    topic: str, route: Route, t_ns: NDArray[np.int64], position: NDArray[np.float64], child: str
) -> Stream:
    records = _blank(layout(ODOMETRY, {"header.frame_id": "map", "child_frame_id": child}), t_ns)
    _place(records, "pose.pose", route, position)
    set_body_twist(records, t_ns, yaw_or_course(route), position)
    covariance = records["pose.covariance"]
    if route.covariance_m2 is not None:
        own = np.where(np.isfinite(route.covariance_m2), route.covariance_m2, _UNKNOWN_M2)
        covariance[:, 0], covariance[:, 7] = own[:, 0, 0], own[:, 1, 1]
        covariance[:, 1] = covariance[:, 6] = own[:, 0, 1]
    if route.yaw_rad is None:
        covariance[:, 35] = _UNKNOWN_M2
    return Stream(topic, ODOMETRY, t_ns, split(records))


def _navsat(topic: str, route: Route, t_ns: NDArray[np.int64], child: str) -> Stream:
    records = _blank(layout(_NAV_SAT_FIX, {"header.frame_id": child}), t_ns)
    records["latitude"], records["longitude"] = route.latitude_deg, route.longitude_deg
    records["altitude"] = -route.depth_m
    if route.covariance_m2 is not None:
        covariance, own = records["position_covariance"], route.covariance_m2
        covariance[:, 0], covariance[:, 4] = own[:, 0, 0], own[:, 1, 1]
        covariance[:, 1] = covariance[:, 3] = own[:, 0, 1]
        records["position_covariance_type"] = 3  # known; the height's is 0, it is the depth sensor's
    return Stream(topic, _NAV_SAT_FIX, t_ns, split(records))
