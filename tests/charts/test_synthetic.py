"""Synthetic charts: the same seed is the same seabed, and the seabed is what its description says."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from uwcoop.charts import reachable_sigma, synthetic
from uwcoop.charts.information import slope
from uwcoop.errors import ChartError


@pytest.mark.parametrize("name", ["st-john", "poor-bay"])
def test_a_seed_is_a_seabed(name: str) -> None:
    one, again, other = synthetic(name, seed=4), synthetic(name, seed=4), synthetic(name, seed=5)
    assert one.sha256 == again.sha256
    assert one.sha256 != other.sha256
    assert one.shape == (1001, 1001)
    assert one.extent == (0, 0, 1000, 1000)
    assert (one.cell_m, one.sigma_map_m, one.correlation_length_m, one.hole_share) == (1, 0, 0, 0)
    assert "seed 4" in one.notes[0]


@pytest.mark.parametrize("seed", range(4))
def test_st_john_has_rich_and_flat_ground_between_a_few_and_thirty_metres(seed: int) -> None:
    chart = synthetic("st-john", seed=seed)
    shallow, deep = chart.depth_range_m
    assert 1.0 < shallow < 8.0
    assert 20.0 < deep < 32.0
    steep = slope(chart)
    assert 0.1 < np.nanquantile(steep, 0.9) < 0.3
    # Ground that fixes a position to half a metre, and ground where a crossing leaves metres.
    sigma = reachable_sigma(chart)
    assert (sigma < 1.0).mean() > 0.2
    assert (sigma > 3.0).mean() > 0.2


def test_relief_scales_the_deviation_from_the_mean_depth() -> None:
    full, flat = synthetic("st-john", seed=1), synthetic("st-john", seed=1, relief=0.15)
    assert flat.depth_m.mean() == pytest.approx(full.depth_m.mean(), abs=1e-3)
    assert flat.depth_m.std() == pytest.approx(0.15 * full.depth_m.std(), rel=1e-4)
    assert synthetic("st-john", seed=1, relief=0.0).depth_m.std() == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_poor_bay_is_as_its_description_states(seed: int) -> None:
    """Relief of 0.5 m at 30-400 m, amplitude ∝ f^-1.5, detail of at most 7 cm, about 15 m deep."""
    depth = synthetic("poor-bay", seed=seed).depth_m.astype(float)
    assert depth.mean() == pytest.approx(15.0, abs=0.05)
    assert depth.std() == pytest.approx(0.5, rel=0.02)
    window = np.hanning(depth.shape[0])
    spectrum = np.abs(np.fft.fft2((depth - depth.mean()) * np.outer(window, window))) ** 2
    frequency = np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(depth.shape[0], 1.0)]))
    in_band = (frequency > 1 / 450) & (frequency < 1 / 28)
    detail = (frequency > 1 / 26) & (frequency < 1 / 3.5)
    assert spectrum[in_band].sum() > 0.97 * spectrum[1:, 1:].sum()
    assert 0 < spectrum[detail].sum() / spectrum.sum() < (0.07 / 0.5) ** 2
    edges = np.geomspace(1 / 250, 1 / 35, 8)
    bands = [spectrum[(frequency >= a) & (frequency < b)].mean() for a, b in pairwise(edges)]
    exponent = np.polyfit(np.log(np.sqrt(edges[1:] * edges[:-1])), np.log(bands) / 2, 1)[0]
    assert exponent == pytest.approx(-1.5, abs=0.3)


def test_size_is_chosen_in_metres() -> None:
    small, large = synthetic("st-john", seed=2, size_m=200), synthetic("poor-bay", seed=2, size_m=1500)
    assert small.extent == (0, 0, 200, 200)
    assert large.shape == (1501, 1501)
    np.testing.assert_allclose(small.depth_m, synthetic("st-john", seed=2).depth_m[:201, :201], atol=1e-5)


def test_arguments_out_of_bounds_are_refused() -> None:
    for arguments, message in [
        ({"name": "atlantis"}, "'atlantis' is unknown: choose one of charles-river, poor-bay, st-john"),
        ({"name": "st-john", "seed": -1}, "seed -1 must be at least 0"),
        ({"name": "st-john", "relief": -0.1}, "relief -0.1 must be"),
        ({"name": "st-john", "relief": 3.0}, "relief 3.0 lifts the seabed to a depth of -"),
        ({"name": "st-john", "size_m": 20}, "size 20 m is outside 50 to 4000 m"),
    ]:
        with pytest.raises(ChartError, match=message):
            synthetic(**arguments)  # type: ignore[arg-type]
