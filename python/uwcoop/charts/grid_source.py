"""A grid in a file, whatever its format: what every reader gives, and the one way from there to depths.

Readers state the axes and read rows and columns on demand; here the wanted part is chosen, its size bounded before
anything is read, and its numbers judged, so that no reader does that by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.places import check_degrees, horizontal, unwrapped_axis
from uwcoop.charts.raster import MAX_NODES, Raster, ascending, check_size
from uwcoop.charts.vertical import Stated, depths_from, metres_per_unit
from uwcoop.errors import ChartError
from uwcoop.frames import crs_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.charts.places import Area

    Grid = NDArray[Any]

LONGEST_AXIS = 10_000_000
"""Rows or columns; a file that declares more is damaged, and its axes alone would fill the memory."""


@dataclass(frozen=True)
class Reading:
    """How a caller wants a grid to be read; None where the file or the reader's own rule shall decide."""

    crs: str | None = None
    positive: str | None = None
    depth_unit: str | None = None
    nodata: float | None = None
    area: Area | None = None
    cell_m: float | None = None
    mission_area: Callable[[], Area | None] | None = field(default=None, compare=False)
    """What is read of a grid of more nodes than are read whole, where no area is asked for; asked for that alone."""


@dataclass(frozen=True)
class GridSource:
    """A grid that was opened and not yet read."""

    name: str
    """Of the file, for messages."""
    x: Grid
    """(cols,) positions of the columns in the file's order, which may descend."""
    y: Grid
    """(rows,) of the rows."""
    crs: Any
    """Horizontal pyproj CRS of the positions; None: local metres."""
    stated: Stated
    read: Callable[[slice, slice], tuple[Grid, Grid | None]]
    """Numbers and their standard deviations at rows and columns; NaN where the file states that there are none."""
    notes: tuple[str, ...] = ()
    header: str = ""
    """What `uwcoop.charts.stored` put beside the grid; empty for the files of others."""


def raster_of(source: GridSource, reading: Reading) -> Raster:
    """The depths of a source, or of the area wanted of it.

    Raises:
        ChartError: an area off the grid, too many nodes, positions that are none, or see `depths_from`.
    """
    x, y = source.x, source.y
    if source.crs is not None and source.crs.is_geographic:
        check_degrees(x, y)
        x = unwrapped_axis(x)
    notes = list(source.notes)
    area, whose = reading.area, "area"
    if area is None and reading.mission_area is not None and x.size * y.size > MAX_NODES:
        area, whose = reading.mission_area(), "the mission's area"
    rows, cols = _window(source.name, x, y, source.crs, area, whose, notes)
    check_size(rows.stop - rows.start, cols.stop - cols.start)
    values, sigma = source.read(rows, cols)
    if sigma is not None and sigma.shape != values.shape:
        raise ChartError(f"{source.name}: uncertainty of {sigma.shape} nodes beside {values.shape} depths")
    depth, said = depths_from(
        values, source.stated, reading.positive, reading.depth_unit, nodata=reading.nodata
    )
    if sigma is not None:
        sigma = _sigma(sigma * metres_per_unit(source.stated.unit, reading.depth_unit)[0], depth, notes)
    depth, x_up, y_up = ascending(depth, x[cols], y[rows])
    sigma = None if sigma is None else ascending(sigma, x[cols], y[rows])[0]
    return Raster(depth, x_up, y_up, source.crs, (*notes, *said), sigma)


def _window(
    name: str, x: Grid, y: Grid, crs: Any, area: Area | None, whose: str, notes: list[str]
) -> tuple[slice, slice]:
    """Rows and columns of the area wanted and one node around it."""
    if area is None:
        return slice(0, y.size), slice(0, x.size)
    west, south, east, north = area.bounds(crs, float(x[0] + x[-1]) / 2)
    cols, rows = _between(x, west, east), _between(y, south, north)
    if cols is None or rows is None:
        swapped = "; is it longitude,latitude? An area is latitude,longitude of two opposite corners"
        inside = _between(x, south, north) is not None and _between(y, west, east) is not None
        raise ChartError(
            f"{whose} {area} lies off {name}, which reaches from {min(x[0], x[-1]):.8g} to {max(x[0], x[-1]):.8g} east "
            f"and from {min(y[0], y[-1]):.8g} to {max(y[0], y[-1]):.8g} north"
            + (swapped if crs.is_geographic and inside else "")
        )
    whole = f"{y.size:,} x {x.size:,}"
    notes.append(
        f"{whose} {area}: {rows.stop - rows.start:,} x {cols.stop - cols.start:,} of {whole} nodes read"
    )
    return rows, cols


def _between(axis: Grid, low: float, high: float) -> slice | None:
    """The nodes of an axis from `low` to `high` and one on either side; None where the axis lies elsewhere."""
    if high < min(axis[0], axis[-1]) or low > max(axis[0], axis[-1]):
        return None
    inside = np.flatnonzero((axis >= low) & (axis <= high))
    if not inside.size:  # between two nodes
        nearest = int(np.argmin(np.abs(axis - (low + high) / 2)))
        inside = np.array([nearest])
    return slice(max(0, int(inside[0]) - 1), min(axis.size, int(inside[-1]) + 2))


def _sigma(sigma: Grid, depth: Grid, notes: list[str]) -> Grid | None:
    """Standard deviations that can be: where a depth has none, the largest that the grid has."""
    wet = np.isfinite(depth)
    with np.errstate(invalid="ignore"):
        good = wet & np.isfinite(sigma) & (sigma >= 0) & (sigma < np.maximum(depth, 1000.0))
    missing = int(np.count_nonzero(wet & ~good))
    if not good.any():
        notes.append("the file's uncertainty holds no standard deviation: not used")
        return None
    if missing:
        largest = float(sigma[good].max())
        notes.append(
            f"{missing:,} nodes with a depth have no uncertainty: the largest of the others, {largest:.3g} m, taken"
        )
        sigma = np.where(wet & ~good, largest, sigma)
    return np.where(wet, sigma, np.nan)


def check_axes(name: str, rows: int, cols: int) -> None:
    """Refuse a grid whose axes alone would fill the memory, before they are made."""
    if max(rows, cols) > LONGEST_AXIS or min(rows, cols) < 2:
        check_size(min(rows, 2), min(cols, 2))
        raise ChartError(f"{name} declares {rows:,} x {cols:,} nodes: it is damaged")


def stated_crs(asked: str | None, found: Callable[[], Any], name: str) -> tuple[Any, tuple[str, ...]]:
    """The horizontal CRS asked for (None: local metres) or else found in the file, and notes.

    Raises:
        ChartError: neither.
    """
    if asked == "local":
        return None, ("projection: local metres as asked",)
    if asked is not None:
        return horizontal(crs_of(asked)), (f"projection {asked} as asked",)
    crs = found()
    if crs is None:
        raise ChartError(
            f"{name} states no projection: give crs, such as EPSG:32654, or crs='local' for local metres"
        )
    return horizontal(crs), ()
