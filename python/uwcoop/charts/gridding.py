"""Soundings to a chart.

The method, with verde: the median of the soundings in each cell (single-beam tracks cross themselves, and
medians drop stray echoes), then linear interpolation on the Delaunay triangles of those medians. Splines of
ten thousands of points need a dense solve and overshoot at the edges of tracks; triangles cannot exceed the
soundings they stand on. Nodes farther from every sounding than `max_gap_m` stay holes: a guess between far
tracks looks like a chart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.chart import Chart
from uwcoop.charts.raster import MAX_NODES, check_cell
from uwcoop.errors import ChartError, MissingDependencyError
from uwcoop.missionlog.model import Origin

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Values = NDArray[np.float64]

MAX_GAP_M = 10.0
"""Default distance to the nearest sounding beyond which a node is a hole; at least two cells."""
CORRELATION_LENGTH_M = 10.0
"""Default correlation length of a sounded chart's error: where residuals between surveys fall to half."""
_LEAST_RESIDUALS = 20
_FOLDS = 5
_LEAST_PATCH_NODES = 8
_LEAST_PATCH_SHARE = 1 / 200


def grid_soundings(
    e_m: ArrayLike,
    n_m: ArrayLike,
    depth_m: ArrayLike,
    *,
    cell_m: float | None = None,
    max_gap_m: float | None = None,
    survey: ArrayLike | None = None,
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
        sigma_map_m: standard deviation of the chart's error; None finds it from cross-validated residuals.
        correlation_length_m: of that error; None: 10 m.
        origin: where the local zero lies.
        name: the chart's name.
        notes: what to say before this function's own notes.

    Raises:
        ChartError: fewer than four soundings, all on one line, too small a cell, or nothing but holes.
    """
    east, north, depth = (np.asarray(a, dtype=np.float64).ravel() for a in (e_m, n_m, depth_m))
    _check(east, north, depth, cell_m, max_gap_m)
    said = list(notes)
    if cell_m is None:
        cell_m = _cell_for(east, north)
        said.append(f"cell not asked for: {cell_m:g} m, after the soundings' density")
    if max_gap_m is None:
        max_gap_m = max(MAX_GAP_M, 2 * cell_m)
    axes = [_axis(values, cell_m) for values in (east, north)]
    nodes = axes[0].size * axes[1].size
    if nodes > MAX_NODES:
        area = (axes[0].size - 1) * cell_m, (axes[1].size - 1) * cell_m
        raise ChartError(
            f"cell {cell_m:g} m over {area[0]:,.0f} x {area[1]:,.0f} m makes {nodes:,} nodes, "
            f"above {MAX_NODES:,}: choose at least {np.sqrt(area[0] * area[1] / MAX_NODES) * 1.01:.2g} m, "
            "or leave out stray soundings"
        )
    reduced = _medians(east, north, depth, cell_m)
    grid = _interpolated(reduced, axes, (east, north), max_gap_m)
    if not np.isfinite(grid).any():
        raise ChartError(
            f"no node lies within {max_gap_m:g} m of a sounding and between soundings: all are holes"
        )
    said.append(
        f"gridded to {cell_m:g} m: medians of cells, linear between them (verde); "
        f"holes beyond {max_gap_m:g} m of a sounding"
    )
    grid = _without_strays(grid, said)
    if sigma_map_m is None:
        sigma_map_m = _residual_sigma(reduced, (east, north, depth), survey, cell_m, max_gap_m, said)
    else:
        said.append(f"chart error: sigma_map {sigma_map_m:g} m as asked")
    if correlation_length_m is None:
        correlation_length_m = CORRELATION_LENGTH_M
        said.append(
            f"correlation length of the chart's error: {CORRELATION_LENGTH_M:g} m, usual for soundings"
        )
    rows, cols = (slice(int(k.min()), int(k.max()) + 1) for k in np.nonzero(np.isfinite(grid)))
    if rows.stop - rows.start < 2 or cols.stop - cols.start < 2:
        rows, cols = slice(None), slice(None)
    return Chart(
        depth_m=grid[rows, cols].astype(np.float32),
        east0_m=float(axes[0][cols][0]),
        north0_m=float(axes[1][rows][0]),
        cell_m=cell_m,
        sigma_map_m=sigma_map_m,
        correlation_length_m=correlation_length_m,
        origin=origin or Origin(),
        name=name,
        notes=tuple(said),
    )


def _check(east: Values, north: Values, depth: Values, cell_m: float | None, max_gap_m: float | None) -> None:
    if not east.size == north.size == depth.size:
        raise ChartError(f"soundings' columns differ in length: {east.size}, {north.size}, {depth.size}")
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
    spacing = np.sqrt(_hull(east, north).volume / east.size)  # volume is area in the plane
    steps = [step * 10.0**power for power in range(5) for step in (1, 2, 5)]
    return next((step for step in steps if step >= spacing), steps[-1])


def _hull(east: Values, north: Values) -> Any:
    """The convex hull of positions, which must not lie on one line."""
    spatial = _scipy_spatial()
    try:
        return spatial.ConvexHull(np.column_stack([east, north]))
    except spatial.QhullError as error:
        raise ChartError("soundings lie on one line: a chart needs soundings across it too") from error


def _axis(values: Values, cell_m: float) -> Values:
    first, last = np.floor(values.min() / cell_m), np.ceil(values.max() / cell_m)
    count = int(max(last - first, 1)) + 1
    if count > MAX_NODES:
        raise ChartError(
            f"cell {cell_m:g} m over {np.ptp(values):,.0f} m makes {count:,} nodes on one axis alone"
        )
    return np.asarray(cell_m * (first + np.arange(count)))


def _medians(east: Values, north: Values, depth: Values, cell_m: float) -> tuple[Values, Values, Values]:
    """Median position and depth of the soundings of each cell."""
    reducer = _verde().BlockReduce("median", spacing=cell_m)
    (e, n), z = reducer.filter((east, north), depth)
    return np.asarray(e), np.asarray(n), np.asarray(z)


def _interpolated(
    reduced: tuple[Values, Values, Values],
    axes: list[Values],
    soundings: tuple[Values, Values],
    max_gap_m: float,
) -> Values:
    e, n = np.meshgrid(*axes)
    distance, _ = (
        _scipy_spatial()
        .cKDTree(np.column_stack(soundings))
        .query(np.column_stack([e.ravel(), n.ravel()]), distance_upper_bound=max_gap_m)
    )
    near = np.isfinite(distance).reshape(e.shape)
    grid = np.full(e.shape, np.nan)
    grid[near] = _linear(reduced, (e[near], n[near]))
    return grid


def _linear(known: tuple[Values, Values, Values], at: tuple[Values, Values]) -> Values:
    """Linear interpolation on Delaunay triangles; NaN outside their hull."""
    e, n, z = known
    result = np.full(at[0].shape, np.nan)
    hull = _hull(e, n).equations
    # The search for a point's triangle walks there when it has one, and tries them all when it has none.
    inside = np.all([a * at[0] + b * at[1] + c <= 1e-9 for a, b, c in hull], axis=0)
    if inside.any():
        # Metres both ways: rescaling would change which soundings are neighbours.
        surface = _verde().Linear(rescale=False).fit((e, n), z)
        result[inside] = surface.predict((at[0][inside], at[1][inside]))
    return result


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


def _residual_sigma(
    reduced: tuple[Values, Values, Values],
    soundings: tuple[Values, Values, Values],
    survey: ArrayLike | None,
    cell_m: float,
    max_gap_m: float,
    said: list[str],
) -> float:
    """Standard deviation of what soundings say where others made the chart: between the robust and the plain
    one.

    Other surveys' soundings tell the most (tide, positioning); without labels, blocks of the size of the
    largest gap are left out in turn, which misses what all soundings share.
    """
    labels = None if survey is None else np.unique(np.asarray(survey).astype(str), return_inverse=True)[1]
    if labels is not None and labels.max() > 0:
        e, n, z = soundings
        folds = [
            (
                (e[labels == k], n[labels == k], z[labels == k]),
                _medians(e[labels != k], n[labels != k], z[labels != k], cell_m),
            )
            for k in range(labels.max() + 1)
            if np.count_nonzero(labels != k) >= 4
        ]
        how = f"leaving out one of {labels.max() + 1} surveys"
    else:
        folds = _block_folds(reduced, max_gap_m)
        how = f"leaving out blocks of {max_gap_m:g} m"
    residuals = np.concatenate([_residuals(test, train, max_gap_m) for test, train in folds] or [np.zeros(0)])
    if residuals.size < _LEAST_RESIDUALS:
        raise ChartError(
            f"{residuals.size} soundings lie close enough to others to judge the chart's error, "
            f"below {_LEAST_RESIDUALS}: give sigma_map_m"
        )
    robust = 1.4826 * float(np.median(np.abs(residuals - np.median(residuals))))
    plain = float(residuals.std())
    sigma = float(f"{np.sqrt(robust * plain):.2g}")
    said.append(
        f"chart error: sigma_map {sigma:g} m from {residuals.size:,} residuals {how} "
        f"(robust {robust:.2g} m, plain {plain:.2g} m)"
    )
    return sigma


def _block_folds(reduced: tuple[Values, Values, Values], size_m: float) -> list[tuple[Any, Any]]:
    e, n, _ = reduced
    points = np.column_stack([e, n])
    blocks = np.unique(np.floor(points / size_m), axis=0).shape[0]
    if blocks < _FOLDS:
        return []
    splitter = _verde().BlockKFold(spacing=size_m, n_splits=_FOLDS, shuffle=True, random_state=0)
    return [
        (tuple(a[test] for a in reduced), tuple(a[train] for a in reduced))
        for train, test in splitter.split(points)
    ]


def _residuals(
    test: tuple[Values, Values, Values], train: tuple[Values, Values, Values], max_gap_m: float
) -> Values:
    """Test soundings minus the chart of the others, where that chart would not have had a hole."""
    tree = _scipy_spatial().cKDTree(np.column_stack(train[:2]))
    distance, _ = tree.query(np.column_stack(test[:2]), distance_upper_bound=max_gap_m)
    near = np.isfinite(distance)
    residual = test[2][near] - _linear(train, (test[0][near], test[1][near]))
    return np.asarray(residual[np.isfinite(residual)])


def _verde() -> Any:
    try:
        import verde
    except ImportError as error:
        raise MissingDependencyError("verde", "maps") from error
    return verde


def _scipy_spatial() -> Any:
    try:
        from scipy import spatial
    except ImportError as error:
        raise MissingDependencyError("scipy", "maps") from error
    return spatial
