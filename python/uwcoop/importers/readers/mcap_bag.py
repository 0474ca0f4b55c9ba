"""ROS 2 recordings in MCAP files: read from the start, so that a file that is cut off gives what it holds."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop.importers.bounded import inflate_lz4, inflate_zstd
from uwcoop.importers.readers.ros_topics import RawTopic

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, Schema

__all__ = ["read_mcap"]

CHUNK_LIMIT_BYTES = 256 * 2**20
"""Of one inflated chunk: recorders of cameras write some MiB."""
_OPCODE_AND_LENGTH = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_MESSAGE_OPCODE, _SCHEMA_OPCODE, _CHANNEL_OPCODE = 0x05, 0x03, 0x04


class _Topics:
    """Topics by channel, as their records come along."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.by_channel: dict[int, RawTopic] = {}
        self.by_name: dict[tuple[str, str], RawTopic] = {}
        self.other: dict[str, str] = {}
        """Channels whose messages are no CDR, and how they are encoded."""

    def channel(self, record: Channel) -> None:
        schema = self.schemas.get(record.schema_id)
        msgtype = "" if schema is None else schema.name
        if msgtype.count("/") == 1:
            msgtype = msgtype.replace("/", "/msg/")
        topic = self.by_name.setdefault((record.topic, msgtype), RawTopic(record.topic, msgtype))
        if schema is not None and schema.encoding in ("ros2msg", "ros2idl"):
            topic.definition = schema.data.decode("utf-8", "replace")
            topic.idl = schema.encoding == "ros2idl"
        if record.message_encoding != "cdr":
            self.other[record.topic] = record.message_encoding
        self.by_channel[record.id] = topic


def read_mcap(path: Path) -> tuple[list[RawTopic], list[str]]:
    """The topics of a file, and notes.

    Raises:
        OSError: it cannot be opened. What is damaged ends the reading, with a note of where.
    """
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import StreamReader

    topics = _Topics()
    notes: list[str] = []
    size = path.stat().st_size
    with path.open("rb") as file:
        records = StreamReader(file, record_size_limit=max(size, 1), emit_chunks=True).records
        while True:
            try:
                record = next(records, None)
                if record is None:
                    break
                if isinstance(record, Chunk):
                    _chunk(record, topics)
                elif isinstance(record, Schema):
                    topics.schemas[record.id] = record
                elif isinstance(record, Channel):
                    topics.channel(record)
                elif isinstance(record, Message) and record.channel_id in topics.by_channel:
                    topics.by_channel[record.channel_id].take(record.log_time, record.data)
            except Exception as error:  # the mcap package's and the decompressors' are not listed anywhere
                share = min(file.tell() / max(size, 1), 1.0)
                why = (str(error).splitlines() or [type(error).__name__])[0][:120]
                notes.append(
                    f"{path.name} is cut off or damaged after {100 * share:.0f} % of its {size:,} bytes "
                    f"({why}): what comes before is read"
                )
                break
    kept = [t for t in topics.by_name.values() if t.name not in topics.other]
    for name, encoding in topics.other.items():
        notes.append(f"{name}: its messages are {encoding!r}, not CDR: not read")
    return kept, notes


def _chunk(chunk: Chunk, topics: _Topics) -> None:
    """The records of a chunk; messages by hand, as there are millions."""
    data = _inflated(chunk)
    at, end = 0, len(data)
    by_channel = topics.by_channel
    while at + 9 <= end:
        opcode, length = _OPCODE_AND_LENGTH.unpack_from(data, at)
        at += 9
        if at + length > end:
            raise EOFError("a record is longer than its chunk")
        if opcode == _MESSAGE_OPCODE:
            channel, _, log_ns, _ = _MESSAGE.unpack_from(data, at)
            topic = by_channel.get(channel)
            if topic is not None:
                topic.take(log_ns, data[at + 22 : at + length])
        elif opcode in (_SCHEMA_OPCODE, _CHANNEL_OPCODE):
            _definition(opcode, data[at : at + length], topics)
        at += length


def _definition(opcode: int, content: bytes, topics: _Topics) -> None:
    from io import BytesIO

    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    stream = ReadDataStream(BytesIO(content))
    if opcode == _SCHEMA_OPCODE:
        schema = Schema.read(stream)
        topics.schemas[schema.id] = schema
    else:
        topics.channel(Channel.read(stream))


def _inflated(chunk: Chunk) -> bytes:
    if chunk.compression == "zstd":
        return inflate_zstd(chunk.data, CHUNK_LIMIT_BYTES)
    if chunk.compression == "lz4":
        return inflate_lz4(chunk.data, CHUNK_LIMIT_BYTES)
    if chunk.compression:
        raise ValueError(f"a chunk is compressed by {chunk.compression[:20]!r}")
    return chunk.data
