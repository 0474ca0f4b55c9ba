"""Soundings to a chart.

The method: the median of the soundings in each cell (single-beam tracks cross themselves, and
medians drop stray echoes), then linear interpolation on the Delaunay triangles of those medians. Splines of
ten thousands of points need a dense solve and overshoot at the edges of tracks; triangles cannot exceed the
soundings they stand on. Nodes farther from every sounding than `max_gap_m` stay holes: a guess between far
tracks looks like a chart.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.alignment import Alignment, align_segments, segments_of
from uwcoop.charts.chart import Chart
from uwcoop.charts.new_day import new_day_residuals
from uwcoop.charts.raster import CORRELATION_LENGTH_M, MAX_NODES, Quality, check_cell
from uwcoop.charts.residuals import ResidualReport, leave_one_out, report
from uwcoop.charts.slopes import slope_at
from uwcoop.charts.surface import distance, hull, linear, medians
from uwcoop.errors import ChartError, MissingDependencyError
from uwcoop.frames import Origin

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Values = NDArray[np.float64]

MAX_GAP_M = 10.0
"""Default distance to the nearest sounding beyond which a node is a hole; at least two cells."""
_LEAST_PATCH_NODES = 8
_LEAST_PATCH_SHARE = 1 / 200


@dataclass(frozen=True)
class Soundings:
    """Depths at local positions, and where they come from."""

    east_m: Values
    north_m: Values
    depth_m: Values
    """(N,) metres, positive down."""
    survey: NDArray[Any] | None = None
    """(N,) labels of days or lines; None: unknown."""
    time_s: Values | None = None
    """(N,) seconds; None: unknown."""
    origin: Origin = field(default_factory=Origin)
    name: str = "soundings"
    notes: tuple[str, ...] = ()

    @property
    def surveys(self) -> int:
        """Number of surveys; 0 where it is unknown."""
        return 0 if self.survey is None else np.unique(self.survey.astype(str)).size


@dataclass(frozen=True)
class Gridded:
    """A chart made of soundings, and the residuals found while making it."""

    chart: Chart
    residuals: ResidualReport | None
    """None where the chart's quality was given and no report asked for."""
    alignment: Alignment | None
    """None where segments were left as they are."""
    new_day: ResidualReport | None = None
    """Of surveys that are left out of the alignment too; None unless a report of aligned surveys was asked for."""

    def as_dict(self) -> dict[str, Any]:
        """Residuals, alignment and residuals of a new day, ready for JSON, each None where there is none."""
        return {
            "residuals": None if self.residuals is None else self.residuals.as_dict(),
            "alignment": None if self.alignment is None else self.alignment.as_dict(),
            "new_day": None if self.new_day is None else self.new_day.as_dict(),
        }


def grid_soundings(
    e_m: ArrayLike,
    n_m: ArrayLike,
    depth_m: ArrayLike,
    *,
    cell_m: float | None = None,
    max_gap_m: float | None = None,
    survey: ArrayLike | None = None,
    time_s: ArrayLike | None = None,
    align: bool = False,
    sigma_map_m: float | None = None,
    correlation_length_m: float | None = None,
    origin: Origin | None = None,
    name: str = "soundings",
    notes: tuple[str, ...] = (),
) -> Chart:
    """A chart from soundings at local positions; nodes lie at whole multiples of the cell.

    Args:
        e_m, n_m, depth_m: (N,) metres; depth positive down, all finite.
        cell_m: distance between nodes; None chooses one from the soundings' density and notes it.
        max_gap_m: nodes farther than this from every sounding are holes; None: 10 m, or two cells if larger.
        survey: (N,) labels of days or lines; with two or more, the chart's error is judged by leaving one
            out.
        time_s: (N,) seconds, which cut surveys into segments for `align`; None: one sounding a second.
        align: shift segments of 900 s so that crossing soundings agree, before gridding.
        sigma_map_m: standard deviation of the chart's error; None finds it from cross-validated residuals.
        correlation_length_m: of that error; None finds it from residuals between surveys, or takes 10 m.
        origin: where the local zero lies.
        name: the chart's name.
        notes: printed before this function's own notes.

    Raises:
        ChartError: fewer than four soundings, all on one line, too small a cell, or nothing but holes.
    """
    east, north, depth = (np.asarray(a, dtype=np.float64).ravel() for a in (e_m, n_m, depth_m))
    soundings = Soundings(
        east,
        north,
        depth,
        None if survey is None else np.asarray(survey).ravel(),
        None if time_s is None else np.asarray(time_s, dtype=np.float64).ravel(),
        origin or Origin(),
        name,
        notes,
    )
    quality = Quality(sigma_map_m, correlation_length_m)
    return grid_and_judge(soundings, cell_m=cell_m, max_gap_m=max_gap_m, align=align, quality=quality).chart


def grid_and_judge(
    soundings: Soundings,
    *,
    cell_m: float | None = None,
    max_gap_m: float | None = None,
    align: bool = False,
    quality: Quality | None = None,
    report_residuals: bool = False,
) -> Gridded:
    """As `grid_soundings`, with the residuals and the alignment beside the chart.

    Args:
        soundings: what to make a chart of.
        cell_m, max_gap_m, align: see `grid_soundings`.
        quality: of the chart, as far as it is asked for; the rest is found from residuals.
        report_residuals: find residuals in any case.

    Raises:
        ChartError: see `grid_soundings`.
    """
    quality = quality or Quality()
    points = (soundings.east_m, soundings.north_m, soundings.depth_m)
    _check(soundings, cell_m, max_gap_m)
    said = list(soundings.notes)
    if cell_m is None:
        cell_m = _cell_for(*points[:2])
        said.append(f"cell not asked for: {cell_m:g} m, after the soundings' density")
    if max_gap_m is None:
        max_gap_m = max(MAX_GAP_M, 2 * cell_m)
    alignment = None
    if align:
        segment = segments_of(soundings.survey, soundings.time_s, points[0].size)
        alignment = align_segments(points, segment, cell_m=cell_m, max_gap_m=max_gap_m)
        points = alignment.applied(points)
        said.append(alignment.note)
    grid, axes = _grid(points, cell_m, max_gap_m, said)
    measured = quality.correlation_length_m is None and soundings.surveys > 1
    residuals, slope = None, np.zeros(0)
    if report_residuals or quality.sigma_map_m is None or measured:
        found = leave_one_out(points, soundings.survey, cell_m=cell_m, max_gap_m=max_gap_m)
        rough = Chart(grid.astype(np.float32), float(axes[0][0]), float(axes[1][0]), cell_m)
        slope = slope_at(rough, found.east_m, found.north_m)
        residuals = report(found, slope)
    if align and residuals is not None:
        residuals = residuals.of_aligned()
    new_day = None
    if alignment is not None and report_residuals and soundings.surveys > 1 and soundings.survey is not None:
        raw = (soundings.east_m, soundings.north_m, soundings.depth_m)
        found = new_day_residuals(raw, soundings.survey, alignment, cell_m=cell_m, max_gap_m=max_gap_m)
        new_day = report(found)
        said.append(new_day.new_day_note)
    sigma, length = _quality(residuals, quality, said)
    asked = quality.by_slope and quality.sigma_map_m is None
    level, horizontal = _by_slope(residuals, slope, said) if asked else (0.0, 0.0)
    rows, cols = (slice(int(k.min()), int(k.max()) + 1) for k in np.nonzero(np.isfinite(grid)))
    if rows.stop - rows.start < 2 or cols.stop - cols.start < 2:
        rows, cols = slice(None), slice(None)
    chart = Chart(
        depth_m=grid[rows, cols].astype(np.float32),
        east0_m=float(axes[0][cols][0]),
        north0_m=float(axes[1][rows][0]),
        cell_m=cell_m,
        sigma_map_m=sigma,
        correlation_length_m=length,
        origin=soundings.origin,
        name=soundings.name,
        notes=tuple(said),
        horizontal_error_m=horizontal,
        level_sigma_m=level,
    )
    return Gridded(chart, residuals, alignment, new_day)


def _grid(
    soundings: tuple[Values, Values, Values], cell_m: float, max_gap_m: float, said: list[str]
) -> tuple[Values, list[Values]]:
    """Depths at the nodes, NaN for holes, and the nodes' eastings and northings."""
    axes = [_axis(values, cell_m) for values in soundings[:2]]
    nodes = axes[0].size * axes[1].size
    if nodes > MAX_NODES:
        area = (axes[0].size - 1) * cell_m, (axes[1].size - 1) * cell_m
        raise ChartError(
            f"cell {cell_m:g} m over {area[0]:,.0f} x {area[1]:,.0f} m makes {nodes:,} nodes, "
            f"above {MAX_NODES:,}: choose at least {np.sqrt(area[0] * area[1] / MAX_NODES) * 1.01:.2g} m, "
            "or leave out stray soundings"
        )
    grid = _interpolated(medians(*soundings, cell_m), axes, soundings[:2], max_gap_m)
    if not np.isfinite(grid).any():
        raise ChartError(
            f"no node lies within {max_gap_m:g} m of a sounding and between soundings: all are holes"
        )
    said.append(
        f"gridded to {cell_m:g} m: medians of cells, linear between them; "
        f"holes beyond {max_gap_m:g} m of a sounding"
    )
    return _without_strays(grid, said), axes


def _quality(residuals: ResidualReport | None, asked: Quality, said: list[str]) -> tuple[float, float]:
    """The chart's sigma and correlation length: as asked, else as the residuals propose."""
    sigma, length = asked.sigma_map_m, asked.correlation_length_m
    proposed = ("", "") if residuals is None else residuals.notes()
    if sigma is None:
        assert residuals is not None
        sigma = residuals.sigma_map_m
        said.append(proposed[0])
    else:
        said.append(f"chart error: sigma_map {sigma:g} m as asked")
    if length is None:
        length = CORRELATION_LENGTH_M if residuals is None else residuals.correlation_length_m
        said.append(
            proposed[1] or f"correlation length of the chart's error: {length:g} m, usual for soundings"
        )
    return sigma, length


def _by_slope(residuals: ResidualReport | None, slope: Values, said: list[str]) -> tuple[float, float]:
    """Level sigma and horizontal error of the chart, m; zeros where its error does not grow with the slope.

    The fit is of robust spreads of residuals less their survey's datum; both numbers are scaled so that over the
    residuals the mean variance is that of `sigma_map_m`.
    """
    known = slope[np.isfinite(slope)]
    if residuals is None or not residuals.horizontal_error_m or not known.size:
        return 0.0, 0.0
    level, horizontal = residuals.flat_sd_m or 0.0, residuals.horizontal_error_m
    scale = residuals.sigma_map_m / np.sqrt(np.mean(level**2 + (known * horizontal) ** 2))
    level, horizontal = (float(f"{scale * x:.2g}") for x in (level, horizontal))
    said.append(
        f"chart error by slope: {level:g} m where level, growing as a horizontal error of {horizontal:g} m"
    )
    return level, horizontal


def _check(soundings: Soundings, cell_m: float | None, max_gap_m: float | None) -> None:
    east, north, depth = soundings.east_m, soundings.north_m, soundings.depth_m
    if not east.size == north.size == depth.size:
        raise ChartError(f"soundings' columns differ in length: {east.size}, {north.size}, {depth.size}")
    for name, extra in (("survey", soundings.survey), ("time_s", soundings.time_s)):
        if extra is not None and extra.size != east.size:
            raise ChartError(f"soundings' {name} has {extra.size} values, not {east.size}")
    if east.size < 4:
        raise ChartError(f"{east.size} soundings are too few for a chart: at least 4")
    for name, values in (("easting", east), ("northing", north), ("depth", depth)):
        if not np.isfinite(values).all():
            raise ChartError(
                f"soundings' {name} holds {np.count_nonzero(~np.isfinite(values))} values not finite"
            )
    check_cell(cell_m)
    if max_gap_m is not None and not (np.isfinite(max_gap_m) and max_gap_m > 0):
        raise ChartError(f"max_gap_m {max_gap_m} must be finite and above 0 m")


def _cell_for(east: Values, north: Values) -> float:
    """From 1-2-5: at least 1 m, and no finer than the soundings would lie if spread evenly."""
    spacing = np.sqrt(hull(east, north).volume / east.size)  # volume is area in the plane
    steps = [step * 10.0**power for power in range(5) for step in (1, 2, 5)]
    return next((step for step in steps if step >= spacing), steps[-1])


def _axis(values: Values, cell_m: float) -> Values:
    first, last = np.floor(values.min() / cell_m), np.ceil(values.max() / cell_m)
    count = int(max(last - first, 1)) + 1
    if count > MAX_NODES:
        raise ChartError(
            f"cell {cell_m:g} m over {np.ptp(values):,.0f} m makes {count:,} nodes on one axis alone: "
            "choose a larger one, or leave out stray soundings"
        )
    return np.asarray(cell_m * (first + np.arange(count)))


def _interpolated(
    reduced: tuple[Values, Values, Values],
    axes: list[Values],
    soundings: tuple[Values, Values],
    max_gap_m: float,
) -> Values:
    grid = np.full((axes[1].size, axes[0].size), np.nan)
    # Row by row of nodes within reach of a sounding: an area that is mostly empty costs its grid alone.
    row, col = np.nonzero(_reached(axes, soundings, max_gap_m))
    e, n = axes[0][col], axes[1][row]
    near = np.isfinite(distance(soundings, (e, n), max_gap_m))
    grid[row[near], col[near]] = linear(reduced, (e[near], n[near]))
    return grid


def _reached(axes: list[Values], soundings: tuple[Values, Values], max_gap_m: float) -> NDArray[np.bool_]:
    """Nodes that may lie within `max_gap_m` of a sounding: all in the square around each."""
    from scipy import ndimage

    cell = axes[0][1] - axes[0][0]
    occupied = np.zeros((axes[1].size, axes[0].size), dtype=bool)
    col, row = (
        np.clip(np.rint((values - axis[0]) / cell).astype(np.intp), 0, axis.size - 1)
        for values, axis in zip(soundings, axes, strict=True)
    )
    occupied[row, col] = True
    half = int(np.ceil(max_gap_m / cell)) + 1
    for axis, size in enumerate(occupied.shape):
        occupied = ndimage.maximum_filter1d(
            occupied, min(2 * half + 1, 2 * size + 1), axis=axis, mode="constant"
        )
    return occupied


def _without_strays(grid: Values, said: list[str]) -> Values:
    """The grid without patches that are tiny beside the largest: those come from stray positions."""
    try:
        from scipy import ndimage
    except ImportError as error:
        raise MissingDependencyError("scipy", "maps") from error
    patch, count = ndimage.label(np.isfinite(grid), structure=np.ones((3, 3)))
    sizes = np.bincount(patch.ravel(), minlength=count + 1)[1:]
    stray = np.flatnonzero(
        sizes < min(sizes.max(), max(_LEAST_PATCH_NODES, sizes.max() * _LEAST_PATCH_SHARE))
    )
    if not stray.size:
        return grid
    said.append(f"{sizes[stray].sum()} nodes in {stray.size} stray patches far from the rest left out")
    return np.where(np.isin(patch, stray + 1), np.nan, grid)
