"""The one reader of text tables: soundings, tracks, range tests, logs.

    table = open_table("dive.csv")                      # looks at the first lines only
    table.labels, table.units                           # ("Longitude (°)", …), ("°", …)
    roles = assign_roles(table.labels, {"lon": {"lon", "longitude"}, "depth": {"depth", "z"}})
    rows = table.read(numbers=roles.place, texts={"survey": table.place("day")}, where={"station": "A"})
    rows.numbers["lon"], rows.texts["survey"], rows.line

Encoding (UTF-8, UTF-16, Windows-1252), separator (comma, semicolon, tab, bar, blanks), decimal sign, header (also in a
comment, or below other text) and units (in names, or in a row below them, as ERDDAP writes) are found and noted; gzip
is unpacked. Only the columns asked for are kept, so that memory is eight bytes for each of their cells.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TableError
from uwcoop.importers.text_dialect import (
    COMMA_NUMBER,
    DOT_NUMBER,
    NO_VALUE,
    Dialect,
    cells_of,
    content_lines,
    dialect_of,
    open_lines,
)

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import NDArray

__all__ = ["Rows", "TextTable", "open_table"]

MOST_ROWS = 20_000_000
_CHUNK = 50_000


@dataclass(frozen=True)
class Rows:
    """The cells that were asked for, of the rows that were."""

    numbers: dict[str, NDArray[np.float64]]
    """(N,) by name; NaN where the cell is empty or says that there is no value ("nan", "N/A", "-", "inf")."""
    texts: dict[str, NDArray[np.object_]]
    """(N,) str by name."""
    line: NDArray[np.int32]
    """(N,) number of each row's line in the file, from 1."""


@dataclass(frozen=True)
class TextTable:
    """A text table that was looked at and not yet read."""

    path: Path
    dialect: Dialect

    @property
    def labels(self) -> tuple[str, ...]:
        """The columns' names as written; "column 1" … where there is no header."""
        return self.dialect.labels

    @property
    def units(self) -> tuple[str, ...]:
        """Each column's unit as its name or the row of units states it; "" where neither does."""
        return self.dialect.units

    @property
    def has_header(self) -> bool:
        """Whether the columns have names of their own."""
        return self.dialect.has_header

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found that is not usual, one phrase each."""
        return self.dialect.notes

    def place(self, label: str) -> int:
        """The column of a name: as written, or but for upper and lower case.

        Raises:
            TableError: there is none, or case alone tells several apart.
        """
        if label in self.labels:
            return self.labels.index(label)
        alike = [k for k, own in enumerate(self.labels) if own.lower() == label.lower()]
        if len(alike) == 1:
            return alike[0]
        close = difflib.get_close_matches(label.lower(), [own.lower() for own in self.labels], n=1)
        hint = next((f", nearest {own!r}" for own in self.labels if own.lower() in close), "")
        raise TableError(f"{self.path.name} has no column {label!r}: it has {', '.join(self.labels)}{hint}")

    def read(
        self,
        numbers: Mapping[str, int],
        texts: Mapping[str, int] | None = None,
        where: Mapping[str, str] | None = None,
    ) -> Rows:
        """Read the file.

        Args:
            numbers: columns, from 0, of which the cells are numbers, by the name under which they are returned.
            texts: the same of cells that stay as they are.
            where: only rows whose column of this label holds exactly this text.

        Raises:
            TableError: a cell that is no number, with its column and line; a row with more cells than the
                header; a damaged file; more than 20 million rows.
        """
        texts = texts or {}
        wanted = {self.place(label): text for label, text in (where or {}).items()}
        parts: dict[str, list[NDArray[np.float64]]] = {name: [] for name in numbers}
        strings: dict[str, list[str]] = {name: [] for name in texts}
        kept: list[NDArray[np.int32]] = []
        count = 0
        with open_lines(self.path, self.dialect.encoding) as lines:
            rows = content_lines(lines, self.dialect.skipped)
            while chunk := list(islice(rows, _CHUNK)):
                line, cells = self._cells(chunk, wanted)
                count += len(line)
                if count > MOST_ROWS:
                    raise TableError(f"{self.path.name} holds more than {MOST_ROWS:,} rows: cut it")
                kept.append(line)
                for name, place in numbers.items():
                    parts[name].append(self._numbers([row[place] for row in cells], place, line))
                for name, place in texts.items():
                    strings[name] += [row[place] for row in cells]
        empty = np.zeros(0)
        return Rows(
            {name: np.concatenate(parts.pop(name) or [empty]) for name in list(parts)},
            {name: np.array([*column, None], dtype=object)[:-1] for name, column in strings.items()},
            np.concatenate(kept) if kept else np.zeros(0, np.int32),
        )

    def _cells(
        self, chunk: list[tuple[int, str]], wanted: Mapping[int, str]
    ) -> tuple[NDArray[np.int32], list[list[str]]]:
        """Line numbers and cells of the rows wanted, each row as long as the header: what is missing is empty."""
        width, separator = len(self.labels), self.dialect.separator
        numbers, rows = [], []
        for number, text in chunk:
            row = cells_of(text, separator)
            if len(row) != width:
                if any(row[width:]):
                    raise TableError(
                        f"{self.path.name} line {number} has {len(row)} cells, more than the {width} of the first"
                    )
                row += [""] * (width - len(row))
            if all(row[place] == text for place, text in wanted.items()):
                numbers.append(number)
                rows.append(row)
        return np.array(numbers, dtype=np.int32), rows

    def _numbers(self, cells: list[str], place: int, line: NDArray[np.int32]) -> NDArray[np.float64]:
        if self.dialect.decimal == ",":
            cells = [cell.replace(",", ".") if COMMA_NUMBER.match(cell) else cell for cell in cells]
        try:
            # Python reads 1_000 as a number too, which no other program writes.
            values = np.array([float(cell) for cell in cells]) if "_" not in "".join(cells) else None
        except ValueError:
            values = None
        if values is None:
            values = np.array(
                [self._number(cell, place, int(at)) for cell, at in zip(cells, line, strict=True)]
            )
        return np.where(np.isfinite(values), values, np.nan)

    def _number(self, cell: str, place: int, line: int) -> float:
        if DOT_NUMBER.match(cell):
            return float(cell)
        if cell.lower() in NO_VALUE:
            return np.nan
        raise TableError(
            f"column {self.labels[place]!r} holds {cell[:60]!r} in line {line} of {self.path.name}: not a number"
        )


def open_table(path: str | PathLike[str]) -> TextTable:
    """Look at the first lines of a text table and find how it is written.

    Raises:
        TableError: not text, or empty.
    """
    path = Path(path)
    return TextTable(path, dialect_of(path))
