"""Sensors that fail: what is missing, stuck or impossible in the log, and that nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.errors import ScenarioError
from uwcoop.missionlog import MissionLog
from uwcoop.world.simulate import simulate

DVL = "sensors.ground_velocity={sigma_mps=0.01}"


def flown(*overrides: str) -> MissionLog:
    return simulate(scenario.load("flat-bay", ["duration_s=200", DVL, *overrides]), 3)


def of(log: MissionLog, kind: str, column: str, vehicle: int = 0) -> tuple[np.ndarray, np.ndarray]:
    table = log.events[kind]
    own = table["vehicle"] == vehicle
    return table["t_ns"][own] / 1e9, table[column][own]


def test_a_dropout_leaves_no_readings_and_changes_no_other() -> None:
    plain, failed = flown(), flown("sensors.ground_velocity.faults=[{kind='dropout', from_s=60, to_s=120}]")
    t, v = of(failed, "ground_velocity", "forward_mps")
    at, whole = of(plain, "ground_velocity", "forward_mps")
    assert not ((t >= 60) & (t < 120)).any()
    kept = (at < 60) | (at >= 120)
    np.testing.assert_array_equal(t, at[kept])
    np.testing.assert_array_equal(v, whole[kept])
    for kind in ("motion", "depth", "water_depth", "fix"):
        for name, column in plain.events[kind].items():
            np.testing.assert_array_equal(column, failed.events[kind][name])


def test_no_velocity_stands_on_both_axes_for_ten_rows() -> None:
    failed = flown("sensors.ground_velocity.faults=[{kind='value', value=-32.768, from_s=100, to_s=110}]")
    for axis in ("forward_mps", "left_mps"):
        t, v = of(failed, "ground_velocity", axis)
        assert (v == -32.768).sum() == 10
        assert set(t[v == -32.768]) == set(range(100, 110))


def test_a_stuck_sounder_repeats_what_it_read_before() -> None:
    plain, failed = flown(), flown("sensors.water_depth.faults=[{kind='stuck', from_s=50, to_s=90}]")
    t, z = of(failed, "water_depth", "water_depth_m")
    _, whole = of(plain, "water_depth", "water_depth_m")
    np.testing.assert_array_equal(z[(t >= 50) & (t < 90)], whole[t == 49][0])
    np.testing.assert_array_equal(z[t >= 90], whole[t >= 90])


def test_a_share_of_readings_is_struck_the_same_for_the_same_seed() -> None:
    fault = "sensors.water_depth.faults=[{kind='value', value=100, from_s=0, to_s=200, share=0.3}]"
    _, z = of(flown(fault), "water_depth", "water_depth_m")
    _, again = of(flown(fault), "water_depth", "water_depth_m")
    np.testing.assert_array_equal(z, again)
    assert 0.2 < (z == 100).mean() < 0.4
    _, other = of(flown(fault), "water_depth", "water_depth_m", vehicle=1)
    assert ((z == 100) != (other[: z.size] == 100)).any()


def test_a_heading_that_is_stuck_at_a_value_is_given_as_a_compass_shows_it() -> None:
    failed = flown("sensors.heading={faults=[{kind='value', value=90, from_s=0, to_s=10}]}")
    _, yaw = of(failed, "heading", "yaw_rad")
    np.testing.assert_allclose(yaw[:10], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("{kind='dropout', from_s=9, to_s=3}", "to_s is 3: must be above from_s, 9"),
        ("{kind='value', from_s=0, to_s=3}", "kind is 'value': value belongs to kind 'value'"),
        ("{kind='stuck', value=3, from_s=0, to_s=3}", "kind is 'stuck': value belongs to kind 'value'"),
        ("{kind='lost', from_s=0, to_s=3}", "must be one of 'dropout', 'stuck', 'value'"),
    ],
)
def test_faults_that_cannot_be_are_refused(fault: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.load("flat-bay", [f"sensors.water_depth.faults=[{fault}]"])
    assert says in str(caught.value)


@pytest.mark.parametrize("depth_m", [100.0, 10_000.0])
@pytest.mark.parametrize("navigator", ["mpf-terrain-only", "dmpf", "team"])
def test_a_sounding_that_the_chart_cannot_have_is_counted_and_changes_little(
    navigator: str, depth_m: float
) -> None:
    short = ["duration_s=200", f"navigator.{navigator}.particles=300"]
    fault = f'sensors.water_depth.faults=[{{kind="value", value={depth_m}, from_s=100, to_s=130}}]'
    clean = uwcoop.run("flat-bay", [navigator], seed=4, overrides=short, clouds=False).tracks
    faulty = uwcoop.run("flat-bay", [navigator], seed=4, overrides=[*short, fault], clouds=False).tracks
    more = faulty.rejected.isel(time=-1) - clean.rejected.isel(time=-1)
    assert (more >= 25).all(), more.values
    moved = np.linalg.norm((faulty.position_m - clean.position_m).isel(time=-1).values, axis=-1)
    assert moved.max() < 15.0
