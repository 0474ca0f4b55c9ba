"""Clocks, sound speed, late arrivals: what navigators are told of them, and what it gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.errors import NavigatorError
from uwcoop.navigators import options_of
from uwcoop.scenario import MissionSetup

WRONG = (
    "acoustics.clock.offset_sigma_s=0.005",
    "acoustics.clock.drift_sigma_ppm=5",
    "acoustics.sound_speed_error_sigma_mps=10",
    "acoustics.range_outlier_share=0.05",
)


def setup_of(*overrides: str) -> MissionSetup:
    return MissionSetup.of(scenario.load("flat-bay", overrides))


@pytest.mark.parametrize("name", ["team", "mpf"])
def test_what_the_scenario_says_of_ranges_is_told_and_can_be_told_otherwise(name: str) -> None:
    clock = options_of(name, setup_of(*WRONG)).clock  # type: ignore[union-attr]
    told = (clock.offset_sigma_s, clock.drift_sigma_ppm, clock.sound_speed_sigma_mps, clock.late_share)
    assert told == (0.005, 5.0, 10.0, 0.05)
    assert clock.lateness_m == 20.0
    uniform = "acoustics.range_outlier_m={distribution='uniform', low=10, high=50}"
    clock = options_of(name, setup_of(*WRONG, uniform)).clock  # type: ignore[union-attr]
    assert clock.lateness_m == 30.0
    own = f"navigator.{name}.clock.offset_sigma_s=0.02"
    clock = options_of(name, setup_of(*WRONG, own)).clock  # type: ignore[union-attr]
    assert (clock.offset_sigma_s, clock.drift_sigma_ppm) == (0.02, 5.0)
    clock = options_of(name, setup_of(*WRONG, 'acoustics.ranging="two-way"')).clock  # type: ignore[union-attr]
    assert (clock.offset_sigma_s, clock.drift_sigma_ppm, clock.late_share) == (0.0, 0.0, 0.05)


def test_equation_17_is_told_nothing_and_refuses_to_be() -> None:
    uwcoop.run("flat-bay", ["dmpf"], seed=0, clouds=False, overrides=["duration_s=20", *WRONG])
    told = ["duration_s=20", "navigator.dmpf.clock.late_share=0.1"]
    with pytest.raises(
        NavigatorError, match=r"navigator.dmpf.clock: not read, because \(17\) has no variance"
    ):
        uwcoop.run("flat-bay", ["dmpf"], seed=0, clouds=False, overrides=told)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("offset_sigma_s=-1", r"clock.offset_sigma_s is -1"),
        ("late_share=0.95", r"clock.late_share is 0.95"),
        ("lateness_m=0", r"clock.lateness_m is 0"),
        ("offset_s=1", r"clock.offset_s"),
    ],
)
def test_options_outside_their_bounds_are_refused(option: str, message: str) -> None:
    with pytest.raises(NavigatorError, match=message):
        options_of("team", setup_of(f"navigator.team.clock.{option}"))


def flown(*overrides: str, seed: int = 1) -> Any:
    few = ["duration_s=400", "navigator.all.particles=400"]
    return uwcoop.run("flat-bay", ["team"], seed=seed, clouds=False, overrides=[*few, *overrides]).tracks


def test_a_model_that_is_ruled_out_leaves_the_bits_as_they_are() -> None:
    zero = "navigator.team.clock={offset_sigma_s=0.0, drift_sigma_ppm=0.0, sound_speed_sigma_mps=0.0, late_share=0.0}"
    assert flown().position_m.values.tobytes() == flown(zero).position_m.values.tobytes()


def test_clocks_and_sound_speed_are_found_and_told() -> None:
    tracks = flown(*WRONG).sel(navigator="team").isel(time=-1)
    # Told 7.5 m · √2 of offset and 10 m/s.
    assert np.all(tracks.clock_difference_sigma_m.values < 2.0)
    assert np.all(tracks.sound_speed_error_sigma_mps.values < 9.0)
    assert np.all((tracks.range_late_share.values >= 0) & (tracks.range_late_share.values <= 1))
    error = np.hypot(*(tracks.position_m - tracks.truth_position_m).values.T)
    assert np.all(error < 15.0), error


def test_the_referee_can_be_left_out() -> None:
    tracks = flown("navigator.team.referee_nat=0")
    assert "referee_takeovers" not in tracks
    assert flown().referee_takeovers.values.max() == 0


@pytest.mark.long
def test_over_fifty_missions_wrong_ranges_cost_little_and_lose_nobody() -> None:
    """Clock differences, sound speed and late arrivals at once, told as they are: at most 15 % of RMSE."""
    found = [
        uwcoop.study("flat-bay", 50, ["team", "mpf-terrain-only"], overrides=overrides).summary["variants"][0]
        for overrides in ((), WRONG)
    ]
    clean, wrong = (variant["navigators"]["team"] for variant in found)
    assert wrong["median_rmse_m"] <= 1.15 * clean["median_rmse_m"]
    assert wrong["lost_share"] == 0
    assert 1.2 <= wrong["anees_median"] <= 2.6
    assert wrong["anees"] <= 4


@pytest.mark.long
def test_rough_water_over_fifty_missions() -> None:
    found = uwcoop.study("rough-water", 50, ["team", "dead-reckoning"]).summary["variants"][0]["navigators"]
    assert found["team"]["median_rmse_m"] <= found["dead-reckoning"]["median_rmse_m"] / 5
    assert 0.8 <= found["team"]["anees_median"] <= 2.6
