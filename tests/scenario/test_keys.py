"""Keys: every one that a scenario admits, with unit, default, bound and meaning."""

from __future__ import annotations

from typing import Any

import pytest

from uwcoop import scenario
from uwcoop.errors import ScenarioError
from uwcoop.report.keys import all_keys
from uwcoop.scenario.keys import scenario_keys


def dotted(table: Any, at: str = "") -> set[str]:
    if isinstance(table, dict):
        return {key for name, value in table.items() for key in dotted(value, f"{at}.{name}" if at else name)}
    if isinstance(table, list) and table and all(isinstance(entry, dict) for entry in table):
        return {key for entry in table for key in dotted(entry, f"{at}.N")}
    return set() if table in ([], {}) else {at}


@pytest.mark.parametrize("name", [name for name, _ in scenario.packaged()])
def test_every_key_of_a_packaged_scenario_is_among_them(name: str) -> None:
    known = {key.name for key in scenario_keys()} | {"navigator"}
    used = {key for key in dotted(scenario.load(name).resolved()) if not key.startswith("navigator.")}
    assert not used - known


def test_a_key_says_all_of_itself() -> None:
    (key,) = scenario_keys("acoustics.slot_s")
    assert (key.unit, key.default, key.bound) == ("s", "required", "> 0")
    (key,) = scenario_keys("acoustics.sound_speed_mps")
    assert (key.unit, key.default, key.bound, key.meaning) == (
        "m/s",
        "1500.0",
        "> 0",
        "Sound speed that the navigators assume.",
    )
    modem = scenario_keys("acoustics.modem")
    assert [key.name for key in modem][:2] == ["acoustics.modem", "acoustics.modem.name"]
    assert '"seatrac"' in modem[0].bound
    cases = {key.case for key in scenario_keys("vehicles.N.path.start_deg")}
    assert cases == {'kind = "lawnmower"', 'kind = "adrift"'}


def test_navigators_have_keys_too() -> None:
    found = all_keys("navigator.mpf.")
    assert {"navigator.mpf.particles", "navigator.mpf.drift"} <= {key.name for key in found}
    assert all(key.name.startswith("navigator.mpf.") for key in found)


def test_an_unknown_prefix_is_met_with_the_nearest() -> None:
    with pytest.raises(
        ScenarioError, match=r"^no key begins with 'acoustic\.modem': did you mean 'acoustics\.modem'\?$"
    ):
        scenario_keys("acoustic.modem")
    with pytest.raises(ScenarioError, match=r"^no key begins with 'zzz': known: acoustics, area, chart, "):
        scenario_keys("zzz")
