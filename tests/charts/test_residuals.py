"""What soundings say of each other: planted errors are measured, planted shifts are found and taken out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from uwcoop.charts import grid_and_judge, load_chart, load_sounded, load_soundings, synthetic
from uwcoop.charts.alignment import align_segments, segments_of
from uwcoop.charts.gridding import Gridded, Soundings
from uwcoop.charts.residuals import Residuals, autocorrelation, leave_one_out, report
from uwcoop.charts.surface import robust_sd
from uwcoop.charts.survey import Surveyed, sail
from uwcoop.cli import app
from uwcoop.errors import ChartError
from uwcoop.scenario.chart import Survey

pytest.importorskip("scipy")


def planted(value: Any, east: Any, north: Any, surveys: int = 2) -> Residuals:
    fold = np.arange(value.size) % surveys
    return Residuals(east, north, value, fold, surveys, f"leaving out one of {surveys} surveys")


def field(rng: np.random.Generator, length_m: float, east: Any, north: Any) -> Any:
    """Gaussian noise of standard deviation 1 with correlation exp(-d²/4w²), w such that ∫ρ is `length_m`."""
    width = length_m / np.sqrt(np.pi)
    waves = rng.normal(0, 1 / (width * np.sqrt(2)), (2, 400))
    phase = rng.uniform(0, 2 * np.pi, 400)
    return np.sqrt(2 / 400) * np.cos(np.outer(east, waves[0]) + np.outer(north, waves[1]) + phase).sum(axis=1)


def test_a_planted_correlation_length_is_proposed() -> None:
    rng = np.random.default_rng(0)
    east, north = rng.uniform(0, 300, (2, 6000))
    found = report(planted(0.5 * field(rng, 12.0, east, north), east, north))
    assert found.sigma_map_m == pytest.approx(0.5, rel=0.1)
    assert found.correlation_length_m == pytest.approx(12.0, rel=0.2)
    assert found.half_lag_m == pytest.approx(2 * 12 * np.sqrt(np.log(2) / np.pi), rel=0.2)


def test_white_residuals_have_no_length_and_few_pairs_say_nothing() -> None:
    rng = np.random.default_rng(1)
    east, north = rng.uniform(0, 200, (2, 4000))
    white = report(planted(rng.normal(0, 0.3, 4000), east, north))
    assert white.correlation_length_m <= 2
    assert all(abs(r) < 0.1 for _, r in white.autocorrelation)
    few = report(planted(rng.normal(0, 0.3, 30), *rng.uniform(0, 5000, (2, 30))))
    assert (few.half_lag_m, few.correlation_length_m) == (None, 10.0)
    assert "10 m, usual for soundings" in few.notes()[1]


def test_stray_echoes_do_not_make_the_proposal() -> None:
    rng = np.random.default_rng(2)
    east, north = rng.uniform(0, 200, (2, 4000))
    value = rng.normal(0, 0.2, 4000)
    value[::200] += 20
    found = report(planted(value, east, north))
    assert found.robust_sd_m == pytest.approx(0.2, rel=0.1)
    assert found.robust_sd_m < found.sigma_map_m < found.sd_m


def test_datums_are_told_apart_from_the_rest() -> None:
    rng = np.random.default_rng(3)
    east, north = rng.uniform(0, 200, (2, 4000))
    residuals = planted(rng.normal(0, 0.1, 4000), east, north)
    shifted = replace(residuals, residual_m=residuals.residual_m + np.where(residuals.fold == 0, 0.4, -0.4))
    found = report(shifted)
    assert found.datum_sd_m == pytest.approx(0.8 / np.sqrt(2), rel=0.05)
    assert found.own_datum_robust_sd_m == pytest.approx(0.1, rel=0.1)
    # A chart that mixes both datums errs by them; but not over 100 m, as the datums' correlation would say.
    assert found.sigma_map_m > 0.4
    assert found.correlation_length_m <= 2


def test_growth_with_slope_is_the_horizontal_error() -> None:
    rng = np.random.default_rng(4)
    east, north = rng.uniform(0, 500, (2, 8000))
    slope = rng.gamma(2.0, 0.05, 8000)
    value = rng.normal(0, 0.15, 8000) + slope * rng.normal(0, 4.0, 8000)
    found = report(planted(value, east, north), slope)
    assert found.horizontal_error_m == pytest.approx(4.0, rel=0.1)
    assert found.flat_sd_m == pytest.approx(0.15, rel=0.2)
    level = report(planted(rng.normal(0, 0.15, 8000), east, north), slope)
    assert level.horizontal_error_m is not None
    assert level.horizontal_error_m < 0.5
    assert report(planted(value, east, north)).horizontal_error_m is None


def test_autocorrelation_is_within_groups_only() -> None:
    rng = np.random.default_rng(5)
    east, north = rng.uniform(0, 60, (2, 2000))
    value = field(rng, 8.0, east, north)
    group = np.arange(2000) % 2
    together = autocorrelation(east, north, value, np.zeros(2000, dtype=np.intp))
    opposed = autocorrelation(east, north, np.where(group == 0, value, -value), group)
    assert together[0][1] > 0.9
    assert opposed[0][1] > 0.9


# ---------------------------------------------------------------------------------------- segments and shifts


@pytest.fixture(scope="module")
def surveyed() -> Surveyed:
    plan = replace(Survey().plan(), line_spacing_m=30.0, position_sigma_m=1.0, segment_s=300.0)
    return sail(synthetic("st-john", size_m=300), plan, 3)


@pytest.fixture(scope="module")
def gridded(surveyed: Surveyed) -> Gridded:
    return grid_and_judge(surveyed.soundings, cell_m=2.0)


def horizontal_rms(shift: Any, weight: Any) -> float:
    return float(np.sqrt(np.average((shift[:, :2] ** 2).sum(axis=1), weights=weight)))


def test_planted_shifts_are_found(surveyed: Surveyed) -> None:
    said = surveyed.soundings
    points = (said.east_m, said.north_m, said.depth_m)
    found = align_segments(points, surveyed.segment, cell_m=2.0, max_gap_m=10.0)
    weight = np.bincount(surveyed.segment, minlength=len(surveyed.shift_m))
    true = -surveyed.shift_m + np.average(surveyed.shift_m, axis=0, weights=weight)
    before, after = horizontal_rms(true, weight), horizontal_rms(found.shift_m - true, weight)
    assert before > 4
    assert after < before / 2
    assert np.sqrt(np.average((found.shift_m - true)[:, 2] ** 2, weights=weight)) < 0.12
    assert found.after_m < 0.7 * found.before_m
    # Pinned by a robust mean: the plain one is near zero, not at it.
    assert np.average(found.shift_m, axis=0, weights=weight) == pytest.approx(0, abs=0.5)
    moved = found.applied(points)
    np.testing.assert_allclose(moved[0] - points[0], found.shift_m[surveyed.segment, 0], atol=1e-9)


def test_aligning_twice_changes_nothing(surveyed: Surveyed) -> None:
    said = surveyed.soundings
    points = (said.east_m, said.north_m, said.depth_m)
    found = align_segments(points, surveyed.segment, cell_m=2.0, max_gap_m=10.0)
    again = align_segments(found.applied(points), surveyed.segment, cell_m=2.0, max_gap_m=10.0)
    np.testing.assert_array_equal(again.shift_m, 0 * again.shift_m)
    assert again.after_m == again.before_m


def test_the_limit_is_widened_where_segments_end_at_it() -> None:
    """Two segments are 24 m off, beyond the first limit of 15 m."""
    plan = replace(
        Survey().plan(), line_spacing_m=25.0, position_sigma_m=0.0, segment_sigma_m=0.0, datum_sigma_m=0.0,
        segment_s=300.0,
    )  # fmt: skip
    surveyed = sail(synthetic("st-john", size_m=240), plan, 3)
    said, segment = surveyed.soundings, surveyed.segment
    wrong = np.flatnonzero(np.bincount(segment) > 60)[:2]
    east = said.east_m + 24.0 * np.isin(segment, wrong)
    found = align_segments((east, said.north_m, said.depth_m), segment, cell_m=2.0, max_gap_m=10.0)
    assert found.limit_m > 15
    assert found.at_limit < 2
    assert found.shift_m[wrong, 0] == pytest.approx(-24, abs=3.5)
    right = np.setdiff1d(np.arange(len(found.shift_m)), wrong)
    assert np.median(np.hypot(*found.shift_m[right, :2].T)) < 2
    assert f"{found.at_limit} of them end at the limit of {found.limit_m:g} m" in found.note
    assert found.as_dict()["limit_m"] == found.limit_m


def test_a_new_day_fits_worse_than_the_aligned_ones_and_as_it_will() -> None:
    """A survey that nobody aligned, against what was said of such a day."""
    plan = replace(Survey().plan(), surveys=4, line_spacing_m=25.0, position_sigma_m=1.0, datum_sigma_m=0.4)
    seabed = synthetic("st-john", size_m=200)
    said = sail(seabed, plan, 4).soundings
    made = grid_and_judge(said, cell_m=2.0, align=True, report_residuals=True)
    assert made.new_day is not None
    assert made.residuals is not None
    assert made.new_day.surveys == 4
    assert made.new_day.own_datum_robust_sd_m > made.residuals.own_datum_robust_sd_m
    assert made.new_day.new_day_note in made.chart.notes
    assert made.as_dict()["new_day"]["count"] == made.new_day.count
    unseen = sail(seabed, replace(plan, surveys=1, heading_deg=70.0), 77).soundings
    at = np.column_stack([unseen.east_m, unseen.north_m])
    residual = unseen.depth_m - made.chart.depth_at(at)
    spread = robust_sd(residual[np.isfinite(residual)])
    assert 1 / 1.8 < spread / made.new_day.own_datum_robust_sd_m < 1.8


def test_alignment_makes_the_chart_truer(surveyed: Surveyed, gridded: Gridded) -> None:
    seabed = synthetic("st-john", size_m=300)
    # Segments of this survey are 300 s; by times three times as long they are the 900 s that are looked for.
    slower = replace(surveyed.soundings, time_s=3 * np.asarray(surveyed.soundings.time_s))
    aligned = grid_and_judge(slower, cell_m=2.0, align=True)
    assert aligned.alignment is not None
    assert aligned.residuals is not None
    at = np.random.default_rng(6).uniform(20, 280, (5000, 2))
    errors = [chart.depth_at(at) - seabed.depth_at(at) for chart in (gridded.chart, aligned.chart)]
    before, after = (np.nanstd(error) for error in errors)
    assert after < 0.8 * before
    assert aligned.chart.correlation_length_m >= 10
    assert "segments of 900 s shifted by up to" in " ".join(aligned.chart.notes)
    assert json.loads(json.dumps(aligned.as_dict(), allow_nan=False))["alignment"]["segments"] > 3


def test_segments_are_quarters_of_an_hour_of_each_survey() -> None:
    time_s = np.array([5.0, 904, 906, 5, 2000])
    assert segments_of(["a", "a", "a", "b", "b"], time_s, 5).tolist() == [0, 0, 1, 2, 3]
    assert segments_of(None, None, 1000).tolist() == [0] * 900 + [1] * 100


def test_soundings_without_crossings_stay_where_they_are() -> None:
    east, north = np.arange(0.0, 400, 2), np.zeros(200)
    points = (np.concatenate([east, east]), np.concatenate([north, north + 500]), np.full(400, 9.0))
    found = align_segments(points, np.repeat([0, 1], 200), cell_m=2.0, max_gap_m=10.0)
    assert not found.shift_m.any()
    assert found.as_dict()["after_m"] is None


# ------------------------------------------------------------------------------------------ files and commands


def write(path: Path, said: Soundings) -> Path:
    assert said.survey is not None
    assert said.time_s is not None
    rows = zip(said.east_m, said.north_m, said.depth_m, said.survey, said.time_s, strict=True)
    path.write_text("e,n,depth,day,ms\n" + "".join(f"{e},{n},{z},{k},{1000 * t}\n" for e, n, z, k, t in rows))
    return path


def test_a_files_survey_and_time_are_read(surveyed: Surveyed, gridded: Gridded, tmp_path: Path) -> None:
    path = write(tmp_path / "s.csv", surveyed.soundings)
    said = load_soundings(path, crs="local", positive="down")
    assert said.surveys == 3
    np.testing.assert_allclose(said.time_s, surveyed.soundings.time_s)
    told = load_sounded(path, crs="local", positive="down", cell_m=2.0, sigma_map_m=0.4)
    assert told.chart.sigma_map_m == 0.4
    assert told.residuals == gridded.residuals
    assert told.chart.correlation_length_m == gridded.chart.correlation_length_m
    assert load_chart(path, crs="local", positive="down", cell_m=2.0) == gridded.chart


@pytest.mark.parametrize(
    ("column", "cells", "seconds"),
    [
        ("time", ("2020-01-01T00:00:00", "2020-01-01T00:01:30"), [0, 90]),
        ("time_s", ("3", "4.5"), [3, 4.5]),
        ("time (ms)", ("3000", "4500"), [3, 4.5]),
        ("epoch_ms", ("3000", "4500"), [3, 4.5]),
        ("time", ("morning", "noon"), None),
    ],
)
def test_times_in_many_dresses(tmp_path: Path, column: str, cells: Any, seconds: Any) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"e,n,depth,{column}\n" + "".join(f"{k},0,5,{cell}\n" for k, cell in enumerate(cells)))
    said = load_soundings(path)
    if seconds is None:
        assert said.time_s is None
        assert "times not used: column 'time' holds 'morning' in data row 1: no time" in said.notes
    else:
        assert said.time_s == pytest.approx(seconds)


def test_the_chart_command_reports_residuals(surveyed: Surveyed, tmp_path: Path) -> None:
    path = write(tmp_path / "s.csv", surveyed.soundings)
    command = ["chart", "--from-soundings", str(path), "--crs", "local", "--positive", "down", "--cell", "2"]
    told = CliRunner().invoke(app, [*command, "--json"])
    assert told.exit_code == 0, told.output
    facts = json.loads(told.stdout)
    assert facts["residuals"]["surveys"] == 3
    assert facts["residuals"]["sigma_map_m"] == pytest.approx(facts["sigma_map_m"])
    assert facts["residuals"]["correlation_length_m"] == facts["correlation_length_m"]
    assert facts["alignment"] is None
    table = CliRunner().invoke(app, [*command, "--align"]).stdout
    for piece in ("residuals of soundings", "robust sd", "one half at", "effective", "alignment", "proposed"):
        assert piece in table


def test_a_grid_has_no_residuals(tmp_path: Path) -> None:
    path = tmp_path / "grid.asc"
    path.write_text("ncols 2\nnrows 2\nxllcenter 0\nyllcenter 0\ncellsize 5\n1 2\n3 4\n")
    with pytest.raises(ChartError, match=r"grid\.asc is a grid: residuals come from soundings"):
        load_sounded(path)


def test_too_few_soundings_do_not_judge() -> None:
    east, north, depth = (np.array(a, dtype=float) for a in ([0, 90, 0, 90], [0, 0, 90, 90], [3, 3, 3, 3]))
    with pytest.raises(ChartError, match="below 20: give sigma_map_m"):
        leave_one_out((east, north, depth), None, cell_m=5.0, max_gap_m=10.0)


def test_real_surveys_agree_better_once_aligned(reference: Path) -> None:
    file = reference / "data/aburatsubo/sessions_valid.csv.gz"
    said = load_soundings(file, columns="e,n,z,f,ms", crs="EPSG:32654")
    assert said.survey is not None
    assert said.time_s is not None
    # A corner of the bay that most days cross: enough to align, and few enough for a quick test.
    chosen = (np.abs(said.east_m) < 120) & (np.abs(said.north_m) < 120)
    some = replace(
        said, east_m=said.east_m[chosen], north_m=said.north_m[chosen], depth_m=said.depth_m[chosen],
        survey=said.survey[chosen], time_s=said.time_s[chosen],
    )  # fmt: skip
    before, after = (
        grid_and_judge(some, cell_m=2.0, align=align, report_residuals=True).residuals
        for align in (False, True)
    )
    assert before is not None
    assert after is not None
    assert after.robust_sd_m < 0.6 * before.robust_sd_m
    assert after.count > 500
