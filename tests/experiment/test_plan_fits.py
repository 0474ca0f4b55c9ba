"""A mission that is planned where a packet cannot say it is refused before it flies; one that has happened goes on."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import uwcoop
from uwcoop.errors import ScenarioError, ScheduleError
from uwcoop.scenario import parse

LAST_M = 32_768 - 1 / 16


def planned(east_m: float = 0.0, depth_m: float = 2.0, duration_s: int = 200) -> dict[str, Any]:
    def vehicle(name: str, east_m: float, depth_m: float) -> dict[str, Any]:
        corners = [[east_m, 0.0], [east_m, 500.0]]
        return {"name": name, "depth_m": depth_m, "path": {"kind": "waypoints", "waypoints_m": corners}}

    return {
        "name": "reach",
        "duration_s": duration_s,
        "vehicles": [vehicle("near", 0.0, 2.0), vehicle("far", east_m, depth_m)],
        "acoustics": {"modem": "micromodem-64", "slot_s": 35.0, "max_range_m": 40_000.0},
    }


def test_a_plan_beyond_the_position_field_is_refused_with_vehicle_value_and_bound() -> None:
    scenario = parse(planned(33_000.0), "reach")
    line = (
        r"vehicle far: easting 330\d\d\.\d m at t = \d+ s does not fit mpf's packet, which holds -32768 to 32767.9375 m: "
        "plan within that, or choose other navigators"
    )
    with pytest.raises(ScheduleError, match=line):
        uwcoop.run(scenario, ["dead-reckoning", "mpf"], clouds=False)
    with pytest.raises(ScheduleError, match=line):
        uwcoop.study(scenario, 1, ["mpf"], processes=1)
    # Its packets hold positions modulo a distance, or in float64, or none at all.
    for name in ("team", "nekf", "dead-reckoning"):
        tables = planned(33_000.0)
        tables["acoustics"]["modem"] = "unlimited"
        summary = uwcoop.run(parse(tables, "reach"), [name], clouds=False).summary
        assert all(v["unsent"] == 0 for v in summary["navigators"][name]["vehicles"].values())


def test_a_mission_that_has_happened_goes_on_with_slots_left_unsent() -> None:
    log = uwcoop.simulate(parse(planned(33_000.0), "reach"))
    vehicles = uwcoop.run(log, ["mpf"], clouds=False).summary["navigators"]["mpf"]["vehicles"]
    assert vehicles["far"]["unsent"] > 0
    assert vehicles["near"]["unsent"] == 0


@settings(max_examples=12, deadline=None)
@given(st.sampled_from([-1.0, 1.0]), st.floats(0.0, 200.0))
def test_what_is_not_refused_is_sent(sign: float, inside_m: float) -> None:
    east_m = sign * (LAST_M + 60.0 - inside_m)
    try:
        result = uwcoop.run(parse(planned(east_m, duration_s=120), "reach"), ["mpf"], clouds=False)
    except ScheduleError:
        assert inside_m < 70.0
        return
    assert inside_m > 50.0
    # An estimate may stand beyond what the truth does not reach.
    told = result.summary["navigators"]["mpf"]["vehicles"]["far"]["unsent"]
    assert told == 0 or inside_m < 80.0


def test_the_deepest_sea_is_flown_and_what_is_deeper_refused() -> None:
    summary = uwcoop.run(parse(planned(500.0, 10_935.0), "reach"), ["mpf", "team"], clouds=False).summary
    for name in ("mpf", "team"):
        assert all(v["unsent"] == 0 for v in summary["navigators"][name]["vehicles"].values())
    with pytest.raises(ScenarioError, match=r"depth_m is 11001: must be at most 11000"):
        parse(planned(0.0, 11_001.0), "reach")
