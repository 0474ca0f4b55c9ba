"""A ROS 2 bag becomes a mission. This bag is made by code; the import says what it read, converted and assumed."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import uwcoop
from uwcoop.figures.map import map_figure
from uwcoop.importers.recordings import import_recordings

STORE = get_typestore(Stores.ROS2_JAZZY)
ROS: Any = {name.rsplit("/", 1)[1]: kind for name, kind in STORE.types.items()}
START_S, SECONDS, DEPTH_M, COVARIANCE = 1_760_000_000, 400, 2.0, np.diag([4e-4] * 6).ravel()


def seabed_m(east: Any, north: Any) -> Any:
    return 15 + 2 * np.sin(east / 19 + north / 50) + 1.5 * np.cos(north / 17) + np.sin(east / 31 - north / 23)


def messages(t: int, turned_rad: float, altitude_m: float) -> dict[str, Any]:
    """One second of compass (3 degrees off), Doppler log (1 cm/s too fast), altimeter, and GPS before the dive."""
    head, still = ROS["Header"](ROS["Time"](START_S + t, 0), "alpha"), ROS["Vector3"](0.0, 0.0, 0.0)
    facing = ROS["Quaternion"](0.0, 0.0, np.sin(turned_rad / 2), np.cos(turned_rad / 2))
    moving = ROS["TwistWithCovariance"](ROS["Twist"](ROS["Vector3"](1.51, 0.0, 0.0), still), COVARIANCE)
    known, unknown = np.diag([2.5e-3] * 3).ravel(), np.zeros(9)
    sent = {
        "imu": ROS["Imu"](head, facing, known, still, unknown, still, unknown),
        "dvl": ROS["TwistWithCovarianceStamped"](head, moving),
        "altimeter": ROS["Range"](head, 0, 0.2, 0.3, 50.0, altitude_m, 0.0),
        "pressure": ROS["FluidPressure"](head, 101_325 + 1025 * 9.80665 * DEPTH_M, 0.0),
    }
    if t == 0:
        place = 41.9, -70.5, 0.0, np.diag([9.0] * 3).ravel(), 2
        sent["gps"] = ROS["NavSatFix"](head, ROS["NavSatStatus"](0, 1), *place)
    return sent


def write_bag(path: Path) -> tuple[float, float]:
    """Write it, and give where the vehicle really ends."""
    rng, place = np.random.default_rng(2), np.zeros(2)
    topics: dict[str, Any] = {}
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for t in range(SECONDS):
            yaw_rad, water_m = 0.9 * np.sin(t / 60), seabed_m(*place) + 0.05 * rng.standard_normal()
            for name, message in messages(t, yaw_rad + np.deg2rad(3), water_m - DEPTH_M).items():
                if name not in topics:
                    topics[name] = bag.add_connection(f"/alpha/{name}", message.__msgtype__, typestore=STORE)
                bag.write(
                    topics[name], (START_S + t) * 10**9, STORE.serialize_cdr(message, message.__msgtype__)
                )
            end, place = place, place + 1.5 * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    return float(end[0]), float(end[1])


def main(folder: Path) -> None:
    truth = write_bag(folder / "dive")
    log = import_recordings([folder / "dive"], overrides={"origin_deg": [41.9, -70.5]})
    print(*log.notes, sep="\n")
    north, east = np.mgrid[-100:300:4.0, -100:700:4.0]
    chart = uwcoop.Chart(
        seabed_m(east, north), -100.0, -100.0, 4.0, sigma_map_m=0.1, correlation_length_m=10.0
    )
    result = uwcoop.run(log, ["dead-reckoning", "mpf-terrain-only"], chart=chart)
    for name in result.summary["navigators"]:
        end = result.tracks.position_m.sel(navigator=name, vehicle="alpha").isel(time=-1).values
        print(f"{name:17} ends {np.hypot(*(end - truth)):4.1f} m from where the vehicle is")
    map_figure(result.tracks, chart, log.events["fix"]).savefig(folder / "imported_bag.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
