"""Soundings in text files: columns by name or by place, positions geographic or projected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.grid_source import Reading
from uwcoop.charts.gridding import Soundings
from uwcoop.charts.places import NO_PROJECTION, check_degrees, frame_for, horizontal, strays, unwrapped
from uwcoop.charts.vertical import Stated, depths_from
from uwcoop.errors import ChartError, TableError
from uwcoop.frames import Origin, crs_of
from uwcoop.importers.column_roles import assign_roles, split_label
from uwcoop.importers.text_table import open_table
from uwcoop.importers.times import parse_times

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import NDArray

    from uwcoop.charts.places import Area
    from uwcoop.importers.text_table import Rows, TextTable

    Values = NDArray[np.float64]

_ROLES = {
    "lon": {"lon", "long", "longitude", "lng", "longitud"},
    "lat": {"lat", "latitude", "latitud"},
    "east": {"e", "east", "easting", "x"},
    "north": {"n", "north", "northing", "y"},
    "depth": {
        "depth",
        "water depth",
        "z",
        "sounding",
        "elevation",
        "elev",
        "height",
        "altitude",
        "bathymetry",
    },
    "survey": {"survey", "session", "track", "line", "day"},
    "time": {"time", "t", "epoch", "seconds", "ms", "timestamp", "date time", "datetime"},
}
_PAIRS = (("lon", "lat"), ("east", "north"))
_DEGREES = ("", "°", "º", "°n", "°e", "deg", "degree", "degrees", "dd", "decimal degrees")


@dataclass(frozen=True)
class _Columns:
    """Which column of the file plays which role (by place), how each is called, and notes on the choice."""

    place: dict[str, int]
    label: dict[str, str]
    notes: tuple[str, ...] = ()


def load_soundings(
    path: str | PathLike[str],
    *,
    crs: str | None = None,
    positive: str | None = None,
    depth_unit: str | None = None,
    nodata: float | None = None,
    area: Area | None = None,
    columns: str | Sequence[str] | None = None,
    origin: Origin | None = None,
) -> Soundings:
    """Read soundings as CSV or XYZ text (.gz); see `load_chart` for the arguments.

    Raises:
        ChartError: not text, columns that cannot be told apart, a cell that is not a number, positions that
            are not positions, or see `depths_from`.
    """
    path, reading = Path(path), Reading(crs, positive, depth_unit, nodata, area)
    try:
        table = open_table(path)
        chosen = _choose(table, columns, reading.crs is not None and not _geographic(reading.crs))
        numeric = {role: place for role, place in chosen.place.items() if role not in ("survey", "time")}
        rows = table.read(numeric, {r: p for r, p in chosen.place.items() if r not in numeric})
    except TableError as error:
        raise ChartError(f"soundings cannot be read: {error}") from error
    known = np.all([np.isfinite(values) for values in rows.numbers.values()], axis=0)
    if not known.any():
        raise ChartError(f"{path.name} holds no sounding with a position and a depth")
    notes = [
        f"{known.sum():,} soundings from columns {', '.join(chosen.label.values())}",
        *table.notes,
        *chosen.notes,
    ]
    if not known.all():
        notes.append(f"{np.count_nonzero(~known):,} rows with an empty cell left out")
    _refuse_units(table, chosen)
    label = chosen.label["depth"]
    stated = Stated(unit=table.units[chosen.place["depth"]], hint=split_label(label)[0])
    depth = np.full(known.size, np.nan)
    depth[known], vertical_notes = depths_from(
        rows.numbers["depth"][known], stated, reading.positive, reading.depth_unit, nodata=reading.nodata,
        counted="soundings",
    )  # fmt: skip
    use = known & np.isfinite(depth)
    x, y, use, place_notes = _positions(rows, use, reading, path.name)
    east, north, origin, frame_notes = _local(x, y, "lon" in rows.numbers, reading.crs, origin)
    return Soundings(
        east,
        north,
        depth[use],
        rows.texts["survey"][use] if "survey" in rows.texts else None,
        _seconds(rows, use, table, chosen, notes),
        origin,
        path.name.split(".")[0],
        (*notes, *vertical_notes, *place_notes, *frame_notes),
    )


def joined(surveys: Sequence[Soundings]) -> Soundings:
    """The soundings of several files as one; a file is a survey where its own column does not name any.

    Raises:
        ChartError: some lie at places on Earth and some in local metres.
    """
    first = surveys[0]
    if any(s.origin != first.origin for s in surveys):
        raise ChartError("some of the files lie at places on Earth and some in local metres: give crs")
    labels = [
        np.array([f"{k} {s.name}" if s.survey is None else f"{k} {s.name} {own}"
                  for own in (range(1) if s.survey is None else s.survey)], dtype=object)
        for k, s in enumerate(surveys)
    ]  # fmt: skip
    survey = np.concatenate(
        [
            np.repeat(label, s.depth_m.size) if s.survey is None else label
            for label, s in zip(labels, surveys, strict=True)
        ]
    )
    times = [s.time_s for s in surveys]
    said = [f"{s.name}: {note}" for s in surveys for note in s.notes if note not in first.notes or s is first]
    return replace(
        first,
        east_m=np.concatenate([s.east_m for s in surveys]),
        north_m=np.concatenate([s.north_m for s in surveys]),
        depth_m=np.concatenate([s.depth_m for s in surveys]),
        survey=survey,
        time_s=None if any(t is None for t in times) else np.concatenate([t for t in times if t is not None]),
        notes=(f"{len(surveys)} files, each a survey of its own", *said),
    )


def _positions(
    rows: Rows, use: NDArray[np.bool_], reading: Reading, name: str
) -> tuple[Values, Values, NDArray[np.bool_], tuple[str, ...]]:
    """Positions as the file has them, which rows they are of, and notes on those left out."""
    degrees = "lon" in rows.numbers
    x, y = (rows.numbers[role] for role in _PAIRS[0 if degrees else 1])
    notes: list[str] = []
    if degrees:
        check_degrees(x[use], y[use])
        x = x.copy()
        x[use] = unwrapped(x[use])
    stray = np.zeros(use.size, dtype=bool)
    stray[use] = strays(x[use], y[use], degrees)
    if stray.any():
        at = int(np.flatnonzero(stray)[0])
        where = f"{y[at]:g} N, {x[at]:g} E" if degrees else f"east {x[at]:g}, north {y[at]:g}"
        notes.append(
            f"{np.count_nonzero(stray):,} of {np.count_nonzero(use):,} soundings lie far from all others and are left "
            f"out: the first at {where} in line {rows.line[at]}"
        )
        use = use & ~stray
        if degrees:  # strays no longer turn the middle
            x[use] = unwrapped(x[use])
    if reading.area is not None:
        crs = (
            None
            if reading.crs == "local"
            else crs_of(reading.crs or "EPSG:4326")
            if degrees or reading.crs
            else None
        )
        west, south, east, north = reading.area.bounds(
            None if crs is None else horizontal(crs), float(np.median(x[use]))
        )
        inside = use & (x >= west) & (x <= east) & (y >= south) & (y <= north)
        if not inside.any():
            raise ChartError(f"area {reading.area} holds none of the soundings of {name}")
        notes.append(
            f"area {reading.area}: {np.count_nonzero(inside):,} of {np.count_nonzero(use):,} soundings"
        )
        use = inside
    return x[use], y[use], use, tuple(notes)


def _seconds(
    rows: Rows, use: NDArray[np.bool_], table: TextTable, chosen: _Columns, notes: list[str]
) -> Values | None:
    """Times in seconds; None, and a note, where they cannot be told: soundings do without."""
    if "time" not in rows.texts:
        return None
    label = chosen.label["time"]
    unit = table.units[chosen.place["time"]] or split_label(label)[0]
    try:
        times = parse_times(rows.texts["time"][use].tolist(), unit=unit, label=label)
    except TableError as error:
        notes.append(f"times not used: {error}")
        return None
    return times.seconds if times.absolute else times.t_ns / 1e9


def _choose(table: TextTable, columns: str | Sequence[str] | None, prefer_projected: bool) -> _Columns:
    name, labels, width = table.path.name, table.labels, len(table.labels)
    wanted = tuple(c.strip() for c in columns.split(",")) if isinstance(columns, str) else columns
    if width < 3:
        raise ChartError(
            f"{name} is not a chart: its first line {' '.join(labels)[:60]!r} does not hold three columns"
        )
    unnamed = not table.has_header or (
        table.dialect.header_is_comment and wanted is not None and not {*wanted} <= {*labels}
    )
    if unnamed:
        if wanted is None:
            raise ChartError(
                f"{name} has no header: say what its {width} columns are, as columns='lon,lat,depth'"
            )
        if len(wanted) > width:
            raise ChartError(f"{name} has {width} columns, fewer than the {len(wanted)} of columns")
        return _by_role(list(wanted), range(len(wanted)), prefer_projected, name, asked=True)
    if wanted is None:
        return _by_role(labels, range(width), prefer_projected, name, asked=False)
    places = [table.place(column) for column in wanted]
    roles = assign_roles(wanted[:3], _ROLES).place
    if len(wanted) >= 3 and len(roles) < 3:
        place = dict(zip(("east", "north", "depth", "survey", "time"), places, strict=False))
        note = f"columns {', '.join(wanted[:3])} taken in the order east, north, depth"
        return _Columns(place, dict(zip(place, wanted, strict=False)), (note,))
    named = [labels[place] for place in places]
    if len(named) >= 4 and not assign_roles(named[3:4], _ROLES).place:
        chosen = _by_role(named[:3], places[:3], prefer_projected, name, asked=True)
        extra = ("survey", "time")
        return _Columns(
            chosen.place | dict(zip(extra, places[3:], strict=False)),
            chosen.label | dict(zip(extra, named[3:], strict=False)),
            chosen.notes,
        )
    return _by_role(named, places, prefer_projected, name, asked=True)


def _by_role(
    labels: Sequence[str], places: Sequence[int], prefer_projected: bool, name: str, *, asked: bool
) -> _Columns:
    """Roles by recognised names; the first of two for one role, degrees before metres unless asked."""
    roles = assign_roles(labels, _ROLES)
    label = {role: labels[k] for role, k in roles.place.items()}
    complete = [pair for pair in (_PAIRS[::-1] if prefer_projected else _PAIRS) if set(pair) <= set(label)]
    if not complete or "depth" not in label:
        missing = "depth" if complete else "position (lon and lat, or e and n)"
        said = "columns=" if asked else "its header "
        raise ChartError(
            f"{name} has no column for the {missing}: {said}{','.join(labels)!r}; "
            "name them, as columns='e,n,depth'"
        )
    kept = [*complete[0], "depth", *(role for role in ("survey", "time") if role in label)]
    notes = [f"column {text!r} taken as {role}" for role, text in roles.guessed.items() if role in kept]
    if len(complete) == 2:
        used, unused = (" and ".join(label[role] for role in pair) for pair in complete)
        notes.append(f"positions from {used}; {unused} not used")
    return _Columns(
        {role: places[roles.place[role]] for role in kept}, {role: label[role] for role in kept}, tuple(notes)
    )


def _refuse_units(table: TextTable, chosen: _Columns) -> None:
    """Refuse positions in units that are neither degrees nor metres."""
    for role in ("lon", "lat", "east", "north"):
        if role not in chosen.place:
            continue
        unit = table.units[chosen.place[role]].lower().replace("_", " ")
        known = _DEGREES if role in ("lon", "lat") else ("", "m", "meter", "meters", "metre", "metres")
        if unit not in known and not (role in ("lon", "lat") and unit.startswith("degree")):
            what = "degrees" if role in ("lon", "lat") else "metres"
            raise ChartError(f"column {chosen.label[role]!r} states {unit!r}: positions must be in {what}")


def _local(
    x: Values, y: Values, from_degrees: bool, crs: str | None, origin: Origin | None
) -> tuple[Values, Values, Origin, tuple[str, ...]]:
    """Local eastings and northings, metres, the frame's origin, and notes."""
    if not from_degrees and (crs is None or crs == "local"):
        if crs is None:
            _refuse_degrees(x, y)
        return x, y, origin or Origin(), (NO_PROJECTION,)
    axes = horizontal(crs_of(crs or "EPSG:4326")) if crs != "local" else None
    if axes is None or (from_degrees and not axes.is_geographic):
        raise ChartError(f"positions are longitudes and latitudes, which crs={crs!r} does not have")
    if not from_degrees and axes.is_geographic:
        raise ChartError(
            f"positions are eastings and northings, but crs={crs!r} is in degrees: name them lon, lat"
        )
    # The middle of nearly all: one stray position must not move the whole chart.
    middle = [float(np.quantile(a, [0.01, 0.99]).mean()) for a in (x, y)]
    frame, notes = frame_for(axes, middle[0], middle[1], origin)
    local = frame.local_from(axes, x, y)
    if not np.isfinite(local).all():
        raise ChartError(
            f"{np.count_nonzero(~np.isfinite(local[:, 0])):,} positions lie outside of the projection"
        )
    assumed = ("datum not stated: WGS 84 assumed",) if crs is None else ()
    return local[:, 0], local[:, 1], frame.origin, (*assumed, *notes, frame.description)


def _refuse_degrees(x: Values, y: Values) -> None:
    """Refuse columns called x and y that can only be degrees: no survey spans so few metres in steps of microns."""
    extent = max(float(np.ptp(x)), float(np.ptp(y)))
    fine = float(np.mean(np.abs(x * 1000 - np.round(x * 1000)) > 1e-6)) > 0.5
    if extent < 5.0 and fine and np.abs(x).max() <= 360 and np.abs(y).max() <= 90:
        raise ChartError(
            f"positions {x.min():.6g} to {x.max():.6g}, {y.min():.6g} to {y.max():.6g} look like degrees, not metres: "
            "name the columns lon and lat (columns='lon,lat,depth'), or give crs='local'"
        )


def _geographic(crs: str) -> bool:
    return crs != "local" and bool(crs_of(crs).is_geographic)
