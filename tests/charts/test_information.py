"""What terrain says about position: against cases with known answers, and the picture of it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from uwcoop.charts import Chart, describe, reachable_sigma, synthetic
from uwcoop.charts.information import Sounding, fisher_information, slope

N = 161
EAST, NORTH = np.meshgrid(np.arange(N) * 1.0, np.arange(N) * 1.0)
WAVES = 20 + 0.5 * np.sin(2 * np.pi * EAST / 20) + 0.25 * np.sin(2 * np.pi * NORTH / 20)
MIDDLE = (N // 2, N // 2)


def chart(depth: Any, **changes: Any) -> Chart:
    return Chart(depth, 0, 0, 1, **changes)


def test_waves_give_the_information_of_their_mean_squared_slope() -> None:
    sounding = Sounding(sigma_m=0.1, spacing_m=2.0, window_m=40.0)
    matrix = fisher_information(chart(WAVES), sounding)[MIDDLE]
    # 20 soundings of 0.1 m over slopes of (0.5, 0.25) 2π/20 cos: half their squares on the mean.
    expected = 20 / 0.1**2 * 0.5 * (2 * np.pi / 20 * np.array([0.5, 0.25])) ** 2
    # Central differences at 18° per node see sin(18°)/18° of a slope.
    expected *= (np.sin(np.deg2rad(18)) / np.deg2rad(18)) ** 2
    np.testing.assert_allclose(np.diag(matrix), expected, rtol=0.04)
    assert abs(matrix[0, 1]) < 0.02 * expected[1]
    assert matrix[0, 1] == matrix[1, 0]
    assert reachable_sigma(chart(WAVES), sounding)[MIDDLE] == pytest.approx(expected[1] ** -0.5, rel=0.04)


def test_a_plane_tells_nothing_that_another_tide_would_not() -> None:
    sigma = reachable_sigma(chart(20 + 0.1 * EAST - 0.05 * NORTH))
    assert (sigma[np.isfinite(sigma)] > 50).all()
    assert np.isposinf(reachable_sigma(chart(np.full((N, N), 20.0)))).all()


def test_ripples_along_one_direction_leave_the_other_unknown() -> None:
    assert reachable_sigma(chart(20 + np.sin(EAST / 3)))[MIDDLE] > 50


def test_chart_error_and_its_correlation_cost_information() -> None:
    def middle(**changes: Any) -> float:
        return float(reachable_sigma(chart(WAVES, **changes), Sounding(sigma_m=0.1))[MIDDLE])

    perfect = middle()
    assert middle(sigma_map_m=0.3) == pytest.approx(perfect * np.sqrt(10), rel=1e-6)
    assert middle(sigma_map_m=np.full((N, N), 0.3)) == pytest.approx(middle(sigma_map_m=0.3), rel=1e-5)
    white = middle(sigma_map_m=0.3)
    # 2 L / s = 20 / 1.5 soundings count as one.
    assert middle(sigma_map_m=0.3, correlation_length_m=10) == pytest.approx(
        white * np.sqrt(20 / 1.5), rel=1e-6
    )


def test_holes_have_no_information_and_no_slope() -> None:
    depth = WAVES.copy()
    depth[:, 100:] = np.nan
    holed = chart(depth)
    sigma = reachable_sigma(holed)
    assert np.isnan(sigma[:, 100:]).all()
    assert np.isfinite(sigma[:, 60:95]).all()
    steep = slope(holed)
    assert np.isnan(steep[:, 99:]).all()
    assert steep[80, 40] == pytest.approx(np.hypot(*holed.gradient([[40.0, 80.0]])[0]), abs=0.05)


def test_description_holds_plain_numbers() -> None:
    depth = WAVES.copy()
    depth[:40, :40] = np.nan
    facts = describe(chart(depth, sigma_map_m=0.2, correlation_length_m=5.0, name="waves", notes=("made",)))
    assert json.loads(json.dumps(facts)) == facts
    assert facts["extent_m"] == {"west": 0.0, "south": 0.0, "east": 160.0, "north": 160.0}
    assert (facts["rows"], facts["cols"], facts["cell_m"]) == (N, N, 1.0)
    assert facts["hole_share"] == pytest.approx(1600 / N**2)
    assert facts["depth_m"]["min"] == pytest.approx(19.25)
    assert facts["depth_m"]["max"] == pytest.approx(20.75)
    assert facts["slope"]["q50"] < facts["slope"]["q90"] < facts["slope"]["q99"] < 0.18
    assert 0 <= facts["terrain"]["helps_share"] <= 1
    assert (facts["sigma_map_m"], facts["correlation_length_m"], facts["notes"]) == (0.2, 5.0, ["made"])


def test_flat_and_tiny_charts_are_described_too() -> None:
    flat = describe(chart(np.full((30, 30), 5.0)))
    assert (flat["terrain"]["helps_share"], flat["terrain"]["median_sigma_m"]) == (0.0, None)
    tiny = describe(chart([[1.0, 2.0], [3.0, np.nan]]))
    assert tiny["slope"]["q50"] == pytest.approx(5**0.5)
    assert tiny["terrain"]["helps_share"] is None


@pytest.mark.parametrize("kind", ["synthetic", "wide", "holed", "flat", "tiny"])
def test_picture_shows_both_maps_whole(kind: str) -> None:
    pytest.importorskip("matplotlib")
    from uwcoop.figures.chart import chart_figure

    holed = WAVES.copy()
    holed[60:, 60:] = np.nan
    subject = {
        "synthetic": lambda: synthetic("poor-bay", seed=0, size_m=200),
        "wide": lambda: chart(WAVES[:40]),
        "holed": lambda: chart(holed),
        "flat": lambda: chart(np.full((30, 30), 5.0)),
        "tiny": lambda: chart([[1.0, 2.0], [3.0, np.nan]]),
    }[kind]()
    figure = chart_figure(subject)
    figure.draw_without_rendering()
    maps = figure.axes[:2]
    assert [axes.get_aspect() for axes in maps] == [1.0, 1.0]
    assert {axes.get_ylabel() for axes in figure.axes[2:]} == {
        "depth (m)",
        "σ of position, worse direction (m)",
    }
    page = figure.bbox
    for axes in figure.axes:
        box = axes.get_tightbbox()
        assert box is not None
        assert page.x0 <= box.x0
        assert page.y0 <= box.y0
        assert box.x1 <= page.x1
        assert box.y1 <= page.y1
