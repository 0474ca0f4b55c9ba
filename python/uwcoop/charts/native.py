"""A chart in the core's form."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop import _native
from uwcoop.charts.slopes import node_sigma

if TYPE_CHECKING:
    from uwcoop.charts.chart import Chart

__all__ = ["native_chart"]


def native_chart(chart: Chart) -> _native.Chart:
    """The chart in the core's form; share it between vehicles and navigators."""
    sigma = chart.sigma_map_m if chart.horizontal_error_m <= 0 else node_sigma(chart).astype(np.float32)
    per_node = isinstance(sigma, np.ndarray)
    finite = np.asarray(sigma)[np.isfinite(sigma)]
    return _native.Chart(
        np.ascontiguousarray(chart.depth_m),
        chart.east0_m,
        chart.north0_m,
        chart.cell_m,
        np.ascontiguousarray(sigma) if per_node else float(sigma),
        float(np.median(finite)) if finite.size else 0.0,
        chart.correlation_length_m,
    )
