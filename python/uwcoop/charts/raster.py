"""From a grid in some map projection to a chart in local metres.

A grid of square metres keeps its nodes. Anything else (degrees, feet, oblong cells, another cell asked for)
is resampled bilinearly to a square metric grid, after averaging where the new cells are much larger.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.chart import Chart
from uwcoop.charts.windows import window_sums
from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame, Origin, crs_of, crs_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Grid = NDArray[np.float64]

MAX_NODES = 50_000_000
"""A grid of more nodes than this (200 MB of depths) is refused before anything is read or made."""


CORRELATION_LENGTH_M = 10.0
"""Usual correlation length of a surveyed chart's error, where nothing measures it."""
NO_PROJECTION = "no projection: positions taken as local metres, place on Earth unknown"


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
            "cut it to the mission's area, or choose a larger cell"
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
    frame, place = _frame(raster, origin)
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
            notes.append(
                f"resampled bilinearly from cells of {step_x:.6g} x {step_y:.6g} m to {wanted:.6g} m"
            )
            grid = _resample_axes(raster, x, y, wanted)
    notes.append(frame.description if frame else NO_PROJECTION)
    sigma = _sigma(grid, quality, notes)
    length = _correlation_length(sigma, quality, notes)
    return Chart(
        depth_m=grid.depth_m.astype(np.float32),
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


def horizontal(crs: Any) -> Any:
    """The horizontal part of a pyproj CRS that may have a vertical one too."""
    return crs.sub_crs_list[0] if crs.is_compound else crs


def middle_of(crs: Any, x: float, y: float) -> tuple[float, float]:
    """WGS 84 latitude and longitude, degrees, of a place in `crs`."""
    from pyproj import Transformer

    longitude, latitude = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
    if not (np.isfinite(latitude) and np.isfinite(longitude)):
        raise ChartError(f"position ({x:g}, {y:g}) is outside the projection {crs_text(crs)}")
    return float(latitude), float(longitude)


def is_metric(crs: Any) -> bool:
    """Whether a projection's axes are in metres."""
    return bool(crs.is_projected) and all(
        abs(axis.unit_conversion_factor - 1) < 1e-12 for axis in crs.axis_info
    )


def frame_for(crs: Any, x: float, y: float, origin: Origin | None) -> LocalFrame:
    """The local frame of positions in `crs` around `origin` or, without one, around (x, y)."""
    own = crs_text(crs) if is_metric(crs) else None
    if origin is not None and origin.latitude_deg is not None and origin.longitude_deg is not None:
        return LocalFrame.at(origin.latitude_deg, origin.longitude_deg, origin.crs or own)
    latitude, longitude = middle_of(crs, x, y)
    return LocalFrame.at(latitude, longitude, own)


def _frame(raster: Raster, origin: Origin | None) -> tuple[LocalFrame | None, tuple[float, float] | None]:
    """The frame, and its zero's place on the raster's own axes: None when those are of another projection."""
    if raster.crs is None:
        return None, None
    x, y = (float(axis[0] + axis[-1]) / 2 for axis in (raster.x, raster.y))
    frame = frame_for(raster.crs, x, y, origin)
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


def _lookup(values: Grid, x: Grid, y: Grid, at_x: Grid, at_y: Grid) -> Grid:
    """Bilinear values at positions on the raster's axes; NaN outside and where a weighted node is a hole."""
    j = (at_x - x[0]) / ((x[-1] - x[0]) / (x.size - 1))
    i = (at_y - y[0]) / ((y[-1] - y[0]) / (y.size - 1))
    # A node that is hit but for rounding is that node: holes beside it and the chart's edge do not count.
    i, j = (np.where(np.abs(a - np.rint(a)) < 1e-6, np.rint(a), a) for a in (i, j))
    inside = (i >= 0) & (i <= y.size - 1) & (j >= 0) & (j <= x.size - 1)
    i, j = np.where(inside, i, 0.0), np.where(inside, j, 0.0)
    i0, j0 = (np.minimum(a.astype(np.intp), size - 2) for a, size in ((i, y.size), (j, x.size)))
    total = np.zeros(at_x.shape)
    for di, dj in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = np.abs(1 - di - (i - i0)) * np.abs(1 - dj - (j - j0))
        total += np.where(weight > 0, weight * values[i0 + di, j0 + dj], 0.0)
    return np.where(inside, total, np.nan)


def _resample_axes(raster: Raster, x: Grid, y: Grid, cell_m: float) -> _Grid:
    cols, rows = (int((axis[-1] - axis[0]) / cell_m + 1e-9) + 1 for axis in (x, y))
    check_size(rows, cols)
    at_x, at_y = np.meshgrid(x[0] + cell_m * np.arange(cols), y[0] + cell_m * np.arange(rows))
    depth, sigma = (
        None if values is None else _lookup(_smoothed(values, x, y, cell_m), x, y, at_x, at_y)
        for values in (raster.depth_m, raster.sigma_m)
    )
    assert depth is not None
    return _Grid(depth, sigma, float(x[0]), float(y[0]), cell_m)


def _resample_projected(raster: Raster, frame: LocalFrame, cell_m: float | None, notes: list[str]) -> _Grid:
    """Resample to local metres through the inverse projection of every new node."""
    from pyproj import Transformer

    there = Transformer.from_crs(raster.crs, crs_of(frame.origin.crs), always_xy=True)
    edge_x = np.concatenate(
        [raster.x, raster.x, np.full_like(raster.y, raster.x[0]), np.full_like(raster.y, raster.x[-1])]
    )
    edge_y = np.concatenate(
        [np.full_like(raster.x, raster.y[0]), np.full_like(raster.x, raster.y[-1]), raster.y, raster.y]
    )
    edge_e, edge_n = (
        a - offset for a, offset in zip(there.transform(edge_x, edge_y), frame.offset_m, strict=True)
    )
    if not (np.isfinite(edge_e).all() and np.isfinite(edge_n).all()):
        raise ChartError(
            f"chart reaches outside the local projection: {raster.x[0]:g} to {raster.x[-1]:g}, "
            f"{raster.y[0]:g} to {raster.y[-1]:g} is too large an area"
        )
    size_e, size_n = float(np.ptp(edge_e)), float(np.ptp(edge_n))
    step_e, step_n = size_e / (raster.x.size - 1), size_n / (raster.y.size - 1)
    cell = cell_m if cell_m is not None else float(f"{min(step_e, step_n):.3g}")
    cols, rows = int(size_e / cell + 1e-9) + 1, int(size_n / cell + 1e-9) + 1
    check_size(rows, cols)
    # Nodes at whole multiples of the cell: charts made around one origin with one cell share their nodes.
    east0, north0 = (cell * np.ceil(edge.min() / cell - 1e-9) for edge in (edge_e, edge_n))
    at_e, at_n = np.meshgrid(east0 + cell * np.arange(cols), north0 + cell * np.arange(rows))
    at_x, at_y = there.transform(at_e + frame.offset_m[0], at_n + frame.offset_m[1], direction="INVERSE")
    if raster.crs.is_geographic:  # a chart across the date line may count its degrees past 180
        at_x = raster.x[0] + np.mod(at_x - raster.x[0] + 1e-9, 360.0) - 1e-9
    scaled_x, scaled_y = (
        raster.x * (step_e / _step(raster.x, "x")),
        raster.y * (step_n / _step(raster.y, "y")),
    )
    depth, sigma = (
        None
        if values is None
        else _lookup(_smoothed(values, scaled_x, scaled_y, cell), raster.x, raster.y, at_x, at_y)
        for values in (raster.depth_m, raster.sigma_m)
    )
    assert depth is not None
    notes.append(
        f"projected and resampled bilinearly from cells of {step_e:.4g} x {step_n:.4g} m to {cell:.6g} m"
    )
    return _Grid(depth, sigma, float(east0), float(north0), cell)


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
