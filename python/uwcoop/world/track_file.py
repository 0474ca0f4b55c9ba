"""Recorded tracks: CSV of time and position, optionally soundings and own depth, at whole seconds."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import ChartError, ScenarioError
from uwcoop.frames import LocalFrame, crs_of
from uwcoop.importers.bounded import refused, text_lines
from uwcoop.scenario.base import nearest
from uwcoop.scenario.vehicle import Track

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.scenario.vehicle import Vehicle

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """A track at the seconds 0..T of the mission."""

    position_m: Array
    """(T + 1, 2) east and north in the chart's frame, interpolated in straight lines."""
    depth_m: Array
    """(T + 1,) own depth, interpolated."""
    soundings_m: Array | None
    """(T + 1,) each recorded sounding at the second nearest to it (the nearest one, where several are); NaN
    where there is none: nothing is interpolated. None when the record has no soundings."""


def read_track(vehicle: Vehicle, chart: Chart | None, steps: int) -> Record:
    """Read a vehicle's record and resample it to `steps` + 1 seconds from `track.start_s` on.

    Raises:
        ScenarioError: a file, column, cell, order or gap that cannot be used; one line with the row's number.
    """
    track = vehicle.track
    assert track is not None
    where = f"vehicle {vehicle.name}: track {track.file}"
    try:
        changed_ns = Path(track.file).stat().st_mtime_ns
    except OSError as error:
        raise ScenarioError(f"{where} cannot be read: {error.strerror}") from error
    rows = _read_once(track.model_dump_json(), changed_ns, where)
    position = _local(track, rows.cells, chart, where)
    _check_span(rows, track, steps, where)
    seconds = track.start_s + np.arange(steps + 1.0)
    depth = np.full(steps + 1, vehicle.depth_m)
    if "depth" in rows.cells:
        depth = np.interp(seconds, rows.time_s, rows.cells["depth"])
    soundings = None
    if "sounding" in rows.cells:
        soundings = _at_nearest_second(rows.time_s - track.start_s, rows.cells["sounding"], steps)
    east, north = (np.interp(seconds, rows.time_s, axis) for axis in position.T)
    return Record(np.column_stack([east, north]), depth, soundings)


@dataclass(frozen=True)
class _Rows:
    time_s: Array  # since the record's first row, strictly ascending
    cells: dict[str, Array]  # by role: east, sounding, ...
    line: NDArray[np.int64]  # in the file, for messages


@lru_cache(maxsize=16)
def _read_once(track_json: str, changed_ns: int, where: str) -> _Rows:
    # A study reads the same record for each of its missions; an edited file is read again.
    return _read(Track.model_validate_json(track_json), where)


def _read(track: Track, where: str) -> _Rows:
    """The rows that the track selects; of rows with the same time the first."""
    with refused(ScenarioError, where):
        lines, values = _columns(csv.DictReader(text_lines(track.file), skipinitialspace=True), track, where)
    if len(lines) < 2:
        rows = "1 row" if lines else "no row"
        selected = f" where {track.where}" if track.where else ""
        raise ScenarioError(f"{where} has {rows}{selected}: must have at least 2")
    cells = {role: np.array(column) for role, column in values.items()}
    time_s = cells.pop("time") * (1e-3 if track.time_unit == "ms" else 1.0)
    time_s = time_s - time_s[0]
    back = np.flatnonzero(np.diff(time_s) < 0)
    if back.size:
        k = int(back[0])
        raise ScenarioError(
            f"{where}: time goes back by {time_s[k] - time_s[k + 1]:g} s in line {lines[k + 1]}: must ascend"
        )
    fresh = np.concatenate([[True], np.diff(time_s) > 0])
    return _Rows(
        time_s[fresh], {role: column[fresh] for role, column in cells.items()}, np.array(lines)[fresh]
    )


def _columns(
    reader: csv.DictReader[str], track: Track, where: str
) -> tuple[list[int], dict[str, list[float]]]:
    """Line numbers and numbers by role, of the rows that `where` selects."""
    roles = {role: name for role, name in track.columns.model_dump().items() if name is not None}
    known = [name for name in reader.fieldnames or [] if name is not None]
    for name in [*roles.values(), *track.where]:
        if name not in known:
            raise ScenarioError(f"{where} has no column {name!r}: {nearest(name, known)}")
    lines: list[int] = []
    values: dict[str, list[float]] = {role: [] for role in roles}
    for row in reader:
        if any(row[column] != wanted for column, wanted in track.where.items()):
            continue
        lines.append(reader.line_num)
        for role, name in roles.items():
            values[role].append(_number(row[name], role, name, reader.line_num, where))
    return lines, values


def _number(text: str | None, role: str, name: str, line: int, where: str) -> float:
    """A cell's number. Only a sounding may be missing; a sounding of 0 m or less is no water depth."""
    text = (text or "").strip()
    if role == "sounding" and text.lower() in {"", "nan"}:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ScenarioError(f"{where}: {name} is {text!r} in line {line}: must be a finite number")
    if role == "sounding" and value <= 0:
        raise ScenarioError(
            f"{where}: sounding {name} is {value:g} m in line {line}: must be above 0 m, positive down "
            "(leave the cell empty where there is none)"
        )
    if role == "depth" and value < 0:
        raise ScenarioError(f"{where}: own depth {name} is {value:g} m in line {line}: must be at least 0 m")
    return value


def _local(track: Track, cells: dict[str, Array], chart: Chart | None, where: str) -> Array:
    """Positions in the chart's local frame, (N, 2)."""
    if "longitude" not in cells and track.crs is None:
        return np.column_stack([cells["east"], cells["north"]])
    if chart is None:
        raise ScenarioError(f"{where} has no place to go: its positions need a [chart], whose frame they get")
    try:
        frame = LocalFrame(chart.origin)
        if "longitude" in cells:
            return frame.to_local(cells["latitude"], cells["longitude"])
        from pyproj import Transformer

        to_wgs84 = Transformer.from_crs(crs_of(track.crs), "EPSG:4326", always_xy=True)
        longitude, latitude = to_wgs84.transform(cells["east"], cells["north"])
        return frame.to_local(latitude, longitude)
    except ChartError as error:
        raise ScenarioError(f"{where} cannot be placed on chart {chart.name!r}: {error}") from error


def _check_span(rows: _Rows, track: Track, steps: int, where: str) -> None:
    start_s, end_s, last_s = track.start_s, track.start_s + steps, rows.time_s[-1]
    if last_s < end_s:
        raise ScenarioError(
            f"{where} ends {last_s:.1f} s after its first row: the mission needs it until {end_s:g} s "
            f"(track.start_s = {start_s:g} + duration_s = {steps})"
        )
    before, after = rows.time_s[:-1], rows.time_s[1:]
    gaps = after - before
    long = np.flatnonzero((before < end_s) & (after > start_s) & (gaps > track.max_gap_s))
    if long.size:
        k = int(long[0])
        more = f" (1 of {long.size} such gaps)" if long.size > 1 else ""
        raise ScenarioError(
            f"{where}: gap of {gaps[k]:g} s before line {rows.line[k + 1]}, {before[k]:g} s into the record, "
            f"is longer than track.max_gap_s = {track.max_gap_s:g} s{more}"
        )


def _at_nearest_second(time_s: Array, soundings: Array, steps: int) -> Array:
    second = np.round(time_s)
    use = np.isfinite(soundings) & (second >= 0) & (second <= steps)
    time_s, second, soundings = time_s[use], second[use].astype(np.int64), soundings[use]
    # Written farthest first, so that the nearest of a second's soundings is what stays.
    order = np.argsort(-np.abs(time_s - second), kind="stable")
    result = np.full(steps + 1, np.nan)
    result[second[order]] = soundings[order]
    return result
