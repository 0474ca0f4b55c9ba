"""Navigators that exchange pose graphs where clocks, sound speed and paths are not as believed, each told the sigmas."""

from __future__ import annotations

import numpy as np
import pytest

import uwcoop
from uwcoop.experiment.named_worlds import World
from uwcoop.navigators import options_of
from uwcoop.scenario import load
from uwcoop.scenario.setup import MissionSetup

ALONE = "local-only"
NAVIGATORS = ("cekf", "deif", "mdeif", "interleaved", "nekf", "covariance-intersection")
FAULTS = {
    "offset": {"acoustics.clock.offset_sigma_s": 0.010},
    "drift": {"acoustics.clock.drift_sigma_ppm": 20.0},
    "sound": {"acoustics.sound_speed_error_sigma_mps": 15.0},
    "late": {"acoustics.range_outlier_share": 0.2},
    "all": {
        "acoustics.clock.offset_sigma_s": 0.005,
        "acoustics.clock.drift_sigma_ppm": 5.0,
        "acoustics.sound_speed_error_sigma_mps": 10.0,
        "acoustics.range_outlier_share": 0.05,
    },
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_ranges_leave_the_family_consistent_and_no_worse_than_alone(fault: str) -> None:
    world = World(name=fault, title=fault, set=FAULTS[fault])
    names = (ALONE, *NAVIGATORS)
    flown = uwcoop.study("ship-and-auv", 2, names, overrides=["duration_s=1500"], worlds=[world], processes=1)
    figures = {
        key: {n: np.array([row[key] for row in flown.rows if row["navigator"] == n]) for n in names}
        for key in ("rmse_m", "anees", "final_error_m")
    }
    alone_m = np.median(figures["rmse_m"][ALONE])
    for name in NAVIGATORS:
        assert np.median(figures["rmse_m"][name]) <= 1.05 * alone_m, name
        # Two missions of two vehicles: alone 2.1, with a drift that is not told 132.
        assert np.mean(figures["anees"][name]) <= 3.0, name
        assert np.max(figures["final_error_m"][name]) < 30.0, name


def test_clocks_are_told_by_the_scenario_and_two_way_ranging_does_not_know_them() -> None:
    one_way = load("ship-and-auv", ["acoustics.clock.offset_sigma_s=0.01"])
    assert options_of("deif", MissionSetup.of(one_way)).model_dump()["clock"]["offset_sigma_s"] == 0.01
    two_way = load(
        "four-vehicle-team", ["acoustics.clock.offset_sigma_s=0.01", 'acoustics.ranging="two-way"']
    )
    told = options_of("mdeif", MissionSetup.of(two_way)).model_dump()["clock"]
    assert told["offset_sigma_s"] == 0.0
