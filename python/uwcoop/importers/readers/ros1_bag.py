"""ROS 1 bags (format 2.0): read from the start without their index: a bag that was cut off gives what it holds."""

from __future__ import annotations

import bz2
import struct
from pathlib import Path
from typing import IO

from uwcoop.errors import LogError
from uwcoop.importers.bounded import ReadLimitError, inflate_lz4
from uwcoop.importers.readers.ros_topics import RawTopic

__all__ = ["read_ros1"]

CHUNK_LIMIT_BYTES = 256 * 2**20
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")
_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
"""Values of the header field `op`."""


def read_ros1(path: Path) -> tuple[list[RawTopic], list[str]]:
    """The topics of a bag, and notes.

    Raises:
        LogError: a bag of another version.
    """
    topics: dict[int, RawTopic] = {}
    notes: list[str] = []
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise LogError(
                f"{path} is a ROS 1 bag of an old version: `rosbag fix` makes a bag of version 2.0 of it"
            )
        try:
            while (record := _record(file)) is not None:
                _take(*record, topics)
        except Exception as error:  # struct, bz2 and lz4 on damage
            share = min(file.tell() / size, 1.0)
            why = (str(error).splitlines() or [type(error).__name__])[0][:120]
            notes.append(
                f"{path.name} is cut off or damaged after {100 * share:.0f} % of its {size:,} bytes ({why}): "
                "what comes before is read"
            )
    merged: dict[tuple[str, str], RawTopic] = {}
    for topic in topics.values():
        first = merged.setdefault((topic.name, topic.msgtype), topic)
        if first is not topic:  # several nodes on one topic
            first.messages += topic.messages
            first.received_ns += topic.received_ns
            first.too_long += topic.too_long
    return list(merged.values()), notes


def _record(file: IO[bytes]) -> tuple[dict[bytes, bytes], bytes] | None:
    start = file.read(4)
    if not start:
        return None
    header = _fields(_exactly(file, _LENGTH.unpack(start)[0]))
    return header, _exactly(file, _LENGTH.unpack(_exactly(file, 4))[0])


def _exactly(file: IO[bytes], length: int) -> bytes:
    content = file.read(length)
    if len(content) < length:
        raise EOFError("a record ends early")
    return content


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields, at = {}, 0
    while at < len(header):
        (length,) = _LENGTH.unpack_from(header, at)
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        fields[name] = value
        at += 4 + length
    return fields


def _take(header: dict[bytes, bytes], content: bytes, topics: dict[int, RawTopic]) -> None:
    op = header.get(b"op", b"\0")[0]
    if op == _CHUNK:
        _chunk(_inflated(header.get(b"compression", b"none"), content), topics)
    elif op == _CONNECTION:
        _connection(header, content, topics)
    elif op == _MESSAGE:
        _message(header, content, topics)


def _chunk(data: bytes, topics: dict[int, RawTopic]) -> None:
    at, end = 0, len(data)
    while at < end:
        (header_length,) = _LENGTH.unpack_from(data, at)
        header = _fields(data[at + 4 : at + 4 + header_length])
        at += 4 + header_length
        (length,) = _LENGTH.unpack_from(data, at)
        if at + 4 + length > end:
            raise EOFError("a record is longer than its chunk")
        _take(header, data[at + 4 : at + 4 + length], topics)
        at += 4 + length


def _inflated(compression: bytes, content: bytes) -> bytes:
    if compression == b"none":
        return content
    if compression == b"lz4":
        return inflate_lz4(content, CHUNK_LIMIT_BYTES)
    if compression != b"bz2":
        raise ValueError(f"a chunk is compressed by {compression[:20]!r}")
    inflater = bz2.BZ2Decompressor()
    data = inflater.decompress(content, CHUNK_LIMIT_BYTES + 1)
    if len(data) > CHUNK_LIMIT_BYTES:
        raise ReadLimitError(
            f"a chunk holds more than {CHUNK_LIMIT_BYTES / 2**20:g} MiB, the most that is read"
        )
    return data


def _connection(header: dict[bytes, bytes], content: bytes, topics: dict[int, RawTopic]) -> None:
    (number,) = _LENGTH.unpack(header[b"conn"])
    about = _fields(content)
    msgtype = about[b"type"].decode("utf-8", "replace")
    if msgtype.count("/") == 1:
        msgtype = msgtype.replace("/", "/msg/")
    name = header[b"topic"].decode("utf-8", "replace")
    topics.setdefault(
        number, RawTopic(name, msgtype, about.get(b"message_definition", b"").decode("utf-8", "replace"))
    )


def _message(header: dict[bytes, bytes], content: bytes, topics: dict[int, RawTopic]) -> None:
    topic = topics.get(_LENGTH.unpack(header[b"conn"])[0])
    if topic is not None:
        seconds, nanoseconds = _TIME.unpack(header[b"time"])
        topic.take(seconds * 1_000_000_000 + nanoseconds, content)
