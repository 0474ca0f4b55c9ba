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


_MOST_STEPS = 1000
_ON_EDGE = 100 * float(np.finfo(np.float64).eps)


def medians(east: Values, north: Values, depth: Values, cell_m: float) -> Triples:
    """Median position and depth of the soundings of each cell, cells in rows from the south-west."""
    cell = blocks(east, north, cell_m)
    order = np.argsort(cell, kind="stable")
    cell = cell[order]
    first = np.flatnonzero(np.r_[True, np.diff(cell) != 0])
    count = np.diff(np.r_[first, cell.size])
    # Sorted within each cell, the middle one or the two around the middle are the median.
    low, high = first + (count - 1) // 2, first + count // 2
    found = []
    for values in (east, north, depth):
        own = values[order]
        own = own[np.lexsort((own, cell))]
        found.append((own[low] + own[high]) / 2)
    return found[0], found[1], found[2]


def blocks(east: Values, north: Values, size_m: float) -> NDArray[np.int64]:
    """Which block of about `size_m` each position lies in, (N,): whole blocks fill the box around all positions."""
    places = []
    for values in (east, north):
        low, span = float(values.min()), float(np.ptp(values))
        count = max(1, round(span / size_m))
        width = span / count if span > 0 else size_m
        places.append((np.minimum(np.floor((values - low) / width), count - 1).astype(np.int64), count))
    (column, columns), (row, _) = places
    return np.asarray(row * columns + column)


def linear(known: Triples, at: tuple[Values, Values]) -> Values:
    """Linear interpolation on Delaunay triangles; NaN outside their hull.

    SciPy's own interpolator solves one system of two equations for each triangle by the linear algebra library, whose
    threads then wait for each other: on a busy machine that takes minutes.
    """
    e, n, z = known
    hull(e, n)
    points = np.column_stack([e, n])
    triangles = spatial().Delaunay(points)
    where = np.column_stack([at[0].ravel(), at[1].ravel()])
    result = np.full(len(where), np.nan)
    # From a triangle at the nearest sounding it is a few steps to the one around a place.
    nearest = spatial().cKDTree(points).query(where)[1]
    triangle = np.maximum(triangles.vertex_to_simplex[nearest], 0)
    walking = np.arange(len(where))
    for _ in range(_MOST_STEPS):
        corners = triangles.simplices[triangle]
        weight = _barycentric(points[corners], where[walking])
        inside = weight.min(axis=1) >= -_ON_EDGE
        result[walking[inside]] = np.sum(weight[inside] * z[corners[inside]], axis=1)
        # Across the edge beyond which a place lies the farthest; -1 is outside of all.
        ahead = triangles.neighbors[triangle, np.argmin(weight, axis=1)]
        going = ~inside & (ahead >= 0)
        walking, triangle = walking[going], ahead[going]
        if not walking.size:
            break
    return result.reshape(at[0].shape)


def _barycentric(corners: Values, places: Values) -> Values:
    """Weights of a triangle's corners (N, 3, 2) at places (N, 2), (N, 3): negative beyond the edge opposite."""
    a, b, c = (corners[:, k] - places for k in range(3))
    areas = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    total = areas.sum(axis=1, keepdims=True)
    return np.asarray(areas / np.where(total == 0, np.nan, total))


def _cross(a: Values, b: Values) -> Values:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


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


def robust_sd(values: Values) -> float:
    """Standard deviation that a normal distribution with the same median absolute deviation has."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def spatial() -> Any:
    """Trees and triangles."""
    try:
        from scipy import spatial
    except ImportError as error:
        raise MissingDependencyError("scipy", "maps") from error
    return spatial


_HUBER_SDS = 1.345
_MEAN_ROUNDS = 20


def robust_mean(values: Values, weights: Values) -> Values:
    """Huber's mean of values (K, D) on each axis, weighted (K,); those far from most count less."""
    centre = np.average(values, axis=0, weights=weights)
    for _ in range(_MEAN_ROUNDS):
        off = np.abs(values - centre)
        scale = np.maximum(np.median(off, axis=0) * 1.4826, 1e-9) * _HUBER_SDS
        share = weights[:, None] * np.minimum(1.0, scale / np.maximum(off, 1e-12))
        moved = (share * values).sum(axis=0) / share.sum(axis=0)
        if np.abs(moved - centre).max() < 1e-6:
            break
        centre = moved
    return np.asarray(centre)
