"""Bounded reading: nothing in a file makes a reader hold more than its limit, and every failure is one line."""

from __future__ import annotations

import gzip
import os
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uwcoop.errors import LogError, UwcoopError
from uwcoop.importers.bounded import (
    READ_LIMIT_BYTES,
    ReadLimitError,
    inflate_lz4,
    inflate_zstd,
    open_binary,
    read_bytes,
    read_limit_bytes,
    read_text,
    refuse_array,
    refused,
    text_lines,
)

MIB = 2**20


def peak_bytes(work: object) -> int:
    tracemalloc.start()
    try:
        work()  # type: ignore[operator]
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@given(st.binary(max_size=200), st.integers(0, 220), st.booleans())
def test_a_file_is_read_whole_or_refused(content: bytes, limit: int, packed: bool) -> None:
    if content[:2] == b"\x1f\x8b":
        return
    path = Path(os.environ["PYTEST_BOUNDED"]) / "file"
    path.write_bytes(gzip.compress(content) if packed else content)
    if len(content) <= limit:
        assert read_bytes(path, limit) == content
    else:
        with pytest.raises(ReadLimitError, match="the most that is read"):
            read_bytes(path, limit)


@pytest.fixture(scope="module", autouse=True)
def _folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    # Hypothesis calls its examples with one fixture; a folder of the module is all they need.
    os.environ["PYTEST_BOUNDED"] = str(tmp_path_factory.mktemp("bounded"))


def test_a_small_file_that_inflates_without_end_costs_no_memory(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.gz"
    squeezer = zlib.compressobj(9, wbits=31)
    packed = b"".join(squeezer.compress(bytes(MIB)) for _ in range(1024)) + squeezer.flush()
    bomb.write_bytes(packed)
    assert len(packed) < 2 * MIB

    def unpack() -> None:
        with refused(LogError, "file bomb"), open_binary(bomb, 8 * MIB) as file:
            while file.read(65536):
                pass

    def lines() -> None:
        with refused(LogError, "file bomb"):
            list(text_lines(bomb))

    for work, line in ((unpack, "more than 8 MiB"), (lines, "line 1 is longer than 1048576 characters")):

        def attempt(work: object = work, line: str = line) -> None:
            with pytest.raises(LogError, match=line):
                work()  # type: ignore[operator]

        assert peak_bytes(attempt) < 16 * MIB


def test_chunks_inflate_to_their_limit_whatever_they_state() -> None:
    import lz4.frame
    import zstandard

    content = bytes(64 * MIB)
    for packed, inflate in (
        (zstandard.compress(content), inflate_zstd),
        (lz4.frame.compress(content), inflate_lz4),
    ):
        assert inflate(packed, len(content)) == content

        def attempt(packed: bytes = packed, inflate: object = inflate) -> None:
            with pytest.raises(ReadLimitError, match="a chunk holds more than 1 MiB"):
                inflate(packed, MIB)  # type: ignore[operator]

        assert peak_bytes(attempt) < 8 * MIB
        with refused_as("file"):
            inflate(b"something else", MIB)
    with refused_as("is cut off"):
        inflate_lz4(lz4.frame.compress(b"abc" * 100)[:-8], MIB)


class refused_as:  # noqa: N801
    """The block must be refused in one line that holds these words."""

    def __init__(self, words: str) -> None:
        self.words = words

    def __enter__(self) -> None:
        self.border = refused(LogError, "file x")
        self.border.__enter__()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> bool:
        with pytest.raises(LogError) as refusal:
            self.border.__exit__(kind, error, trace)  # type: ignore[arg-type]
        line = str(refusal.value)
        assert line.startswith("file x cannot be read: ")
        assert "\n" not in line
        assert self.words in line
        return True


def thrown() -> list[tuple[Exception, str]]:
    return [
        (MemoryError(), "more memory than there is"),
        (RecursionError("maximum recursion depth exceeded"), "nested too deeply"),
        (zlib.error("Error -3 while decompressing"), "Error -3"),
        (RuntimeError("Unable to read\nthe file"), "Unable to read the file"),
        (EOFError(), "cut off"),
        (KeyError("a"), "KeyError 'a'"),
        (IndexError(), "IndexError"),
        (OSError(5, "Input/output error"), "Input/output error"),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid"), "byte 0xff is no UTF-8"),
        (ValueError("x" * 100_000), "xxx…"),
        (SystemError("bad call"), "bad call"),
    ]


@pytest.mark.parametrize(("error", "words"), thrown(), ids=lambda value: type(value).__name__)
def test_whatever_is_thrown_becomes_one_short_line(error: Exception, words: str) -> None:
    with refused_as(words):
        raise error
    with pytest.raises(LogError) as refusal, refused(LogError, "file x"):
        raise error
    assert len(str(refusal.value)) < 400


def test_own_errors_and_interrupts_pass_the_border() -> None:
    for error in (UwcoopError("as it is"), KeyboardInterrupt(), SystemExit(3)):
        with pytest.raises(type(error)) as passed, refused(LogError, "file x"):
            raise error
        assert passed.value is error


def test_lines_come_with_any_line_end_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "lines.txt"
    path.write_bytes("\ufeffa\r\nb\rc\nd".encode())
    assert list(text_lines(path)) == ["a\n", "b\n", "c\n", "d"]
    assert read_text(path, encoding="utf-8-sig") == "a\r\nb\rc\nd"
    with pytest.raises(ReadLimitError, match="line 1 is longer than 1 characters"):
        list(text_lines(path, line_limit=1))


def test_what_never_ends_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path / "fifo", Path("/dev/zero")):
        with pytest.raises(ReadLimitError, match="not a regular file"):
            read_bytes(path)
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "absent")


def test_an_array_is_refused_by_its_dimensions() -> None:
    refuse_array("depth", (1024, 1024), 8)
    with pytest.raises(ReadLimitError, match="depth of 100000 x 100000 holds more than 64 MiB"):
        refuse_array("depth", np.array([100_000, 100_000], np.int32), 8)
    with pytest.raises(ReadLimitError, match="at least 0"):
        refuse_array("depth", (-1, 2), 8)


def test_the_limit_can_be_raised(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert read_limit_bytes() == READ_LIMIT_BYTES
    monkeypatch.setenv("UWCOOP_READ_LIMIT_MB", "1")
    assert read_limit_bytes(7) == MIB
    (tmp_path / "long").write_bytes(bytes(MIB + 1))
    with pytest.raises(ReadLimitError, match=r"more than 1 MiB.*UWCOOP_READ_LIMIT_MB raises it"):
        read_bytes(tmp_path / "long")
    for text in ("0", "-1", "x", "1.5", "", "9" * 30):
        monkeypatch.setenv("UWCOOP_READ_LIMIT_MB", text)
        with pytest.raises(ReadLimitError, match="whole number of megabytes"):
            read_limit_bytes()
