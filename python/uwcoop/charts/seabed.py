"""A true seabed drawn from a chart: the chart plus one realisation of the error that it states."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.chart import Chart
from uwcoop.errors import ChartError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_HALF_LAG_PER_WIDTH = 2 * np.sqrt(np.log(2))
"""Noise smoothed by a Gaussian of standard deviation w has correlation exp(-d²/4w²): one half at this times w."""


def drawn_seabed(chart: Chart, rng: np.random.Generator) -> Chart:
    """A perfect chart of a seabed whose difference from `chart` has that chart's sigma and correlation length.

    Holes stay holes. A correlation length below half a cell makes the error of each node its own.

    Raises:
        ChartError: the chart states no error, or one so large that it lifts the seabed above the surface.
    """
    sigma = np.nan_to_num(np.asarray(chart.sigma_map_m, dtype=np.float64))
    if not np.any(sigma > 0):
        raise ChartError(f"chart {chart.name!r} states no error of its own: give sigma_map_m")
    depth = chart.depth_m + sigma * _field(chart.shape, chart.correlation_length_m / chart.cell_m, rng)
    if np.nanmin(depth) <= 0:
        raise ChartError(
            f"chart error of sigma {float(sigma.max()):g} m lifts the seabed of {chart.name!r} to a depth of "
            f"{float(np.nanmin(depth)):.2f} m: above the surface"
        )
    note = (
        f"seabed drawn from {chart.name}: its error, median sigma {float(np.median(sigma[sigma > 0])):.2g} m, "
        f"correlated over {chart.correlation_length_m:g} m"
    )
    return replace(
        chart,
        depth_m=depth.astype(np.float32),
        sigma_map_m=0.0,
        correlation_length_m=0.0,
        name=f"{chart.name}, drawn",
        notes=(note,),
    )


def _field(shape: tuple[int, int], half_lag: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Gaussian noise of mean 0 and standard deviation 1 whose correlation is one half at `half_lag` nodes."""
    if half_lag < 0.5:
        return rng.standard_normal(shape)
    width = half_lag / _HALF_LAG_PER_WIDTH
    # The field is periodic: a margin of three correlation lengths keeps opposite edges apart.
    padded = tuple(n + int(3 * half_lag) + 1 for n in shape)
    frequency = np.hypot(np.fft.fftfreq(padded[0])[:, None], np.fft.rfftfreq(padded[1])[None, :])
    response = np.exp(-2 * (np.pi * width * frequency) ** 2)
    white = rng.standard_normal(padded)
    field = np.fft.irfft2(np.fft.rfft2(white) * response, padded)
    kernel = np.fft.irfft2(response, padded)
    return np.asarray(field[: shape[0], : shape[1]] / np.sqrt(np.sum(kernel**2)))
