"""A chart made by a simulated survey is wrong as real charts are, and the navigators that know it stay honest."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.charts import Chart
from uwcoop.world.simulate import open_chart, seabed_and_chart


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


# ------------------------------------------------------------------------------------- the bars, over 20 missions

RUNS = 20
Pooled = dict[str, dict[str, float]]


def pooled(name: str | Path, navigators: str, *overrides: str, runs: int = RUNS) -> Pooled:
    made = uwcoop.study(name, runs, navigators.split(","), overrides=overrides)
    found: Pooled = made.summary["variants"][0]["navigators"]
    return found


@pytest.mark.long
def test_the_filter_that_knows_of_correlated_errors_is_honest_where_others_are_not() -> None:
    found = pooled("surveyed-bay", "dead-reckoning,dmpf,mpf")
    reckoned, paper, ours = (found[name] for name in ("dead-reckoning", "dmpf", "mpf"))
    for figure in ("median_rmse_m", "median_final_error_m"):
        assert ours[figure] < reckoned[figure] / 2
        assert paper[figure] > reckoned[figure] / 2
    assert ours["anees_median"] <= 2.6
    assert ours["anees"] <= 4
    assert paper["anees_median"] > 100
    assert paper["lost_share"] > 0.7


@pytest.mark.long
@pytest.mark.parametrize("tails", [(), ("navigator.mpf.student_dof=4.0",)])
def test_a_white_likelihood_fails_with_and_without_tails(tails: tuple[str, ...]) -> None:
    found = pooled("surveyed-bay", "mpf", "navigator.mpf.correlation_length_m=0", *tails)
    assert found["mpf"]["anees_median"] > 20
    assert found["mpf"]["lost_share"] > 0.5


@pytest.mark.long
@pytest.mark.parametrize("drift", ["dvl", "no-dvl"])
def test_the_same_on_real_soundings(
    reference: Path, study_module: Callable[[str], ModuleType], tmp_path: Path, drift: str
) -> None:
    aburatsubo = study_module("aburatsubo")
    teams = aburatsubo.teams(reference)
    assert sum(len(team) for team in teams) >= 5
    for team in teams:
        scenario_file = aburatsubo.write_team(reference, team, tmp_path / team[0], drift)
        found = pooled(scenario_file, "dead-reckoning,dmpf,mpf")
        assert found["mpf"]["median_rmse_m"] < found["dead-reckoning"]["median_rmse_m"] / 2
        assert found["mpf"]["anees_median"] <= 2.6
        assert found["dmpf"]["anees_median"] > 20
        white = pooled(scenario_file, "mpf", "navigator.mpf.correlation_length_m=0")
        assert white["mpf"]["anees_median"] > found["mpf"]["anees_median"]


@pytest.mark.long
def test_a_bottom_that_cannot_localise_is_said_to_be_one(
    reference: Path, study_module: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    navo = study_module("navo")
    found = pooled(navo.write_mission(reference, tmp_path), "dead-reckoning,dmpf,mpf-terrain-only,mpf")
    reckoned = found["dead-reckoning"]
    for name in ("mpf", "mpf-terrain-only"):
        assert 1.4 < found[name]["anees"] < 2.6
        # Errors that last make the median over vehicles smaller than 2: that of dead reckoning is exact.
        assert 0.9 * reckoned["anees_median"] < found[name]["anees_median"] < 2.6
        assert found[name]["median_rmse_m"] > 0.7 * reckoned["median_rmse_m"]
    assert found["dmpf"]["anees_median"] > 100
    assert found["dmpf"]["median_rmse_m"] > 0.7 * reckoned["median_rmse_m"]
