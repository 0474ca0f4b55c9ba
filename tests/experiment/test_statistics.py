"""What the navigators promise, over many seeds: order of accuracy, and covariances that can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.evaluation import metrics

SEEDS = 50


@lru_cache
def runs(name: str, navigators: tuple[str, ...], count: int, overrides: tuple[str, ...] = ()) -> Any:
    """Position errors (navigator, run x vehicle, time), NEES of the same shape, rows; on the 1 Hz grid."""
    loaded = scenario.load(name, overrides)
    errors, nees, rows = [], [], []
    for seed in range(count):
        log = uwcoop.simulate(loaded, seed=seed)
        result = uwcoop.run(log, navigators, clouds=False)
        grid = result.tracks.time.values == np.round(result.tracks.time.values)
        errors.append(metrics.errors(result.tracks).values[..., grid])
        nees.append(metrics.nees(result.tracks).values[..., grid])
        rows += metrics.rows(result.tracks, seconds=result.seconds, packets=result.packets, run=seed)
    return np.concatenate(errors, axis=1), np.concatenate(nees, axis=1), rows


def inside(nees: Any, instants: Sequence[int], confidence: float) -> bool:
    """Whether the mean NEES over independent vehicles lies in its χ² band at every one of a few instants."""
    low, high = metrics.anees_bounds(2, nees.shape[0], confidence)
    means = nees[:, list(instants)].mean(axis=0)
    return bool(np.all((low < means) & (means < high)))


def test_dead_reckoning_knows_its_drift_to_the_chi_square() -> None:
    """The simulator's noise and the filter's covariance are two writings of one model."""
    _, nees, _ = runs("st-john", ("dead-reckoning",), SEEDS, ("duration_s=300",))
    assert inside(nees[0], (300,), 0.999)
    # The current of a mission is common to its vehicles: one vehicle of each mission is independent.
    _, nees, _ = runs("st-john-drift", ("dead-reckoning",), SEEDS, ("duration_s=300",))
    assert inside(nees[0, ::3], (150, 300), 0.999)


def coverage(nees: Any, instants: Sequence[int]) -> Any:
    """Share of vehicles inside their 95 % ellipse at each instant."""
    return (nees[:, list(instants)] < 5.991).mean(axis=0)


def test_mpf_is_consistent_over_fifty_seeds() -> None:
    """A particle filter of 600 has a few transients that rule a mean; shares and medians must be right."""
    _, nees, rows = runs("st-john-drift", ("mpf",), SEEDS, ("duration_s=300",))
    share = coverage(nees[0], (60, 100, 150, 200, 250, 300))
    # 150 vehicles: one standard deviation of the share is 1.8 %.
    assert np.all(share > 0.95 - 0.08)
    assert 0.90 < share.mean() < 0.99
    pooled = metrics.pool(rows)["mpf"]
    assert 1.4 <= pooled["anees_median"] <= 2.6
    assert pooled["lost_share"] == 0


def test_the_share_inside_the_ellipse_would_notice_a_wrong_covariance() -> None:
    _, nees, _ = runs("st-john-drift", ("mpf",), SEEDS, ("duration_s=300",))
    assert coverage(nees[0] * 2.0, (100, 200, 300)).mean() < 0.87
    assert coverage(nees[0] / 3.0, (100, 200, 300)).mean() > 0.98


@pytest.mark.long
def test_the_papers_order_on_rich_terrain() -> None:
    """Tan, Chitre & Hover (2016), Fig. 7."""
    _, _, rows = runs("st-john", ("dead-reckoning", "dmpf", "terrain-only", "ranging-only"), 20)
    final = {name: v["median_final_error_m"] for name, v in metrics.pool(rows).items()}
    assert final["dmpf"] < final["terrain-only"] < final["ranging-only"]
    assert final["ranging-only"] > final["dead-reckoning"]


@pytest.mark.long
def test_mpf_beats_dmpf_under_a_current_that_wanders() -> None:
    _, _, rows = runs("st-john-drift", ("dmpf", "mpf"), 20)
    pooled = metrics.pool(rows)
    for key in ("median_final_error_m", "p95_final_error_m", "median_rmse_m"):
        assert pooled["mpf"][key] < pooled["dmpf"][key]
    assert 1.4 <= pooled["mpf"]["anees_median"] <= 2.6
    assert pooled["mpf"]["lost_share"] == 0


@pytest.mark.long
def test_a_fused_belief_is_not_news() -> None:
    """On a flat bottom D-MPF talks itself into wrong positions; tempered ranges do not."""
    _, _, rows = runs("flat-bay", ("dmpf", "mpf"), 50)
    pooled = metrics.pool(rows)
    assert pooled["dmpf"]["lost_share"] > 0.4
    assert pooled["dmpf"]["anees_median"] > 20
    assert pooled["mpf"]["lost_share"] <= 0.03
    assert pooled["mpf"]["anees_median"] <= 2.6


NOTHING_TO_SEE = (
    "chart.relief=0.001",
    "duration_s=400",
    "navigator.all.sigma_current0_mps=0.0",
    "navigator.all.particles=300",
)


def test_ranges_over_a_bottom_that_tells_nothing_make_nobody_certain() -> None:
    """What is heard again is not news: the team stays as uncertain as dead reckoning, which is exact here."""
    names = ("dead-reckoning", "mpf")
    _, _, rows = runs("st-john-drift", names, SEEDS, NOTHING_TO_SEE)
    pooled = metrics.pool(rows)
    for figure in ("anees", "anees_median"):
        assert 0.7 < pooled["mpf"][figure] / pooled["dead-reckoning"][figure] < 1.4
    assert pooled["mpf"]["median_rmse_m"] < 1.2 * pooled["dead-reckoning"]["median_rmse_m"]
    alike = ("navigator.mpf.range_novelty=false", "navigator.mpf.range_temper=0.5")
    _, _, rows = runs("st-john-drift", ("mpf",), 10, (*NOTHING_TO_SEE, *alike))
    assert metrics.pool(rows)["mpf"]["anees_median"] > 50


@pytest.mark.long
@pytest.mark.parametrize("name", ["charles-river", "st-john-field", "st-john-field-3"])
def test_in_the_papers_field_missions_ranges_help_terrain_and_terrain_dead_reckoning(name: str) -> None:
    """Tan, Chitre & Hover (2016), Figs. 14, 17 and 19."""
    _, _, rows = runs(name, ("dead-reckoning", "terrain-only", "dmpf"), 20)
    pooled = metrics.pool(rows)
    for figure in ("median_final_error_m", "median_rmse_m"):
        reckoned, terrain, ranged = (pooled[n][figure] for n in ("dead-reckoning", "terrain-only", "dmpf"))
        assert ranged < terrain < reckoned


@pytest.mark.long
def test_a_third_vehicle_helps_the_other_two() -> None:
    """Tan, Chitre & Hover (2016), Fig. 19 against Fig. 17."""
    two, _, _ = runs("st-john-field", ("dmpf",), 20)
    three, _, _ = runs("st-john-field-3", ("dmpf",), 20)
    rms = [np.sqrt(np.nanmean(e[0, :, 50:] ** 2, axis=1)) for e in (two, three)]
    shared = [k for k in range(rms[1].size) if k % 3 < 2]  # AUV and ASV of every mission
    assert np.median(rms[1][shared]) < np.median(rms[0])
