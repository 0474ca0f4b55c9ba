"""A surface through soundings: medians of cells, then linear interpolation on their Delaunay triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import ChartError, MissingDependencyError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Values = NDArray[np.float64]
    Triples = tuple[Values, Values, Values]
    """Easting, northing and depth, (N,) metres each."""


def medians(east: Values, north: Values, depth: Values, cell_m: float) -> Triples:
    """Median position and depth of the soundings of each cell."""
    reducer = verde().BlockReduce("median", spacing=cell_m)
    (e, n), z = reducer.filter((east, north), depth)
    return np.asarray(e), np.asarray(n), np.asarray(z)


def linear(known: Triples, at: tuple[Values, Values]) -> Values:
    """Linear interpolation on Delaunay triangles; NaN outside their hull."""
    e, n, z = known
    result = np.full(at[0].shape, np.nan)
    edges = hull(e, n).equations
    # The search for a point's triangle walks there when it has one, and tries them all when it has none.
    inside = np.all([a * at[0] + b * at[1] + c <= 1e-9 for a, b, c in edges], axis=0)
    if inside.any():
        # Metres both ways: rescaling would change which soundings are neighbours.
        surface = verde().Linear(rescale=False).fit((e, n), z)
        with _one_thread():
            result[inside] = surface.predict((at[0][inside], at[1][inside]))
    return result


def linear_near(known: Triples, at: tuple[Values, Values], max_gap_m: float) -> Values:
    """As `linear`, and NaN at places farther than `max_gap_m` from every known sounding."""
    near = distance(known[:2], at, max_gap_m) < np.inf
    result = np.full(at[0].shape, np.nan)
    if near.any():
        result[near] = linear(known, (at[0][near], at[1][near]))
    return result


def distance(soundings: tuple[Values, Values], at: tuple[Values, Values], bound_m: float) -> Values:
    """Distance from each place to the nearest sounding, metres; infinite beyond `bound_m`."""
    tree = spatial().cKDTree(np.column_stack(soundings))
    found, _ = tree.query(np.column_stack([at[0].ravel(), at[1].ravel()]), distance_upper_bound=bound_m)
    return np.asarray(found).reshape(at[0].shape)


def hull(east: Values, north: Values) -> Any:
    """The convex hull of positions, which must not lie on one line."""
    if east.size < 3:
        raise ChartError(f"{east.size} cells with soundings are too few for a chart: at least 3")
    try:
        return spatial().ConvexHull(np.column_stack([east, north]))
    except spatial().QhullError as error:
        raise ChartError("soundings lie on one line: a chart needs soundings across it too") from error


def _one_thread() -> Any:
    """A context in which linear algebra uses one thread: one 2 x 2 matrix per triangle is solved, and threads
    that wait for each other make that a hundred times slower on a busy machine."""
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    return threadpool_limits(limits=1, user_api="blas")


def robust_sd(values: Values) -> float:
    """Standard deviation that a normal distribution with the same median absolute deviation has."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def verde() -> Any:
    """The package that grids."""
    try:
        import verde
    except ImportError as error:
        raise MissingDependencyError("verde", "maps") from error
    return verde


def spatial() -> Any:
    """Trees and triangles."""
    try:
        from scipy import spatial
    except ImportError as error:
        raise MissingDependencyError("scipy", "maps") from error
    return spatial
