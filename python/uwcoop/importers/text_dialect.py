"""How a text table is written, told by its first lines: encoding, separator, decimal sign, header, row of units."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from uwcoop.errors import TableError
from uwcoop.importers.bounded import open_binary, read_limit_bytes, refused
from uwcoop.importers.column_roles import is_unit, split_label
from uwcoop.importers.times import looks_like_time

__all__ = [
    "COMMA_NUMBER",
    "DOT_NUMBER",
    "NO_VALUE",
    "Dialect",
    "cells_of",
    "content_lines",
    "dialect_of",
    "open_lines",
]

SAMPLE_BYTES = 1 << 16
LONGEST_LINE = 1 << 16
"""Characters; a longer line belongs to no table of measurements."""
LARGEST_INFLATION = 200
"""A gzipped table is 3 to 30 times smaller than its text; more than this is an attack or an accident."""
_INFLATED_FREELY = 1 << 26
COMMENTS = ("#", "%", ">", "//")
"""What lines that are not data begin with: most programs' comments, and GMT's segment headers."""
_SEPARATORS = ("\t", ";", "|", ",", "")
"""Tried in this order; "" is any run of blanks."""
NO_VALUE = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "--", "---", "*", "inf", "+inf", "-inf"})
DOT_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
COMMA_NUMBER = re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?$")
_BLANK_LABELS = re.compile(r'"[^"]*"|[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?|[(\[][^)\]]*[)\]]')


@dataclass(frozen=True)
class Dialect:
    """How one table is written."""

    encoding: str
    separator: str
    """"," ";" tab "|", or "" for runs of blanks."""
    decimal: str
    """"." or ","."""
    labels: tuple[str, ...]
    """The header's names as written; "column 1" … where there is no header."""
    units: tuple[str, ...]
    """Of each column, as its label or a row of units states it; "" where neither does."""
    has_header: bool
    header_is_comment: bool
    skipped: int
    """Lines before the first row of data."""
    notes: tuple[str, ...]


@contextmanager
def open_lines(path: Path, encoding: str) -> Iterator[Iterator[str]]:
    """The lines of a text file, gzipped or not; undecodable bytes become U+FFFD, which is part of no number.

    Raises:
        TableError: no regular file, a line without end, a damaged gzip stream, or one that inflates without end.
    """
    with refused(TableError, path.name), _open(path) as raw:
        yield _bounded(io.TextIOWrapper(raw, encoding=encoding, errors="replace"), path.name)


def _open(path: Path) -> io.BufferedReader:
    """The file's bytes, inflated: a table of any length, but no more than a table can inflate to."""
    return open_binary(path, read_limit_bytes(max(_INFLATED_FREELY, LARGEST_INFLATION * path.stat().st_size)))


def _bounded(text: io.TextIOWrapper, name: str) -> Iterator[str]:
    number = 1
    while line := text.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise TableError(
                f"{name} line {number} is longer than {LONGEST_LINE:,} characters: it is no table"
            )
        yield line
        number += 1


def content_lines(lines: Iterator[str], skipped: int = 0) -> Iterator[tuple[int, str]]:
    """Numbers, from 1, and text of the lines that are neither blank nor comments, after the first `skipped`."""
    for number, line in enumerate(lines, start=1):
        if number <= skipped:
            continue
        text = line.strip("\r\n\x00\x1a")
        if text.strip() and not text.lstrip().startswith(COMMENTS):
            yield number, text


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of one line, without the blanks around them."""
    if not separator:
        return line.split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def dialect_of(path: Path) -> Dialect:
    """Find how `path` is written.

    Raises:
        TableError: not text, empty, or no line that holds a table.
    """
    encoding = _encoding(path)
    sample = _sample(path, encoding)
    rows = list(content_lines(iter(sample)))
    if not rows:
        raise TableError(f"{path.name} is empty: it holds no rows")
    separator, decimal = _separator([text for _, text in rows])
    notes = [] if encoding.startswith("utf-8") else [f"text in {encoding}"]
    if decimal == ",":
        notes.append("decimal commas")
    start = _preamble(rows, separator)
    if start:
        notes.append(f"{start} lines before the header left out, the first: {rows[0][1].strip()[:40]!r}")
    first = _labels_in(rows[start][1], separator)
    has_header, from_comment = _is_header(first), False
    labels, data = tuple(first), start + 1
    if not has_header:
        data = start
        said = _commented_labels(sample[: rows[start][0] - 1], separator, len(first))
        from_comment = said is not None
        labels = tuple(said or [f"column {k + 1}" for k in range(len(first))])
        if said:
            notes.append(f"column names from the comment above the data: {', '.join(said)}")
    units = tuple(split_label(label)[1] for label in labels)
    below = cells_of(rows[data][1], separator) if has_header and len(rows) > data else []
    if below and _is_unit_row(below):
        units = tuple((below[k] if k < len(below) else "") or units[k] for k in range(len(labels)))
        notes.append(f"units from the row below the header: {', '.join(cell or '-' for cell in below)}")
        data += 1
    skipped = rows[data][0] - 1 if data < len(rows) else rows[-1][0]
    return Dialect(
        encoding,
        separator,
        decimal,
        labels,
        units,
        has_header or from_comment,
        from_comment,
        skipped,
        tuple(notes),
    )


def _encoding(path: Path) -> str:
    with refused(TableError, path.name), _open(path) as raw:
        start = raw.read(SAMPLE_BYTES)
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
        (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"),
    ):  # fmt: skip
        if start.startswith(mark):
            return name
    zeros = [start[k::2].count(0) for k in (0, 1)]
    if max(zeros) > 0.4 * len(start) / 2 and min(zeros) == 0:
        return "utf-16-be" if zeros[0] else "utf-16-le"
    if re.search(rb"[\x00-\x08\x0e-\x19\x1b-\x1f\x7f]", start.rstrip(b"\x00\x1a")):
        raise TableError(f"{path.name} is no text: it holds control characters")
    # A multi-byte character may be cut by the end of the sample, which is not its end.
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        decoder.decode(start)
    except UnicodeDecodeError:
        try:
            start.decode("cp1252")
        except UnicodeDecodeError as error:
            raise TableError(f"{path.name} is no text: neither UTF-8, UTF-16 nor Windows-1252") from error
        return "cp1252"
    return "utf-8"


def _sample(path: Path, encoding: str) -> list[str]:
    sample: list[str] = []
    size = 0
    with open_lines(path, encoding) as lines:
        for line in lines:
            sample.append(line)
            size += len(line)
            if size > SAMPLE_BYTES:
                break
    return sample


def _separator(rows: Sequence[str]) -> tuple[str, str]:
    """The separator and the decimal sign by which most cells are values, and most rows as long as the others."""
    looked = rows[:200]
    best: tuple[float, str, str] = (-1.0, "", ".")
    for separator in _SEPARATORS:
        split = [cells_of(row, separator) for row in looked]
        width, count = Counter(len(cells) for cells in split).most_common(1)[0]
        if width < 2:
            continue
        whole = [cells for cells in split if len(cells) == width]
        body = whole[1:] or whole
        total = sum(map(len, body))
        for decimal, pattern in ((".", DOT_NUMBER), (",", COMMA_NUMBER)):
            if decimal == "," and separator == ",":
                continue
            values = sum(_is_value(cell, pattern) for cells in body for cell in cells)
            score = count / len(looked) * (0.2 + values / total)
            if score > best[0] + 1e-9:
                best = score, separator, decimal
    return best[1], best[2]


def _is_value(cell: str, pattern: re.Pattern[str]) -> bool:
    return cell.lower() in NO_VALUE or bool(pattern.match(cell)) or looks_like_time(cell)


def _labels_in(line: str, separator: str) -> list[str]:
    """The cells of a header: names between blanks keep a unit in brackets that follows them."""
    if separator:
        return cells_of(line, separator)
    return [cell.strip('"') for cell in _BLANK_LABELS.findall(line)]


def _is_header(cells: Sequence[str]) -> bool:
    values = sum(bool(DOT_NUMBER.match(c) or COMMA_NUMBER.match(c) or looks_like_time(c)) for c in cells)
    return 2 * values < len(cells) and any(re.search(r"[^\W\d]", cell) for cell in cells)


def _preamble(rows: Sequence[tuple[int, str]], separator: str) -> int:
    """How many lines of other text stand before the header: those with fewer cells than the rows below."""
    widths = [len(_labels_in(text, separator)) for _, text in rows[:50]]
    usual = Counter(widths).most_common(1)[0]
    if usual[1] < 3 or usual[0] < 2:
        return 0
    start = next(k for k, width in enumerate(widths) if width >= usual[0])
    return start if start and all(_is_header(_labels_in(text, separator)) for _, text in rows[:start]) else 0


def _commented_labels(lines: Sequence[str], separator: str, width: int) -> list[str] | None:
    """The names in the last comment above the data, as NumPy and GMT write them; None where it is none."""
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    if not last.startswith(("#", "%")):
        return None
    cells = _labels_in(last.lstrip("#% ").strip(), separator)
    return cells if len(cells) == width and _is_header(cells) else None


def _is_unit_row(cells: Sequence[str]) -> bool:
    given = [cell for cell in cells if cell]
    return bool(given) and any(is_unit(cell) for cell in given) and not any(
        DOT_NUMBER.match(cell) or COMMA_NUMBER.match(cell) or looks_like_time(cell) for cell in given
    )  # fmt: skip
