"""Simulated surveys and drawn seabeds: a wrong chart, and in which ways it is wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.charts import Chart, synthetic
from uwcoop.charts.residuals import autocorrelation
from uwcoop.charts.seabed import drawn_seabed
from uwcoop.charts.survey import Surveyed, sail, surveyed_chart
from uwcoop.errors import ChartError, ScenarioError
from uwcoop.scenario.chart import Survey

pytest.importorskip("scipy")

SEABED = synthetic("st-john", size_m=400)
PLAN = Survey().plan()
EXACT = replace(PLAN, position_sigma_m=0.0, segment_sigma_m=0.0, sounding_sigma_m=0.0, datum_sigma_m=0.0)


def believed(surveyed: Surveyed) -> Any:
    return np.column_stack([surveyed.soundings.east_m, surveyed.soundings.north_m])


def test_without_errors_the_soundings_are_the_seabed() -> None:
    surveyed = sail(SEABED, EXACT, 0)
    np.testing.assert_array_equal(believed(surveyed), surveyed.true_position_m)
    np.testing.assert_allclose(surveyed.soundings.depth_m, SEABED.depth_at(surveyed.true_position_m))
    chart = surveyed_chart(SEABED, replace(EXACT, line_spacing_m=4.0, max_gap_m=6.0), 0).chart
    at = np.random.default_rng(0).uniform(20, 380, (2000, 2))
    # What is left is the gridding to 2 m over the roughest ground.
    assert np.nanstd(chart.depth_at(at) - SEABED.depth_at(at)) < 0.1
    assert np.max(chart.sigma_map_m) < 0.15


def test_lines_have_their_spacing_and_their_heading() -> None:
    plan = replace(EXACT, surveys=2, heading_deg=0.0, turn_deg=90.0, line_spacing_m=25.0)
    surveyed = sail(SEABED, plan, 1)
    first = surveyed.soundings.survey == 0
    for axis, chosen in ((0, first), (1, ~first)):  # north-south lines have one easting each
        lines = np.unique(surveyed.true_position_m[chosen, axis].round(6))
        assert lines.size == 16
        np.testing.assert_allclose(np.diff(lines), 25.0)
    assert surveyed.soundings.time_s is not None
    steps = np.hypot(*np.diff(surveyed.true_position_m[first], axis=0).T)
    assert np.median(steps) == pytest.approx(plan.speed_mps * plan.interval_s)
    assert np.diff(surveyed.soundings.time_s[first]).min() == pytest.approx(plan.interval_s)


def test_errors_are_of_the_size_and_the_persistence_that_were_asked_for() -> None:
    big = synthetic("poor-bay")
    drift = sail(big, replace(EXACT, position_sigma_m=4.0, position_time_s=60.0), 2)
    error = believed(drift) - drift.true_position_m
    assert error.std(axis=0) == pytest.approx(4.0, rel=0.25)
    lagged = [np.corrcoef(error[:-k, 0], error[k:, 0])[0, 1] for k in (6, 60, 600)]
    assert lagged[0] > 0.85
    assert lagged[1] == pytest.approx(np.exp(-1), abs=0.15)
    assert abs(lagged[2]) < 0.2

    shifted = sail(big, replace(EXACT, segment_sigma_m=6.0, segment_max_m=15.0), 3)
    shift = believed(shifted) - shifted.true_position_m
    np.testing.assert_allclose(shift, shifted.shift_m[shifted.segment, :2], atol=1e-9)
    assert len(np.unique(shifted.segment)) > 30
    length = np.hypot(*shifted.shift_m[:, :2].T)
    assert 1 < length.std() < length.max() <= 15 + 1e-9
    assert shifted.soundings.time_s is not None
    for k in np.unique(shifted.segment):
        assert np.ptp(shifted.soundings.time_s[shifted.segment == k]) <= 900

    noisy = sail(big, replace(EXACT, sounding_sigma_m=0.2, datum_sigma_m=0.5, surveys=8), 4)
    residual = noisy.soundings.depth_m - big.depth_at(noisy.true_position_m)
    datums = np.array([residual[noisy.soundings.survey == k].mean() for k in range(8)])
    assert datums.std(ddof=1) == pytest.approx(0.5, rel=0.5)
    assert residual[noisy.soundings.survey == 3].std() == pytest.approx(0.2, rel=0.05)


def test_a_survey_is_its_seeds_and_parts_do_not_shift_each_other() -> None:
    first, again, other = (sail(SEABED, PLAN, 5, k) for k in (1, 1, 2))
    depth = first.soundings.depth_m
    np.testing.assert_array_equal(depth, again.soundings.depth_m)
    assert not np.array_equal(depth[:50], other.soundings.depth_m[:50])
    finer = sail(SEABED, replace(PLAN, segment_s=100.0), 5, 1)
    np.testing.assert_array_equal(finer.soundings.depth_m[:50], depth[:50])
    one = sail(SEABED, replace(PLAN, surveys=1), 5, 1)
    np.testing.assert_array_equal(one.soundings.depth_m, depth[: one.soundings.depth_m.size])


def test_a_survey_that_misses_the_chart_is_refused() -> None:
    coarse = replace(PLAN, line_spacing_m=90_000.0)
    with pytest.raises(
        ChartError, match="survey lines 90000 m apart give 0 soundings on the chart 'st-john'"
    ):
        sail(SEABED, coarse, 0)


# ----------------------------------------------------------------------------------- what the chart is wrong in


@pytest.fixture(scope="module")
def charts() -> tuple[Chart, list[Chart]]:
    seabed = synthetic("st-john", seed=1, size_m=600)
    return seabed, [surveyed_chart(seabed, PLAN, seed).chart for seed in range(4)]


def errors(seabed: Chart, chart: Chart, at: Any) -> Any:
    return chart.depth_at(at) - seabed.depth_at(at)


def test_its_error_is_one_field_over_metres_and_forgotten_over_fifty(
    charts: tuple[Chart, list[Chart]],
) -> None:
    seabed, made = charts
    at = np.random.default_rng(7).uniform(60, 540, (3000, 2))
    found = []
    for chart in made:
        error = errors(seabed, chart, at)
        known = np.isfinite(error)
        error = error[known] - np.median(error[known])
        found.append(autocorrelation(at[known, 0], at[known, 1], error, np.zeros(error.size, dtype=np.intp)))
    lag, correlation = np.array(found).mean(axis=0).T
    assert np.interp(3, lag, correlation) > 0.7
    assert np.interp(6, lag, correlation) > 0.4
    assert np.interp(10, lag, correlation) > 0.1
    assert np.abs(correlation[lag > 50]).max() < 0.15
    # What residuals between the surveys say, as of real soundings: a white error would say 2 m at most.
    assert all(7 < chart.correlation_length_m < 30 for chart in made)


def test_its_error_grows_with_slope_by_the_surveys_horizontal_error(
    charts: tuple[Chart, list[Chart]],
) -> None:
    seabed, made = charts
    at = np.random.default_rng(8).uniform(60, 540, (20_000, 2))
    slope = np.hypot(*seabed.gradient(at).T)
    flat, steep = slope < np.quantile(slope, 0.2), slope > np.quantile(slope, 0.9)
    for chart in made:
        error = errors(seabed, chart, at)
        assert np.nanstd(error[steep]) > 2.5 * np.nanstd(error[flat])
        effective = np.nanstd(error[steep]) / np.sqrt(np.mean(slope[steep] ** 2))
        assert 2 < effective < 7


def test_it_has_holes_between_its_lines(charts: tuple[Chart, list[Chart]]) -> None:
    for chart in charts[1]:
        inner = chart.depth_m[30:-30, 30:-30]
        assert 0.02 < np.isnan(inner).mean() < 0.4


def test_it_states_its_error(charts: tuple[Chart, list[Chart]]) -> None:
    seabed, made = charts
    at = np.random.default_rng(9).uniform(60, 540, (20_000, 2))
    for chart in made:
        # A survey's residuals hold its own error beside the chart's: they say rather too much.
        assert 0.8 < float(np.max(chart.sigma_map_m)) / np.nanstd(errors(seabed, chart, at)) < 2.0
        assert "simulated survey of st-john" in chart.notes[0]
        assert "leaving out one of 3 surveys" in " ".join(chart.notes)


# -------------------------------------------------------------------------------------------- scenario and log

SHORT = ("duration_s=60", "chart.survey.line_spacing_m=80")


def test_vehicles_sound_the_truth_and_navigators_get_the_chart() -> None:
    told = ("chart.survey.each_mission=false", *SHORT)
    surveyed = uwcoop.simulate(scenario.load("surveyed-bay", told), seed=3)
    plain = uwcoop.simulate(scenario.load("st-john-drift", SHORT[:1]), seed=3)
    for kind in ("water_depth", "motion"):
        for name, column in plain.events[kind].items():
            np.testing.assert_array_equal(surveyed.events[kind][name], column)
    assert surveyed.chart is not None
    assert surveyed.chart.name == "st-john, surveyed"
    assert surveyed.chart.correlation_length_m > 0
    again = uwcoop.simulate(scenario.load("surveyed-bay", told), seed=4)
    assert again.chart is surveyed.chart  # one survey for all missions
    other = uwcoop.simulate(scenario.load("surveyed-bay", (*told, "chart.survey.seed=1")), seed=3)
    assert other.chart != surveyed.chart


def test_each_mission_can_have_its_own_survey() -> None:
    spec = scenario.load("surveyed-bay", SHORT)
    first, again, other = (uwcoop.simulate(spec, seed=k).chart for k in (0, 0, 1))
    assert first == again
    assert first != other


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("chart.survey.line_spacing_m=0", "line_spacing_m is 0: must be above 0"),
        ("chart.survey.surveys=0", "surveys is 0: must be"),
        ("chart.survey.spacing=3", "unknown key 'chart.survey.spacing'"),
        ("chart.seabed={}", "both survey and seabed"),
    ],
)
def test_bad_survey_tables_get_one_line(override: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as caught:
        scenario.load("surveyed-bay", (override,))
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------------------------ drawn seabeds

FLAT = np.full((200, 240), 20.0, dtype=np.float32)


def test_a_drawn_seabed_differs_by_the_stated_error() -> None:
    sigma = np.full(FLAT.shape, 0.2, dtype=np.float32)
    sigma[:, 120:] = 0.6
    depth = FLAT.copy()
    depth[50:60, 50:60] = np.nan
    chart = Chart(depth, 0.0, 0.0, 2.0, sigma_map_m=sigma, correlation_length_m=16.0)
    error = np.stack([drawn_seabed(chart, np.random.default_rng(k)).depth_m - depth for k in range(6)])
    np.testing.assert_array_equal(np.isnan(error), np.broadcast_to(np.isnan(depth), error.shape))
    assert np.nanstd(error[:, :, :120]) == pytest.approx(0.2, rel=0.1)
    right = error[:, :, 120:]
    assert right.std() == pytest.approx(0.6, rel=0.1)
    assert np.mean(right[:, :, 8:] * right[:, :, :-8]) / np.mean(right**2) == pytest.approx(0.5, abs=0.08)
    drawn = drawn_seabed(chart, np.random.default_rng(0))
    assert (drawn.sigma_map_m, drawn.correlation_length_m) == (0.0, 0.0)


def test_a_white_error_is_each_nodes_own() -> None:
    chart = Chart(FLAT, 0.0, 0.0, 2.0, sigma_map_m=0.3)
    error = drawn_seabed(chart, np.random.default_rng(1)).depth_m - FLAT
    assert error.std() == pytest.approx(0.3, rel=0.02)
    assert abs(np.mean(error[:, 1:] * error[:, :-1])) < 0.002


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(ChartError, match="states no error of its own: give sigma_map_m"):
        drawn_seabed(Chart(FLAT, 0.0, 0.0, 2.0), np.random.default_rng(0))
    with pytest.raises(ChartError, match="lifts the seabed of"):
        drawn_seabed(Chart(FLAT, 0.0, 0.0, 2.0, sigma_map_m=30.0), np.random.default_rng(0))
