"""A mission log on disk is whole and what it claims to be, or refused in one line."""

from __future__ import annotations

import io
import random
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from sample_log import rewrite, sample_chart, sample_log
from uwcoop.errors import LogError
from uwcoop.missionlog import (
    MissionLog,
)
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.missionlog.messages import layout
from uwcoop.missionlog.topics import EVENT_TOPICS


@pytest.fixture(scope="module")
def log() -> MissionLog:
    return sample_log(seconds=12)


@pytest.fixture(scope="module")
def content(log: MissionLog, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("mcap") / "mission.mcap"
    write_log(log, path)
    return path.read_bytes()


def refusal(path: Path, content: bytes) -> str:
    """The one line with which these bytes are refused."""
    path.write_bytes(content)
    with pytest.raises(LogError) as error:
        load_log(path)
    line = str(error.value)
    assert line.startswith(f"log {path}: ")
    assert "\n" not in line
    return line.removeprefix(f"log {path}: ")


def of_topic(records: list[McapRecord], topic: str) -> list[Message]:
    (channel,) = {r.id for r in records if isinstance(r, Channel) and r.topic == topic}
    return [record for record in records if isinstance(record, Message) and record.channel_id == channel]


def test_a_log_cut_off_anywhere_is_refused(content: bytes, tmp_path: Path) -> None:
    rng = random.Random(3)
    lengths = [1, 7, 8, 9, 40, len(content) - 1, len(content) - 8, len(content) - 37]
    for length in lengths + [rng.randrange(1, len(content)) for _ in range(30)]:
        line = refusal(tmp_path / "cut.mcap", content[:length])
        assert line.startswith(f"cut off: {length} bytes")
    assert refusal(tmp_path / "cut.mcap", b"") == "empty file"


def test_a_changed_byte_anywhere_is_refused(content: bytes, tmp_path: Path) -> None:
    rng = random.Random(4)
    for at in [8, 20, len(content) - 9, len(content) - 30] + [rng.randrange(len(content)) for _ in range(60)]:
        changed = bytearray(content)
        changed[at] ^= 1 << rng.randrange(8)
        line = refusal(tmp_path / "changed.mcap", bytes(changed))
        assert line.startswith(("damaged: ", "not an MCAP file", "cut off: ")), line


@pytest.mark.parametrize("compression", list(CompressionType))
def test_changed_bytes_in_a_file_without_crcs_never_leak_another_error(
    compression: CompressionType, content: bytes, tmp_path: Path
) -> None:
    bare = rewrite(content, compression=compression)
    rng = random.Random(5)
    refused, lines = 0, list[str]()
    for _ in range(80):
        changed = bytearray(bare)
        for _ in range(rng.choice([1, 4, 20])):
            changed[rng.randrange(8, len(bare) - 8)] = rng.randrange(256)
        (tmp_path / "changed.mcap").write_bytes(changed)
        try:
            load_log(tmp_path / "changed.mcap")
        except LogError as error:
            lines += str(error).splitlines()
            refused += 1
    assert refused == len(lines) > 20


def test_a_file_of_another_kind_is_refused(content: bytes, tmp_path: Path) -> None:
    assert refusal(tmp_path / "a.mcap", b"PK\x03\x04 something else entirely") == "not an MCAP file"
    out = io.BytesIO()
    writer = Writer(out)
    writer.start("ros2", "a recorder")
    writer.finish()  # type: ignore[no-untyped-call]
    assert "without uwcoop's metadata (library 'a recorder')" in refusal(tmp_path / "a.mcap", out.getvalue())
    with pytest.raises(LogError, match="cannot be read: No such file"):
        load_log(tmp_path / "absent.mcap")
    with pytest.raises(LogError, match="cannot be read: Is a directory"):
        load_log(tmp_path)


def test_a_failed_write_leaves_nothing_behind(
    log: MissionLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "log.mcap"
    target.write_bytes(b"what was there")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Writer, "finish", full)
        with pytest.raises(LogError, match="cannot be written: No space left on device"):
            write_log(log, target)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"what was there"]
    with pytest.raises(LogError, match="cannot be written: there is no such folder"):
        write_log(log, tmp_path / "absent" / "log.mcap")
    with pytest.raises(LogError, match="cannot be written: is a folder, the output must be a file"):
        write_log(log, tmp_path)


def test_another_missions_chart_is_refused(log: MissionLog, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    assert log.chart is not None
    assert load_log(path, chart=sample_chart()).chart == log.chart
    other = sample_chart(seed=8)
    with pytest.raises(LogError) as error:
        load_log(path, chart=other)
    assert log.chart.sha256 in str(error.value)
    assert other.sha256 in str(error.value)


def test_an_attached_chart_that_is_not_the_missions_is_refused(content: bytes, tmp_path: Path) -> None:
    def swap(records: list[McapRecord]) -> list[McapRecord]:
        for record in records:
            if isinstance(record, Attachment):
                record.data = sample_chart(seed=8).to_bytes()
        return records

    def remove(records: list[McapRecord]) -> list[McapRecord]:
        return [record for record in records if not isinstance(record, Attachment)]

    line = refusal(tmp_path / "log.mcap", rewrite(content, swap))
    assert (
        line
        == f"attached chart has SHA-256 {sample_chart(8).sha256}, the mission's is {sample_chart().sha256}"
    )
    assert "is not attached" in refusal(tmp_path / "log.mcap", rewrite(content, remove))


def test_messages_out_of_order_are_refused(content: bytes, tmp_path: Path) -> None:
    def log_times(records: list[McapRecord]) -> list[McapRecord]:
        first, second = of_topic(records, "/V2/depth")[3:5]
        first.log_time, second.log_time = second.log_time, first.log_time
        return records

    def stamps(records: list[McapRecord]) -> list[McapRecord]:
        first, second = of_topic(records, "/V2/depth")[3:5]
        first.data, second.data = second.data, first.data
        return records

    def places(records: list[McapRecord]) -> list[McapRecord]:
        first, second = (records.index(message) for message in of_topic(records, "/acoustics/slot")[1:3])
        records[first], records[second] = records[second], records[first]
        return records

    path = tmp_path / "log.mcap"
    line = refusal(path, rewrite(content, log_times))
    assert line == "/V2/depth is out of order: message 4 at 3.000000007 s follows one at 4.000000007 s"
    assert refusal(path, rewrite(content, stamps)).startswith(
        "/V2/depth is out of order: message 4 stamped 3.0"
    )
    assert refusal(path, rewrite(content, places)).startswith("/acoustics/slot is out of order: message 2")


def test_a_nan_depth_in_the_file_is_refused(content: bytes, tmp_path: Path) -> None:
    def spoil(records: list[McapRecord]) -> list[McapRecord]:
        message = of_topic(records, "/V2/water_depth")[4]
        fields = layout(EVENT_TOPICS["water_depth"].msgtype, {"header.frame_id": "map"}).dtype.fields
        assert fields is not None
        at = fields["pose.pose.position.z"][1]
        message.data = message.data[:at] + np.float64(np.nan).tobytes() + message.data[at + 8 :]
        return records

    line = refusal(tmp_path / "log.mcap", rewrite(content, spoil))
    assert re.fullmatch(
        r"water_depth: water_depth_m -?nan of vehicle 'V2' at t = 4.000000007 s must be finite", line
    )


def test_messages_that_were_taken_out_or_replaced_are_refused(content: bytes, tmp_path: Path) -> None:
    def without(topic: str) -> Callable[[list[McapRecord]], list[McapRecord]]:
        return lambda records: [
            r for r in records if not (isinstance(r, Message) and r in of_topic(records, topic))
        ]

    def shorter(records: list[McapRecord]) -> list[McapRecord]:
        message = of_topic(records, "/V1/fix")[2]
        message.data = message.data[:-4]
        return records

    def other_frame(records: list[McapRecord]) -> list[McapRecord]:
        message = of_topic(records, "/V1/fix")[2]
        message.data = message.data.replace(b"map", b"odo")
        return records

    def payload(records: list[McapRecord]) -> list[McapRecord]:
        of_topic(records, "/acoustics/reception")[2].data += b"more"
        return records

    def other_type(records: list[McapRecord]) -> list[McapRecord]:
        for record in records:
            if isinstance(record, Schema) and record.name == "sensor_msgs/msg/Imu":
                record.name = "sensor_msgs/msg/Temperature"
        return records

    def other_format(records: list[McapRecord]) -> list[McapRecord]:
        for record in records:
            if isinstance(record, Metadata):
                record.metadata["format"] = '"2"'
        return records

    for change, line in [
        (without("/V2/depth"), "depth holds 24 messages, the log states 36"),
        (without("/acoustics/slot"), "/acoustics/slot holds 0 messages, the log states 3"),
        (without("/truth/V3/yaw"), "/truth/V3/yaw holds 0 messages, the log states 12"),
        (shorter, "/V1/fix: message 2 has 360 bytes, its definition needs 364"),
        (other_frame, "/V1/fix: message 2 has header.frame_id b'odo', not b'map'"),
        (payload, "/acoustics/reception: payload of message 2 is cut off"),
        (other_type, "/V1/turn_rate carries sensor_msgs/msg/Temperature, it must be sensor_msgs/msg/Imu"),
        (other_format, "format '2' is unknown: this version reads '1'"),
    ]:
        assert refusal(tmp_path / "log.mcap", rewrite(content, change)) == line


@pytest.mark.parametrize(
    "key", ["seed", "rows", "link", "vehicles", "namespaces", "origin", "truth", "chart"]
)
def test_metadata_that_is_not_ours_is_refused(key: str, content: bytes, tmp_path: Path) -> None:
    for value in ("{", '"x"', "[1]", '{"a": 1}'):

        def spoil(records: list[McapRecord], value: str = value) -> list[McapRecord]:
            for record in records:
                if isinstance(record, Metadata):
                    record.metadata[key] = value
            return records

        assert refusal(tmp_path / "log.mcap", rewrite(content, spoil))
