"""The scenarios after the papers' further figures: what they say is what happens in them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.charts import reachable_sigma, synthetic
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.validate import validate
from uwcoop.navigators import NAVIGATORS, options_of
from uwcoop.world.simulate import simulate

NAMES = ["charles-river", "st-john-bias", "st-john-current", "st-john-field", "st-john-field-3"]


def positions(log: MissionLog) -> np.ndarray:
    assert log.truth is not None
    return log.truth["position_m"].to_numpy()


@pytest.mark.parametrize("name", NAMES)
def test_each_is_packaged_simulates_and_says_that_it_is_synthetic(name: str) -> None:
    described = dict(scenario.packaged())
    assert "synthetic stand-in: the recordings are not public" in described[name]
    loaded = scenario.load(name)
    assert scenario.parse(json.loads(json.dumps(loaded.resolved()))) == loaded
    log = simulate(loaded, seed=1)
    validate(log)
    assert log.vehicles == tuple(vehicle.name for vehicle in loaded.team)
    # One fix at the start, and never GPS.
    assert log.events["fix"]["t_ns"].tolist() == [0] * len(log.vehicles)
    assert len(log.events["water_depth"]["t_ns"]) == len(log.events["motion"]["t_ns"])  # never off the chart
    for navigator in NAVIGATORS:
        options_of(navigator, scenario.MissionSetup.of(loaded))


@pytest.mark.parametrize("speed", [0.0, 0.25, 0.5])
def test_st_john_current_flows_south(speed: float) -> None:
    s = scenario.load("st-john-current", [f"current.speed_mps={speed}"])
    log = simulate(s, seed=2)
    assert log.truth is not None
    np.testing.assert_allclose(
        log.truth["current_mps"].to_numpy(), np.broadcast_to([0, -speed], (3, 901, 2)), atol=1e-12
    )
    resolved, base = s.resolved(), scenario.load("st-john").resolved()
    for table in (resolved, base):
        del table["name"], table["description"], table["current"], table["navigator"]
    assert resolved == base


def test_the_default_current_is_the_middle_one_and_missions_with_it_stay_paired() -> None:
    assert scenario.load("st-john-current").current.speed_mps == 0.25
    weak, strong = (
        simulate(scenario.load("st-john-current", [f"current.speed_mps={v}"]), 3) for v in (0, 0.5)
    )
    np.testing.assert_array_equal(positions(weak)[:, 0], positions(strong)[:, 0])
    np.testing.assert_array_equal(weak.events["fix"]["e_m"], strong.events["fix"]["e_m"])


def test_st_john_bias_errs_by_a_degree_and_a_tenth() -> None:
    s = scenario.load("st-john-bias", ["drift.velocity_noise_m_per_sqrt_s=0"])
    log = simulate(s, seed=2)
    assert log.truth is not None
    motion = log.events["motion"]
    for vehicle in range(3):
        mine = motion["vehicle"] == vehicle
        command = np.column_stack([motion["velocity_e_mps"][mine], motion["velocity_n_mps"][mine]])[:-1]
        moved = np.diff(positions(log)[vehicle], axis=0)
        np.testing.assert_allclose(np.hypot(*moved.T) - np.hypot(*command.T), 0.1, atol=1e-9)
        cross = command[:, 0] * moved[:, 1] - command[:, 1] * moved[:, 0]
        turned = np.arctan2(cross, (command * moved).sum(axis=1))
        np.testing.assert_allclose(np.rad2deg(turned), -1.0, atol=1e-9)  # clockwise of what it believes


def test_charles_river_ranges_along_one_bearing_and_sways() -> None:
    loaded = scenario.load("charles-river")
    assert loaded.acoustics.slot_s * len(loaded.team) == 15
    log = simulate(loaded, seed=0)
    assert log.chart is not None
    assert log.chart.extent == (0, 0, 500, 300)
    position = positions(log)
    for a, b in [(0, 1), (1, 2), (0, 2)]:
        de, dn = (position[b] - position[a]).T
        axis = np.abs(np.rad2deg(np.arctan2(dn, de)))
        assert np.quantile(axis, 0.9) < 20  # east and west of each other throughout
    calm = positions(simulate(scenario.load("charles-river", ["waves.amplitude_m=0"]), seed=0))
    sway = position - calm
    assert np.abs(sway[0, 10:100, 0]).max() == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_the_charles_river_chart_is_flat_and_patchy(seed: int) -> None:
    chart = synthetic("charles-river", seed=seed)
    assert chart.shape == (301, 501)
    shallow, deep = chart.depth_range_m
    assert 3 < shallow < deep < 10
    sigma = reachable_sigma(chart)
    assert 0.1 < (sigma < 1.0).mean() < 0.7
    assert (sigma > 3.0).mean() > 0.2
    wide = synthetic("charles-river", seed=seed, size_m=(600, 200))
    assert wide.extent == (0, 0, 600, 200)
    np.testing.assert_array_equal(
        wide.depth_m[:200, :500], synthetic("charles-river", seed=seed).depth_m[:200, :500]
    )


def receptions(log: MissionLog, sender: int, receiver: int, from_s: float, to_s: float) -> float:
    o = log.opportunities
    t = o["tol_ns"] / 1e9
    chosen = (o["sender"] == sender) & (o["receiver"] == receiver) & (t >= from_s) & (t < to_s)
    return float(o["survive_probability"][chosen].mean())


def test_st_john_field_has_its_schedule_current_and_shadows() -> None:
    loaded = scenario.load("st-john-field")
    assert (loaded.acoustics.slot_s, len(loaded.team)) == (8, 2)
    log = simulate(loaded, seed=0)
    assert log.truth is not None
    current = log.truth["current_mps"].to_numpy()
    assert (current[..., 0] < 0).all()
    assert (current[..., 1] > 0).all()
    # The models' velocity makes up for the current: it points further south-east than the way over ground.
    motion, position = log.events["motion"], positions(log)
    for vehicle in range(2):
        mine = motion["vehicle"] == vehicle
        command = [motion[k][mine][:-1].mean() for k in ("velocity_e_mps", "velocity_n_mps")]
        over_ground = np.diff(position[vehicle], axis=0).mean(axis=0)
        assert command[0] > over_ground[0]
        assert command[1] < over_ground[1]
    # Northward, away from the AUV, with its thruster between the modems.
    north = np.diff(position[1, :, 1])
    assert north[215:290].min() > 0.5
    assert north[515:590].min() > 0.5
    for sender, receiver in [(0, 1), (1, 0)]:
        assert receptions(log, sender, receiver, 0, 90) > 0.9
        assert receptions(log, sender, receiver, 240, 300) < 0.1
        assert receptions(log, sender, receiver, 560, 610) < 0.1
        assert receptions(log, sender, receiver, 700, 800) < 0.2  # far apart


def test_the_third_vehicle_leaves_the_first_two_as_they_were() -> None:
    two, three = simulate("st-john-field", seed=4), simulate("st-john-field-3", seed=4)
    np.testing.assert_array_equal(positions(two), positions(three)[:2])
    for kind in ("motion", "water_depth", "fix"):
        pair = three.events[kind]["vehicle"] < 2
        for name, column in two.events[kind].items():
            np.testing.assert_array_equal(column, three.events[kind][name][pair])
    assert (
        scenario.load("st-john-field-3").acoustics.slot_s == scenario.load("st-john-field").acoustics.slot_s
    )
