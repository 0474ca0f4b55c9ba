"""Messages that a log carries for other tools only; reading a log back ignores them.

They hold what the tables hold in the shape that ROS tooling expects, where that shape would lose the last
bits (quaternions, degrees) or needs a running sum.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import ChartError, LogError, MissingDependencyError
from uwcoop.missionlog.messages import Records, layout, set_stamps, split, typestore
from uwcoop.missionlog.model import Columns, MissionLog
from uwcoop.missionlog.topics import Stream, frame_id, namespaces

if TYPE_CHECKING:
    from numpy.typing import NDArray

MISSION_TOPIC = "/mission"
ODOMETRY = "nav_msgs/msg/Odometry"
_IMU = "sensor_msgs/msg/Imu"
_NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"


def encode_copies(log: MissionLog) -> Iterator[Stream]:
    """`/mission`, and each vehicle's `orientation`, `odometry` and `navsat` where there is something to copy.

    `navsat` needs a log with a known origin, and pyproj; without pyproj it is left out.

    Raises:
        LogError: the origin's projection is unknown.
    """
    yield _mission(log)
    for vehicle, namespace in enumerate(namespaces(log.vehicles)):
        for kind, encode in (("heading", _orientation), ("odometry", _odometry)):
            if (table := _of_vehicle(log, kind, vehicle)) is not None:
                yield encode(table, namespace)
        fixes = _of_vehicle(log, "fix", vehicle)
        if fixes is not None and log.origin.latitude_deg is not None and log.origin.longitude_deg is not None:
            geographic = _geographic(log, fixes)
            if geographic is not None:
                yield _navsat(fixes, geographic, namespace)


def set_yaw(records: Records, path: str, yaw_rad: NDArray[np.float64]) -> None:
    """Write a turn about the vertical as the quaternion at `path`."""
    records[f"{path}.z"] = np.sin(yaw_rad / 2)
    records[f"{path}.w"] = np.cos(yaw_rad / 2)


def set_body_twist(
    records: Records, t_ns: NDArray[np.int64], yaw_rad: NDArray[np.float64], position_m: NDArray[np.float64]
) -> None:
    """Write the mean velocity from each pose to the next into an Odometry's twist, in the body frame.

    Args:
        yaw_rad, position_m: (N,) and (N, 3) east, north, up; the last pose repeats the velocity before it.
    """
    if t_ns.size < 2:
        return
    seconds = np.diff(t_ns) / 1e9
    seconds[seconds == 0] = np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        east, north, up = (np.diff(position_m, axis=0) / seconds[:, None]).T
        turn = np.diff(yaw_rad)
        rate = (turn - 2 * np.pi * np.round(turn / (2 * np.pi))) / seconds
        cosine, sine = np.cos(yaw_rad[:-1]), np.sin(yaw_rad[:-1])
        forward, left = cosine * east + sine * north, cosine * north - sine * east
    for path, values in (("linear.x", forward), ("linear.y", left), ("linear.z", up), ("angular.z", rate)):
        records[f"twist.twist.{path}"] = np.append(values, values[-1])


def _mission(log: MissionLog) -> Stream:
    store = typestore()
    time = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    msgtype = "uwcoop_msgs/msg/Mission"
    message = store.types[msgtype](
        header=store.types["std_msgs/msg/Header"](stamp=time, frame_id="map"),
        name=log.name,
        vehicles=list(log.vehicles),
        namespaces=list(namespaces(log.vehicles)),
    )
    content = bytes(store.serialize_cdr(message, msgtype, little_endian=True))
    return Stream(MISSION_TOPIC, msgtype, np.zeros(1, dtype=np.int64), [content])


def _of_vehicle(log: MissionLog, kind: str, vehicle: int) -> Columns | None:
    """The vehicle's rows of an event table, None when there are none."""
    table = log.events.get(kind)
    if table is None:
        return None
    rows = np.flatnonzero(table["vehicle"] == vehicle)
    return {name: column[rows] for name, column in table.items()} if rows.size else None


def _orientation(table: Columns, namespace: str) -> Stream:
    records = layout(_IMU, {"header.frame_id": frame_id("base_link", namespace)}).blank(len(table["t_ns"]))
    set_stamps(records, table["t_ns"])
    set_yaw(records, "orientation", table["yaw_rad"])
    with np.errstate(over="ignore", under="ignore"):
        records["orientation_covariance"][:, 8] = table["sigma_rad"] ** 2
    records["angular_velocity_covariance"][:, 0] = -1.0
    records["linear_acceleration_covariance"][:, 0] = -1.0
    return Stream(f"/{namespace}/orientation", _IMU, table["t_ns"], split(records))


def _odometry(table: Columns, namespace: str) -> Stream:
    """Increments summed up from zero in the vehicle's `odom` frame; covariances stay zero: not computed."""
    shape = layout(
        ODOMETRY,
        {
            "header.frame_id": frame_id("odom", namespace),
            "child_frame_id": frame_id("base_link", namespace),
        },
    )
    records = shape.blank(len(table["t_ns"]))
    set_stamps(records, table["t_ns"])
    with np.errstate(over="ignore", invalid="ignore"):
        yaw = np.cumsum(table["yaw_change_rad"])
        before = yaw - table["yaw_change_rad"]
        cosine, sine = np.cos(before), np.sin(before)
        forward, left = table["forward_m"], table["left_m"]
        east = np.cumsum(cosine * forward - sine * left)
        north = np.cumsum(sine * forward + cosine * left)
        records["pose.pose.position.x"], records["pose.pose.position.y"] = east, north
        set_yaw(records, "pose.pose.orientation", yaw)
    set_body_twist(records, table["t_ns"], yaw, np.column_stack([east, north, np.zeros_like(east)]))
    return Stream(f"/{namespace}/odometry", ODOMETRY, table["t_ns"], split(records))


def _geographic(log: MissionLog, fixes: Columns) -> NDArray[np.float64] | None:
    """Latitude and longitude of the fixes, (N, 2) degrees; None when pyproj is not installed."""
    from uwcoop.frames import LocalFrame

    try:
        return LocalFrame(log.origin).to_geographic(np.column_stack([fixes["e_m"], fixes["n_m"]]))
    except MissingDependencyError:
        return None
    except ChartError as error:
        raise LogError(f"origin of the log: {error}") from error


def _navsat(table: Columns, geographic: NDArray[np.float64], namespace: str) -> Stream:
    shape = layout(_NAV_SAT_FIX, {"header.frame_id": frame_id("base_link", namespace)})
    records = shape.blank(len(table["t_ns"]))
    set_stamps(records, table["t_ns"])
    records["status.service"] = 1  # GPS
    records["latitude"], records["longitude"] = geographic.T
    records["altitude"] = np.nan  # as the type says it: unknown
    covariance = records["position_covariance"]
    covariance[:, 0], covariance[:, 4] = table["cov_ee_m2"], table["cov_nn_m2"]
    covariance[:, 1] = covariance[:, 3] = table["cov_en_m2"]
    records["position_covariance_type"] = 3  # known
    return Stream(f"/{namespace}/navsat", _NAV_SAT_FIX, table["t_ns"], split(records))
