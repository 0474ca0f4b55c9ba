"""Fixes of covariance 0 are unknown, not exact."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.errors import LogError, ScenarioError
from uwcoop.experiment.mission import open_mission
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.missionlog.unknown_covariance import FIX_SIGMA_M
from uwcoop.world.simulate import simulate


@pytest.fixture(scope="module")
def log() -> MissionLog:
    made = simulate(scenario.load("flat-bay", ["duration_s=20", "sensors.gps={sigma_m=3}"]), 1)
    table = dict(made.events["fix"])
    first = np.arange(table["t_ns"].size) < 10
    for name in ("cov_ee_m2", "cov_en_m2", "cov_nn_m2"):
        table[name] = np.where(first, 0.0, table[name])
    return replace(made, events={**made.events, "fix": table})


@pytest.mark.parametrize(("overrides", "sigma_m"), [([], FIX_SIGMA_M), (["log.fix_sigma_m=2.5"], 2.5)])
def test_they_get_a_sigma_and_a_note(log: MissionLog, overrides: list[str], sigma_m: float) -> None:
    found = open_mission(log, overrides=overrides)
    fixes = found.events["fix"]
    np.testing.assert_array_equal(fixes["cov_ee_m2"][:10], sigma_m**2)
    np.testing.assert_array_equal(fixes["cov_nn_m2"][:10], sigma_m**2)
    np.testing.assert_array_equal(fixes["cov_ee_m2"][10:], log.events["fix"]["cov_ee_m2"][10:])
    count = fixes["t_ns"].size
    assert any(
        f"10 of {count} fixes have covariance 0" in note and f"sigma {sigma_m:g} m" in note
        for note in found.notes
    )
    assert (log.events["fix"]["cov_ee_m2"][:10] == 0).all()


def test_a_log_that_states_its_covariances_is_left_as_it_is(log: MissionLog) -> None:
    whole = open_mission(log)
    assert open_mission(whole) is whole


def test_notes_survive_the_file(log: MissionLog, tmp_path: Path) -> None:
    noted = open_mission(log)
    write_log(noted, tmp_path / "a.mcap")
    again = load_log(tmp_path / "a.mcap")
    assert again.notes == noted.notes
    assert noted.difference(again) is None


@pytest.mark.parametrize("value", ["0", "-1", "true", "'x'", "inf"])
def test_a_sigma_must_be_one(log: MissionLog, value: Any) -> None:
    with pytest.raises(LogError, match=r"log\.fix_sigma_m is .*: must be a number above 0"):
        open_mission(log, overrides=[f"log.fix_sigma_m={value}"])
    with pytest.raises(ScenarioError, match=r"log\.fix_sigma_m and log\.capacity_bytes only"):
        open_mission(log, overrides=["log.sigma=3"])
