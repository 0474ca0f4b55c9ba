"""The landmark navigators on packaged missions: the paper's limits, honesty, recovery, and what they refuse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from uwcoop.errors import NavigatorError
from uwcoop.navigators import NAVIGATORS, Context, build, options_of

Runs = Callable[..., dict[str, list[dict[str, Any]]]]


@pytest.fixture
def runs(study_module: Callable[[str], ModuleType]) -> Runs:
    """Each navigator's runs of a scenario, as the study of alternating landmarks measures them."""
    study = study_module("alternating_landmark")

    def fly(
        scenario: str, seeds: range, names: Sequence[str], *overrides: str
    ) -> dict[str, list[dict[str, Any]]]:
        case = study.Case(scenario, tuple(names), overrides)
        missions = [study.fly((case, seed)) for seed in seeds]
        return {name: [mission[case.label(name)] for mission in missions] for name in names}

    return fly


def test_a_survey_stays_inside_the_papers_limits(runs: Runs) -> None:
    found = runs(
        "seafloor-survey", range(3), ["landmark", "landmark-paper", "dead-reckoning-dvl"],
        "navigator.landmark-paper.particles=1000",
    )  # fmt: skip
    metres = {name: np.median([run["rmse_m"] for run in each]) for name, each in found.items()}
    assert metres["landmark"] < 0.25
    assert metres["landmark-paper"] < 0.4
    assert metres["dead-reckoning-dvl"] > 2 * metres["landmark"]
    assert np.median([run["yaw_rmse_deg"] for run in found["landmark"]]) < 1.0
    assert 0.3 < np.mean([run["anees"] for run in found["landmark"]]) < 2.0
    assert all(run["resets"] == 0 for run in found["landmark"])


def test_a_kidnapped_vehicle_is_found_again(runs: Runs) -> None:
    (run,) = runs("seafloor-survey-kidnap", range(1), ["landmark"])["landmark"]
    assert run["rmse_m"] < 0.5
    assert run["resets"] >= 1


@pytest.mark.long
def test_the_bars_of_the_survey(runs: Runs) -> None:
    found = runs("seafloor-survey", range(50), ["landmark", "landmark-paper"])
    robust, paper = found["landmark"], found["landmark-paper"]
    assert np.median([run["rmse_m"] for run in robust]) <= 0.15
    assert np.median([run["yaw_rmse_deg"] for run in robust]) <= 0.6
    assert np.mean([run["rmse_m"] <= 0.3 and run["yaw_rmse_deg"] <= 1.0 for run in robust]) >= 0.95
    assert 0.8 <= np.mean([run["anees"] for run in robust]) <= 1.3
    assert all(run["resets"] == 0 for run in robust)
    assert np.mean([run["rmse_m"] <= 0.3 and run["yaw_rmse_deg"] <= 1.0 for run in paper]) >= 0.8


@pytest.mark.parametrize(
    ("option", "value"),
    [("packet_bytes", 24), ("sigma_range_m", 0.0), ("outlier_share", 1.0), ("monitor_reading", "log10")],
)
def test_an_option_outside_its_bound_is_refused_in_one_line(option: str, value: Any) -> None:
    with pytest.raises(NavigatorError, match=option) as refused:
        options_of("landmark-paper", {"navigator": {"landmark-paper": {option: value}}})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["landmark", "landmark-paper", "landmark-ekf", "dead-reckoning-dvl"])
def test_a_navigator_of_each_name_is_made_and_says_that_it_has_not_started(name: str) -> None:
    assert name in NAVIGATORS
    context = Context(vehicle=1, vehicles=2, sound_speed_mps=1500.0, seed=0, chart=None)
    navigator: Any = build(name, context, options_of(name), None)
    assert navigator.estimate(0).status == "not started"
    assert navigator.transmit(0, 128) is None
    numbers = navigator.diagnostics()
    assert "landmark_yaw_rad" in numbers
