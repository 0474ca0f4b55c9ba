"""The MCAP container: whole or refused, then taken apart into topics, metadata and attachments.

Checks come before parsing: the magic bytes at both ends find a file that is cut off or something else, the
CRCs of the data and summary sections find changed bytes. What still fails to parse was written that way. Chunks are
inflated within bounds, whatever they state: a small file cannot ask for much memory.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING

from uwcoop.errors import LogError
from uwcoop.importers.bounded import ReadLimitError, inflate_lz4, inflate_zstd

if TYPE_CHECKING:
    from mcap.records import Chunk, McapRecord

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, summary CRC
_DATA_END = struct.Struct("<BQI")  # opcode, length, data section CRC
_FOOTER_OPCODE, _DATA_END_OPCODE = 0x02, 0x0F
CHUNK_LIMIT_BYTES = 16 * 2**20
"""Of one inflated chunk: writers start a new one at 1 to 4 MiB."""
INFLATED_LIMIT_BYTES, INFLATED_LIMIT_RATIO = 64 * 2**20, 64
"""All chunks of a file may hold so much, or so many times the file: missions reach 10 times."""


@dataclass
class Contents:
    """What an MCAP file holds; messages in the order of the file."""

    library: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    """Topic -> schema name."""
    messages: dict[str, list[bytes]] = field(default_factory=dict)
    """Topic -> CDR bytes."""


def zstd_available() -> bool:
    """Whether chunks can be compressed with zstd."""
    try:
        import zstandard  # noqa: F401
    except ImportError:
        return False
    return True


def parse(content: bytes) -> Contents:
    """Take an MCAP file apart.

    Raises:
        LogError: empty, not MCAP, cut off, a CRC that does not match, a topic out of order, or damaged
        otherwise.
    """
    _refuse_damage(content)
    contents = Contents()
    times: dict[str, list[int]] = {}
    try:
        _collect(content, contents, times)
    except LogError:
        raise
    except (
        Exception
    ) as error:  # what the mcap package and the decompressors raise on damage is not listed anywhere
        raise LogError(f"damaged: {_what(error)}") from error
    for topic, stamps in times.items():
        for number, (before, after) in enumerate(pairwise(stamps), start=1):
            if after < before:
                raise LogError(
                    f"{topic} is out of order: message {number} at {after / 1e9:.9f} s "
                    f"follows one at {before / 1e9:.9f} s"
                )
    return contents


def _refuse_damage(content: bytes) -> None:
    if not content:
        raise LogError("empty file")
    if not content.startswith(_MAGIC[: len(content)]):
        raise LogError("not an MCAP file")
    end = len(content) - len(_MAGIC)
    footer_at = end - _FOOTER.size
    if footer_at < len(_MAGIC) or content[end:] != _MAGIC:
        raise LogError(f"cut off: {len(content)} bytes without the closing record of an MCAP file")
    opcode, _, summary_at, _, summary_crc = _FOOTER.unpack_from(content, footer_at)
    data_end_at = (summary_at or footer_at) - _DATA_END.size
    if opcode != _FOOTER_OPCODE or not len(_MAGIC) <= data_end_at <= footer_at - _DATA_END.size:
        raise LogError("damaged: its footer is not that of an MCAP file")
    opcode, _, data_crc = _DATA_END.unpack_from(content, data_end_at)
    if opcode != _DATA_END_OPCODE:
        raise LogError("damaged: its data section does not end where the footer says")
    view = memoryview(content)
    # A CRC of 0 means that the writer did not compute one.
    for name, crc, part in (
        ("data", data_crc, view[:data_end_at]),
        ("summary", summary_crc, view[data_end_at + _DATA_END.size : end - 4]),
    ):
        if crc and zlib.crc32(part) != crc:
            raise LogError(f"damaged: CRC of the {name} section is {zlib.crc32(part):08x}, not {crc:08x}")


def _collect(content: bytes, contents: Contents, times: dict[str, list[int]]) -> None:
    from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema

    schemas: dict[int, str] = {}
    topics: dict[int, str] = {}
    for record in _records(content):
        if isinstance(record, Message):
            topic = topics[record.channel_id]
            contents.messages[topic].append(record.data)
            times[topic].append(record.log_time)
        elif isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            if record.id not in topics:
                topics[record.id] = record.topic
                contents.types[record.topic] = schemas[record.schema_id]
                contents.messages.setdefault(record.topic, [])
                times.setdefault(record.topic, [])
        elif isinstance(record, Metadata):
            contents.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            contents.attachments[record.name] = record.data
        elif isinstance(record, Header):
            contents.library = record.library


def _records(content: bytes) -> Iterator[McapRecord]:
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    left = max(INFLATED_LIMIT_BYTES, INFLATED_LIMIT_RATIO * len(content))
    # No record can be longer than its file; a damaged length must not make the reader ask for memory.
    reader = StreamReader(
        BytesIO(content), validate_crcs=True, record_size_limit=len(content), emit_chunks=True
    )
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        inflated = _inflated(record, min(left, CHUNK_LIMIT_BYTES))
        left -= len(inflated.data)
        yield from breakup_chunk(inflated, validate_crc=True)


def _inflated(chunk: Chunk, limit_bytes: int) -> Chunk:
    """The chunk without its compression; mcap itself believes the length that the chunk states."""
    if chunk.compression == "zstd":
        data = inflate_zstd(chunk.data, limit_bytes)
    elif chunk.compression == "lz4":
        data = inflate_lz4(chunk.data, limit_bytes)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise LogError(f"damaged: a chunk is compressed by {chunk.compression[:20]!r}: must be zstd or lz4")
    if len(data) > limit_bytes:
        raise ReadLimitError(f"a chunk holds more than {limit_bytes / 2**20:g} MiB, the most that is read")
    if len(data) != chunk.uncompressed_size:
        raise LogError(f"damaged: a chunk holds {len(data)} bytes and says {chunk.uncompressed_size}")
    return replace(chunk, compression="", data=data)


def _what(error: Exception) -> str:
    lines = str(error).splitlines() or [type(error).__name__]
    return f"id {lines[0]} is not declared" if isinstance(error, KeyError) else lines[0][:200]
