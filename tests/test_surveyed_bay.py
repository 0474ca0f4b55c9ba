"""A chart made by a simulated survey is wrong as real charts are, and the navigators that know it stay honest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import metrics, scenario
from uwcoop.charts import Chart
from uwcoop.simulate import open_chart, seabed_and_chart


@pytest.fixture(scope="module")
def charts() -> tuple[Chart, Chart]:
    spec = scenario.load("surveyed-bay").chart
    return seabed_and_chart(spec, open_chart(spec), seed=0)


def error_at(charts: tuple[Chart, Chart], points: Any) -> Any:
    seabed, seen = charts
    return seen.depth_at(points) - seabed.depth_at(points)


def test_the_error_has_holes_grows_with_slope_and_is_correlated(charts: tuple[Chart, Chart]) -> None:
    seabed, seen = charts
    assert 0.01 < seen.hole_share < 0.6
    points = np.random.default_rng(1).uniform(60, 940, (20_000, 2))
    error = error_at(charts, points)
    slope = np.hypot(*seabed.gradient(points).T)
    known = np.isfinite(error) & np.isfinite(slope)
    steep = slope > np.quantile(slope[known], 0.75)
    flat = slope < np.quantile(slope[known], 0.25)
    assert error[known & steep].std() > 2 * error[known & flat].std()

    def correlation(lag_m: float) -> float:
        moved = error_at(charts, points + np.array([lag_m, 0.0]))
        both = known & np.isfinite(moved)
        return float(np.corrcoef(error[both], moved[both])[0, 1])

    assert correlation(2.0) > 0.6
    assert correlation(2.0) > correlation(8.0) > correlation(40.0)
    assert abs(correlation(200.0)) < 0.15


def test_the_chart_states_its_error(charts: tuple[Chart, Chart]) -> None:
    points = np.random.default_rng(2).uniform(60, 940, (20_000, 2))
    error = error_at(charts, points)
    stated = np.nanmean(charts[1].sigma_at(points))
    assert 0.5 < stated / np.nanstd(error) < 3
    assert 3 <= charts[1].correlation_length_m <= 30


def test_vehicles_sound_the_seabed_and_not_the_chart() -> None:
    log = uwcoop.simulate(scenario.load("surveyed-bay", ("duration_s=120",)), seed=0)
    assert log.chart is not None
    assert log.truth is not None
    table = log.events["water_depth"]
    seabed = open_chart(scenario.load("surveyed-bay").chart)
    position = log.truth.position_m.values[table["vehicle"], table["t_ns"] // 10**9]
    np.testing.assert_allclose(table["water_depth_m"], seabed.depth_at(position), atol=0.3)
    assert np.nanstd(table["water_depth_m"] - log.chart.depth_at(position)) > 0.1


@pytest.mark.long
def test_the_filter_that_knows_of_correlated_errors_is_honest_where_others_are_not() -> None:
    rows = []
    for seed in range(20):
        log = uwcoop.simulate("surveyed-bay", seed=seed)
        result = uwcoop.run(log, ["dead-reckoning", "dmpf", "mpf"], clouds=False)
        rows += metrics.rows(result.tracks, seconds=result.seconds, packets=result.packets, run=seed)
    pooled = metrics.pool(rows)
    assert pooled["mpf"]["median_rmse_m"] < pooled["dead-reckoning"]["median_rmse_m"] / 2
    assert pooled["mpf"]["anees_median"] <= 2.6
    assert pooled["dmpf"]["anees_median"] > 20
