"""Intervals of a study's figures: they hold the figure, they cover as often as they say, and pairs are paired."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from uwcoop.evaluation import metrics
from uwcoop.evaluation.intervals import LEAST_MISSIONS, intervals, mission_rmse, paired
from uwcoop.evaluation.sensitivity import sensitivity


def row(seed: int, navigator: str, vehicle: str, rmse_m: float | None, **more: Any) -> dict[str, Any]:
    every = dict.fromkeys(metrics.row_columns())
    counts = {"instants": 100 if rmse_m is not None else 0, "nees_instants": 100, "anees": 2.0}
    own = {"seed": seed, "run": seed, "navigator": navigator, "vehicle": vehicle, "rmse_m": rmse_m}
    return {**every, "nees_not_finite": 0, "seconds": 1.0, **counts, "inside_share": 0.95, **own, **more}


errors = st.one_of(st.none(), st.floats(0.0, 1e3), st.just(math.inf))


@given(
    st.lists(st.tuples(errors, errors, st.floats(0, 1e4)), min_size=LEAST_MISSIONS, max_size=12),
    st.integers(0, 5),
)
def test_every_interval_is_in_order_and_holds_what_all_missions_agree_on(
    table: list[tuple[float | None, float | None, float]], first: int
) -> None:
    rows = [
        row(first + k, "a", vehicle, error, final_error_m=error, anees=anees)
        for k, (one, two, anees) in enumerate(table)
        for vehicle, error in (("x", one), ("y", two))
    ]
    pooled = metrics.pool(rows)["a"]
    for key, bounds in intervals(rows)["a"].items():
        if bounds is None:
            assert pooled[key] is None
            continue
        low, high = (math.inf if bound is None else bound for bound in bounds)
        assert low <= high
        values = [r["rmse_m"] for r in rows if r["rmse_m"] is not None]
        if key == "median_rmse_m":
            assert min(values) <= low
            assert high <= max(values)
    same = [row(seed, "a", "x", 3.0, final_error_m=40.0) for seed in range(LEAST_MISSIONS)]
    assert intervals(same)["a"] == {
        "median_rmse_m": [3.0, 3.0],
        "rmse_m": [3.0, 3.0],
        "anees": [2.0, 2.0],
        "inside_share": [pytest.approx(0.95)] * 2,
        "lost_share": [1.0, 1.0],
    }


def test_few_missions_have_no_interval() -> None:
    rows = [row(k, "a", "x", 1.0 + k) for k in range(LEAST_MISSIONS - 1)]
    assert set(intervals(rows)["a"].values()) == {None}


def test_the_interval_of_a_mean_is_that_of_scipy() -> None:
    rng = np.random.default_rng(1)
    anees = rng.chisquare(2, 60)
    rows = [row(k, "a", "x", 1.0, anees=float(value)) for k, value in enumerate(anees)]
    other = stats.bootstrap(
        (anees,), np.mean, method="percentile", n_resamples=5000, rng=np.random.default_rng(2)
    ).confidence_interval
    own = intervals(rows)["a"]["anees"]
    assert own is not None
    assert own == pytest.approx([other.low, other.high], rel=0.05)


def test_intervals_cover_the_true_median_about_as_often_as_they_say() -> None:
    """Missions of a log-normal error whose vehicles share half of it: 200 studies of 40 missions."""
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(200):
        common = rng.normal(size=40)
        rows = [
            row(k, "a", vehicle, math.exp(common[k] + rng.normal()))
            for k in range(40)
            for vehicle in ("x", "y", "z")
        ]
        low, high = intervals(rows)["a"]["median_rmse_m"] or (None, None)
        assert low is not None
        assert high is not None
        held += low <= 1.0 <= high
    assert 0.88 <= held / 200 <= 0.99


def test_differences_are_of_the_same_missions() -> None:
    """A difference of 0.1 m is seen under errors that scatter by 10 m between missions, in rows of any order."""
    rng = np.random.default_rng(4)
    level = rng.uniform(5, 50, 20)
    rows = [row(k, "a", "x", float(level[k])) for k in range(20)]
    rows += [row(k, "b", "x", float(level[k] - 0.1 + rng.normal(0, 0.02))) for k in reversed(range(20))]
    found = paired(rows)["b"]
    assert (found["reference"], found["missions"], found["better_share"]) == ("a", 20, 1.0)
    assert found["median_difference_m"] == pytest.approx(-0.1, abs=0.02)
    assert -0.15 < found["interval_m"][0] <= found["interval_m"][1] < -0.05
    assert mission_rmse([row(1, "a", "x", 3.0), row(1, "a", "y", 4.0), row(1, "a", "z", None)]) == {
        1: math.sqrt(12.5)
    }


def test_a_rank_correlation_is_that_of_scipy_and_other_keys_are_left_alone() -> None:
    rng = np.random.default_rng(5)
    rows, points = [], []
    for value in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0):
        for seed in range(8):
            rmse = float(value + rng.normal(0, 2) + 10)
            points.append((value, rmse))
            rows.append({**row(seed, "a", "x", rmse), "k": value, "word": "w"})
    (entry,) = sensitivity(rows, ["k", "word"])
    expected = stats.spearmanr(*zip(*points, strict=True)).statistic
    assert entry["rank_correlation"] == pytest.approx(expected, abs=1e-12)
    low, high = entry["interval"]
    assert low < expected < high
    assert (entry["key"], entry["navigator"], entry["low"], entry["high"]) == ("k", "a", 0.5, 4.5)
    assert entry["rmse_low_m"] < entry["rmse_high_m"]
