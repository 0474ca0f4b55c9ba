"""A recorded track's file: its rows by role, with times on the clock that the file states."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from uwcoop.charts.plausible import DEEPEST_M, HIGHEST_M, without_fills
from uwcoop.charts.vertical import METRES_PER_UNIT, unit_of
from uwcoop.errors import ChartError, ScenarioError, TableError
from uwcoop.importers.bounded import refuse_irregular, refused
from uwcoop.importers.column_roles import assign_roles
from uwcoop.importers.text_table import open_table
from uwcoop.importers.times import parse_times
from uwcoop.scenario.vehicle import Track, TrackColumns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.importers.text_table import Rows as TableRows
    from uwcoop.importers.text_table import TextTable
    from uwcoop.importers.times import Times

    Array = NDArray[np.float64]

Clock = Literal["absolute", "time of day", "own"]
NO_ECHO_M = (0.0, -1.0)
"""What echo sounders write when they hear none."""
_STUCK_ROWS = 60
"""So many equal soundings in a row are worth a note."""
_NAMES = {
    "time": {"time", "timestamp", "time stamp", "utc", "datetime", "date time", "t", "epoch", "gps time"},
    "longitude": {"longitude", "lon", "long", "lng"},
    "latitude": {"latitude", "lat"},
    "east": {"east", "easting", "x", "e"},
    "north": {"north", "northing", "y", "n"},
    "sounding": {"sounding", "water depth", "bathymetry", "seabed depth", "bottom depth"},
    "depth": {"vehicle depth", "own depth"},
}
"""What columns are called in files, for a track that names none of them."""


@dataclass(frozen=True)
class TrackRows:
    """The rows of a record that a track selects; of rows with the same time the first."""

    t_ns: NDArray[np.int64]
    """(N,) strictly ascending, on `clock`."""
    clock: Clock
    """absolute: since 1970-01-01 UTC. time of day: since a midnight. own: since a zero of the file's own."""
    cells: dict[str, Array]
    """(N,) by role: longitude and latitude in degrees, east, north, depth and sounding (NaN: none) in metres."""
    line: NDArray[np.int64]
    """(N,) in the file, for messages."""
    notes: tuple[str, ...]


def read_rows(track: Track, where: str) -> TrackRows:
    """Read a track's file; a file that has not changed since is read once.

    Raises:
        ScenarioError: a file, column, cell or order that cannot be used; one line that begins with `where`.
    """
    try:
        changed_ns = Path(track.file).stat().st_mtime_ns
    except OSError as error:
        raise ScenarioError(f"{where} cannot be read: {error.strerror}") from error
    # A study reads the same record for each of its missions.
    return _read_once(track.model_dump_json(), changed_ns, where)


@lru_cache(maxsize=16)
def _read_once(track_json: str, changed_ns: int, where: str) -> TrackRows:
    track = Track.model_validate_json(track_json)
    try:
        with refused(ScenarioError, where):
            refuse_irregular(Path(track.file))
            return _read(track, where)
    except TableError as error:
        raise ScenarioError(f"{where}: {error}") from error


def _read(track: Track, where: str) -> TrackRows:
    table = open_table(track.file)
    notes = list(table.notes)
    columns = track.columns or _found_columns(table, track, where, notes)
    place = {role: table.place(name) for role, name in columns.model_dump().items() if name is not None}
    time_at = place.pop("time")
    rows = table.read(place, {"time": time_at}, track.where)
    if len(rows.line) < 2:
        count = "1 row" if len(rows.line) else "no row"
        selected = f" where {track.where}" if track.where else ""
        raise ScenarioError(f"{where} has {count}{selected}: must have at least 2")
    unit, label = track.time_unit or table.units[time_at], table.labels[time_at]
    times = _times(rows, unit, label, table.dialect.decimal, where)
    if "told" in times.how or "assumed" in times.how:
        notes.append(times.how)
    if "sounding" in place:
        unit = unit_of(table.units[place["sounding"]])
        rows.numbers["sounding"] = _echoes(rows.numbers["sounding"], unit, rows.line, where, notes)
    cells = {
        role: _in_metres(values, table.units[place[role]], role, where, notes)
        for role, values in rows.numbers.items()
    }
    _check_cells(cells, {role: table.labels[at] for role, at in place.items()}, rows.line, where)
    if "longitude" in cells:
        keep = _with_fix(cells, rows.line, track, where, notes)
    else:
        keep = np.ones(len(rows.line), dtype=bool)
    if keep.sum() < 2:
        raise ScenarioError(f"{where} has {keep.sum()} rows with a position: must have at least 2")
    t_ns, line = times.t_ns[keep], rows.line[keep].astype(np.int64)
    cells = {role: values[keep] for role, values in cells.items()}
    back = np.flatnonzero(np.diff(t_ns) < 0)
    if back.size:
        k = int(back[0])
        raise ScenarioError(
            f"{where}: time goes back by {(t_ns[k] - t_ns[k + 1]) / 1e9:g} s in line {line[k + 1]}: must ascend"
        )
    fresh = np.concatenate([[True], np.diff(t_ns) > 0])
    if not fresh.all():
        notes.append(f"{(~fresh).sum()} rows repeat a time, the first in line {line[~fresh][0]}: left out")
    return TrackRows(
        t_ns[fresh], _clock_of(times), {role: values[fresh] for role, values in cells.items()}, line[fresh],
        tuple(notes),
    )  # fmt: skip


def _found_columns(table: TextTable, track: Track, where: str, notes: list[str]) -> TrackColumns:
    """The columns by what they are called, for a track that names none."""
    found = assign_roles(table.labels, _NAMES).place
    pair = ("longitude", "latitude") if {"longitude", "latitude"} <= found.keys() else ("east", "north")
    wanted = [role for role in ("time", *pair) if role not in found]
    if wanted:
        raise ScenarioError(
            f"{where}: no column is called {' or '.join(wanted)} among {', '.join(table.labels)}: "
            "name them in track.columns"
        )
    names = {
        role: table.labels[found[role]] for role in ("time", *pair, "sounding", "depth") if role in found
    }
    notes.append("columns by their names: " + ", ".join(f"{role} {name!r}" for role, name in names.items()))
    return TrackColumns(**names)


def _times(rows: TableRows, unit: str, label: str, decimal: str, where: str) -> Times:
    cells = [str(cell) for cell in rows.texts["time"]]
    if decimal == ",":
        cells = [cell.replace(",", ".") for cell in cells]
    empty = next((k for k, cell in enumerate(cells) if not cell.strip()), None)
    if empty is not None:
        raise ScenarioError(f"{where}: {label} is '' in line {rows.line[empty]}: must be a time")
    try:
        return parse_times(cells, unit=unit, label=label)
    except TableError as error:
        # Of the rows that the track selects, told as the file's lines.
        said = re.sub(
            r"in data row (\d+)", lambda found: f"in line {rows.line[int(found[1]) - 1]}", str(error)
        )
        raise ScenarioError(f"{where}: {said}") from error


def _clock_of(times: Times) -> Clock:
    if times.absolute:
        return "absolute"
    return "time of day" if times.how.startswith("times of day") else "own"


def _in_metres(values: Array, unit: str, role: str, where: str, notes: list[str]) -> Array:
    """A length in metres, whatever unit its column states; degrees as they are."""
    stated = unit_of(unit)
    if role in ("longitude", "latitude"):
        if stated.startswith("rad"):
            notes.append(f"{role} in radians: converted")
            return np.degrees(values)
        return values
    if stated in ("", "m"):
        return values
    if stated not in METRES_PER_UNIT:
        raise ScenarioError(f"{where}: {role} states the unit {unit!r}: must be m, ft or fathom")
    notes.append(f"{role} in {stated}: converted")
    return values * METRES_PER_UNIT[stated]


def _check_cells(
    cells: dict[str, Array], labels: dict[str, str], line: NDArray[np.int32], where: str
) -> None:
    """Refuse what no position and no depth can be; only a sounding may be missing."""
    for role, values in cells.items():
        if role == "sounding":
            continue
        bad = np.isnan(values)
        if bad.any():
            raise ScenarioError(
                f"{where}: {labels[role]} is empty or not finite in line {line[bad][0]}: must be a finite number"
            )
        low, high = {"latitude": (-90.0, 90.0), "longitude": (-180.0, 360.0), "depth": (-5.0, DEEPEST_M)}.get(
            role, (-1e8, 1e8)
        )
        bad = (values < low) | (values > high)
        if bad.any():
            value = values[bad][0]
            unit, bound = (" m", f"outside {low:g} to {high:,.0f} m") if role not in ("latitude", "longitude") else (
                "", "outside ±90: columns swapped?" if role == "latitude" else "outside -180 to 360"
            )  # fmt: skip
            name = role if role in ("latitude", "longitude") else f"{role} {labels[role]}"
            raise ScenarioError(f"{where}: {name} {value:.10g}{unit} in line {line[bad][0]} is {bound}")


def _with_fix(
    cells: dict[str, Array], line: NDArray[np.int32], track: Track, where: str, notes: list[str]
) -> NDArray[np.bool_]:
    """Rows with a position: receivers write (0, 0) until they have a fix."""
    none = (np.abs(cells["latitude"]) < 1e-6) & (np.abs(cells["longitude"]) < 1e-6)
    if none.any():
        rows = f"{none.sum()} rows, the first in line {line[none][0]}, have no fix yet at (0, 0)"
        if not track.drop_without_fix:
            raise ScenarioError(f"{where}: {rows}: leave them out, or set track.drop_without_fix = true")
        notes.append(f"{rows}: left out")
    return ~none


def _echoes(soundings: Array, unit: str, line: NDArray[np.int32], where: str, notes: list[str]) -> Array:
    """Soundings, as the file has them, without those that are none: no echo, fill values. The others must be depths."""
    scale = METRES_PER_UNIT.get(unit, 1.0)
    silent = np.isin(soundings, NO_ECHO_M)
    rest = np.where(silent, np.nan, soundings)
    try:
        kept = without_fills(rest, scale, None, "soundings")[0] if np.isfinite(rest).any() else rest
    except ChartError as error:
        raise ScenarioError(f"{where}: soundings: {error}") from error
    fill = np.isfinite(rest) & (np.isnan(kept) | (rest * scale < -HIGHEST_M))
    for bad, why in ((silent, "0 or -1 m: no echo"), (fill, "no depths: fill values")):
        if bad.any():
            notes.append(
                f"{bad.sum()} of {np.isfinite(soundings).sum()} soundings, the first in line {line[bad][0]}, are {why}; "
                "left out"
            )
    soundings = np.where(silent | fill, np.nan, soundings)
    below = soundings < 0
    if below.any():
        raise ScenarioError(
            f"{where}: sounding is {soundings[below][0]:g} {unit or 'm'} in line {line[below][0]}: must be "
            f"above 0 m, positive down ({below.sum()} of {np.isfinite(soundings).sum()} are not)"
        )
    _note_stuck(soundings, line, notes)
    return soundings


def _note_stuck(soundings: Array, line: NDArray[np.int32], notes: list[str]) -> None:
    """A note on the longest run of equal soundings."""
    known = np.flatnonzero(np.isfinite(soundings))
    if known.size < _STUCK_ROWS:
        return
    values = soundings[known]
    starts = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0]))
    lengths = np.diff(np.concatenate([starts, [values.size]]))
    longest = int(np.argmax(lengths))
    if lengths[longest] >= _STUCK_ROWS:
        at = known[starts[longest]]
        notes.append(
            f"{lengths[longest]} soundings in a row are {soundings[at]:g} m, from line {line[at]} on: a stuck or "
            "saturated sounder? They are used"
        )
