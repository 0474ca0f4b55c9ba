"""From channels to events: frames, units, lever arms, clocks, beams, pressure, ranges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorded_dive import LAT0, LON0, T0, Array, channel, source, yaw_quaternion
from uwcoop.errors import LogError
from uwcoop.frames import LocalFrame, wrap_angle
from uwcoop.importers.channels import Channel
from uwcoop.importers.import_config import load_config
from uwcoop.importers.mapping.heading import declination_deg
from uwcoop.importers.mapping.mission import mission_of
from uwcoop.importers.mapping.vertical import depth_of_pressure
from uwcoop.missionlog import MissionLog

T = np.arange(40.0)
ONE = {"vehicles": [{"name": "v"}]}


def of(*channels: Channel, **told: Any) -> MissionLog:
    return mission_of([source(*channels)], load_config(None, {**ONE, **told}))


def imu(yaw: Array, name: str = "/v/imu", **about: Any) -> Channel:
    columns = {k.replace(".", "__"): v for k, v in yaw_quaternion(yaw, **about).items()}
    return channel(name, "sensor_msgs/msg/Imu", T[: len(yaw)], **columns)


def dvl(forward: Any = 1.0, left: Any = 0.0, name: str = "/v/dvl") -> Channel:
    full = np.ones(len(T))
    return channel(
        name, "geometry_msgs/msg/TwistWithCovarianceStamped", T,
        twist__twist__linear__x=forward * full, twist__twist__linear__y=left * full,
    )  # fmt: skip


def table(**columns: Any) -> Channel:
    made = channel("v.csv", "table", T)
    values = {label: np.asarray(v, dtype=np.float64) * np.ones(len(T)) for label, v in columns.items()}
    return Channel("v.csv", "v.csv", "table", made.t_ns, values)


def column(log: MissionLog, kind: str, name: str) -> Array:
    return np.asarray(log.events[kind][name])


angles = st.floats(-3.1, 3.1)
tilts = st.floats(-0.6, 0.6)


@settings(max_examples=40, deadline=None)
@given(yaw=angles, roll=tilts, pitch=tilts)
def test_an_orientation_is_the_same_in_both_conventions(yaw: float, roll: float, pitch: float) -> None:
    """ENU with forward-left-up, and NED with forward-right-down: roll the same, pitch the other way."""
    yaws = np.full(5, yaw)
    enu = of(imu(yaws, roll=roll, pitch=-pitch), dvl())
    ned = of(imu(np.pi / 2 - yaws, roll=roll, pitch=pitch), dvl(), sensors={"heading": {"frame": "ned"}})
    for log in (enu, ned):
        np.testing.assert_allclose(wrap_angle(column(log, "heading", "yaw_rad") - yaw), 0, atol=1e-9)


def down(log: MissionLog) -> Array:
    return column(log, "water_depth", "water_depth_m")


def ranger(value: float) -> Channel:
    full = np.full(len(T), value)
    return channel(
        "/v/alt", "sensor_msgs/msg/Range", T, range=full, min_range=0 * full, max_range=100 + 0 * full
    )


@settings(max_examples=40, deadline=None)
@given(yaw=angles, roll=tilts, pitch=tilts, far=st.floats(1, 50))
def test_an_altimeter_measures_along_its_tilted_beam(
    yaw: float, roll: float, pitch: float, far: float
) -> None:
    yaws = np.full(len(T), yaw)
    depth = channel("/v/depth", "std_msgs/msg/Float64", T, data=np.full(len(T), 7.0))
    told = {"vehicles": [{"name": "v", "depth": {"topic": "/v/depth"}}]}
    log = of(imu(yaws, roll=roll, pitch=pitch), dvl(), ranger(far), depth, **told)
    np.testing.assert_allclose(down(log), 7.0 + far * np.cos(roll) * np.cos(pitch), rtol=1e-9)


def test_a_beam_that_is_mounted_ahead_looks_ahead() -> None:
    depth = channel("/v/depth", "std_msgs/msg/Float64", T, data=np.zeros(len(T)))
    told = {
        "vehicles": [{"name": "v", "depth": {"topic": "/v/depth"}, "altimeter": {"mounting_deg": [0, 30, 0]}}]
    }
    log = of(imu(np.zeros(len(T))), dvl(), ranger(10.0), depth, **told)
    np.testing.assert_allclose(down(log), 10 * np.cos(np.deg2rad(30)))


@pytest.mark.parametrize("beams", ["mean", "each"])
def test_four_beams_over_a_flat_seabed_agree_whatever_the_attitude(beams: str) -> None:
    roll, pitch, tilt = 0.15, 0.1, np.deg2rad(22.5)
    yaws = np.linspace(0, 1, len(T))
    # The vertical 20 m below: each beam is as long as its own fall needs.
    azimuth = 2 * np.pi * (np.arange(4) + 0.5) / 4
    x, y, z = np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)
    z1 = y * np.sin(roll) + z * np.cos(roll)
    fall = -(x * np.sin(pitch) + z1 * np.cos(pitch))
    full = np.ones(len(T))
    report = channel(
        "/v/dvl/data", "dvl_msgs/msg/DVL", T, velocity__x=full, velocity__y=0 * full, velocity_valid=full,
        **{f"beams[{k}]__distance": 20.0 / fall[k] * full for k in range(4)},
    )  # fmt: skip
    depth = channel("/v/depth", "std_msgs/msg/Float64", T, data=5 * full)
    told = {"vehicles": [{"name": "v", "depth": {"topic": "/v/depth"}, "altimeter": {"beams": beams}}]}
    log = of(imu(yaws, roll=roll, pitch=-pitch), report, depth, **told)
    assert len(down(log)) == len(T) * (4 if beams == "each" else 1)
    np.testing.assert_allclose(down(log), 25.0, rtol=1e-9)


def test_velocities_of_a_driver_that_looks_down_have_their_left_turned_round() -> None:
    full = np.ones(len(T))
    report = channel(
        "/v/dvl/data", "dvl_msgs/msg/DVL", T, velocity__x=full, velocity__y=0.3 * full, velocity_valid=full
    )
    log = of(imu(np.zeros(len(T))), report)
    np.testing.assert_allclose(column(log, "ground_velocity", "left_mps"), -0.3)
    flu = of(imu(np.zeros(len(T))), report, sensors={"ground_velocity": {"frame": "flu"}})
    np.testing.assert_allclose(column(flu, "ground_velocity", "left_mps"), 0.3)


def test_a_velocity_ahead_of_the_point_is_that_of_the_point_and_the_turn() -> None:
    rate, arm = 0.05, (0.8, -0.2, 0.0)
    # The instrument moves with the point and round it: v + rate x arm.
    log = of(
        imu(rate * T), dvl(1.0 - rate * arm[1], rate * arm[0]),
        sensors={"ground_velocity": {"lever_arm_m": list(arm)}, "turn_rate": {"use": False}},
    )  # fmt: skip
    np.testing.assert_allclose(column(log, "ground_velocity", "forward_mps"), 1.0, atol=1e-9)
    np.testing.assert_allclose(column(log, "ground_velocity", "left_mps"), 0.0, atol=1e-9)


def test_a_mounting_turns_velocity_and_heading() -> None:
    turned = np.deg2rad(30)
    log = of(
        imu(np.full(len(T), 0.5) + turned), dvl(np.cos(turned), -np.sin(turned)),
        sensors={"heading": {"mounting_deg": [0, 0, 30]}, "ground_velocity": {"mounting_deg": [0, 0, 30]}},
    )  # fmt: skip
    np.testing.assert_allclose(column(log, "heading", "yaw_rad"), 0.5)
    np.testing.assert_allclose(column(log, "ground_velocity", "forward_mps"), 1.0)
    np.testing.assert_allclose(column(log, "ground_velocity", "left_mps"), 0.0, atol=1e-12)


def fixes(name: str = "/v/gps", **columns: Any) -> Channel:
    full = np.ones(len(T))
    values = {"latitude": LAT0 * full, "longitude": LON0 + 1e-6 * T, "status__status": 0 * full, **columns}
    return channel(name, "sensor_msgs/msg/NavSatFix", T, **values)


def test_an_antenna_aft_gives_the_place_of_the_point() -> None:
    told = {"origin_deg": [LAT0, LON0], "sensors": {"fix": {"lever_arm_m": [-2.0, 0.0, 0.0]}}}
    plain, mounted = (
        of(fixes(), imu(np.full(len(T), np.pi / 2)), **t) for t in ({"origin_deg": [LAT0, LON0]}, told)
    )
    np.testing.assert_allclose(column(mounted, "fix", "n_m") - column(plain, "fix", "n_m"), 2.0)
    np.testing.assert_allclose(column(mounted, "fix", "e_m"), column(plain, "fix", "e_m"), atol=1e-9)


def test_a_covariance_that_is_unknown_is_not_taken_as_exact() -> None:
    full = np.ones(len(T))
    kind = np.where(T < 10, 0, 2)
    cov = {
        "position_covariance[0]": np.where(T < 20, 0.0, 9.0),
        "position_covariance[4]": np.where(T < 20, 0.0, 4.0),
    }
    log = of(fixes(position_covariance_type=kind, **cov, **{"position_covariance[1]": 0 * full}), imu(0 * T))
    np.testing.assert_allclose(column(log, "fix", "cov_ee_m2"), np.where(T < 20, 25.0, 9.0))
    np.testing.assert_allclose(column(log, "fix", "cov_nn_m2"), np.where(T < 20, 25.0, 4.0))
    assert any("20 without one: 5 m assumed" in note for note in log.notes)


def test_a_magnetometer_is_a_heading_by_the_declination_of_place_and_date() -> None:
    pytest.importorskip("pygeomag")
    frame = LocalFrame.at(LAT0, LON0)
    east = declination_deg(frame, T0 * 10**9, "test")
    assert east == pytest.approx(-13.9, abs=0.3), "Massachusetts Bay in 2025, by WMM2025"
    heading = np.deg2rad(40.0)
    mag = channel(
        "/v/mag", "sensor_msgs/msg/MagneticField", T, magnetic_field__x=2e-5 * np.cos(heading) + 0 * T,
        magnetic_field__y=2e-5 * np.sin(heading) + 0 * T, magnetic_field__z=4e-5 + 0 * T,
    )  # fmt: skip
    log = of(fixes(), mag, origin_deg=[LAT0, LON0], sensors={"heading": {"declination_deg": "wmm"}})
    np.testing.assert_allclose(column(log, "heading", "yaw_rad"), np.deg2rad(90 - 40 - east), atol=1e-9)
    assert any(f"declination {east:+.2f} deg by the World Magnetic Model" in note for note in log.notes)


UNITS = {
    ("depth", "depth_ft", "ft", 0.3048), ("depth", "depth_m", "", 1.0), ("depth", "depth", "fathom", 1.8288),
}  # fmt: skip


@pytest.mark.parametrize(("role", "label", "unit", "factor"), sorted(UNITS))
def test_units_are_those_of_the_name_or_of_the_settings(
    role: str, label: str, unit: str, factor: float
) -> None:
    told = {"sensors": {role: {"unit": unit}}} if unit else {}
    log = of(table(lat=LAT0 + 1e-6 * T, lon=LON0, heading_deg=80 + T, **{label: 10.0}), **told)
    np.testing.assert_allclose(column(log, "depth", "depth_m"), 10.0 * factor)
    np.testing.assert_allclose(column(log, "heading", "yaw_rad"), np.deg2rad(10 - T), atol=1e-12)


def test_pressure_becomes_depth_by_the_formula_of_the_sea() -> None:
    import uwcoop.importers.mapping.vertical as vertical

    # UNESCO technical paper 44 gives 9,712.653 m at 10,000 dbar and 30 degrees.
    fallback, name = _without_gsw(vertical, np.array([1e8]), 30.0)
    assert name == "UNESCO 1983"
    assert fallback[0] == pytest.approx(9712.653, abs=1e-3)
    fresh, _ = depth_of_pressure(np.array([98_066.5]), density_kgpm3=1000.0)
    assert fresh[0] == pytest.approx(10.0)


def _without_gsw(vertical: Any, pascal: Array, latitude: float) -> tuple[Array, str]:
    import sys

    hidden = sys.modules.get("gsw")
    sys.modules["gsw"] = None  # type: ignore[assignment]
    try:
        found: tuple[Array, str] = vertical.depth_of_pressure(pascal, None, latitude)
        return found
    finally:
        if hidden is None:
            del sys.modules["gsw"]
        else:
            sys.modules["gsw"] = hidden


def test_a_sensor_that_counts_from_its_own_zero_is_put_on_the_recorders_clock() -> None:
    own = imu(np.zeros(len(T)))
    late = Channel(
        "dive", "/v/imu", own.kind, (T * 1e9).astype(np.int64), own.columns, clock="own", received_ns=own.t_ns
    )
    log = of(fixes(), late)
    np.testing.assert_array_equal(column(log, "heading", "t_ns"), column(log, "fix", "t_ns"))
    assert any("/v/imu: its stamps count from a zero of their own" in note for note in log.notes)
    with pytest.raises(
        LogError, match=r"/v/imu of dive counts time from a zero of its own.*cannot be put on one clock"
    ):
        of(fixes(), late, align_clocks=False)


def test_jumps_and_drift_of_a_clock_are_said() -> None:
    t = np.arange(600.0)
    jump = channel("/v/imu", "sensor_msgs/msg/Imu", t + np.where(t > 300, 4.0, 0.0), received=t + 0.01, **{
        k.replace(".", "__"): v for k, v in yaw_quaternion(np.zeros(600)).items()
    })  # fmt: skip
    drift = channel(
        "/v/dvl", "geometry_msgs/msg/TwistWithCovarianceStamped", t * (1 + 5e-4), received=t + 0.01,
        twist__twist__linear__x=1 + 0 * t, twist__twist__linear__y=0 * t,
    )  # fmt: skip
    log = of(jump, drift)
    assert any(
        "/v/imu: its clock jumps against the recorder's 1 times, first 30" in n and "+4.000 s" in n
        for n in log.notes
    )
    assert any(
        "/v/dvl: its clock drifts against the recorder's by +500 ppm, +0.300 s" in note for note in log.notes
    )


def test_stamps_out_of_order_and_twice_are_mended_and_counted() -> None:
    order = np.random.default_rng(2).permutation(len(T))
    values = np.linspace(0, 1, len(T))
    mixed = channel("/v/imu", "sensor_msgs/msg/Imu", np.append(T[order], 3.0), **{
        k.replace(".", "__"): v for k, v in yaw_quaternion(np.append(values[order], 9.0)).items()
    })  # fmt: skip
    log = of(mixed, dvl())
    np.testing.assert_allclose(column(log, "heading", "yaw_rad"), values, atol=1e-12)
    assert any(
        "stamps before the one before them: sorted; 1 with a stamp that is there already" in n
        for n in log.notes
    )


def test_fast_sensors_are_thinned_and_offsets_move_their_stamps() -> None:
    t = np.arange(0, 20, 0.02)
    fast = channel("/v/imu", "sensor_msgs/msg/Imu", t, **{
        k.replace(".", "__"): v for k, v in yaw_quaternion(0.01 * t).items()
    })  # fmt: skip
    log = of(fast, dvl(), sensors={"ground_velocity": {"offset_s": 0.25}})
    assert len(column(log, "heading", "t_ns")) == 100
    np.testing.assert_array_equal(column(log, "ground_velocity", "t_ns") % 10**9, 250_000_000)
    assert any("thinned to 5 Hz" in note for note in log.notes)


def test_what_an_instrument_says_without_a_reading_is_dropped() -> None:
    log = of(imu(np.zeros(len(T))), dvl(np.where(T % 4 == 0, -32.768, 1.2)))
    np.testing.assert_allclose(column(log, "ground_velocity", "forward_mps"), 1.2)
    assert any("10 with forward outside -15 to 15 m/s (no reading)" in note for note in log.notes)


def test_a_range_to_a_beacon_is_an_event_and_one_to_a_vehicle_a_signal() -> None:
    ranges = Channel(
        "ranges.csv", "ranges.csv", "table", channel("r", "", T[5:9]).t_ns,
        {
            "from": np.array(["v", "w", "v", "w"], dtype=object), "to": np.array(["b1", "v", "w", "b1"], dtype=object),
            "range_m": np.array([100.0, 150.0, 75.0, 30.0]),
            "kind": np.array(["two-way", "two-way", "one-way", "one-way"], dtype=object),
        },
    )  # fmt: skip
    log = of(
        imu(0 * T), fixes(), imu(0 * T, "/w/imu"), fixes("/w/gps"), ranges, origin_deg=[LAT0, LON0],
        vehicles=[{"name": "v"}, {"name": "w"}], beacons=[{"name": "b1", "place_m": [10, 20], "depth_m": 3}],
    )  # fmt: skip
    beacon = log.events["beacon_range"]
    np.testing.assert_array_equal(beacon["vehicle"], [0, 1])
    np.testing.assert_allclose(beacon["range_m"], [100, 30])
    np.testing.assert_allclose(beacon["beacon_e_m"], 10)
    np.testing.assert_array_equal(beacon["one_way"], [False, True])
    heard = log.opportunities
    # w polled v and has the range: v sent. v sent and w heard it one way.
    np.testing.assert_array_equal(heard["sender"], [0, 0])
    np.testing.assert_array_equal(heard["receiver"], [1, 1])
    np.testing.assert_array_equal(heard["toa_ns"], np.array([6, 7]) * 10**9)
    np.testing.assert_array_equal(heard["toa_ns"] - heard["tol_ns"], [100_000_000, 50_000_000])


def test_usbl_as_bearing_and_range_from_a_ship_that_turns() -> None:
    yaw = 0.05 * T
    # The vehicle lies 30 m to starboard of the ship, 40 m below it.
    usbl = channel(
        "/ship/usbl",
        "my_msgs/msg/Usbl",
        T,
        az=90 + 0 * T,
        slant=50 + 0 * T,
        el=np.rad2deg(np.arctan2(40, 30)) + 0 * T,
    )
    told = {
        "vehicles": [
            {"name": "ship"},
            {"name": "v", "usbl": {
                "topic": "/ship/usbl", "ship": "ship", "age_s": 0.5, "unit": "deg",
                "columns": {"bearing": "az", "range": "slant", "elevation": "el"},
            }},
        ],
        "origin_deg": [LAT0, LON0],
    }  # fmt: skip
    log = of(fixes("/ship/gps"), imu(yaw, "/ship/imu"), usbl, imu(0 * T), **told)
    table_ = log.events["usbl"]
    # Bearing and ship count as they were when it was measured.
    ship, then = log.events["fix"], np.maximum(T - 0.5, 0)
    seen = 0.05 * then
    np.testing.assert_allclose(table_["e_m"], np.interp(then, T, ship["e_m"]) + 30 * np.sin(seen), atol=1e-6)
    np.testing.assert_allclose(table_["n_m"], np.interp(then, T, ship["n_m"]) - 30 * np.cos(seen), atol=1e-6)
    np.testing.assert_array_equal(table_["t_ns"] - table_["measured_ns"], 500_000_000)


@settings(max_examples=25, deadline=None)
@given(order=st.permutations(range(5)), yaw=angles)
def test_the_order_of_channels_does_not_count(order: list[int], yaw: float) -> None:
    channels = [
        imu(np.full(len(T), yaw)),
        dvl(),
        fixes(),
        ranger(9.0),
        channel("/v/x", "std_msgs/msg/String", T, a=T),
    ]
    one = of(*channels, origin_deg=[LAT0, LON0])
    other = of(*(channels[k] for k in order), origin_deg=[LAT0, LON0])
    for kind, events in one.events.items():
        for name, values in events.items():
            np.testing.assert_array_equal(values, other.events[kind][name])
