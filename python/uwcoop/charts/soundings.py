"""Soundings in text files: columns by name or by place, positions geographic or projected."""

from __future__ import annotations

import gzip
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.gridding import Soundings
from uwcoop.charts.raster import NO_PROJECTION, frame_for, horizontal
from uwcoop.charts.vertical import Stated, depths_from
from uwcoop.errors import ChartError
from uwcoop.frames import Origin, crs_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    import pandas as pd
    from numpy.typing import NDArray

    Values = NDArray[np.float64]

_ROLES = {
    "lon": {"lon", "long", "longitude", "lng"},
    "lat": {"lat", "latitude"},
    "east": {"e", "east", "easting", "x"},
    "north": {"n", "north", "northing", "y"},
    "depth": {"depth", "water depth", "z", "sounding", "elevation", "elev", "height", "altitude"},
    "survey": {"survey", "session", "track", "line", "day"},
    "time": {"time", "t", "epoch", "seconds", "time s", "ms", "time ms"},
}


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
    columns: str | Sequence[str] | None = None,
    origin: Origin | None = None,
) -> Soundings:
    """Read soundings as CSV or XYZ text (.gz); see `load_chart` for the arguments.

    Raises:
        ChartError: not text, columns that cannot be told apart, a cell that is not a number, positions that
            are not positions, or see `depths_from`.
    """
    path = Path(path)
    header, width, separator = _look(path)
    wanted = tuple(c.strip() for c in columns.split(",")) if isinstance(columns, str) else columns
    chosen = _choose(header, width, wanted, crs is not None and not _geographic(crs), path.name)
    table = _table(path, separator, header is not None)
    numbers = {
        role: _numbers(table, place, chosen.label[role], header is not None)
        for role, place in chosen.place.items()
        if role not in ("survey", "time")
    }
    known = np.all([np.isfinite(values) for values in numbers.values()], axis=0)
    if not known.any():
        raise ChartError(f"{path.name} holds no sounding with a position and a depth")
    notes = [f"{known.sum():,} soundings from columns {', '.join(chosen.label.values())}", *chosen.notes]
    if not known.all():
        notes.append(f"{np.count_nonzero(~known):,} rows with an empty cell left out")
    label = chosen.label["depth"]
    stated = Stated(unit=_unit_in(label), hint=_bare(label))
    depth, vertical_notes = depths_from(numbers["depth"][known], stated, positive, depth_unit)
    positions = {role: values[known] for role, values in numbers.items() if role != "depth"}
    east, north, origin, frame_note = _local(positions, crs, origin)
    survey = table.iloc[:, chosen.place["survey"]].to_numpy()[known] if "survey" in chosen.place else None
    time_s = None
    if "time" in chosen.place:
        time_s = _seconds(table.iloc[:, chosen.place["time"]].loc[known], chosen.label["time"], notes)
    wet = np.isfinite(depth)
    return Soundings(
        east[wet],
        north[wet],
        depth[wet],
        None if survey is None else survey[wet],
        None if time_s is None else time_s[wet],
        origin,
        path.name.split(".")[0],
        (*notes, *vertical_notes, *frame_note),
    )


def _seconds(column: pd.Series[Any], label: str, notes: list[str]) -> Values | None:
    """Times in seconds; None, and a note, where they cannot be told: soundings do without."""
    import pandas as pd

    numbers = pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64)
    if np.isfinite(numbers).all():
        return numbers / 1000 if _MILLISECONDS.search(label.lower()) else numbers
    stamps = pd.to_datetime(column.astype(str), errors="coerce", utc=True, format="ISO8601")
    if stamps.isna().any():
        notes.append(f"column {label!r} holds {stamps.isna().sum():,} cells that are no time: not used")
        return None
    return np.asarray((stamps - stamps.min()).dt.total_seconds(), dtype=np.float64)


def _look(path: Path) -> tuple[list[str] | None, int, str]:
    """The header's names (None without one), the number of columns, and the separator as a pandas pattern."""
    try:
        with _open(path) as lines:
            first = next((line.strip() for line in lines if line.strip() and not line.startswith("#")), "")
    except (UnicodeDecodeError, gzip.BadGzipFile, EOFError) as error:
        raise ChartError(f"{path.name} is not a chart: neither GeoTIFF nor NetCDF, nor text") from error
    if not first:
        raise ChartError(f"{path.name} is empty: it holds no soundings")
    separator = next((s for s in (",", ";", "\t") if s in first), r"\s+")
    cells = [cell.strip().strip('"') for cell in re.split(separator, first)]
    if len(cells) < 3:
        raise ChartError(
            f"{path.name} is not a chart: its first line {first[:60]!r} does not hold three columns"
        )
    numeric = [_is_number(cell) for cell in cells]
    return (None if sum(numeric) >= 3 else cells), len(cells), separator


def _open(path: Path) -> Any:
    packed = path.read_bytes()[:2] == b"\x1f\x8b"
    return gzip.open(path, "rt", encoding="utf-8-sig") if packed else path.open(encoding="utf-8-sig")


def _choose(
    header: list[str] | None, width: int, wanted: Sequence[str] | None, prefer_projected: bool, name: str
) -> _Columns:
    if header is None:
        if wanted is None:
            raise ChartError(
                f"{name} has no header: say what its {width} columns are, as columns='lon,lat,depth'"
            )
        if len(wanted) > width:
            raise ChartError(f"{name} has {width} columns, fewer than the {len(wanted)} of columns")
        return _by_role(list(wanted), range(len(wanted)), prefer_projected, name, positional=True)
    if wanted is None:
        return _by_role(header, range(len(header)), prefer_projected, name, positional=False)
    by_name = {cell.lower(): place for place, cell in enumerate(header)}
    absent = [column for column in wanted if column.lower() not in by_name]
    if absent:
        raise ChartError(f"{name} has no column {absent[0]!r}: it has {', '.join(header)}")
    places = [by_name[column.lower()] for column in wanted]
    if len(wanted) >= 3 and any(_role(column) is None for column in wanted[:3]):
        place = dict(zip(("east", "north", "depth", "survey", "time"), places, strict=False))
        note = f"columns {', '.join(wanted[:3])} taken in the order east, north, depth"
        return _Columns(place, dict(zip(place, wanted, strict=False)), (note,))
    labels = [header[place] for place in places]
    if len(labels) >= 4 and _role(labels[3]) is None:
        chosen = _by_role(labels[:3], places[:3], prefer_projected, name, positional=True)
        extra = ("survey", "time")
        return _Columns(
            chosen.place | dict(zip(extra, places[3:], strict=False)),
            chosen.label | dict(zip(extra, labels[3:], strict=False)),
            chosen.notes,
        )
    return _by_role(labels, places, prefer_projected, name, positional=True)


def _by_role(
    labels: Sequence[str], places: Sequence[int], prefer_projected: bool, name: str, *, positional: bool
) -> _Columns:
    """Roles by recognised names; the first of two for one role, degrees before metres unless asked."""
    place: dict[str, int] = {}
    label: dict[str, str] = {}
    for text, where in zip(labels, places, strict=True):
        role = _role(text)
        if role is not None and role not in place:
            place[role], label[role] = where, text
    pairs = [("lon", "lat"), ("east", "north")]
    complete = [pair for pair in (reversed(pairs) if prefer_projected else pairs) if set(pair) <= set(place)]
    if not complete or "depth" not in place:
        missing = "depth" if complete else "position (lon and lat, or e and n)"
        said = "columns=" if positional else "its header "
        raise ChartError(
            f"{name} has no column for the {missing}: {said}{','.join(labels)!r}; "
            "name them, as columns='e,n,depth'"
        )
    notes: tuple[str, ...] = ()
    if len(complete) == 2:
        notes = (f"positions from {' and '.join(label[r] for r in complete[0])}; "
                 f"{' and '.join(label[r] for r in complete[1])} not used",)  # fmt: skip
    kept = [*complete[0], "depth", *(role for role in ("survey", "time") if role in place)]
    return _Columns({role: place[role] for role in kept}, {role: label[role] for role in kept}, notes)


def _role(label: str) -> str | None:
    bare = _bare(label)
    if _MILLISECONDS.sub("", bare).strip(" _()[]") in _ROLES["time"]:
        return "time"
    return next((role for role, names in _ROLES.items() if bare in names), None)


_MILLISECONDS = re.compile(r"(^|[ _([])ms\b|millisecond")
_UNIT_SUFFIX = re.compile(r"[ _]*[\[(]?\b(m|meters?|metres?|ft|feet|foot|fathoms?|deg|degrees)[\])]?$")


def _bare(label: str) -> str:
    """A column's name without its unit: "depth" for "Depth_m" and "depth (ft)"."""
    plain = label.lower().replace("_", " ").strip()
    return _UNIT_SUFFIX.sub("", plain).strip() or plain


def _unit_in(label: str) -> str:
    found = _UNIT_SUFFIX.search(label.lower().replace("_", " ").strip())
    return found.group(1) if found and found.start() > 0 else ""


def _table(path: Path, separator: str, has_header: bool) -> pd.DataFrame:
    import pandas as pd

    try:
        return pd.read_csv(
            path,
            sep=separator,
            header=0 if has_header else None,
            comment="#",
            skipinitialspace=True,
            compression="gzip" if path.read_bytes()[:2] == b"\x1f\x8b" else None,
            encoding="utf-8-sig",
            low_memory=False,
            index_col=False,
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError, EOFError, OSError) as error:
        raise ChartError(f"{path.name} cannot be read as soundings: {str(error).splitlines()[0]}") from error


def _numbers(table: pd.DataFrame, place: int, label: str, has_header: bool) -> Values:
    import pandas as pd

    column = table.iloc[:, place]
    numbers = pd.to_numeric(column, errors="coerce")
    wrong = numbers.isna() & column.notna()
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise ChartError(
            f"column {label!r} holds {str(column.iloc[row])!r} in data row {row + 1}: not a number"
        )
    return np.asarray(numbers, dtype=np.float64)


def _local(
    positions: dict[str, Values], crs: str | None, origin: Origin | None
) -> tuple[Values, Values, Origin, tuple[str, ...]]:
    """Local eastings and northings, metres, the frame's origin, and notes."""
    from_degrees = "lon" in positions
    if not from_degrees and (crs is None or crs == "local"):
        return positions["east"], positions["north"], origin or Origin(), (NO_PROJECTION,)
    axes = horizontal(crs_of(crs or "EPSG:4326")) if crs != "local" else None
    if axes is None or (from_degrees and not axes.is_geographic):
        raise ChartError(f"positions are longitudes and latitudes, which crs={crs!r} does not have")
    if not from_degrees and axes.is_geographic:
        raise ChartError(
            f"positions are eastings and northings, but crs={crs!r} is in degrees: name them lon, lat"
        )
    x, y = (positions["lon"], positions["lat"]) if from_degrees else (positions["east"], positions["north"])
    if from_degrees:
        _check_degrees(x, y)
    # The middle of nearly all: one stray position must not move the whole chart.
    middle = [float(np.quantile(a, [0.01, 0.99]).mean()) for a in (x, y)]
    frame = frame_for(axes, middle[0], middle[1], origin)
    local = frame.local_from(axes, x, y)
    assumed = ("datum not stated: WGS 84 assumed",) if crs is None else ()
    return local[:, 0], local[:, 1], frame.origin, (*assumed, frame.description)


def _check_degrees(longitude: Values, latitude: Values) -> None:
    for name, values, bound in (("latitude", latitude, 90.0), ("longitude", longitude, 360.0)):
        worst = float(values[np.argmax(np.abs(values))])
        if abs(worst) > bound:
            raise ChartError(
                f"{name} {worst:g} deg is outside -{bound:g} to {bound:g} deg: are columns in another order?"
            )


def _geographic(crs: str) -> bool:
    return crs != "local" and bool(crs_of(crs).is_geographic)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
