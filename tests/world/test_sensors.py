"""Sensors: each event against the truth it was made from, noise by its statistics, streams independent."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.charts import Chart
from uwcoop.frames import wrap_angle
from uwcoop.missionlog.model import EVENT_COLUMNS, Columns
from uwcoop.scenario import Scenario
from uwcoop.world.sensors import Tides, events_of, sample_times
from uwcoop.world.vehicles import Motion, team_motion

BASE: dict[str, Any] = {
    "name": "bay",
    "duration_s": 900,
    "chart": {"source": "synthetic:st-john"},
    "vehicles": [{"name": "auv", "depth_m": 3.0}],
    "acoustics": {"modem": "unlimited", "slot_s": 5.0, "max_range_m": 1000.0},
}
EAST = np.arange(1001, dtype=np.float32)
SLOPE = Chart(np.tile(10 + 0.02 * EAST, (1001, 1)).astype(np.float32), 0.0, 0.0, 1.0)
"""10 m deep in the west, 30 m in the east."""


def world(*overrides: str) -> Scenario:
    return scenario.parse(scenario.apply_overrides(copy.deepcopy(BASE), overrides))


def sensed(s: Scenario, seed: int = 0, chart: Chart = SLOPE) -> tuple[dict[str, Columns], list[Motion]]:
    motion = team_motion(s, chart, seed)
    return events_of(s, chart, motion, seed), motion


def test_by_default_there_are_motion_depth_water_depth_and_one_fix_at_whole_seconds() -> None:
    events, _ = sensed(world("duration_s=20"))
    assert set(events) == {"motion", "depth", "water_depth", "fix"}
    for kind in ("motion", "depth", "water_depth"):
        assert events[kind]["t_ns"].tolist() == [k * 1_000_000_000 for k in range(21)]
    assert events["fix"]["t_ns"].tolist() == [0]


def test_columns_are_those_of_the_log() -> None:
    kinds = ["heading={}", "turn_rate={}", "ground_velocity={}", "odometry={}", "gps={}"]
    events, _ = sensed(world("duration_s=20", "vehicles={count = 2}", *(f"sensors.{kind}" for kind in kinds)))
    assert set(events) == {
        "motion", "depth", "water_depth", "fix", "heading", "turn_rate", "ground_velocity", "odometry",
    }  # fmt: skip
    for kind, table in events.items():
        assert set(table) == {"t_ns", "vehicle", *EVENT_COLUMNS[kind]}
        for name, dtype in {"t_ns": "i8", "vehicle": "i8", **EVENT_COLUMNS[kind]}.items():
            assert table[name].dtype == np.dtype(dtype), (kind, name)
            assert np.isfinite(table[name]).all()
        key = list(zip(table["t_ns"], table["vehicle"], strict=True))
        assert key == sorted(key)


def test_motion_events_carry_the_command() -> None:
    events, motion = sensed(world("drift={preset='no-dvl'}"))
    np.testing.assert_array_equal(events["motion"]["velocity_e_mps"], motion[0].command_mps[:, 0])
    np.testing.assert_array_equal(events["motion"]["velocity_n_mps"], motion[0].command_mps[:, 1])


def test_water_depth_is_chart_plus_noise_with_its_sigma() -> None:
    events, motion = sensed(world("sensors.water_depth.sigma_m=0.3"))
    error = events["water_depth"]["water_depth_m"] - SLOPE.depth_at(motion[0].position_m)
    assert error.std() == pytest.approx(0.3, rel=0.1)
    assert abs(error.mean()) < 4 * 0.3 / 30
    assert set(events["water_depth"]["sigma_m"]) == {0.3}
    white = np.corrcoef(error[:-1], error[1:])[0, 1]
    assert abs(white) < 4 / 30


def test_own_depth_has_its_own_noise() -> None:
    events, motion = sensed(world("sensors.depth.sigma_m=0.1"))
    own = events["depth"]["depth_m"] - 3.0
    water = events["water_depth"]["water_depth_m"] - SLOPE.depth_at(motion[0].position_m)
    assert own.std() == pytest.approx(0.1, rel=0.1)
    assert abs(np.corrcoef(own, water)[0, 1]) < 4 / 30


def test_high_tide_is_deeper_than_the_chart() -> None:
    events, motion = sensed(world("sensors.water_depth.sigma_m=0", "tide.offset_m=0.7"))
    error = events["water_depth"]["water_depth_m"] - SLOPE.depth_at(motion[0].position_m)
    np.testing.assert_allclose(error, 0.7, atol=1e-9)


def test_tides() -> None:
    t = np.array([0.0, 900.0, 1800.0, 2700.0])
    wave = Tides(world("tide={amplitude_m=1.5, period_s=3600}").tide, 0)
    np.testing.assert_allclose(wave.at(t), [0, 1.5, 0, -1.5], atol=1e-12)
    late = Tides(world("tide={amplitude_m=1.5, period_s=3600, phase_deg=90, offset_m=1}").tide, 0)
    np.testing.assert_allclose(late.at(t), [2.5, 1, -0.5, 1], atol=1e-12)
    spring = world("tide.offset_sigma_m=0.3").tide
    offsets = np.array([Tides(spring, seed).at(t) for seed in range(1000)])
    np.testing.assert_array_equal(offsets[:, 0], offsets[:, 3])
    assert offsets[:, 0].std() == pytest.approx(0.3, rel=0.08)


def test_over_a_hole_and_off_the_chart_there_is_no_sounding() -> None:
    depth = np.full((201, 201), 10.0, dtype=np.float32)
    depth[:, 80:120] = np.nan
    chart = Chart(depth, 0.0, 0.0, 1.0)
    path = "vehicles.auv.path={kind='waypoints', waypoints_m=[[0.5, 100], [400, 100]]}"
    events, motion = sensed(world(path, "duration_s=200"), chart=chart)
    east = motion[0].position_m[:, 0]
    seen = np.zeros(201, dtype=bool)
    seen[events["water_depth"]["t_ns"] // 1_000_000_000] = True
    np.testing.assert_array_equal(seen, np.isfinite(chart.depth_at(motion[0].position_m)))
    assert not seen[(east > 81) & (east < 118)].any()
    assert not seen[east > 201].any()
    assert seen[(east > 121) & (east < 199)].all()
    assert len(events["depth"]["t_ns"]) == len(events["motion"]["t_ns"]) == 201  # the rest goes on


def test_holes_do_not_shift_the_noise_of_later_soundings() -> None:
    depth = np.full((201, 301), 10.0, dtype=np.float32)
    path = "vehicles.auv.path={kind='waypoints', waypoints_m=[[1, 100], [299, 100]]}"
    whole, _ = sensed(world(path, "duration_s=190"), chart=Chart(depth, 0.0, 0.0, 1.0))
    holed = depth.copy()
    holed[:, 80:120] = np.nan
    part, _ = sensed(world(path, "duration_s=190"), chart=Chart(holed, 0.0, 0.0, 1.0))
    both = np.isin(whole["water_depth"]["t_ns"], part["water_depth"]["t_ns"])
    np.testing.assert_array_equal(
        whole["water_depth"]["water_depth_m"][both], part["water_depth"]["water_depth_m"]
    )


def test_recorded_soundings_replace_the_altimeter_even_where_there_is_no_chart() -> None:
    zero, steps = np.zeros(11), np.column_stack([np.arange(11.0), np.zeros(11)])
    soundings = np.full(11, np.nan)
    soundings[[2, 7]] = [4.5, 99.0]
    off_chart = Motion(steps + 5000, zero, zero, steps * 0, zero, steps * 0, soundings)
    events = events_of(world("duration_s=10", "sensors.water_depth.sigma_m=0.4"), SLOPE, [off_chart], 0)
    assert events["water_depth"]["t_ns"].tolist() == [2_000_000_000, 7_000_000_000]
    assert events["water_depth"]["water_depth_m"].tolist() == [4.5, 99.0]
    assert events["water_depth"]["sigma_m"].tolist() == [0.4, 0.4]


def test_the_start_fix_is_uniform_in_its_disc_and_says_so() -> None:
    s = world(
        "duration_s=1",
        "sensors.fix.radius_m=10",
        "vehicles.auv.path={kind='waypoints', waypoints_m=[[9, 9], [99, 9]]}",
    )
    errors = []
    for seed in range(1500):
        fix = events_of(s, SLOPE, team_motion(s, SLOPE, seed), seed)["fix"]
        errors.append([fix["e_m"][0] - 9, fix["n_m"][0] - 9])
        assert (fix["cov_ee_m2"][0], fix["cov_en_m2"][0], fix["cov_nn_m2"][0]) == (25.0, 0.0, 25.0)
    distance = np.hypot(*np.array(errors).T)
    assert distance.max() <= 10
    np.testing.assert_allclose(
        np.quantile(distance, [0.25, 0.5, 0.75]), 10 * np.sqrt([0.25, 0.5, 0.75]), atol=0.4
    )
    np.testing.assert_allclose(np.cov(np.array(errors).T), 25 * np.eye(2), atol=2.5)


def test_a_vehicle_can_start_without_a_fix() -> None:
    assert "fix" not in sensed(world("duration_s=5", "sensors.fix.at_start=false"))[0]


def test_gps_fixes_come_at_their_rate_after_the_start() -> None:
    events, motion = sensed(world("sensors.gps={rate_hz=0.5, sigma_m=3}", "sensors.fix.at_start=false"))
    fix = events["fix"]
    assert fix["t_ns"].tolist() == [k * 2_000_000_000 for k in range(1, 451)]
    error = np.column_stack([fix["e_m"], fix["n_m"]]) - motion[0].position_at(fix["t_ns"] / 1e9)
    np.testing.assert_allclose(error.std(axis=0), [3, 3], rtol=0.15)
    assert set(fix["cov_ee_m2"]) == {9.0}


def test_only_the_vehicle_at_the_surface_has_gps() -> None:
    table = copy.deepcopy(BASE)
    table["vehicles"] = [{"name": "ship", "depth_m": 0, "sensors": {"gps": {"rate_hz": 1}}}, {"name": "auv"}]
    s = scenario.parse(table)
    fix = sensed(s)[0]["fix"]
    assert np.bincount(fix["vehicle"]).tolist() == [901, 1]


def test_heading_shares_the_compass_bias() -> None:
    events, motion = sensed(world("drift.compass_bias_deg=5", "sensors.heading.sigma_deg=0.2"))
    error = wrap_angle(events["heading"]["yaw_rad"] - motion[0].yaw_rad)
    assert np.degrees(error.mean()) == pytest.approx(5, abs=0.05)  # clockwise bias: believes more to the left
    assert np.degrees(error.std()) == pytest.approx(0.2, rel=0.1)
    assert (np.abs(events["heading"]["yaw_rad"]) <= math.pi).all()


def test_turn_rate_integrates_to_the_turned_angle() -> None:
    events, motion = sensed(world("sensors.turn_rate={sigma_degps=0}"))
    rate = events["turn_rate"]["yaw_rate_radps"]
    assert len(rate) == 900
    np.testing.assert_allclose(
        wrap_angle(np.cumsum(rate) - (motion[0].yaw_rad[1:] - motion[0].yaw_rad[0])), 0, atol=1e-9
    )
    events, motion = sensed(world("sensors.turn_rate={sigma_degps=0, rate_hz=4}"))
    rate = events["turn_rate"]["yaw_rate_radps"]
    assert len(rate) == 3600
    turned = motion[0].yaw_rad[-1] - motion[0].yaw_rad[0]
    assert wrap_angle(rate.sum() / 4 - turned) == pytest.approx(0, abs=1e-9)
    biased = world("duration_s=2", "sensors.turn_rate={sigma_degps=0, bias_sigma_degps=0.01}")
    biases = []
    for seed in range(200):
        events, motion = sensed(biased, seed)
        turned = wrap_angle(np.diff(motion[0].yaw_rad))
        biases.append(np.degrees(events["turn_rate"]["yaw_rate_radps"][0] - turned[0]))
    assert np.std(biases) == pytest.approx(0.01, rel=0.2)


def test_ground_velocity_is_over_ground_in_the_body_frame() -> None:
    path = "vehicles.auv.path={kind='waypoints', waypoints_m=[[100, 100], [100, 2000]]}"
    quiet = ["drift.velocity_noise_m_per_sqrt_s=0", "sensors.ground_velocity={rate_hz=3, sigma_mps=0}"]
    events, motion = sensed(world(path, "current={model='constant', velocity_mps=[0.2, -0.3]}", *quiet))
    dvl = events["ground_velocity"]
    assert len(dvl["t_ns"]) == 2701
    yaw = motion[0].yaw_rad[(dvl["t_ns"] / 1e9).astype(int)]
    east = np.cos(yaw) * dvl["forward_mps"] - np.sin(yaw) * dvl["left_mps"]
    north = np.sin(yaw) * dvl["forward_mps"] + np.cos(yaw) * dvl["left_mps"]
    seconds = np.minimum((dvl["t_ns"] / 1e9).astype(int), 899)
    np.testing.assert_allclose(
        np.column_stack([east, north]), np.diff(motion[0].position_m, axis=0)[seconds], atol=1e-9
    )
    # by hand, at the first second: heading north-ish, the current sets to the right and astern
    through_water = 1.5 * np.array([1.0, 0.0])
    c, s = math.cos(yaw[0]), math.sin(yaw[0])
    current = np.array([c * 0.2 + s * -0.3, -s * 0.2 + c * -0.3])
    np.testing.assert_allclose(
        [dvl["forward_mps"][0], dvl["left_mps"][0]], through_water + current, atol=1e-9
    )
    assert dvl["left_mps"][0] < 0


def test_dvl_errors() -> None:
    path = "vehicles.auv.path={kind='waypoints', waypoints_m=[[100, 100], [100, 2000]]}"
    still = ["drift.velocity_noise_m_per_sqrt_s=0", path]
    noisy, _ = sensed(world(*still, "sensors.ground_velocity={sigma_mps=0.05}"))
    assert noisy["ground_velocity"]["left_mps"].std() == pytest.approx(0.05, rel=0.1)
    biased = world(
        "duration_s=2",
        *still,
        "sensors.ground_velocity={sigma_mps=0, scale_sigma=0.01, misalignment_sigma_deg=0.5}",
    )
    first = np.array(
        [
            [sensed(biased, k)[0]["ground_velocity"][name][0] for name in ("forward_mps", "left_mps")]
            for k in range(300)
        ]
    )
    assert (first[:, 0] / 1.5).std() == pytest.approx(0.01, rel=0.2)
    assert np.degrees(first[:, 1] / 1.5).std() == pytest.approx(0.5, rel=0.2)


def test_odometry_adds_up_to_the_track() -> None:
    s = world("sensors.odometry={rate_hz=0.5, sigma_m_per_sqrt_s=1e-9, sigma_yaw_deg_per_sqrt_s=1e-9}")
    events, motion = sensed(s)
    odometry = events["odometry"]
    assert odometry["t_ns"].tolist() == [k * 2_000_000_000 for k in range(1, 451)]
    yaw = motion[0].yaw_rad[0] + np.concatenate([[0], np.cumsum(odometry["yaw_change_rad"])])
    c, sn = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    east = np.cumsum(c * odometry["forward_m"] - sn * odometry["left_m"])
    north = np.cumsum(sn * odometry["forward_m"] + c * odometry["left_m"])
    track = motion[0].position_m[2::2] - motion[0].position_m[0]
    np.testing.assert_allclose(np.column_stack([east, north]), track, atol=1e-5)


def test_odometry_noise_is_what_its_covariance_says() -> None:
    s = world("sensors.odometry={rate_hz=0.25, sigma_m_per_sqrt_s=0.1, sigma_yaw_deg_per_sqrt_s=1}")
    noisy, _ = sensed(s)
    exact, _ = sensed(
        world("sensors.odometry={rate_hz=0.25, sigma_m_per_sqrt_s=1e-12, sigma_yaw_deg_per_sqrt_s=1e-12}")
    )
    odometry = noisy["odometry"]
    assert set(np.round(odometry["cov_ff"], 12)) == {0.04}  # 0.1² x 4 s
    np.testing.assert_allclose(odometry["cov_yy"], math.radians(2) ** 2)
    for name, sigma in [("forward_m", 0.2), ("left_m", 0.2), ("yaw_change_rad", math.radians(2))]:
        difference = odometry[name] - exact["odometry"][name]
        assert wrap_angle(difference).std() == pytest.approx(sigma, rel=0.2)


@pytest.mark.parametrize(("rate", "count"), [(0, 0), (1, 11), (25, 251), (0.3, 4), (0.1, 2), (0.01, 1)])
def test_sample_times(rate: float, count: int) -> None:
    times = sample_times(rate, 10.0)
    assert len(times) == count
    assert (times <= 10).all()


def test_a_sensor_switched_off_is_absent() -> None:
    events, _ = sensed(world("duration_s=5", "sensors.water_depth.rate_hz=0", "sensors.depth.rate_hz=0"))
    assert set(events) == {"motion", "fix"}


def test_a_further_sensor_or_vehicle_changes_no_other_noise() -> None:
    one, _ = sensed(world("vehicles={count = 1}", "duration_s=60"), 5)
    more = ["sensors.heading={}", "sensors.gps={}", "sensors.odometry={}", "sensors.ground_velocity={}"]
    three, _ = sensed(world("vehicles={count = 3}", "duration_s=60", *more), 5)
    for kind in ("motion", "depth", "water_depth"):
        first = three[kind]["vehicle"] == 0
        for name, column in one[kind].items():
            np.testing.assert_array_equal(column, three[kind][name][first])
    assert one["fix"]["e_m"][0] == three["fix"]["e_m"][0]


def test_noises_of_vehicles_are_independent() -> None:
    events, motion = sensed(world("vehicles={count = 2}"))
    table = events["water_depth"]
    error = [
        table["water_depth_m"][table["vehicle"] == v] - SLOPE.depth_at(motion[v].position_m) for v in range(2)
    ]
    assert abs(np.corrcoef(error)[0, 1]) < 4 / 30
