"""Overrides that leave options of a scenario without effect."""

from __future__ import annotations

import json
import warnings
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uwcoop import _native
from uwcoop.errors import NavigatorError, ScenarioError
from uwcoop.navigators import NAVIGATORS, options_of
from uwcoop.scenario import apply_overrides, apply_settings, load
from uwcoop.scenario.setup import MissionSetup
from uwcoop.scenario.unread_options import UnreadOptionWarning


def taken(navigator: dict[str, Any], name: str = "mpf") -> dict[str, Any]:
    """The options that a navigator is made with."""
    setup = MissionSetup.parse({"navigator": navigator})
    return options_of(name, setup).model_dump(exclude_unset=True)


def test_a_packaged_scenario_does_not_block_a_switch_off() -> None:
    line = r"navigator\.mpf: range_temper of the scenario dropped, because use_ranges is false"
    with pytest.warns(UnreadOptionWarning, match=line):
        scenario = load("st-john-drift", ["navigator.mpf.use_ranges=false"])
    assert scenario.navigator["mpf"] == {"use_ranges": False}
    assert taken(scenario.navigator)["use_ranges"] is False


def test_neither_does_one_for_all_navigators() -> None:
    with pytest.warns(UnreadOptionWarning) as said:
        scenario = load("st-john-drift", ["navigator.all.use_ranges=false"])
    lines = {str(one.message) for one in said}
    assert lines == {
        "navigator.mpf: range_temper of the scenario dropped, because use_ranges is false",
        "navigator.team: current_difference, offset_difference_m of the scenario dropped, because use_ranges is false",
    }
    assert taken(scenario.navigator, "team")["use_ranges"] is False


def test_a_log_and_the_variants_of_a_study_follow_the_same_rule() -> None:
    setup = MissionSetup.of(load("st-john-drift"))
    with pytest.warns(UnreadOptionWarning, match="range_temper"):
        assert setup.with_overrides(["navigator.mpf.use_ranges=false"]).navigator.own["mpf"] == {
            "use_ranges": False
        }
    with pytest.warns(UnreadOptionWarning, match="range_temper"):
        apply_settings(load("st-john-drift").resolved(), {"navigator.mpf.use_ranges": False})


@pytest.mark.parametrize(
    "overrides",
    [
        ["navigator.mpf.use_ranges=false", "navigator.mpf.range_temper=0.5"],
        ["navigator.mpf.range_temper=0.5", "navigator.mpf.use_ranges=false"],
        ["navigator.mpf={use_ranges = false, range_temper = 0.5}"],
    ],
)
def test_what_the_user_states_against_its_own_reading_stays_refused(overrides: list[str]) -> None:
    scenario = load("st-john-drift", overrides)
    with pytest.raises(NavigatorError, match=r"mpf\.range_temper: not read, because use_ranges is false"):
        taken(scenario.navigator)


def test_so_does_what_one_file_states_against_its_own_reading() -> None:
    file = {"navigator": {"mpf": {"use_ranges": False, "range_temper": 0.5}}}
    changed = apply_overrides(file, ["navigator.mpf.particles=100"])
    with pytest.raises(NavigatorError, match="range_temper: not read"):
        taken(changed["navigator"])


def test_other_overrides_and_tables_that_are_refused_later_are_left_alone() -> None:
    file = {"navigator": {"mpf": {"range_temper": 0.5}, "nobody": {"a": 1}}}
    assert apply_overrides(file, ["duration_s=9"])["navigator"] == file["navigator"]
    for override in ("navigator.mpf.use_ranges=7", "navigator.mpf.no_option=7", "navigator.all=3"):
        changed = apply_overrides(file, [override])["navigator"]
        assert changed["mpf"]["range_temper"] == 0.5
        with pytest.raises((NavigatorError, ScenarioError)):
            taken(changed)


SWITCHES = {
    name: [
        option
        for option, value in options_of(name).model_dump().items()
        if isinstance(value, bool)
        and option not in NAVIGATORS[name].fixed
        and option not in dict(_native.unread_options(name, "{}"))
    ]
    for name in NAVIGATORS
}


@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_after_any_switch_every_navigator_can_be_made(data: st.DataObject) -> None:
    """Whatever is stated that is read, one switch turned by an override refuses nothing."""
    name = data.draw(st.sampled_from([name for name, switches in SWITCHES.items() if switches]))
    defaults = options_of(name).model_dump(mode="json", exclude_none=True)
    unread = dict(_native.unread_options(name, "{}"))
    read = [o for o in defaults if o not in unread and o not in NAVIGATORS[name].fixed]
    stated = {o: defaults[o] for o in data.draw(st.sets(st.sampled_from(read)))}
    switch = data.draw(st.sampled_from(SWITCHES[name]))
    override = f"navigator.{name}.{switch}={json.dumps(not defaults[switch])}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnreadOptionWarning)
        changed = apply_overrides({"navigator": {name: stated}}, [override])["navigator"]
    assert taken(changed, name)[switch] is not defaults[switch]
    dropped = set(stated) - set(changed[name])
    assert dropped <= set(dict(_native.unread_options(name, json.dumps(changed[name]))))


def test_the_guard_has_switches_to_turn() -> None:
    assert sum(len(switches) for switches in SWITCHES.values()) > 15
