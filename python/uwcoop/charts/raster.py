"""From a grid in some map projection to a chart in local metres.

A grid of square metres keeps its nodes. Anything else (degrees, feet, oblong cells, another cell asked for)
is resampled bilinearly to a square metric grid, after averaging where the new cells are much larger.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.chart import Chart
from uwcoop.charts.places import NO_PROJECTION, frame_for, is_metric
from uwcoop.charts.windows import window_sums
from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame, Origin, crs_of, crs_text, transformer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Grid = NDArray[Any]

MAX_NODES = 16_000_000
"""A grid of more nodes than this is refused before anything is read or made: 4 km × 4 km at one metre, and half a
gigabyte of memory on the way to a chart."""


CORRELATION_LENGTH_M = 10.0
"""Usual correlation length of a surveyed chart's error, where nothing measures it."""


@dataclass(frozen=True)
class Quality:
    """How far the caller trusts a chart; None where the reader's own rule shall decide."""

    sigma_map_m: float | None = None
    correlation_length_m: float | None = None
    by_slope: bool = False
    """Let the error of a chart of soundings grow with its slope, as their residuals do."""


@dataclass(frozen=True)
class Raster:
    """Depths (rows, cols), metres, at the crossings of `y` (rows,) and `x` (cols,), both ascending.

    `crs` is a pyproj CRS or None for local metres; x and y are in its unit. `sigma_m` is as `depth_m`, or
    None.
    """

    depth_m: Grid
    x: Grid
    y: Grid
    crs: Any
    notes: tuple[str, ...]
    sigma_m: Grid | None = None


def ascending(values: Grid, x: Grid, y: Grid) -> tuple[Grid, Grid, Grid]:
    """The same grid with both axes ascending: south first, west first."""
    if x.size > 1 and x[1] < x[0]:
        values, x = values[:, ::-1], x[::-1]
    if y.size > 1 and y[1] < y[0]:
        values, y = values[::-1], y[::-1]
    return values, x, y


def check_size(rows: int, cols: int) -> None:
    """Refuse a grid that is too small to be a chart or too large to hold."""
    if min(rows, cols) < 2:
        raise ChartError(f"chart grid of {rows} x {cols} nodes is smaller than 2 x 2")
    if rows * cols > MAX_NODES:
        raise ChartError(
            f"chart grid of {rows} x {cols} = {rows * cols:,} nodes is above {MAX_NODES:,}: "
            "give the mission's area, or choose a larger cell (--area, chart.area; a scenario with all places in degrees "
            "tells its area by itself)"
        )


def chart_from_raster(
    raster: Raster, *, name: str, cell_m: float | None, origin: Origin | None, quality: Quality
) -> Chart:
    """The chart of a raster, shifted to local metres around `origin` (None: its own middle).

    Raises:
        ChartError: uneven axes, too many nodes, a projection that cannot be used.
    """
    step_x, step_y = _step(raster.x, "x"), _step(raster.y, "y")
    check_cell(cell_m)
    notes = list(raster.notes)
    frame, place = _frame(raster, origin, notes)
    if frame is not None and place is None:
        grid = _resample_projected(raster, frame, cell_m, notes)
    else:
        zero = place or (0.0, 0.0)
        x, y = raster.x - zero[0], raster.y - zero[1]
        square = abs(step_x - step_y) <= 1e-4 * step_x
        wanted = cell_m if cell_m is not None else min(step_x, step_y)
        if square and abs(wanted - step_x) <= 1e-6 * step_x:
            grid = _Grid(raster.depth_m, raster.sigma_m, float(x[0]), float(y[0]), (step_x + step_y) / 2)
        else:
            grid = _resample_axes(raster, x, y, wanted, notes)
    notes.append(frame.description if frame else NO_PROJECTION)
    sigma = _sigma(grid, quality, notes)
    length = _correlation_length(sigma, quality, notes)
    return Chart(
        depth_m=grid.depth_m,
        east0_m=grid.east0_m,
        north0_m=grid.north0_m,
        cell_m=grid.cell_m,
        sigma_map_m=sigma,
        correlation_length_m=length,
        origin=frame.origin if frame else (origin or Origin()),
        name=name,
        notes=tuple(notes),
    )


@dataclass(frozen=True)
class _Grid:
    depth_m: Grid
    sigma_m: Grid | None
    east0_m: float
    north0_m: float
    cell_m: float


def check_cell(cell_m: float | None) -> None:
    """Refuse a cell size that is not a length."""
    if cell_m is not None and not (np.isfinite(cell_m) and cell_m > 0):
        raise ChartError(f"chart cell_m {cell_m} must be finite and above 0 m")


def _frame(
    raster: Raster, origin: Origin | None, notes: list[str]
) -> tuple[LocalFrame | None, tuple[float, float] | None]:
    """The frame, and its zero's place on the raster's own axes: None when those are of another projection."""
    if raster.crs is None:
        return None, None
    x, y = (float(axis[0] + axis[-1]) / 2 for axis in (raster.x, raster.y))
    frame, found = frame_for(raster.crs, x, y, origin)
    notes.extend(found)
    same = is_metric(raster.crs) and crs_of(frame.origin.crs) == crs_of(crs_text(raster.crs))
    if not same:
        return frame, None
    # The middle itself, not there and back through latitude and longitude: nodes keep round numbers.
    return frame, (x, y) if origin is None or origin.latitude_deg is None else frame.offset_m


def _step(axis: Grid, name: str) -> float:
    steps = np.diff(axis)
    step = float(axis[-1] - axis[0]) / steps.size
    if not (np.isfinite(step) and step > 0):
        raise ChartError(f"chart axis {name} from {axis[0]:g} to {axis[-1]:g} does not grow")
    worst = float(np.abs(steps - step).max())
    if worst > 1e-2 * step:
        raise ChartError(f"chart axis {name} is uneven: steps of {steps.min():g} to {steps.max():g}")
    return step


def _lookup(values: Grid, x: Grid, y: Grid, at_x: Grid, at_y: Grid, nearest: bool) -> Grid:
    """Values at positions on the raster's axes, bilinear or of the nearest node; NaN outside and where a node that
    counts is a hole."""
    j = (at_x - x[0]) / ((x[-1] - x[0]) / (x.size - 1))
    i = (at_y - y[0]) / ((y[-1] - y[0]) / (y.size - 1))
    # A node that is hit but for rounding is that node: holes beside it and the chart's edge do not count.
    i, j = (np.where(np.abs(a - np.rint(a)) < 1e-6, np.rint(a), a) for a in (i, j))
    inside = (i >= 0) & (i <= y.size - 1) & (j >= 0) & (j <= x.size - 1)
    i, j = np.where(inside, i, 0.0), np.where(inside, j, 0.0)
    if nearest:
        return np.where(inside, values[np.rint(i).astype(np.intp), np.rint(j).astype(np.intp)], np.nan)
    i0, j0 = (np.minimum(a.astype(np.intp), size - 2) for a, size in ((i, y.size), (j, x.size)))
    total = np.zeros(at_x.shape)
    for di, dj in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = np.abs(1 - di - (i - i0)) * np.abs(1 - dj - (j - j0))
        total += np.where(weight > 0, weight * values[i0 + di, j0 + dj], 0.0)
    return np.where(inside, total, np.nan)


_NEARLY_SQUARE = 1.05
_SPARSE = 0.6
"""Between nodes of which most have a hole beside them, as in a coarse part of a survey of variable resolution, bilinear
lookup leaves a smaller share of the depths than this."""
_BAND_NODES = 1 << 18
"""Nodes that are looked up at a time: memory beside the grids themselves stays small."""


def _resample_axes(raster: Raster, x: Grid, y: Grid, cell_m: float, notes: list[str]) -> _Grid:
    cols, rows = (int((axis[-1] - axis[0]) / cell_m + 1e-9) + 1 for axis in (x, y))
    check_size(rows, cols)
    east, north = x[0] + cell_m * np.arange(cols), y[0] + cell_m * np.arange(rows)
    depth, sigma, how = _looked_up(raster, (x, y), (x, y), (east, north), cell_m, lambda e, n: (e, n))
    steps = f"{_step(raster.x, 'x'):.6g} x {_step(raster.y, 'y'):.6g}"
    notes.append(f"resampled {how} from cells of {steps} m to {cell_m:.6g} m")
    return _Grid(depth, sigma, float(x[0]), float(y[0]), cell_m)


def _resample_projected(raster: Raster, frame: LocalFrame, cell_m: float | None, notes: list[str]) -> _Grid:
    """Resample to local metres through the inverse projection of every new node."""
    there = transformer(raster.crs, crs_of(frame.origin.crs))
    edge_e, edge_n = _edge(raster, there, frame)
    size_e, size_n = float(np.ptp(edge_e)), float(np.ptp(edge_n))
    step_e, step_n = size_e / (raster.x.size - 1), size_n / (raster.y.size - 1)
    cell = cell_m if cell_m is not None else _square_cell(step_e, step_n)
    cols, rows = round(size_e / cell) + 1, round(size_n / cell) + 1
    check_size(rows, cols)
    # Nodes at whole multiples of the cell: charts made around one origin with one cell share their nodes.
    east0, north0 = (cell * np.ceil(edge.min() / cell - 1e-9) for edge in (edge_e, edge_n))

    def back(e: Grid, n: Grid) -> tuple[Grid, Grid]:
        at_x, at_y = there.transform(e + frame.offset_m[0], n + frame.offset_m[1], direction="INVERSE")
        if raster.crs.is_geographic:  # a chart across the date line may count its degrees past 180
            at_x = raster.x[0] + np.mod(at_x - raster.x[0] + 1e-9, 360.0) - 1e-9
        return at_x, at_y

    scaled = raster.x * (step_e / _step(raster.x, "x")), raster.y * (step_n / _step(raster.y, "y"))
    nodes = east0 + cell * np.arange(cols), north0 + cell * np.arange(rows)
    depth, sigma, how = _looked_up(raster, scaled, (raster.x, raster.y), nodes, cell, back)
    notes.append(f"projected and resampled {how} from cells of {step_e:.4g} x {step_n:.4g} m to {cell:.6g} m")
    return _Grid(depth, sigma, float(east0), float(north0), cell)


def _square_cell(step_e: float, step_n: float) -> float:
    """The side of a square cell for cells of two sides: as large where they are nearly square, else the finer."""
    low, high = sorted((step_e, step_n))
    return float(f"{np.sqrt(low * high) if high < _NEARLY_SQUARE * low else low:.3g}")


def _edge(raster: Raster, there: Any, frame: LocalFrame) -> tuple[Grid, Grid]:
    """Local eastings and northings of the raster's outermost nodes."""
    x = np.concatenate(
        [raster.x, raster.x, np.full_like(raster.y, raster.x[0]), np.full_like(raster.y, raster.x[-1])]
    )
    y = np.concatenate(
        [np.full_like(raster.x, raster.y[0]), np.full_like(raster.x, raster.y[-1]), raster.y, raster.y]
    )
    east, north = (a - offset for a, offset in zip(there.transform(x, y), frame.offset_m, strict=True))
    if not (np.isfinite(east).all() and np.isfinite(north).all()):
        raise ChartError(
            f"chart reaches outside the local projection: {raster.x[0]:g} to {raster.x[-1]:g}, "
            f"{raster.y[0]:g} to {raster.y[-1]:g} is too large an area"
        )
    return east, north


def _looked_up(
    raster: Raster,
    metres: tuple[Grid, Grid],
    axes: tuple[Grid, Grid],
    nodes: tuple[Grid, Grid],
    cell_m: float,
    back: Callable[[Grid, Grid], tuple[Grid, Grid]],
) -> tuple[Grid, Grid | None, str]:
    """Depth and sigma at new nodes, bilinear or, where the old nodes are too sparse, of the nearest; and how.

    Args:
        raster: the grids.
        metres: the raster's axes in metres, to average over what fits a new cell.
        axes: the raster's axes, in the unit of what `back` gives.
        nodes: eastings and northings of the new nodes.
        cell_m: their distance.
        back: positions on the raster's axes of eastings and northings, each (M, cols).
    """
    given = (raster.depth_m, raster.sigma_m)
    grids = [_smoothed(values, *metres, cell_m) for values in given if values is not None]
    made, how = _fill(grids, axes, nodes, back, nearest=False), "bilinearly"
    left = np.isfinite(made[0]).mean() / np.isfinite(raster.depth_m).mean()
    if left < _SPARSE:
        made = _fill(grids, axes, nodes, back, nearest=True)
        how = f"by the nearest node (bilinearly {100 * left:.0f} % of the depths would be left between the holes)"
    return made[0], made[1] if len(made) > 1 else None, how


def _fill(
    grids: Sequence[Grid],
    axes: tuple[Grid, Grid],
    nodes: tuple[Grid, Grid],
    back: Callable[[Grid, Grid], tuple[Grid, Grid]],
    nearest: bool,
) -> list[Grid]:
    """Each grid at the new nodes, a band of rows at a time."""
    east, north = nodes
    made = [np.empty((north.size, east.size), np.float32) for _ in grids]
    band = max(1, _BAND_NODES // east.size)
    for start in range(0, north.size, band):
        rows = slice(start, start + band)
        at = back(*np.meshgrid(east, north[rows]))
        for values, target in zip(grids, made, strict=True):
            target[rows] = _lookup(values, *axes, *at, nearest=nearest)
    return made


def _smoothed(values: Grid, x: Grid, y: Grid, cell_m: float) -> Grid:
    """Running means over as many nodes as fit a new cell: coarser cells average instead of picking."""
    for axis, nodes in ((0, y), (1, x)):
        width = int(cell_m / (abs(nodes[-1] - nodes[0]) / (nodes.size - 1)) + 1e-9)
        half = (width - 1) // 2 if width % 2 else width // 2
        if half < 1:
            continue
        known = np.isfinite(values)
        total, count = (
            window_sums(a, half, axis) for a in (np.where(known, values, 0.0), known.astype(float))
        )
        values = np.where(known, total / np.maximum(count, 1.0), np.nan)
    return values


def _sigma(grid: _Grid, quality: Quality, notes: list[str]) -> float | NDArray[np.float32]:
    if quality.sigma_map_m is not None:
        notes.append(f"chart error: sigma_map {quality.sigma_map_m:g} m as asked")
        return quality.sigma_map_m
    if grid.sigma_m is not None:
        notes.append(
            f"chart error: the file's uncertainty per node, median {np.nanmedian(grid.sigma_m):.2g} m"
        )
        return grid.sigma_m.astype(np.float32)
    notes.append("chart error not stated: taken as perfect, sigma_map 0 and correlation length 0")
    return 0.0


def _correlation_length(sigma: float | NDArray[np.float32], quality: Quality, notes: list[str]) -> float:
    """As asked; for a chart that errs, what is usual, since no format says over which distance it does."""
    if quality.correlation_length_m is not None:
        return quality.correlation_length_m
    if not np.any(np.nan_to_num(np.asarray(sigma)) > 0):
        return 0.0
    notes.append(
        f"correlation length of the chart's error not stated: {CORRELATION_LENGTH_M:g} m assumed, "
        "give correlation_length_m if it is known"
    )
    return CORRELATION_LENGTH_M
