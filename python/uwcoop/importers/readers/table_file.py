"""Text tables (CSV and its kin) as channels: one with all columns, stamped by the column of times."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from uwcoop.errors import LogError, TableError
from uwcoop.importers.channels import Channel, Columns, SourceFile
from uwcoop.importers.column_roles import assign_roles
from uwcoop.importers.text_dialect import COMMA_NUMBER, NO_VALUE
from uwcoop.importers.text_table import TextTable, open_table
from uwcoop.importers.times import looks_like_time, parse_times, time_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.importers.times import Times

__all__ = ["TimeColumns", "read_table"]

_TIME_NAMES = {
    "time": {
        "time", "timestamp", "time stamp", "t", "utc", "datetime", "date time", "stamp", "epoch", "unix time", "gps time",
        "time utc", "time of day", "ms",
    },
    "date": {"date", "day", "gps date", "date utc"},
}  # fmt: skip


class TimeColumns(Protocol):
    """Names of the columns of times; None: find them."""

    @property
    def time(self) -> str | None: ...
    @property
    def date(self) -> str | None: ...
    @property
    def time_unit(self) -> str: ...


def read_table(path: Path, about: TimeColumns) -> SourceFile:
    """Read a table.

    Raises:
        LogError: no column of times, or a table that cannot be read; one line that says what it has.
    """
    try:
        table = open_table(path)
        if not table.has_header:
            raise LogError(f"{path} has no header: its columns need names")
        cells = table.read({}, {label: k for k, label in enumerate(table.labels)}).texts
        if not cells or not len(next(iter(cells.values()))):
            raise LogError(f"{path} has a header and no rows")
        notes = [f"{path.name}: {note}" for note in table.notes]
        times, without = _times(table, cells, about, path)
    except TableError as error:
        raise LogError(f"{path}: {error}") from error
    if without.any():
        notes.append(f"{path.name}: {without.sum():,} of {without.size:,} rows have no time: left out")
    notes.append(f"{path.name}: times are {times.how}")
    make = {
        label: partial(_column, column, ~without, table.dialect.decimal) for label, column in cells.items()
    }
    channel = Channel(
        path.name, path.name, "table", times.t_ns, _Cached(tuple(table.labels), int((~without).sum()), make),
        clock="utc" if times.absolute else "own",
        units={label: unit for label, unit in zip(table.labels, table.units, strict=True) if unit},
    )  # fmt: skip
    return SourceFile(path.name, "text table", (channel,), (), tuple(notes))


class _Cached(Columns):
    """Columns that are made once: a text is costly to read as a number."""

    def __init__(self, labels: tuple[str, ...], count: int, make: Any) -> None:
        super().__init__(labels, count, make)
        self._made: dict[str, NDArray[Any]] = {}

    def __getitem__(self, label: str) -> NDArray[Any]:
        if label not in self._made:
            self._made[label] = super().__getitem__(label)
        return self._made[label]


def _times(
    table: TextTable, cells: dict[str, NDArray[np.object_]], about: TimeColumns, path: Path
) -> tuple[Times, NDArray[np.bool_]]:
    """The instants of the rows that have one, and which have none."""
    places = assign_roles(table.labels, _TIME_NAMES).place
    if about.time is not None:
        places["time"] = table.place(about.time)
    if about.date is not None:
        places["date"] = table.place(about.date)
    if "time" not in places and "date" in places:
        places["time"] = places.pop("date")
    if "time" not in places:
        raise LogError(
            f"{path} has no column of times that is called so: it has {', '.join(table.labels)}; name it by "
            '[csv] time = "…"'
        )
    label = table.labels[places["time"]]
    texts = cells[label]
    dates = None
    clock_only = bool(len(texts)) and looks_like_time(str(texts[0])) and "date" in places
    without = np.array([not str(text).strip() for text in texts])
    if clock_only and not _holds_date(str(texts[0])):
        days = cells[table.labels[places["date"]]]
        without |= np.array([not str(day).strip() for day in days])
        dates = [str(day) for day in days[~without]]
    unit = about.time_unit or time_unit(label) or table.units[places["time"]]
    times = parse_times([str(text) for text in texts[~without]], unit=unit, dates=dates, label=label)
    return times, without


def _holds_date(cell: str) -> bool:
    return any(mark in cell for mark in "-/") or cell.count(".") > 1


def _column(cells: NDArray[np.object_], kept: NDArray[np.bool_], decimal: str) -> NDArray[Any]:
    """Numbers where every cell is one or says that there is none; texts else."""
    own = cells[kept]
    texts = [str(cell).strip() for cell in own]
    if decimal == ",":
        texts = [text.replace(",", ".") if COMMA_NUMBER.match(text) else text for text in texts]
    try:
        values = np.array(
            [np.nan if text.lower() in NO_VALUE else float(text) for text in texts], dtype=np.float64
        )
    except ValueError:
        return own
    return np.where(np.isfinite(values), values, np.nan)
