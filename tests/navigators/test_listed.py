"""Which navigators take part when nobody is asked for, missions without a chart, and who uses ranges."""

from __future__ import annotations

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.errors import NavigatorError, ScenarioError
from uwcoop.experiment.navigator_choice import default_navigators
from uwcoop.experiment.packet_budget import budget
from uwcoop.navigators import NAVIGATORS
from uwcoop.scenario import MissionSetup
from uwcoop.world.simulate import simulate

BARE = {
    "name": "bare",
    "duration_s": 60,
    "vehicles": [
        {
            "name": "ship",
            "fuses_ranges": False,
            "path": {"kind": "waypoints", "waypoints_m": [[0, 0], [60, 0]]},
        },
        {"name": "auv", "path": {"kind": "waypoints", "waypoints_m": [[0, 20], [60, 20]]}},
    ],
    "acoustics": {"modem": "unlimited", "slot_s": 5.0, "max_range_m": 500.0},
    "navigators": ["mpf", "dead-reckoning"],
}


def test_a_scenario_without_a_list_takes_all_that_are_for_any() -> None:
    found = default_navigators(MissionSetup.of(scenario.load("st-john")), 3)
    assert found == [
        name for name, spec in NAVIGATORS.items() if not (spec.listed_only or spec.needs_bandwidth)
    ]


def test_the_list_and_its_order_are_what_run_study_and_budget_take() -> None:
    short = ["duration_s=30", "navigators=['mpf', 'dead-reckoning']"]
    flown = scenario.load("flat-bay", short)
    assert list(uwcoop.run(flown, clouds=False).tracks.navigator.values) == ["mpf", "dead-reckoning"]
    assert list(budget(flown).costs) == ["mpf", "dead-reckoning"]
    result = uwcoop.study(flown, runs=1, processes=1)
    assert list(result.summary["variants"][0]["navigators"]) == ["mpf", "dead-reckoning"]
    asked = uwcoop.run(flown, ["terrain-only"], clouds=False)
    assert list(asked.tracks.navigator.values) == ["terrain-only"]


def test_variants_that_list_differently_fly_what_they_share() -> None:
    lists = [["mpf", "dead-reckoning"], ["terrain-only", "mpf"]]
    result = uwcoop.study(
        "flat-bay", runs=1, processes=1, vary={"navigators": lists}, overrides=["duration_s=30"]
    )
    assert [list(v["navigators"]) for v in result.summary["variants"]] == [["mpf"], ["mpf"]]


@pytest.mark.parametrize(
    ("listed", "line"),
    [(["mfp"], "navigator 'mfp' is unknown; did you mean 'mpf'?"), (["mpf", "mpf"], "lists 'mpf' 2 times")],
)
def test_a_list_that_cannot_be_flown_is_refused(listed: list[str], line: str) -> None:
    with pytest.raises(NavigatorError, match=line.replace("?", r"\?")):
        uwcoop.run(scenario.parse(BARE | {"navigators": listed}))


def test_a_mission_needs_no_chart() -> None:
    log = simulate(scenario.parse(BARE))
    assert log.chart is None
    assert "water_depth" not in log.events
    tracks = uwcoop.run(log).tracks
    assert np.isfinite(tracks.position_m).all()
    assert scenario.parse(log.setup.tables()) == scenario.parse(BARE)


def test_a_random_path_and_a_recorded_one_need_a_chart() -> None:
    vehicles = [{"name": "auv"}]
    with pytest.raises(ScenarioError, match="vehicle auv: a random lawn mower is laid on a chart"):
        simulate(scenario.parse(BARE | {"vehicles": vehicles}))


def test_the_team_agrees_who_uses_ranges() -> None:
    assert MissionSetup.of(scenario.parse(BARE)).fuses_ranges == (False, True)
    assert MissionSetup.of(scenario.load("st-john")).fuses_ranges == ()
    assert MissionSetup.parse({}).fuses_ranges == ()


def test_a_fleet_of_equals_that_uses_no_ranges_uses_none() -> None:
    fleet = scenario.load("st-john", ["vehicles.fuses_ranges=false", "duration_s=60"])
    assert MissionSetup.of(fleet).fuses_ranges == (False,) * 3


@pytest.mark.parametrize("form", ["f64", "32", "64", "256"])
def test_the_packets_form_is_a_word_or_a_number(form: str) -> None:
    assert scenario.load("flat-bay", [f"acoustics.packet={form}"]).acoustics.packet == form


def test_another_form_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"acoustics.packet is '?33'?: must be one of"):
        scenario.load("flat-bay", ["acoustics.packet=33"])
