"""The bars of `team`, over fifty missions each where a claim is statistical, with the same missions for every form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.evaluation import metrics
from uwcoop.evaluation.cramer_rao import bound_m
from uwcoop.world.simulate import simulate

SAME = "navigator.all.particles=1500"
Found = dict[str, dict[str, Any]]


def flown(name: str | Path, navigators: str, *overrides: str, runs: int = 50, **vary: Any) -> list[Found]:
    made = uwcoop.study(
        name, runs, navigators.split(","), overrides=overrides,
        vary={key.replace("__", "."): values for key, values in vary.items()},
    )  # fmt: skip
    return [variant["navigators"] for variant in made.summary["variants"]]


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_whoever_shares_the_water_could_know_more_of_it() -> None:
    bounds = {}
    for difference in (1.0, 0.5, 0.1):
        told = [
            "duration_s=200",
            f"navigator.team.current_difference={difference}",
            f"navigator.team.offset_difference_m={0.05 if difference < 1 else 2.0}",
        ]
        log = simulate(scenario.load("flat-bay", told), 3)
        at = np.arange(60, 201, dtype=np.int64) * 10**9
        bounds[difference] = [rms(bound_m(log, at, linearised=linearised)) for linearised in (False, True)]
    strict, linearised = np.array(list(bounds.values())).T
    assert strict[2] < strict[1] < strict[0]
    assert linearised[2] < linearised[1] < linearised[0]
    assert np.all(strict < linearised)


@pytest.mark.long
def test_rich_terrain() -> None:
    team = flown("st-john-drift", "team")[0]["team"]
    assert 1.0 <= team["rmse_over_bound"] <= 1.35
    assert 1.6 <= team["anees_median"] <= 2.5
    assert team["anees"] <= 4
    assert team["lost_share"] <= 0.01


@pytest.mark.long
def test_a_flat_bottom() -> None:
    found = flown("flat-bay", "team,dmpf")[0]
    team, paper = found["team"], found["dmpf"]
    assert 1.0 <= team["rmse_over_bound"] <= 1.7
    assert team["median_final_error_m"] <= paper["median_final_error_m"] / 10
    assert team["anees_median"] <= 2.6
    assert team["lost_share"] <= 0.03


@pytest.mark.long
def test_hardly_any_relief() -> None:
    found = flown("poor-bay", "team,dmpf")[0]
    team, paper = found["team"], found["dmpf"]
    assert team["median_final_error_m"] <= paper["median_final_error_m"] / 5
    assert 1.2 <= team["anees_median"] <= 2.6
    assert team["lost_share"] == 0


def better_on_such_charts(found: Found, *, at_least: float, of_mpf: float) -> None:
    rmse = {name: values["median_rmse_m"] for name, values in found.items()}
    assert rmse["team"] <= 0.70 * rmse["mpf-terrain-only"]
    assert rmse["team"] <= of_mpf * rmse["mpf"]
    assert rmse["team"] <= rmse["dead-reckoning"] / at_least
    assert found["team"]["anees_median"] <= 2.6


EVERY = "team,mpf,mpf-terrain-only,dead-reckoning"


@pytest.mark.long
def test_a_surveyed_chart() -> None:
    found = flown("surveyed-bay", EVERY)[0]
    better_on_such_charts(found, at_least=2.5, of_mpf=0.88)
    assert found["team"]["lost_share"] <= 0.03


@pytest.mark.long
@pytest.mark.parametrize(("drift", "at_least"), [("dvl", 2.5), ("no-dvl", 4.0)])
def test_real_soundings(
    reference: Path, study_module: Callable[[str], ModuleType], tmp_path: Path, drift: str, at_least: float
) -> None:
    aburatsubo = study_module("aburatsubo")
    rows: list[Any] = []
    for team in aburatsubo.teams(reference):
        world = aburatsubo.write_team(reference, team, tmp_path / team[0], drift)
        rows += uwcoop.study(world, 4, EVERY.split(",")).rows
    found = metrics.pool(rows)
    assert found["team"]["median_rmse_m"] <= found["dead-reckoning"]["median_rmse_m"] / at_least
    assert found["team"]["anees_median"] <= 2.6
    if drift == "dvl":
        better_on_such_charts(found, at_least=at_least, of_mpf=0.88)
        assert found["team"]["lost_share"] <= 0.03


@pytest.mark.long
@pytest.mark.parametrize("world", ["flat-bay", "surveyed-bay"])
def test_less_loss_never_hurts_and_none_is_worse_than_alone(world: str) -> None:
    variants = flown(
        world, "team,mpf-terrain-only", SAME, 'acoustics.loss.model="independent"', runs=20,
        acoustics__loss__probability=[0.0, 0.2, 0.5, 0.8, 1.0],
    )  # fmt: skip
    team = [found["team"]["median_rmse_m"] for found in variants]
    for found, less in zip(variants, [team[0], *team], strict=False):
        assert found["team"]["median_rmse_m"] <= 1.05 * found["mpf-terrain-only"]["median_rmse_m"]
        assert less <= 1.05 * found["team"]["median_rmse_m"]
        assert found["team"]["anees_median"] <= 2.6


@pytest.mark.long
def test_shorter_cycles_never_hurt() -> None:
    slow, middle, fast = (
        found["team"] for found in flown("flat-bay", "team", runs=20, acoustics__slot_s=[12.0, 6.0, 3.0])
    )
    assert fast["median_rmse_m"] <= 1.05 * middle["median_rmse_m"] <= 1.05**2 * slow["median_rmse_m"]
    assert all(1.4 <= each["anees_median"] <= 2.6 for each in (slow, middle, fast))


def test_rounded_packets_with_a_tag_cost_little_in_a_short_mission() -> None:
    assert rounding(4, ("duration_s=250", "navigator.team.particles=400")) < 1.25


@pytest.mark.long
def test_rounded_packets_with_a_tag_cost_at_most_five_per_cent() -> None:
    assert rounding(50) <= 1.05


def rounding(runs: int, overrides: tuple[str, ...] = ()) -> float:
    """Median of RMSE with 32 bytes, of which 4 are a tag, over RMSE with float64."""
    made = uwcoop.study(
        "flat-bay", runs, ["team"], {"navigator.team.packet": ["rounded", "f64"]},
        overrides=('acoustics.modem="unlimited"', "acoustics.authentication.tag_bytes=4", *overrides), processes=1,
    )  # fmt: skip
    key = "navigator.team.packet"
    rounded, whole = ([row["rmse_m"] for row in made.rows if row[key] == form] for form in ("rounded", "f64"))
    assert len(rounded) == len(whole) == 3 * runs
    return float(np.median(np.divide(rounded, whole)))
