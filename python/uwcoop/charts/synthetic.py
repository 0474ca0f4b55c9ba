"""Synthetic charts from seeded NumPy: the same seed gives the same bits on one machine.

`st-john` is like the waters around St John's Island, Singapore, where Tan, Chitre & Hover (2016) simulate: a
shore platform, a slope, a deep basin filled flat by sediment, a winding channel, mounds, and patches of rough
ground. About half the area tells a vehicle where it is within metres; over the rest it has to wait or ask.
`poor-bay` has hardly any relief. `charles-river` is like the basin of their section 6.1: small, flat, and patchy
in places.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.chart import Chart
from uwcoop.errors import ChartError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Grid = NDArray[np.float64]

SIZE_M = 1000.0
SIZES_M = {"charles-river": (500.0, 300.0)}
"""East and north, where it is not `SIZE_M` squared."""
CELL_M = 1.0
SHALLOWEST_M = 0.5
"""A chart whose relief would bring the seabed above this depth is refused."""


def synthetic(
    name: str, *, seed: int = 0, relief: float = 1.0, size_m: float | tuple[float, float] | None = None
) -> Chart:
    """A synthetic chart with 1 m cells and its south-west corner at (0, 0), without error or holes.

    Args:
        name: "st-john", "poor-bay" or "charles-river".
        seed: 0 or above; another seed is another seabed of the same kind.
        relief: factor on every depth's deviation from the mean depth; 0.15 makes a flat bay.
        size_m: side, or east and north, metres, each 50 to 4000; None: 1000, `charles-river` 500 by 300. Below
            1000 the corner of a chart of 1000 m.

    Raises:
        ChartError: an unknown name or an argument outside its bounds.
    """
    if name not in _MAKERS:
        raise ChartError(f"synthetic chart {name!r} is unknown: choose one of {', '.join(sorted(_MAKERS))}")
    if seed < 0:
        raise ChartError(f"synthetic chart seed {seed} must be at least 0")
    if not (np.isfinite(relief) and relief >= 0):
        raise ChartError(f"synthetic chart relief {relief} must be finite and at least 0")
    sides = SIZES_M.get(name, (SIZE_M, SIZE_M)) if size_m is None else size_m
    east_m, north_m = sides if isinstance(sides, tuple) else (sides, sides)
    for side in (east_m, north_m):
        if not 50 <= side <= 4000:
            raise ChartError(f"synthetic chart size {side} m is outside 50 to 4000 m")
    columns, rows, least = (round(side / CELL_M) + 1 for side in (east_m, north_m, SIZE_M))
    depth = _MAKERS[name](np.random.default_rng(np.random.SeedSequence(seed)), max(columns, rows, least))
    depth = depth[:rows, :columns]
    mean = float(depth.mean())
    depth = mean + relief * (depth - mean)
    if depth.min() < SHALLOWEST_M:
        raise ChartError(
            f"synthetic chart relief {relief} lifts the seabed to a depth of {depth.min():.2f} m, "
            f"above the least depth of {SHALLOWEST_M} m"
        )
    note = f"synthetic {name}, seed {seed}, relief x {relief:g}: a perfect chart, sigma_map 0"
    return Chart(depth.astype(np.float32), 0.0, 0.0, CELL_M, name=name, notes=(note,))


def _st_john(rng: np.random.Generator, nodes: int) -> Grid:
    """Shore platform, slope and filled basin; on top a channel, mounds, rough patches, faint ripples."""
    side = (nodes - 1) * CELL_M
    axis = np.linspace(0.0, side, nodes)
    east, north = axis[None, :], axis[:, None]
    azimuth = rng.uniform(0, 2 * np.pi)
    offshore = ((east - side / 2) * np.cos(azimuth) + (north - side / 2) * np.sin(azimuth)) / side
    depth = 14.0 + 11.0 * np.tanh(3.5 * offshore) + 2.2 * _spectral(rng, nodes, 250.0, 900.0, 2.0)
    basin = 21.0 + 0.1 * _spectral(rng, nodes, 300.0, 1000.0, 2.0)
    platform = 6.0 + 0.1 * _spectral(rng, nodes, 300.0, 1000.0, 2.0)
    depth = _soft_minimum(depth, basin, 0.8)
    depth = -_soft_minimum(-depth, -platform, 0.8)
    depth += _channel(rng, east, north, side)
    depth -= _mounds(rng, east, north, side)
    depth += _patches(rng, nodes, 350.0) * _spectral(rng, nodes, 10.0, 90.0, 1.3)
    depth += 0.02 * _spectral(rng, nodes, 40.0, 150.0, 1.5)
    return np.asarray(-_soft_minimum(-depth, np.full_like(depth, -1.5), 0.3))


def _poor_bay(rng: np.random.Generator, nodes: int) -> Grid:
    """Relief of 0.5 m standard deviation at wavelengths of 30-400 m; detail of at most 7 cm, in patches."""
    relief = 0.5 * _spectral(rng, nodes, 30.0, 400.0, 1.5)
    detail = _patches(rng, nodes, 200.0) * _spectral(rng, nodes, 4.0, 30.0, 1.0)
    return np.asarray(15.0 + relief + 0.07 * detail / np.abs(detail).max())


def _charles_river(rng: np.random.Generator, nodes: int) -> Grid:
    """Flat mud about 6 m deep with a faint undulation; in patches relief of decimetres at 12-70 m."""
    basin = 6.0 + 0.15 * _spectral(rng, nodes, 200.0, 700.0, 2.0)
    mud = 0.03 * _spectral(rng, nodes, 20.0, 120.0, 1.5)
    rough = 0.35 * _patches(rng, nodes, 160.0) * _spectral(rng, nodes, 12.0, 70.0, 1.3)
    return np.asarray(basin + mud + rough)


_MAKERS: dict[str, Callable[[np.random.Generator, int], Grid]] = {
    "st-john": _st_john,
    "poor-bay": _poor_bay,
    "charles-river": _charles_river,
}


def _spectral(
    rng: np.random.Generator, nodes: int, shortest_m: float, longest_m: float, exponent: float
) -> Grid:
    """Noise of mean 0 and standard deviation 1 in a band of wavelengths, amplitude ∝ frequency^-exponent."""
    padded = nodes + 64  # the field is periodic; the margin keeps opposite edges from being alike
    frequency = np.hypot(np.fft.fftfreq(padded, CELL_M)[:, None], np.fft.rfftfreq(padded, CELL_M)[None, :])
    longest_m = min(longest_m, padded * CELL_M)
    band = (frequency >= (1 - 1e-9) / longest_m) & (frequency <= 1 / shortest_m)
    amplitude = np.zeros_like(frequency)
    amplitude[band] = frequency[band] ** -exponent
    white = rng.standard_normal(frequency.shape) + 1j * rng.standard_normal(frequency.shape)
    field = np.fft.irfft2(amplitude * white, (padded, padded))[:nodes, :nodes]
    return np.asarray((field - field.mean()) / field.std())


def _patches(rng: np.random.Generator, nodes: int, wavelength_m: float) -> Grid:
    """Smooth mask between 0 and 1, near 1 in patches that cover two fifths of the area."""
    noise = _spectral(rng, nodes, wavelength_m, 3 * wavelength_m, 1.0)
    return np.asarray(1 / (1 + np.exp(-6 * (noise - 0.2))))


def _soft_minimum(a: Grid, b: Grid, width_m: float) -> Grid:
    """The smaller of two surfaces, rounded over about `width_m` of depth where they cross."""
    return np.asarray(-width_m * np.logaddexp(-a / width_m, -b / width_m))


def _channel(rng: np.random.Generator, east: Grid, north: Grid, side: float) -> Grid:
    """Depth added by one winding channel across the chart, metres."""
    azimuth = rng.uniform(0, np.pi)
    along = (east - side / 2) * np.cos(azimuth) + (north - side / 2) * np.sin(azimuth)
    across = (north - side / 2) * np.cos(azimuth) - (east - side / 2) * np.sin(azimuth)
    bend = 0.07 * side * np.sin(2 * np.pi * along / (0.8 * side) + rng.uniform(0, 2 * np.pi))
    middle = bend + rng.uniform(-0.2, 0.2) * side
    return np.asarray(4.0 * np.exp(-0.5 * ((across - middle) / 35.0) ** 2))


def _mounds(rng: np.random.Generator, east: Grid, north: Grid, side: float) -> Grid:
    """Height added by round mounds strewn over the chart, metres."""
    total = np.zeros((north.size, east.size))
    for _ in range(round(8 * (side / 1000.0) ** 2)):
        e, n = rng.uniform(0, side, 2)
        radius, height = rng.uniform(12, 35), rng.uniform(0.6, 3.0)
        total += (
            height * np.exp(-0.5 * ((north - n) / radius) ** 2) * np.exp(-0.5 * ((east - e) / radius) ** 2)
        )
    return total
