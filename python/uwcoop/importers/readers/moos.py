"""MOOS logs (`.alog`): lines of time, variable, source and value.

What one process posts together is one row: a channel is a process and the first word of its variables, as
"pNav/NAV", and its columns are the variables.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.bounded import text_lines
from uwcoop.importers.channels import Channel, SourceFile

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["read_alog"]

TOGETHER_S = 0.02
"""Entries of one process within so many seconds are one row."""
_LIMIT_BYTES = 2**32
_START = re.compile(r"^%+\s*LOGSTART\s+([\d.]+)")
_OPENED = re.compile(r"^%+\s*FILE OPENED ON\s+(.+?)\s*$")
_ENTRY = re.compile(r"^\s*([\d.eE+-]+)\s+(\S+)\s+(\S+)\s+(.*?)\s*$")


def read_alog(path: Path) -> SourceFile:
    """Read a MOOS log.

    Raises:
        LogError: it holds no entry.
    """
    entries: dict[str, list[tuple[float, str, str]]] = {}
    start_s: float | None = None
    opened = ""
    damaged = count = 0
    for line in text_lines(path, _LIMIT_BYTES, encoding="latin-1"):
        if line.startswith("%"):
            if found := _START.match(line):
                start_s = float(found.group(1))
            elif found := _OPENED.match(line):
                opened = found.group(1)
            continue
        if not line.strip():
            continue
        entry = _ENTRY.match(line)
        try:
            seconds = float(entry.group(1)) if entry is not None else None
        except ValueError:
            seconds = None
        if entry is None or seconds is None:
            damaged += 1
            continue
        count += 1
        name = f"{entry.group(3).split(':')[0]}/{entry.group(2).split('_')[0]}"
        entries.setdefault(name, []).append((seconds, entry.group(2), entry.group(4)))
    if not count:
        raise LogError(f"{path} holds no entry of a MOOS log")
    notes = [f"{path.name}: {damaged:,} lines are no entries: left out"] if damaged else []
    if start_s is None and opened:
        start_s = _local_seconds(opened)
        if start_s is not None:
            notes.append(f"{path.name}: it has no LOGSTART; opened on {opened}, taken as UTC")
    base_ns = 0 if start_s is None else round(start_s * 1e9)
    absolute = start_s is not None and start_s > 315_532_800
    if not absolute:
        notes.append(f"{path.name}: times count from a zero of its own, as it has no LOGSTART")
    channels = tuple(
        _channel(path.name, name, rows, base_ns, absolute) for name, rows in sorted(entries.items())
    )
    return SourceFile(path.name, "MOOS log", channels, (), tuple(notes))


def _channel(
    source: str, name: str, entries: list[tuple[float, str, str]], base_ns: int, absolute: bool
) -> Channel:
    stamps: list[float] = []
    rows: list[dict[str, str]] = []
    for seconds, variable, value in entries:
        if not rows or seconds - stamps[-1] > TOGETHER_S or seconds < stamps[-1] or variable in rows[-1]:
            stamps.append(seconds)
            rows.append({})
        rows[-1][variable] = value
    variables = dict.fromkeys(variable for row in rows for variable in row)
    columns = {variable: _values([row.get(variable) for row in rows]) for variable in variables}
    t_ns = base_ns + np.round(np.array(stamps) * 1e9).astype(np.int64)
    return Channel(source, name, "moos/entries", t_ns, columns, clock="utc" if absolute else "own")


def _values(cells: list[str | None]) -> NDArray[Any]:
    """Numbers, NaN where there is none; texts where most of the values are none."""
    numbers = np.array([_number(cell) for cell in cells])
    told = sum(cell is not None for cell in cells)
    if 2 * np.isfinite(numbers).sum() > told:
        return numbers
    return np.array([*(cell or "" for cell in cells), None], dtype=object)[:-1]


def _number(cell: str | None) -> float:
    try:
        return np.nan if cell is None else float(cell)
    except ValueError:
        return np.nan


def _local_seconds(text: str) -> float | None:
    for form in ("%a %b %d %H:%M:%S %Y", "%Y-%m-%d %H:%M:%S"):
        try:
            return datetime.strptime(" ".join(text.split()), form).replace(tzinfo=UTC).timestamp()
        except ValueError:
            continue
    return None
