"""What other tools make of a mission log on disk: rosbags, Rerun, and any reader of the definitions in it."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.records import Channel, Header, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sample_log import rewrite, sample_log
from uwcoop.errors import LogError, MissingDependencyError
from uwcoop.frames import Origin
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.missionlog.messages import DEFINITIONS, layout, typestore
from uwcoop.missionlog.topics import EVENT_TOPICS

S = 1_000_000_000


@pytest.fixture(scope="module")
def log() -> MissionLog:
    return sample_log(seconds=12)


@pytest.fixture(scope="module")
def content(log: MissionLog, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("mcap") / "mission.mcap"
    write_log(log, path)
    return path.read_bytes()


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("use_chunking", [True, False])
def test_a_log_that_another_tool_rewrote_is_the_same(
    compression: CompressionType, use_chunking: bool, log: MissionLog, content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(rewrite(content, compression=compression, use_chunking=use_chunking))
    assert log.difference(load_log(path)) is None


def _decoded(content: bytes) -> Iterator[tuple[Channel, Message, Any]]:
    """Every message, decoded as foreign tooling would: from the definitions in the file alone."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    store = get_typestore(Stores.EMPTY)
    for record in StreamReader(io.BytesIO(content), validate_crcs=True).records:
        if isinstance(record, Header):
            assert record.profile == "ros2"
        elif isinstance(record, Schema) and record.id not in schemas:
            assert record.encoding == "ros2msg"
            schemas[record.id] = record
            store.register(get_types_from_msg(record.data.decode(), record.name))
        elif isinstance(record, Channel):
            assert record.message_encoding == "cdr"
            assert record.metadata["topic_type_hash"] == store.hash_rihs01(schemas[record.schema_id].name)
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            yield channel, record, store.deserialize_cdr(record.data, schemas[channel.schema_id].name)


def test_every_message_decodes_from_the_embedded_definitions_alone(log: MissionLog, content: bytes) -> None:
    topics: dict[str, list[Any]] = {}
    last = 0
    for channel, record, message in _decoded(content):
        header = message if message.__msgtype__ == "std_msgs/msg/Header" else message.header
        assert record.log_time == header.stamp.sec * S + header.stamp.nanosec
        assert record.log_time >= last
        last = record.log_time
        topics.setdefault(channel.topic, []).append(message)
    assert len(topics) == 3 * (len(EVENT_TOPICS) + 3 + 3) + 4
    mine = {name: table["vehicle"] == 1 for name, table in log.events.items()}

    def column(kind: str, name: str) -> list[float]:
        return list(log.events[kind][name][mine[kind]])

    assert [m.twist.linear.x for m in topics["/V2/commanded_velocity"]] == column("motion", "velocity_e_mps")
    assert [-m.pose.pose.position.z for m in topics["/V2/depth"]] == column("depth", "depth_m")
    assert [m.pose.covariance[14] ** 0.5 for m in topics["/V2/depth"]] == column("depth", "sigma_m")
    assert [m.angular_velocity.z for m in topics["/V2/turn_rate"]] == column("turn_rate", "yaw_rate_radps")
    assert [m.pose.covariance[6] for m in topics["/V2/fix"]] == column("fix", "cov_en_m2")
    assert [m.covariance[3] for m in topics["/V2/odometry_increment"]] == column("odometry", "cov_fl")
    assert [m.landmark for m in topics["/V2/role_taken"]] == column("role_taken", "landmark")
    assert topics["/V2/ground_velocity"][0].header.frame_id == "V2/base_link"
    draws = [list(m.draws) for m in topics["/acoustics/opportunity"]]
    assert draws == log.opportunities["draws"].tolist()
    assert [bytes(m.payload) for m in topics["/acoustics/reception"]] == log.payloads
    assert topics["/mission"][0].vehicles == ["V1", "V2", "V3"]


def test_copies_for_other_tools_say_what_the_log_says(log: MissionLog, content: bytes) -> None:
    topics: dict[str, list[Any]] = {}
    for channel, _, message in _decoded(content):
        topics.setdefault(channel.topic, []).append(message)
    yaw = log.events["heading"]["yaw_rad"][::3]
    turn = [2 * np.arctan2(m.orientation.z, m.orientation.w) for m in topics["/V1/orientation"]]
    assert np.allclose(np.exp(1j * np.array(turn)), np.exp(1j * yaw), atol=1e-12)
    steps = {name: column[::3] for name, column in log.events["odometry"].items()}
    pose, angle = 0j, 0.0
    for m, forward, left, change in zip(
        topics["/V1/odometry"], steps["forward_m"], steps["left_m"], steps["yaw_change_rad"], strict=True
    ):
        pose += np.exp(1j * angle) * (forward + 1j * left)
        angle += change
        assert m.pose.pose.position.x == pytest.approx(pose.real, abs=1e-9)
        assert m.pose.pose.position.y == pytest.approx(pose.imag, abs=1e-9)
    assert log.truth is not None
    truth = log.truth.isel(vehicle=0)
    first = topics["/truth/V1/odometry"][0].twist.twist.linear
    step = np.diff(truth["position_m"].to_numpy(), axis=0)[0]
    angle = float(truth["yaw_rad"][0])
    assert first.x + 1j * first.y == pytest.approx((step[0] + 1j * step[1]) * np.exp(-1j * angle))


def test_fixes_are_copied_as_geographic_positions(log: MissionLog, content: bytes) -> None:
    pytest.importorskip("pyproj")
    from uwcoop.frames import LocalFrame

    fixes = [message for channel, _, message in _decoded(content) if channel.topic == "/V1/navsat"]
    local = LocalFrame(log.origin).to_local([m.latitude for m in fixes], [m.longitude for m in fixes])
    expected = np.column_stack([log.events["fix"]["e_m"][::3], log.events["fix"]["n_m"][::3]])
    assert np.allclose(local, expected, atol=1e-6)


def test_a_log_is_written_without_pyproj_too(
    log: MissionLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(_: object) -> None:
        raise MissingDependencyError("pyproj", "maps")

    monkeypatch.setattr("uwcoop.frames.crs_of", absent)
    write_log(log, tmp_path / "log.mcap")
    topics = {channel.topic for channel, _, _ in _decoded((tmp_path / "log.mcap").read_bytes())}
    assert "/V1/fix" in topics
    assert "/V1/navsat" not in topics
    assert log.difference(load_log(tmp_path / "log.mcap")) is None


def test_an_origin_of_unknown_projection_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    log = sample_log(seconds=4)
    log.origin = Origin(1.0, 103.0, "EPSG:nonsense")
    with pytest.raises(LogError, match="origin of the log: projection 'EPSG:nonsense' is unknown"):
        write_log(log, tmp_path / "log.mcap")


def test_rosbags_reads_the_file_as_a_bag(log: MissionLog, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mission.mcap"
    path.write_bytes(content)
    with AnyReader([path]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        times = [time for _, time, _ in reader.messages()]
        (connection,) = [c for c in reader.connections if c.topic == "/truth/V3/odometry"]
        poses = [reader.deserialize(raw, connection.msgtype) for _, _, raw in reader.messages([connection])]
    assert counts["/V1/depth"] == 12
    assert times == sorted(times)
    assert log.truth is not None
    position = log.truth["position_m"].to_numpy()[2]
    assert [[m.pose.pose.position.x, m.pose.pose.position.y] for m in poses] == position.tolist()


def test_rerun_decodes_every_topic(log: MissionLog, content: bytes, tmp_path: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk", reason="needs the rerun-sdk of the viz extra")
    path = tmp_path / "mission.mcap"
    path.write_bytes(content)
    rows: dict[str, int] = {}
    depths: list[float] = []
    for piece in chunk.McapReader(path).stream():
        if not piece.is_static:
            rows[piece.entity_path] = rows.get(piece.entity_path, 0) + piece.num_rows
        if piece.entity_path == "/V2/depth" and not piece.is_static:
            batch = piece.to_record_batch()
            name = next(n for n in batch.schema.names if n.endswith("PoseWithCovarianceStamped:message"))
            depths += [-m[0]["pose"]["pose"]["position"]["z"] for m in batch.column(name).to_pylist()]
    topics = {channel.topic for channel, _, _ in _decoded(content)}
    assert topics <= rows.keys()
    assert depths == log.events["depth"]["depth_m"][1::3].tolist()


# Mission holds a sequence of strings, which has no fixed layout: rosbags itself serialises it.
_LAID_OUT = {f"uwcoop_msgs/msg/{name}" for name in DEFINITIONS if name != "Mission"}
_LAID_OUT |= {topic.msgtype for topic in EVENT_TOPICS.values()}
_LAID_OUT |= {"nav_msgs/msg/Odometry", "sensor_msgs/msg/NavSatFix"}


@pytest.mark.parametrize("msgtype", sorted(_LAID_OUT))
def test_layouts_are_what_ros_serialises(msgtype: str) -> None:
    """A record with a value in every field is the byte string that rosbags makes of the same message."""
    store = typestore()
    rng = np.random.default_rng(1)
    filler = {
        "string": lambda: "abcde"[: rng.integers(1, 5)], "bool": lambda: True,
        "float64": lambda: float(rng.normal()),
        "int32": lambda: int(rng.integers(-9, 9)), "uint32": lambda: int(rng.integers(9)),
        "int8": lambda: int(rng.integers(-9, 9)), "uint16": lambda: int(rng.integers(9)),
        "int64": lambda: int(rng.integers(-(2**60), 2**60)), "uint8": lambda: int(rng.integers(256)),
    }  # fmt: skip
    strings: dict[str, str] = {}
    counts: dict[str, int] = {}
    values: dict[str, Any] = {}

    def build(kind: str, prefix: str) -> Any:
        made: dict[str, Any] = {}
        for field, (node, detail) in store.fielddefs[kind][1]:
            path = prefix + field
            if node == Nodetype.NAME:
                made[field] = build(str(detail), path + ".")
                continue
            if node == Nodetype.BASE:
                value = filler[detail[0]]()
                (strings if isinstance(value, str) else values)[path] = value
            else:
                (_, (element, _)), length = detail
                if node == Nodetype.SEQUENCE:
                    length = counts[path] = 5
                value = values[path] = np.array(
                    [filler[element]() for _ in range(length)],
                    dtype=element,
                )
            made[field] = value
        return store.types[kind](**made)

    message = build(msgtype, "")
    shape = layout(msgtype, strings, counts)
    record = shape.blank(1)
    for path, value in values.items():
        record[path] = value
    assert record.tobytes() == bytes(store.serialize_cdr(message, msgtype, little_endian=True))
    assert shape.read([record.tobytes()]).tobytes() == record.tobytes()


def test_a_simulated_mission_comes_back_bit_for_bit(tmp_path: Path) -> None:
    simulation = pytest.importorskip("uwcoop.world.simulate")
    from uwcoop import scenario

    log = simulation.simulate(scenario.load("poor-bay", ["duration_s=120"]), seed=4)
    write_log(log, tmp_path / "log.mcap")
    back = load_log(tmp_path / "log.mcap")
    assert log.difference(back) is None
    assert log.truth.identical(back.truth)
    assert back.chart == log.chart
