"""What a log keeps of its scenario: typed, parsed once, and the same again after a file."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import uwcoop
from uwcoop import scenario
from uwcoop.errors import LogError, NavigatorError, ScenarioError
from uwcoop.experiment.navigator_choice import check_packets_fit
from uwcoop.experiment.packet_contents import packet_bytes
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.navigators import NAVIGATORS, options_of
from uwcoop.scenario import MissionSetup
from uwcoop.scenario.models import Metrics
from uwcoop.scenario.setup import PositioningSigmas

NAMES = [name for name, _ in scenario.packaged()]


@pytest.mark.parametrize("name", NAMES)
def test_a_setup_holds_what_its_scenario_says(name: str) -> None:
    whole = scenario.load(name)
    setup = MissionSetup.of(whole)
    assert setup.acoustics == whole.acoustics
    assert setup.navigators == whole.navigators
    assert setup.metrics == whole.metrics
    assert setup.diagnostics == whole.diagnostics
    assert setup.exchanges_roles == (whole.exchange is not None)
    assert (setup.positioning is not None) == (whole.exchange is not None)
    assert {**setup.navigator.own, "all": setup.navigator.common} == {"all": {}} | whole.navigator
    uses = tuple(vehicle.fuses_ranges for vehicle in whole.team)
    assert setup.fuses_ranges in ((uses,) if not all(uses) else (uses, ()))
    carried = {key for key, value in whole.team[0].sensors or () if value is not None}
    assert setup.sensors == carried
    assert setup.tables() == whole.resolved()
    assert MissionSetup.parse(setup.tables()) == setup
    assert scenario.parse(setup.tables()) == whole


def test_a_log_without_a_scenario_has_the_defaults() -> None:
    setup = MissionSetup()
    assert setup == MissionSetup.parse({})
    assert setup.metrics == Metrics()
    assert (setup.acoustics, setup.navigators, setup.positioning) == (None, (), None)
    assert setup.authentication.tag_bytes == 0
    check_packets_fit(list(NAVIGATORS), setup, 3)  # no schedule: nothing to fit
    with pytest.raises(ScenarioError, match="mpf's packet: the mission has no table acoustics"):
        packet_bytes("mpf", setup, 3, 32)
    for name in NAVIGATORS:
        assert options_of(name, setup) == options_of(name)


def test_a_setup_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        MissionSetup().metrics = Metrics(settle_s=3.0)  # type: ignore[misc]


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False)
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
READ = {"acoustics", "navigators", "navigator", "metrics", "diagnostics", "vehicles", "sensors", "exchange",
        "mutual", "mrclam"}  # fmt: skip


@given(st.dictionaries(st.text(max_size=8).filter(lambda key: key not in READ), json_values, max_size=4))
def test_keys_that_no_replay_reads_are_kept_for_the_file(tables: dict[str, Any]) -> None:
    setup = MissionSetup.parse(tables)
    assert json.dumps(setup.tables()) == json.dumps(tables)
    assert MissionSetup.parse(setup.tables()) == setup


@given(st.sampled_from(sorted(READ)), json_values)
def test_nonsense_in_a_key_that_is_read_is_taken_or_refused_in_one_line(key: str, value: Any) -> None:
    line = ""
    try:
        assert MissionSetup.parse({key: value}).tables() == {key: value}
    except ScenarioError as refused:
        line = str(refused)
    assert "\n" not in line


@pytest.mark.parametrize(
    ("tables", "line"),
    [
        ({"metrics": {"settle_s": -1.0}}, "scenario: metrics.settle_s is -1: must be at least 0"),
        ({"metrics": {"settle": 1.0}}, "scenario: unknown key 'metrics.settle': did you mean 'settle_s'?"),
        ({"navigator": {"mpf": 3}}, "scenario: navigator.mpf is 3: must be a table"),
        ({"acoustics": {"modem": "aloc"}}, "scenario: key 'acoustics.slot_s' is missing"),
        ({"vehicles": [{"fuses_ranges": 1}]}, "scenario: vehicles: fuses_ranges is 1: must be true or false"),
        ({"path": Path("x")}, "scenario cannot be written as JSON"),
    ],
)
def test_what_is_outside_its_bound_is_refused(tables: dict[str, Any], line: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        MissionSetup.parse(tables)
    assert line in str(refused.value)


def test_a_file_with_such_a_value_is_refused_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = uwcoop.simulate(scenario.load("flat-bay", ["duration_s=20"]))
    monkeypatch.setattr(MissionSetup, "tables", lambda _: {"metrics": {"settle_s": -1}})
    write_log(log, tmp_path / "bad.mcap")
    with pytest.raises(
        LogError, match=r"log .*bad.mcap: scenario: metrics.settle_s is -1: must be at least 0"
    ):
        load_log(tmp_path / "bad.mcap")


def test_overrides_change_what_they_name_and_nothing_else() -> None:
    setup = MissionSetup.of(scenario.load("flat-bay"))
    changed = setup.with_overrides(["navigator.mpf.particles=77", "metrics.settle_s=3"])
    assert changed.navigator.own["mpf"] == {"particles": 77}
    assert changed.metrics.settle_s == 3
    assert changed.acoustics == setup.acoustics
    assert setup.metrics.settle_s == scenario.load("flat-bay").metrics.settle_s
    with pytest.raises(NavigatorError, match=r"navigator\.mpff: no such navigator"):
        options_of("mpf", setup.with_overrides(["navigator.mpff.particles=77"]))


def test_a_data_sets_sigmas_are_those_of_positioning() -> None:
    stated = {"mrclam": {"range_sigma_m": 0.3, "bearing_sigma_deg": 2.0, "landmark": 1}}
    assert MissionSetup.parse(stated).positioning == PositioningSigmas(0.3, 2.0, 2.0)
