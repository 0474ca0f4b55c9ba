"""Bounded reading: what a file may make a reader hold in memory, and one line for whatever goes wrong.

A small file can ask for a lot of memory: 3 MB of gzip inflate to 3 GB, a header of 8 bytes states a length of 4 GB, a
line has no end. Readers therefore open files here. A file may be as long as `READ_LIMIT_BYTES` once it is inflated; the
environment variable `UWCOOP_READ_LIMIT_MB` raises that. A reader's use is

    with refused(LogError, f"recording {path}"):
        for number, line in enumerate(text_lines(path), 1):
            ...

where `refused` turns whatever a library throws into that reader's error, one line long.
"""

from __future__ import annotations

import gzip
import io
import math
import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final

import numpy as np

from uwcoop.errors import UwcoopError

__all__ = [
    "LINE_LIMIT_BYTES",
    "READ_LIMIT_BYTES",
    "ReadLimitError",
    "beyond",
    "inflate_lz4",
    "inflate_zstd",
    "open_binary",
    "read_bytes",
    "read_limit_bytes",
    "read_text",
    "refuse_array",
    "refuse_irregular",
    "refused",
    "text_lines",
]

READ_LIMIT_BYTES: Final = 64 * 2**20
"""Bytes of one file that a reader gets, after inflating."""
LINE_LIMIT_BYTES: Final = 2**20
"""Characters of one line of text."""
READ_LIMIT_VARIABLE: Final = "UWCOOP_READ_LIMIT_MB"
_GZIP = b"\x1f\x8b"
_REASON_CHARACTERS = 300


class ReadLimitError(ValueError):
    """A file that would take more memory than its reader may use; the message names the bound."""


def read_limit_bytes(default: int = READ_LIMIT_BYTES) -> int:
    """The limit of one file: `default`, unless the environment variable sets another one for all readers.

    Raises:
        ReadLimitError: the variable is not a whole number of megabytes, at least 1.
    """
    text = os.environ.get(READ_LIMIT_VARIABLE)
    if text is None:
        return default
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= 2**24:
        raise ReadLimitError(
            f"environment variable {READ_LIMIT_VARIABLE} is {text[:40]!r}: must be a whole number of megabytes, "
            f"1 to {2**24}"
        )
    return int(text) * 2**20


@contextmanager
def refused(error: type[UwcoopError], what: str) -> Iterator[None]:
    """A reader's border: what the block throws becomes `error`, "{what} cannot be read: reason", in one line.

    The package's own errors pass as they are, `KeyboardInterrupt` and `SystemExit` too. Arithmetic on a file's numbers
    may overflow in silence: what comes of it is checked, and refused in one line.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except UwcoopError:
        raise
    except Exception as thrown:
        raise error(f"{what} cannot be read: {_reason(thrown)}") from thrown


def _reason(thrown: Exception) -> str:
    """Why, in one line that does not repeat a long part of the file."""
    if isinstance(thrown, MemoryError):
        return "it asks for more memory than there is"
    if isinstance(thrown, RecursionError):
        return "it is nested too deeply"
    if isinstance(thrown, EOFError):
        return "it is cut off"
    if isinstance(thrown, UnicodeDecodeError):
        return f"byte {thrown.object[thrown.start]:#04x} is no {thrown.encoding.upper()}"
    text = thrown.strerror if isinstance(thrown, OSError) and thrown.strerror else str(thrown)
    line = " ".join(text.split())
    if isinstance(thrown, KeyError) or not line:
        line = f"{type(thrown).__name__} {line}".strip()
    return line if len(line) <= _REASON_CHARACTERS else f"{line[:_REASON_CHARACTERS]}…"


def refuse_irregular(path: Path) -> None:
    """Raise for what is no regular file: a device or a FIFO may never end.

    Raises:
        OSError: there is no such file.
        ReadLimitError: it is not a regular file.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(21, "Is a directory", str(path))
    if not stat.S_ISREG(mode):
        raise ReadLimitError("it is not a regular file")


class _Counted(io.RawIOBase):
    """The bytes of a stream, up to a limit."""

    def __init__(self, source: IO[bytes] | gzip.GzipFile, limit_bytes: int) -> None:
        self._source = source
        self._limit_bytes = limit_bytes
        self._left = limit_bytes

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        # One byte more than may be had tells a file at its limit from one beyond it.
        piece = self._source.read(min(len(buffer), self._left + 1))
        if len(piece) > self._left:
            raise ReadLimitError(beyond(self._limit_bytes))
        self._left -= len(piece)
        buffer[: len(piece)] = piece
        return len(piece)

    def close(self) -> None:
        self._source.close()
        super().close()


def beyond(limit_bytes: int, what: str = "it") -> str:
    """The line of a refusal: what is longer than its limit, and how to raise that."""
    return (
        f"{what} holds more than {limit_bytes / 2**20:g} MiB, the most that is read "
        f"(environment variable {READ_LIMIT_VARIABLE} raises it)"
    )


def open_binary(path: str | os.PathLike[str], limit_bytes: int | None = None) -> io.BufferedReader:
    """A file's bytes, inflated if they are gzip (told by the first two bytes, not by the name).

    Args:
        path: a regular file.
        limit_bytes: after inflating; None: `read_limit_bytes()`.

    Raises:
        OSError, ReadLimitError: also while reading, as `zlib.error` and `EOFError` are for damaged gzip.
    """
    source = Path(path)
    refuse_irregular(source)
    limit = read_limit_bytes() if limit_bytes is None else limit_bytes
    file = source.open("rb")
    try:
        packed = file.read(2) == _GZIP
        file.seek(0)
        return io.BufferedReader(_Counted(_Gzip(file) if packed else file, limit))
    except BaseException:
        file.close()
        raise


class _Gzip(gzip.GzipFile):
    """Gzip that closes what it reads from."""

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(fileobj=file, mode="rb")
        self._file = file

    def close(self) -> None:
        super().close()
        self._file.close()


def read_bytes(path: str | os.PathLike[str], limit_bytes: int | None = None) -> bytes:
    """All of a file, inflated; raises as `open_binary`."""
    with open_binary(path, limit_bytes) as file:
        return file.read()


def read_text(path: str | os.PathLike[str], limit_bytes: int | None = None, encoding: str = "utf-8") -> str:
    """All of a text file, inflated; raises as `open_binary`, and `UnicodeDecodeError`."""
    return read_bytes(path, limit_bytes).decode(encoding)


def text_lines(
    path: str | os.PathLike[str],
    limit_bytes: int | None = None,
    *,
    line_limit: int = LINE_LIMIT_BYTES,
    encoding: str = "utf-8-sig",
) -> Iterator[str]:
    """The lines of a text file with their ends, inflated and decoded as they are asked for: fit for `csv.reader`.

    Args:
        path: a regular file; line ends are those of any system.
        limit_bytes: of the whole file; None: `read_limit_bytes()`.
        line_limit: characters of a line.
        encoding: by default UTF-8, with or without a byte-order mark.

    Raises:
        OSError, ReadLimitError, UnicodeDecodeError, zlib.error, EOFError: see `open_binary`; `refused` makes one line
            of them.
    """
    with io.TextIOWrapper(open_binary(path, limit_bytes), encoding=encoding) as file:
        number = 1
        while line := file.readline(line_limit + 1):
            if len(line) > line_limit:
                raise ReadLimitError(f"line {number} is longer than {line_limit} characters")
            yield line
            number += 1


def refuse_array(what: str, shape: Sequence[int], item_bytes: int, limit_bytes: int | None = None) -> None:
    """Raise before an array is loaded whose stated dimensions take more memory than may be used.

    Args:
        what: its name in the message.
        shape: as the file states it.
        item_bytes: bytes of one item in memory.
        limit_bytes: None: `read_limit_bytes()`.

    Raises:
        ReadLimitError: a dimension below zero, or too many bytes.
    """
    limit = read_limit_bytes() if limit_bytes is None else limit_bytes
    sizes = [int(size) for size in shape]
    if any(size < 0 for size in sizes):
        raise ReadLimitError(f"{what} has the dimensions {sizes}: must be at least 0")
    if math.prod(sizes) * item_bytes > limit:
        raise ReadLimitError(beyond(limit, f"{what} of {' x '.join(map(str, sizes))}"))


def inflate_zstd(content: bytes, limit_bytes: int) -> bytes:
    """One zstd frame, inflated to at most `limit_bytes`, whatever its header states.

    Raises:
        ReadLimitError: it is longer.
        zstandard.ZstdError: it is damaged.
    """
    import zstandard

    with zstandard.ZstdDecompressor().stream_reader(content) as stream:
        return _at_most(stream.read(limit_bytes + 1), limit_bytes)


def inflate_lz4(content: bytes, limit_bytes: int) -> bytes:
    """One lz4 frame, inflated to at most `limit_bytes`, whatever its header states.

    Raises:
        ReadLimitError: it is longer.
        RuntimeError, EOFError: it is damaged, or cut off.
    """
    import lz4.frame

    stream = lz4.frame.LZ4FrameDecompressor()
    inflated = _at_most(stream.decompress(content, max_length=limit_bytes + 1), limit_bytes)
    if not stream.eof:
        raise EOFError
    return inflated


def _at_most(inflated: bytes, limit_bytes: int) -> bytes:
    if len(inflated) > limit_bytes:
        raise ReadLimitError(f"a chunk holds more than {limit_bytes / 2**20:g} MiB, the most that is read")
    return inflated
