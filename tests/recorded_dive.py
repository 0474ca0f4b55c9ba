"""A made-up dive of two vehicles, as channels and as files of the formats that recorders write."""

from __future__ import annotations

import csv
import struct
from pathlib import Path
from typing import Any

import numpy as np

from uwcoop.importers.channels import Channel, SourceFile

LAT0, LON0, T0 = 41.9, -70.5, 1_760_000_000
M_LAT, M_LON = 111_132.0, 111_320 * np.cos(np.deg2rad(LAT0))
SECONDS = 90
VEHICLES = ("alpha", "bravo")

Array = np.ndarray[Any, Any]


def channel(name: str, kind: str, seconds: Array, received: Array | None = None, **columns: Any) -> Channel:
    """A channel with stamps in seconds after T0; `__` in a column's name stands for a dot, `_0_` at its end for [0]."""
    values = {label.replace("__", "."): np.asarray(v) for label, v in columns.items()}
    t_ns = T0 * 10**9 + np.round(np.asarray(seconds) * 1e9).astype(np.int64)
    got = None if received is None else T0 * 10**9 + np.round(np.asarray(received) * 1e9).astype(np.int64)
    return Channel("dive", name, kind, t_ns, values, received_ns=got)


def source(*channels: Channel) -> SourceFile:
    return SourceFile("dive", "made up", channels)


def yaw_quaternion(yaw: Array, roll: float = 0.0, pitch: float = 0.0) -> dict[str, Array]:
    """Columns of an orientation: yaw, then pitch, then roll about the turned axes."""
    cy, sy, cp, sp, cr, sr = (f(v / 2) for v in (yaw, pitch, roll) for f in (np.cos, np.sin))
    return {
        "orientation.x": sr * cp * cy - cr * sp * sy, "orientation.y": cr * sp * cy + sr * cp * sy,
        "orientation.z": cr * cp * sy - sr * sp * cy, "orientation.w": cr * cp * cy + sr * sp * sy,
    }  # fmt: skip


def swim(index: int) -> dict[str, Array]:
    """East, north, depth, yaw from east, forward speed and altitude at whole seconds."""
    t = np.arange(SECONDS + 1.0)
    east, north = 20 + 1.3 * t, 30 + 50 * index + 15 * np.sin(t / 30 + index)
    de, dn = np.gradient(east), np.gradient(north)
    return {
        "t": t, "east": east, "north": north, "depth": 4 + 0.5 * np.sin(t / 20), "yaw": np.arctan2(dn, de),
        "forward": np.hypot(de, dn), "altitude": 12 + np.sin(east / 30),
    }  # fmt: skip


def degrees_of(own: dict[str, Array]) -> tuple[Array, Array]:
    return LAT0 + own["north"] / M_LAT, LON0 + own["east"] / M_LON


def distance_m(a: int, b: int, k: int) -> float:
    one, two = swim(a), swim(b)
    return float(np.linalg.norm([one[q][k] - two[q][k] for q in ("east", "north", "depth")]))


def messages(store: Any, ros1: bool) -> list[tuple[int, str, str, Any]]:
    """(time, topic, type, message) of both vehicles, in the order of time."""
    kinds = store.types
    rows: list[tuple[int, str, str, Any]] = []

    def put(t: float, topic: str, kind: str, **fields: Any) -> None:
        ns = round((T0 + t) * 1e9)
        stamp = kinds["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        head = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=topic, **({"seq": 0} if ros1 else {}))
        rows.append((ns, topic, kind, kinds[kind](header=head, **fields)))

    vector = kinds["geometry_msgs/msg/Vector3"]
    nothing = vector(x=0.0, y=0.0, z=0.0)
    for index, name in enumerate(VEHICLES):
        own = swim(index)
        latitude, longitude = degrees_of(own)
        for k, t in enumerate(own["t"]):
            if k % 30 == 0:
                put(
                    t, f"/{name}/gps", "sensor_msgs/msg/NavSatFix",
                    status=kinds["sensor_msgs/msg/NavSatStatus"](status=0, service=1), latitude=latitude[k],
                    longitude=longitude[k], altitude=0.0, position_covariance=np.diag([4.0, 4.0, 25.0]).ravel(),
                    position_covariance_type=2,
                )  # fmt: skip
            turned = {label[-1]: float(v) for label, v in yaw_quaternion(own["yaw"][k]).items()}
            put(
                t, f"/{name}/imu", "sensor_msgs/msg/Imu", orientation=kinds["geometry_msgs/msg/Quaternion"](**turned),
                orientation_covariance=np.diag([1e-4] * 3).ravel(), angular_velocity=nothing,
                angular_velocity_covariance=np.diag([1e-6] * 3).ravel(), linear_acceleration=nothing,
                linear_acceleration_covariance=np.zeros(9),
            )  # fmt: skip
            covariance = np.zeros(36)
            covariance[[0, 7, 14]] = 4e-4
            twist = kinds["geometry_msgs/msg/Twist"](
                vector(x=float(own["forward"][k]), y=0.0, z=0.0), nothing
            )
            put(
                t, f"/{name}/dvl", "geometry_msgs/msg/TwistWithCovarianceStamped",
                twist=kinds["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=covariance),
            )  # fmt: skip
            span = {"radiation_type": 0, "field_of_view": 0.2, **({} if ros1 else {"variance": 0.0})}
            put(
                t, f"/{name}/altimeter", "sensor_msgs/msg/Range", min_range=0.3, max_range=50.0,
                range=float(own["altitude"][k]), **span,
            )  # fmt: skip
            put(
                t, f"/{name}/pressure", "sensor_msgs/msg/FluidPressure",
                fluid_pressure=101325 + 1025 * 9.80665 * float(own["depth"][k]), variance=0.0,
            )  # fmt: skip
            if k and k % 10 == 5 * index:
                away = distance_m(0, 1, k)
                put(
                    t,
                    f"/{name}/modem/range",
                    "sensor_msgs/msg/Range",
                    min_range=0.0,
                    max_range=3e3,
                    range=away,
                    **span,
                )
    return sorted(rows, key=lambda row: (row[0], row[1]))


def write_bags(folder: Path, kinds: tuple[str, ...] = ("mcap", "sqlite3", "ros1")) -> dict[str, Path]:
    """The dive as ROS bags."""
    from rosbags.rosbag1 import Writer as Ros1Writer
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Ros2Writer
    from rosbags.typesys import Stores, get_typestore

    made = {}
    for kind in kinds:
        ros1 = kind == "ros1"
        store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
        made[kind] = folder / (f"dive-{kind}" + (".bag" if ros1 else ""))
        plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}.get(kind)
        writer: Any = (
            Ros1Writer(made[kind]) if ros1 else Ros2Writer(made[kind], version=9, storage_plugin=plugin)
        )
        serialize: Any = store.serialize_ros1 if ros1 else store.serialize_cdr
        with writer:
            connections: dict[str, Any] = {}
            for ns, topic, msgtype, message in messages(store, ros1):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
                writer.write(connections[topic], ns, serialize(message, msgtype))
    return made


def write_tables(folder: Path, order: int = 0) -> list[Path]:
    """The dive as text tables: one of each vehicle and one of ranges; `order` permutes the columns."""
    paths = []
    for index, name in enumerate(VEHICLES):
        own = swim(index)
        latitude, longitude = degrees_of(own)
        rows = [
            {
                "time": f"{T0 + t:.1f}", "gps_lat": f"{latitude[k]:.8f}" if k % 30 == 0 else "",
                "gps_lon": f"{longitude[k]:.8f}" if k % 30 == 0 else "", "depth": f"{own['depth'][k]:.4f}",
                "altitude": f"{own['altitude'][k]:.4f}", "heading_deg": f"{(90 - np.rad2deg(own['yaw'][k])) % 360:.4f}",
                "vel_fwd": f"{own['forward'][k]:.5f}", "vel_left": "0",
            }
            for k, t in enumerate(own["t"])
        ]  # fmt: skip
        labels = list(rows[0])
        labels = (
            [labels[k] for k in np.random.default_rng(order).permutation(len(labels))] if order else labels
        )
        paths.append(folder / f"{name}.csv")
        with paths[-1].open("w", newline="") as file:
            writer = csv.DictWriter(file, labels)
            writer.writeheader()
            writer.writerows(rows)
    paths.append(folder / "ranges.csv")
    with paths[-1].open("w", newline="") as file:
        writer_ = csv.writer(file)
        writer_.writerow(["time", "from", "to", "range_m", "kind"])
        for index, name in enumerate(VEHICLES):
            for k in range(5 * index or 10, SECONDS + 1, 10):
                writer_.writerow([T0 + k, name, VEHICLES[1 - index], f"{distance_m(0, 1, k):.5f}", "two-way"])
    return paths


def write_tlog(path: Path) -> Path:
    """The first vehicle as ArduSub's telemetry, by pymavlink."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    mav, own = dialect.MAVLink(None, srcSystem=1, srcComponent=1), swim(0)
    latitude, longitude = degrees_of(own)
    with path.open("wb") as file:
        for k, t in enumerate(own["t"]):
            ms, heading = int(t * 1000), float(np.pi / 2 - own["yaw"][k])
            sent = [
                dialect.MAVLink_attitude_message(ms, 0.0, 0.05, heading, 0.0, 0.0, 0.01),
                dialect.MAVLink_scaled_pressure2_message(
                    ms, 1013.25 + 10.25 * 9.80665 * float(own["depth"][k]), 0.0, 900
                ),
                dialect.MAVLink_distance_sensor_message(
                    ms, 30, 5000, int(100 * own["altitude"][k]), 2, 1, 25, 0
                ),
            ]
            if k % 30 == 0:
                place = int(latitude[k] * 1e7), int(longitude[k] * 1e7)
                sent.append(dialect.MAVLink_gps_raw_int_message(ms * 1000, 3, *place, 0, 100, 100, 0, 0, 10))
            for message in sent:
                file.write(struct.pack(">Q", int((T0 + t) * 1e6)) + message.pack(mav))
    return path


def write_dataflash(path: Path) -> Path:
    """The first vehicle as ArduSub's own log: records packed by pymavlink from their formats."""
    from pymavlink import DFReader

    formats = {
        number: DFReader.DFFormat(number, name, 0, form, columns)
        for number, name, form, columns in (
            (0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
            (1, "GPS", "QBIHLL", "TimeUS,Status,GMS,GWk,Lat,Lng"),
            (2, "ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw"),
            (3, "RFND", "Qf", "TimeUS,Dist"),
        )
    }
    own = swim(0)
    latitude, longitude = degrees_of(own)
    week, into_ms = divmod((T0 - 315_964_800 + 18) * 1000, 604_800_000)
    content = bytearray()

    def put(number: int, *values: Any) -> None:
        packed = struct.pack("<" + formats[number].msg_struct.lstrip("<"), *values)
        content.extend(b"\xa3\x95" + bytes([number]) + packed)

    for number, form in formats.items():
        length = struct.calcsize("<" + form.msg_struct.lstrip("<")) + 3
        put(0x80, number, length, form.name.encode(), form.format.encode(), ",".join(form.columns).encode())
    for k, t in enumerate(own["t"]):
        micros = 5_000_000 + int(t * 1e6)
        if k % 30 == 0:
            put(
                1,
                micros,
                3,
                into_ms + int(t * 1000),
                week,
                round(latitude[k] * 1e7),
                round(longitude[k] * 1e7),
            )
        put(2, micros, 0, 0, round(100 * ((90 - np.rad2deg(own["yaw"][k])) % 360)))
        put(3, micros, float(own["altitude"][k]))
    path.write_bytes(bytes(content))
    return path


def write_alog(path: Path) -> Path:
    """The first vehicle as MOOS logs it."""
    own = swim(0)
    latitude, longitude = degrees_of(own)
    lines = [
        "%" * 40,
        f"%% LOG FILE:   {path}",
        "%% FILE OPENED ON  Thu Oct  9 08:53:20 2025",
        f"%% LOGSTART   {T0}.0",
        "%" * 40,
    ]
    for k, t in enumerate(own["t"]):
        heading = (90 - np.rad2deg(own["yaw"][k])) % 360
        told = {
            "NAV_HEADING": heading,
            "NAV_DEPTH": own["depth"][k],
            "NAV_SPEED": own["forward"][k],
            "NAV_ALTITUDE": own["altitude"][k],
        }
        lines += [f"{t:<15.5f} {name:<20} {'pNav':<15} {value:.6f}" for name, value in told.items()]
        if k % 30 == 0:
            lines += [f"{t + 0.001:<15.5f} {'GPS_LATITUDE':<20} {'iGPS':<15} {latitude[k]:.8f}"]
            lines += [f"{t + 0.002:<15.5f} {'GPS_LONGITUDE':<20} {'iGPS':<15} {longitude[k]:.8f}"]
        lines += [f"{t + 0.003:<15.5f} {'DB_UPTIME':<20} {'MOOSDB_alpha':<15} {t}"]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_lsf(path: Path) -> Path:
    """The first vehicle as DUNE logs it, by imcpy."""
    import imcpy

    own = swim(0)
    latitude, longitude = degrees_of(own)
    with path.open("wb") as file:
        for k, t in enumerate(own["t"]):
            made = [imcpy.EulerAngles(), imcpy.Depth(), imcpy.GroundVelocity()]
            made[0].phi, made[0].theta, made[0].psi = 0.0, 0.05, float(np.pi / 2 - own["yaw"][k])
            made[1].value = float(own["depth"][k])
            made[2].x, made[2].y, made[2].z = float(own["forward"][k]), 0.0, 0.0
            made[2].validity = 7
            if k % 30 == 0:
                fix = imcpy.GpsFix()
                fix.lat, fix.lon = float(np.deg2rad(latitude[k])), float(np.deg2rad(longitude[k]))
                fix.hacc, fix.validity = 2.0, 0xFFFF
                made.append(fix)
            for message in made:
                message.src, message.src_ent, message.timestamp = 30, 1, float(T0 + t)
                file.write(bytes(imcpy.Packet.serialize(message)))
    return path
