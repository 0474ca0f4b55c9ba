"""A chart's error where it is steep and where it is level.

A horizontal error e of the soundings changes a charted depth by slope · e, so σ² = level² + (slope · e)². Navigators that
take one sigma for all of such a chart learn too little from its level parts and too much from its slopes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from uwcoop.charts.surface import Values

REACH_M = 5.0
"""Slopes are taken over so many metres to each side, or a cell."""


class ChartedDepths(Protocol):
    """What is read of a `Chart`, whose own error depends on this module."""

    @property
    def cell_m(self) -> float: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def east_m(self) -> NDArray[np.float64]: ...
    @property
    def north_m(self) -> NDArray[np.float64]: ...
    @property
    def sigma_map_m(self) -> float | NDArray[np.float32]: ...
    @property
    def horizontal_error_m(self) -> float: ...
    @property
    def level_sigma_m(self) -> float: ...
    def depth_at(self, points: ArrayLike) -> NDArray[np.float64]: ...


def slope_at(chart: ChartedDepths, east_m: Values, north_m: Values, *, one_sided: bool = False) -> Values:
    """Steepness at places, over a few metres; NaN beside holes, or (`one_sided`) where an axis has no depth on either
    side."""
    reach = max(REACH_M, chart.cell_m)

    def depths(east: float, north: float) -> Values:
        return chart.depth_at(np.column_stack([east_m + reach * east, north_m + reach * north]))

    here = depths(0, 0) if one_sided else None
    rises = []
    for east, north in ((1, 0), (0, 1)):
        ahead, behind = depths(east, north), depths(-east, -north)
        rise = (ahead - behind) / (2 * reach)
        if here is not None:
            half = np.where(np.isfinite(ahead), ahead - here, here - behind) / reach
            rise = np.where(np.isfinite(rise), rise, half)
        rises.append(rise)
    return np.asarray(np.hypot(*rises))


def node_sigma(chart: ChartedDepths) -> Values:
    """(rows, cols) standard deviation of the chart's error at each node, metres: its `sigma_map_m`, or as the slope says
    where the chart states a horizontal error; the former where there is no slope."""
    sigma = np.broadcast_to(np.asarray(chart.sigma_map_m, dtype=np.float64), chart.shape)
    if chart.horizontal_error_m <= 0:
        return sigma
    east, north = np.meshgrid(chart.east_m, chart.north_m)
    slope = slope_at(chart, east.ravel(), north.ravel(), one_sided=True).reshape(chart.shape)
    by_slope = np.hypot(chart.level_sigma_m, slope * chart.horizontal_error_m)
    return np.where(np.isfinite(by_slope), by_slope, sigma)
