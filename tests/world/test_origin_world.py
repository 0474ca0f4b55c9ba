"""The world of the origin state: drifting ships, losses by direction, unequal roles, streams as in Table 1."""

from __future__ import annotations

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.acoustics import packet_survival
from uwcoop.errors import ScenarioError
from uwcoop.experiment.packet_budget import budget
from uwcoop.world.simulate import simulate
from uwcoop.world.vehicles import team_motion

NAMES = ("ship-and-auv", "ship-and-auv-blackout", "ship-and-auv-long-blackout")


def test_a_ship_adrift_is_pushed_as_stated_and_stays_around() -> None:
    world = scenario.load("ship-and-auv", ["duration_s=12000"])
    pushes, places = [], []
    for seed in range(6):
        position = team_motion(world, None, seed)[0].position_m
        velocity = np.diff(position, axis=0)
        pushes.append(np.diff(velocity, axis=0))
        places.append(position[4000:] - (300.0, 120.0))
    # White acceleration of 1e-4 m²/s³ changes the velocity by 0.01 m/s in a second.
    np.testing.assert_allclose(np.std(pushes), 0.01, rtol=0.02)
    np.testing.assert_allclose(np.std(places), 120.0, rtol=0.4)
    assert abs(np.mean(places)) < 100


def test_nothing_is_commanded_adrift() -> None:
    moved = team_motion(scenario.load("ship-and-auv", ["duration_s=60"]), None, 0)[0]
    assert not moved.command_mps.any()
    np.testing.assert_allclose(np.diff(moved.position_m, axis=0), moved.current_mps[:-1], atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_cycle_has_six_slots_topside_and_four_subsea(name: str) -> None:
    log = simulate(name, seed=0)
    assert log.vehicles == ("ship", "auv")
    senders, tol_s = log.slots["sender"], log.slots["tol_ns"] / 1e9
    assert (np.bincount(senders[:10]) == [6, 4]).all()
    assert (senders[10:20] == senders[:10]).all()
    assert tol_s[10] - tol_s[0] == pytest.approx(145.0)


def test_streams_are_those_of_table_1() -> None:
    log = simulate(scenario.load("ship-and-auv", ["duration_s=100"]), seed=0)
    rates = {}
    for kind, table in log.events.items():
        for vehicle, name in enumerate(log.vehicles):
            rates[name, kind] = (table["vehicle"] == vehicle).sum()
    assert rates["auv", "heading"] == 2501
    assert rates["auv", "ground_velocity"] == 301
    assert rates["auv", "depth"] == 201
    assert rates["ship", "fix"] == 101
    assert rates["auv", "fix"] == 1
    assert rates["ship", "ground_velocity"] == rates["ship", "heading"] == rates["ship", "depth"] == 0
    assert np.rad2deg(log.events["heading"]["sigma_rad"]).max() == pytest.approx(2.0)


def test_losses_have_a_direction() -> None:
    heard = np.zeros((2, 2))
    for seed in range(5):
        o = simulate("ship-and-auv", seed).opportunities
        for sender in (0, 1):
            own = o["sender"] == sender
            heard[sender] += own.sum(), (o["draws"][own, 0] < o["survive_probability"][own]).sum()
    down, up = heard[:, 1] / heard[:, 0]
    assert down == pytest.approx(0.81, abs=0.04)
    assert up == pytest.approx(0.67, abs=0.06)


def test_the_budget_tells_the_worst_direction() -> None:
    plan = scenario.load("ship-and-auv").acoustics
    assert packet_survival(plan, 1) == pytest.approx(0.67)
    assert packet_survival(plan, 2) == pytest.approx(0.67**2)
    both = scenario.load("flat-bay", ["acoustics.loss={probability=0.25}"]).acoustics
    assert packet_survival(both, 1) == pytest.approx(0.75)


def test_a_direction_names_vehicles_that_exist() -> None:
    with pytest.raises(ScenarioError, match=r"acoustics\.losses names 'V9'"):
        scenario.load("flat-bay", ["acoustics.losses=[{probability=0.5, senders=['V9']}]"])


@pytest.mark.parametrize(("name", "start_s", "end_s"), [(NAMES[1], 3400, 3700), (NAMES[2], 300, 4200)])
def test_blackouts_silence_the_way_up_alone(name: str, start_s: float, end_s: float) -> None:
    o = simulate(name, seed=0).opportunities
    inside = (o["tol_ns"] >= start_s * 1e9) & (o["tol_ns"] < end_s * 1e9)
    assert (o["survive_probability"][inside & (o["sender"] == 1)] == 0).all()
    np.testing.assert_allclose(o["survive_probability"][o["sender"] == 0], 0.81)
    np.testing.assert_allclose(o["survive_probability"][~inside & (o["sender"] == 1)], 0.67)


def test_every_packaged_navigator_of_these_scenarios_has_a_budget() -> None:
    for name in (*NAMES, "four-vehicle-team"):
        costs = budget(scenario.load(name)).costs
        assert costs["cekf"] is None
        assert costs["nekf"] is not None
        assert costs["nekf"].packet_bytes == 47
        assert "dmpf" not in costs
