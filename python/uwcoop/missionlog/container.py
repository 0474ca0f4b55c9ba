"""The MCAP container: whole or refused, then taken apart into topics, metadata and attachments.

Checks come before parsing: the magic bytes at both ends find a file that is cut off or something else, the
CRCs of the data and summary sections find changed bytes. What still fails to parse was written that way.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING

from uwcoop.errors import LogError

if TYPE_CHECKING:
    from mcap.records import McapRecord

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, summary CRC
_DATA_END = struct.Struct("<BQI")  # opcode, length, data section CRC
_FOOTER_OPCODE, _DATA_END_OPCODE = 0x02, 0x0F


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
    except _parse_errors() as error:
        lines = str(error).splitlines() or [type(error).__name__]
        what = f"id {lines[0]} is not declared" if isinstance(error, KeyError) else lines[0]
        raise LogError(f"damaged: {what}") from error
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
    from mcap.stream_reader import StreamReader

    # No record can be longer than its file; a damaged length must not make the reader ask for memory.
    yield from StreamReader(BytesIO(content), validate_crcs=True, record_size_limit=len(content)).records


def _parse_errors() -> tuple[type[Exception], ...]:
    """What the mcap package and the decompressors raise on bytes that they cannot read."""
    from mcap.exceptions import McapError

    errors: list[type[Exception]] = [
        McapError, ValueError, LookupError, ArithmeticError, EOFError, MemoryError, RuntimeError,
        struct.error,
    ]  # fmt: skip
    if zstd_available():
        from zstandard import ZstdError

        errors.append(ZstdError)
    return tuple(errors)
