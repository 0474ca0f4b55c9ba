"""The terrain's information on position: Fisher information of depth, and a summary of a chart.

A vehicle that crosses a window sounds n times, over slopes g, with an unknown offset between its depths and
the chart's (the tide). What is left about position after the offset is

    J = n / n_c · (mean(w g gᵀ) − mean(w g) mean(w g)ᵀ / mean(w)),   w = 1 / (σ² + σ_map²),

the scatter of slopes: a plane, however steep, tells nothing that another tide would not. 1/√λ_min(J) is the
standard deviation along the direction that a crossing tells least about.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.slopes import node_sigma
from uwcoop.charts.windows import square_sums
from uwcoop.errors import MissingDependencyError
from uwcoop.frames import LocalFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.charts.chart import Chart

    Grid = NDArray[np.float64]

_BAND_NODES = 1 << 18
"""Nodes whose information is found at a time."""


@dataclass(frozen=True)
class Sounding:
    """How a vehicle sounds while it crosses a window: what "terrain helps" means.

    Attributes:
        sigma_m: standard deviation of one sounding, metres.
        spacing_m: metres travelled between soundings (1.5 m/s at 1 Hz).
        window_m: side of the window and length of one crossing, metres.
        helps_below_m: terrain helps where one crossing fixes both coordinates better than this.
    """

    sigma_m: float = 0.1
    spacing_m: float = 1.5
    window_m: float = 50.0
    helps_below_m: float = 5.0


def slope(chart: Chart) -> Grid:
    """Steepness at each node, m/m, (rows, cols); NaN at holes and beside them."""
    north, east = _gradient(chart.depth_m, chart.cell_m)
    return np.hypot(east, north)


def fisher_information(chart: Chart, sounding: Sounding | None = None) -> Grid:
    """Information matrix about [east, north] from one crossing of the window around each node, 1/m².

    Chart errors that stay the same over `correlation_length_m` make neighbouring soundings say the same: n_c
    of them count as one. Windows that are less than half charted give NaN.

    Returns:
        (rows, cols, 2, 2).
    """
    return _information(chart, slice(0, chart.shape[0]), sounding or Sounding(), node_sigma(chart))


def _half_window(chart: Chart, sounding: Sounding) -> int:
    """Nodes on each side of the middle one of a window."""
    return max(1, round(sounding.window_m / chart.cell_m / 2))


def _information(chart: Chart, rows: slice, sounding: Sounding, sigma: Grid) -> Grid:
    """Information matrices of some rows, right for those that lie a window's half away from where they are cut."""
    depth = chart.depth_m[rows]
    north, east = _gradient(depth, chart.cell_m)
    known = np.isfinite(east)
    n_c = max(1.0, 2 * chart.correlation_length_m / sounding.spacing_m)
    weight = np.where(known, 1 / (sounding.sigma_m**2 + sigma[rows] ** 2), 0.0)
    east, north = np.where(known, east, 0.0), np.where(known, north, 0.0)
    half = _half_window(chart, sounding)
    count, whole = square_sums(known.astype(float), half), square_sums(np.ones(known.shape), half)
    nodes = np.maximum(count, 1.0)
    mean_w, mean_e, mean_n = (
        square_sums(weight * g, half) / nodes for g in (np.ones_like(east), east, north)
    )
    mean_w = np.where(mean_w > 0, mean_w, np.inf)
    crossing = sounding.window_m / sounding.spacing_m / n_c
    matrix = np.empty((*known.shape, 2, 2))
    slopes, means = (east, north), (mean_e, mean_n)
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        product = square_sums(weight * slopes[i] * slopes[j], half) / nodes
        matrix[..., i, j] = crossing * (product - means[i] * means[j] / mean_w)
    matrix[(count < 0.5 * whole) | np.isnan(depth)] = np.nan
    return matrix


def reachable_sigma(chart: Chart, sounding: Sounding | None = None) -> Grid:
    """Standard deviation of position in the worse direction after one crossing, metres, (rows, cols).

    Infinite where a direction stays unknown; NaN at holes and where less than half the window is charted.
    """
    sounding = sounding or Sounding()
    rows, cols = chart.shape
    half, sigma = _half_window(chart, sounding), node_sigma(chart)
    band = max(2 * half, _BAND_NODES // cols)
    reachable = np.empty(chart.shape)
    # By bands of rows with as many more as a window reaches: the matrices of a whole chart take half a gigabyte.
    for start in range(0, rows, band):
        first, last = max(0, start - half - 1), min(rows, start + band + half + 1)
        matrix = _information(chart, slice(first, last), sounding, sigma)
        own = slice(start - first, min(start + band, rows) - first)
        reachable[start : start + band] = _worse_direction(matrix[own])
    return reachable


def _worse_direction(matrix: Grid) -> Grid:
    a, b, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    least = (a + d) / 2 - np.sqrt(((a - d) / 2) ** 2 + b**2)
    # Differences of nearly equal numbers: below rounding there is no information, not a negative one.
    least = np.where(least > 1e-9 * (a + d), least, np.where(np.isnan(least), np.nan, 0.0))
    with np.errstate(divide="ignore"):
        return np.asarray(1 / np.sqrt(least))


def describe(chart: Chart, sounding: Sounding | None = None) -> dict[str, Any]:
    """What a chart holds, as plain numbers ready for a table or JSON; shares are of the charted nodes.

    Keys: name, extent_m, corners_deg ([latitude, longitude] of south-west, south-east, north-east and north-west; None
    where the place on Earth is not known), size_m, cell_m, rows, cols, depth_m {min, median, max}, hole_share,
    slope {q50, q90, q99}, terrain {helps_share, median_sigma_m, helps_below_m, window_m, sounding_sigma_m}, sigma_map_m
    (median), correlation_length_m, origin {latitude_deg, longitude_deg, crs}, sha256, notes. A median that is
    infinite, or a quantile that no node has, is None.
    """
    sounding = sounding or Sounding()
    west, south, east, north = chart.extent
    steepness = slope(chart)
    steepness = steepness[np.isfinite(steepness)]
    sigma = reachable_sigma(chart, sounding)
    judged = sigma[~np.isnan(sigma)]
    low, high = chart.depth_range_m
    return {
        "name": chart.name,
        "extent_m": {"west": west, "south": south, "east": east, "north": north},
        "corners_deg": _corners(chart),
        "size_m": {"east": east - west, "north": north - south},
        "cell_m": chart.cell_m,
        "rows": chart.shape[0],
        "cols": chart.shape[1],
        "depth_m": {"min": low, "median": float(np.nanmedian(chart.depth_m)), "max": high},
        "hole_share": chart.hole_share,
        "slope": {f"q{q}": _quantile(steepness, q) for q in (50, 90, 99)},
        "terrain": {
            "helps_share": float((judged < sounding.helps_below_m).mean()) if judged.size else None,
            "median_sigma_m": _quantile(judged, 50),
            "helps_below_m": sounding.helps_below_m,
            "window_m": sounding.window_m,
            "sounding_sigma_m": sounding.sigma_m,
        },
        "sigma_map_m": float(np.nanmedian(chart.sigma_map_m)),
        "correlation_length_m": chart.correlation_length_m,
        "origin": {
            "latitude_deg": chart.origin.latitude_deg,
            "longitude_deg": chart.origin.longitude_deg,
            "crs": chart.origin.crs,
        },
        "sha256": chart.sha256,
        "notes": list(chart.notes),
    }


def _corners(chart: Chart) -> list[list[float]] | None:
    """Latitude and longitude of the outermost nodes."""
    if chart.origin.latitude_deg is None or chart.origin.longitude_deg is None:
        return None
    west, south, east, north = chart.extent
    places = [(west, south), (east, south), (east, north), (west, north)]
    try:
        found = LocalFrame(chart.origin).to_geographic(places)
    except MissingDependencyError:
        return None
    return [[float(latitude), float(longitude)] for latitude, longitude in found]


def _gradient(depth_m: NDArray[np.float32], cell_m: float) -> tuple[Grid, Grid]:
    """Slopes towards north and east at each node, m/m; NaN at holes and beside them."""
    north, east = np.gradient(depth_m.astype(np.float64), cell_m)
    # A central difference does not read its own node: a hole must not get a slope from its neighbours.
    unknown = np.isnan(north) | np.isnan(east) | np.isnan(depth_m)
    return np.where(unknown, np.nan, north), np.where(unknown, np.nan, east)


def _quantile(values: Grid, percent: int) -> float | None:
    if not values.size:
        return None
    value = float(np.quantile(values, percent / 100, method="lower"))
    return value if np.isfinite(value) else None
