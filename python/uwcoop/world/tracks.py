"""Recorded tracks on one clock and in one frame, checked before anything is simulated, at whole seconds."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import ChartError, ScenarioError
from uwcoop.frames import LocalFrame, crs_of, transformer
from uwcoop.world.track_file import TrackRows, read_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.frames import Origin
    from uwcoop.scenario.vehicle import Track, Vehicle

    Array = NDArray[np.float64]

FAR_M = 100_000.0
"""Beyond it distances are taken on the ellipsoid: a chart's projection does not reach."""
_DEGREES_SPAN = 5.0


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
    notes: tuple[str, ...]
    """What was assumed, dropped or converted, one sentence each."""


@dataclass(frozen=True)
class _Read:
    vehicle: Vehicle
    track: Track
    where: str
    rows: TrackRows


def read_tracks(
    team: Sequence[Vehicle], chart: Chart | None, origin: Origin | None, steps: int
) -> dict[str, Record]:
    """The records of the vehicles that have one, by name, on one clock.

    Records with absolute times keep them: the mission starts at the first instant at which each of them has run for
    its `track.start_s`. So do records with times of day alone. A record whose times count from a zero of its own
    starts at its first row plus `start_s`.

    Args:
        team: vehicles, those with a track and others.
        chart: what vehicles sound.
        origin: of the frame in which positions are wanted; None: the chart's.
        steps: the mission's seconds.

    Raises:
        ScenarioError: a file, column, cell, order or gap that cannot be used, records that do not overlap, a speed
            above `track.max_speed_mps`, a track off the chart; one line with vehicle, file and line.
    """
    read = []
    for vehicle in team:
        if vehicle.track is not None:
            where = f"vehicle {vehicle.name}: track {vehicle.track.file}"
            read.append(_Read(vehicle, vehicle.track, where, read_rows(vehicle.track, where)))
    starts, notes = _starts_ns(read)
    return {
        one.vehicle.name: _record(one, start_ns, chart, origin, steps, [*one.rows.notes, *more])
        for one, start_ns, more in zip(read, starts, notes, strict=True)
    }


def _starts_ns(read: list[_Read]) -> tuple[list[int], list[list[str]]]:
    """Each record's time at the mission's start, and notes on what was assumed."""
    own = [int(one.rows.t_ns[0]) + round(one.track.start_s * 1e9) for one in read]
    starts, notes = list(own), [list[str]() for _ in read]
    clocks = {one.rows.clock for one in read}
    for clock in ("absolute", "time of day"):
        group = [k for k, one in enumerate(read) if one.rows.clock == clock]
        if len(group) < 2:
            continue
        last = max(group, key=lambda k: own[k])
        begin = _instant(own[last], clock)
        for k in group:
            starts[k] = own[last]
            end_ns = int(read[k].rows.t_ns[-1])
            if end_ns <= own[last]:
                raise ScenarioError(
                    f"{read[k].where} ends at {_instant(end_ns, clock)}, before the record of vehicle "
                    f"{read[last].vehicle.name}, {read[last].track.file}, starts at {begin}: they must overlap"
                )
            if k != last and own[k] != own[last]:
                notes[k].append(f"the mission starts at {begin}, {(own[last] - own[k]) / 1e9:g} s further on")
        if clock == "time of day":
            names = ", ".join(read[k].vehicle.name for k in group)
            notes[group[0]].append(f"times of day without a date: {names} taken for the same day")
    if len(read) > 1 and ({"own"} & clocks or len(clocks) > 1):
        for k, one in enumerate(read):
            clock = "a zero of its own" if one.rows.clock == "own" else f"the clock {one.rows.clock!r}"
            notes[k].append(
                f"its times count on {clock}, which not every record shares: line {one.rows.line[0]} plus start_s is put "
                "at the mission's start"
            )
    return starts, notes


def _instant(t_ns: int, clock: str) -> str:
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=t_ns // 1000)
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC" if clock == "absolute" else f"{moment:%H:%M:%S}"


def _record(
    one: _Read, start_ns: int, chart: Chart | None, origin: Origin | None, steps: int, notes: list[str]
) -> Record:
    rows, track, where = one.rows, one.track, one.where
    time_s = (rows.t_ns - start_ns) / 1e9
    position = _local(one, chart, origin)
    _check_speed(position, rows, track, where)
    _check_span(rows, time_s, track, steps, where)
    seconds = np.arange(steps + 1.0)
    depth = np.full(steps + 1, one.vehicle.depth_m)
    if "depth" in rows.cells:
        above = rows.cells["depth"] < 0
        if above.any():
            notes.append(
                f"{above.sum()} own depths above the surface, down to {rows.cells['depth'].min():g} m: taken as 0"
            )
        depth = np.maximum(np.interp(seconds, time_s, rows.cells["depth"]), 0.0)
    east, north = (np.interp(seconds, time_s, axis) for axis in position.T)
    used = (time_s >= 0) & (time_s <= steps)
    sounded = used & np.isfinite(rows.cells["sounding"]) if "sounding" in rows.cells else None
    at = np.column_stack([east, north]) if sounded is None else position[sounded]
    notes += _on_the_chart(at, "seconds" if sounded is None else "soundings", one, chart)
    soundings = None
    if "sounding" in rows.cells:
        soundings = _at_nearest_second(time_s, rows.cells["sounding"], steps)
    said = tuple(f"{where}: {note}" for note in notes)
    return Record(np.column_stack([east, north]), depth, soundings, said)


def _local(one: _Read, chart: Chart | None, origin: Origin | None) -> Array:
    """Positions in the local frame, (N, 2)."""
    cells, where, track = one.rows.cells, one.where, one.track
    if "longitude" not in cells and track.crs is None:
        position = np.column_stack([cells["east"], cells["north"]])
        _refuse_degrees(position, one)
        return position
    if origin is None or origin.latitude_deg is None:
        origin = None if chart is None else chart.origin
    if origin is None:
        raise ScenarioError(
            f"{where} has no place to go: its positions need a [chart], whose frame they get, or an [origin]"
        )
    try:
        frame = LocalFrame(origin)
        if "longitude" in cells:
            latitude, longitude = cells["latitude"], cells["longitude"]
        else:
            to_wgs84 = transformer(crs_of(track.crs), "EPSG:4326")
            longitude, latitude = to_wgs84.transform(cells["east"], cells["north"])
        _refuse_far(latitude, longitude, one, frame, chart)
        return frame.to_local(latitude, longitude)
    except ChartError as error:
        name = "the frame" if chart is None else f"chart {chart.name!r}"
        raise ScenarioError(f"{where} cannot be placed on {name}: {error}") from error


def _refuse_degrees(position: Array, one: _Read) -> None:
    """Metres that lie like degrees: a track that does not move, written with the decimals of degrees."""
    first, second = position.T
    length_m = np.hypot(*np.diff(position, axis=0).T).sum()
    fine = np.mean(np.abs(position - np.round(position, 3)) > 1e-9) > 0.5
    if fine and 0 < length_m < 1.0 and np.abs(position).max() > 1 and np.ptp(position, axis=0).max() < _DEGREES_SPAN and (
        np.abs(first).max() <= 360 and np.abs(second).max() <= 90
    ):  # fmt: skip
        raise ScenarioError(
            f"{one.where}: east and north [{first[0]:.10g}, {second[0]:.10g}] in line {one.rows.line[0]} look like "
            f"degrees, all rows within {length_m:.3g} m: name them longitude and latitude"
        )


def _refuse_far(
    latitude: Array, longitude: Array, one: _Read, frame: LocalFrame, chart: Chart | None
) -> None:
    """Refuse a track so far away that the chart's projection does not reach it."""
    from pyproj import Geod

    if not np.isfinite(latitude).all() or not np.isfinite(longitude).all():
        raise ScenarioError(f"{one.where}: positions are outside of the area of projection {one.track.crs!r}")
    west, south, east, north = (0.0, 0.0, 0.0, 0.0) if chart is None else chart.extent
    centre = [[(west + east) / 2, (south + north) / 2]]
    lat0, lon0 = frame.to_geographic(centre)[0]
    geod = Geod(ellps="WGS84")
    distance = np.asarray(
        geod.inv(np.full_like(longitude, lon0), np.full_like(latitude, lat0), longitude, latitude)[2]
    )
    # As far as the chart reaches a row may lie off its middle.
    reach_m = FAR_M + float(np.hypot(east - west, north - south))
    if distance.min() > reach_m:
        raise ScenarioError(
            f"{one.where}: track lies {_distance(float(distance.min()))} from {_target(chart)}"
            f"{_hint(latitude, longitude, lat0, lon0)}"
        )
    wild = distance > reach_m
    if wild.any():
        k = int(np.argmax(wild))
        raise ScenarioError(
            f"{one.where}: position {latitude[k]:.6f}, {longitude[k]:.6f} in line {one.rows.line[k]} lies "
            f"{_distance(float(distance[k]))} from {_target(chart)} ({wild.sum()} such rows)"
        )


def _target(chart: Chart | None) -> str:
    return "the origin" if chart is None else "the chart"


def _hint(latitude: Array, longitude: Array, lat0: float, lon0: float) -> str:
    """What would bring the track to the chart, if it is a usual mistake."""
    lat, lon = float(np.median(latitude)), float(np.median(longitude))
    for other, what in (
        ((lat, -lon), "the other sign of longitude"),
        ((-lat, lon), "the other sign of latitude"),
        ((lon, lat), "latitude and longitude swapped"),
    ):
        if abs(other[0] - lat0) < 0.5 and abs((other[1] - lon0 + 180) % 360 - 180) < 0.5:
            return f"; with {what} it would lie near it"
    return ""


def _distance(metres: float) -> str:
    return (
        f"{metres / 1000:,.0f} km"
        if metres >= 1e5
        else f"{metres / 1000:.3g} km"
        if metres >= 1000
        else f"{metres:.0f} m"
    )


def _check_speed(position: Array, rows: TrackRows, track: Track, where: str) -> None:
    """Refuse moves that no vehicle makes. Within a second a fix's own noise counts for less."""
    moved = np.hypot(*np.diff(position, axis=0).T)
    took_s = np.maximum(np.diff(rows.t_ns) / 1e9, 1.0)
    fast = np.flatnonzero(moved / took_s > track.max_speed_mps)
    if fast.size:
        k = int(fast[0])
        more = f" (1 of {fast.size} such moves)" if fast.size > 1 else ""
        raise ScenarioError(
            f"{where}: moves {moved[k]:.1f} m in {np.diff(rows.t_ns)[k] / 1e9:g} s to line {rows.line[k + 1]}, "
            f"{moved[k] / took_s[k]:.3g} m/s: must be at most track.max_speed_mps = {track.max_speed_mps:g}{more}"
        )


def _on_the_chart(points: Array, what: str, one: _Read, chart: Chart | None) -> list[str]:
    """Refuse a track no part of which is on the chart; a note where some is not."""
    if chart is None or not len(points):
        return []
    off = np.isnan(chart.depth_at(points))
    if off.all():
        west, south, east, north = chart.extent
        beside = np.maximum(np.maximum([west, south] - points, points - [east, north]), 0)
        nearest_m = float(np.hypot(*beside.T).min())
        place = (
            f"track lies {_distance(nearest_m)} from the chart"
            if nearest_m
            else "track lies over holes of the chart"
        )
        raise ScenarioError(f"{one.where}: {place} {chart.name!r}: none of {len(points):,} {what} is on it")
    if off.any():
        return [
            f"{off.sum():,} of {len(points):,} {what} ({100 * off.mean():.1f} %) lie off the chart or over its holes: "
            "no terrain to compare with there"
        ]
    return []


def _check_span(rows: TrackRows, time_s: Array, track: Track, steps: int, where: str) -> None:
    first_s, last_s = float(time_s[0]), float(time_s[-1])
    if last_s < steps:
        raise ScenarioError(
            f"{where} ends {last_s - first_s:.1f} s after its first row: the mission needs it until "
            f"{steps - first_s:g} s (it starts {-first_s:g} s after the first row, duration_s = {steps})"
        )
    before, after = time_s[:-1], time_s[1:]
    gaps = after - before
    long = np.flatnonzero((before < steps) & (after > 0) & (gaps > track.max_gap_s))
    if long.size:
        k = int(long[0])
        more = f" (1 of {long.size} such gaps)" if long.size > 1 else ""
        raise ScenarioError(
            f"{where}: gap of {gaps[k]:g} s before line {rows.line[k + 1]}, {before[k] - first_s:g} s into the record, "
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
