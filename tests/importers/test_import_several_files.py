"""Several files with channels of one name, clocks of ranges, and what is told of a sensor and has an effect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from recorded_dive import LAT0, LON0, T0, Array, channel, yaw_quaternion
from uwcoop.errors import LogError
from uwcoop.importers.channels import Channel, SourceFile
from uwcoop.importers.import_config import load_config
from uwcoop.importers.mapping.mission import mission_of
from uwcoop.missionlog import MissionLog

T = np.arange(40.0)


def imu(yaw: float, name: str = "/imu") -> Channel:
    columns = {k.replace(".", "__"): v for k, v in yaw_quaternion(yaw + 0 * T).items()}
    return channel(name, "sensor_msgs/msg/Imu", T, **columns)


def fixes(name: str = "/gps", **about: Any) -> Channel:
    return channel(
        name, "sensor_msgs/msg/NavSatFix", T, latitude=LAT0 + 0 * T, longitude=LON0 + 0 * T, **about
    )


def table(**columns: Any) -> Channel:
    values = {label: np.asarray(v, dtype=np.float64) * np.ones(len(T)) for label, v in columns.items()}
    return replace(channel("v.csv", "table", T), source="v.csv", columns=values)


def files(**channels: tuple[Channel, ...]) -> list[SourceFile]:
    return [
        SourceFile(f"{name}.mcap", "made up", tuple(replace(c, source=f"{name}.mcap") for c in own))
        for name, own in channels.items()
    ]


def of(sources: list[SourceFile], **told: Any) -> MissionLog:
    return mission_of(sources, load_config(None, told))


def yaws(log: MissionLog) -> list[float]:
    found = log.events["heading"]
    return [float(np.median(found["yaw_rad"][found["vehicle"] == k])) for k in range(len(log.vehicles))]


TOPICS = {"heading": {"topic": "/imu"}, "fix": {"topic": "/gps"}}


def test_a_topic_of_one_name_in_two_files_is_each_vehicles_own() -> None:
    sources = files(a=(imu(0.3), fixes()), b=(imu(-1.2), fixes()))
    vehicles = [{"name": "one", "source": "a.mcap"}, {"name": "two", "source": "b.mcap"}]
    for told in (
        {"vehicles": vehicles, "sensors": TOPICS},
        {"vehicles": [{**v, **TOPICS} for v in vehicles]},
        {"vehicles": [{"name": "a"}, {"name": "b"}], "sensors": TOPICS},
    ):
        np.testing.assert_allclose(yaws(of(sources, **told)), [0.3, -1.2])
    with pytest.raises(LogError, match=r"vehicle one: topic '/gps' is in a.mcap, b.mcap: source = "):
        of(sources, vehicles=[{"name": "one"}], sensors=TOPICS)


def test_a_vehicle_whose_file_lacks_a_topic_does_not_get_anothers() -> None:
    sources = files(a=(imu(0.3), fixes()), b=(fixes(),))
    vehicles = [{"name": "one", "source": "a.mcap"}, {"name": "two", "source": "b.mcap"}]
    log = of(sources, vehicles=vehicles, sensors=TOPICS)
    np.testing.assert_array_equal(np.unique(log.events["heading"]["vehicle"]), [0])
    with pytest.raises(LogError, match=r"vehicle two: heading: there is no topic '/imu'"):
        of(sources, vehicles=[vehicles[0], {**vehicles[1], **TOPICS}])


def own_clock(made: Channel, zero_s: float) -> Channel:
    """Stamps from a zero of its own, `zero_s` after T0; the recorder's times are right."""
    return replace(made, t_ns=made.t_ns - round((T0 + zero_s) * 1e9), clock="own", received_ns=made.t_ns)


def test_clocks_of_channels_of_one_name_are_aligned_each_by_itself() -> None:
    sources = files(a=(own_clock(imu(0.3), 5.0), fixes()), b=(own_clock(imu(-1.2), 700.0), fixes()))
    log = of(sources, vehicles=[{"name": "a"}, {"name": "b"}], sensors=TOPICS)
    found = log.events["heading"]
    for vehicle in (0, 1):
        np.testing.assert_array_equal(found["t_ns"][found["vehicle"] == vehicle], (T * 1e9).astype(np.int64))


def test_ranges_on_a_clock_of_their_own_are_aligned_or_refused() -> None:
    def ranges(clock: float | None) -> list[SourceFile]:
        made = channel("/one/modem/range", "sensor_msgs/msg/Range", T[5:], range=100 + 0 * T[5:])
        own = made if clock is None else own_clock(made, clock)
        return files(
            dive=(imu(0.0, "/one/imu"), fixes("/one/gps"), imu(0.0, "/two/imu"), fixes("/two/gps"), own)
        )

    told = {
        "vehicles": [{"name": "one"}, {"name": "two"}],
        "ranges": [{"topic": "/one/modem/range", "from": "one", "to": "two"}],
    }
    right, aligned = of(ranges(None), **told), of(ranges(300.0), **told)
    np.testing.assert_array_equal(aligned.opportunities["toa_ns"], right.opportunities["toa_ns"])
    with pytest.raises(LogError, match=r"/one/modem/range of dive.mcap counts time from a zero of its own"):
        of(ranges(300.0), **told, align_clocks=False)


def of_table(made: Channel, **sensors: Any) -> MissionLog:
    return of([SourceFile("v.csv", "table", (made,))], vehicles=[{"name": "v", **sensors}])


@pytest.mark.parametrize(
    ("labels", "sigma_rad"),
    [
        ({"heading_deg": 80 + T, "err_deg": 0.5}, np.deg2rad(0.5)),
        ({"heading_deg": 80 + T, "err_rad": 0.5}, 0.5),
        ({"heading_rad": 1 + 0.01 * T, "err": 0.02}, 0.02),
        ({"heading": 80 + T, "err": 0.5}, np.deg2rad(0.5)),
    ],
)
def test_a_stated_sigma_of_a_heading_is_in_its_own_unit(labels: dict[str, Array], sigma_rad: float) -> None:
    heading, sigma = labels
    told = {"columns": {"heading": heading, "sigma": sigma}}
    log = of_table(table(lat=LAT0, lon=LON0 + 1e-5 * T, **labels), heading=told)
    np.testing.assert_allclose(log.events["heading"]["sigma_rad"], sigma_rad)


def test_a_stated_sigma_of_a_depth_in_feet_is_in_feet() -> None:
    made = table(lat=LAT0, lon=LON0 + 1e-5 * T, depth_ft=30 + 0 * T, err=2.0)
    log = of_table(made, depth={"columns": {"depth": "depth_ft", "sigma": "err"}})
    np.testing.assert_allclose(log.events["depth"]["sigma_m"], 2 * 0.3048)


@pytest.mark.parametrize("deep_kpa", [30.0, 200.0, 900.0])
def test_a_gauge_is_told_by_its_readings_at_the_surface_however_deep_the_dive(deep_kpa: float) -> None:
    gauge = np.where(T < 4, 0.5, deep_kpa)
    log = of_table(table(lat=LAT0, lon=LON0 + 1e-5 * T, pressure_kpa=gauge))
    assert log.events["depth"]["depth_m"][0] == pytest.approx(0.05, abs=0.01)
    assert log.events["depth"]["depth_m"][-1] == pytest.approx(deep_kpa / 10.07, rel=0.01)
    absolute = of_table(table(lat=LAT0, lon=LON0 + 1e-5 * T, pressure_kpa=gauge + 101.325))
    np.testing.assert_allclose(absolute.events["depth"]["depth_m"], log.events["depth"]["depth_m"], atol=1e-6)


def test_a_fast_turn_in_a_type_that_states_its_unit_is_no_question() -> None:
    made = imu(0.0)
    rate = np.where(T == 7, 4.0, 0.1)
    fast = replace(made, columns={**made.columns, "angular_velocity.z": rate})
    log = of(files(a=(fast, fixes())), vehicles=[{"name": "a"}])
    np.testing.assert_allclose(log.events["turn_rate"]["yaw_rate_radps"], rate)


def test_odometry_ahead_of_the_point_and_turned_is_that_of_the_point() -> None:
    """The vehicle turns on the spot: its point does not move, its sensor goes round on a circle."""
    yaw = 0.1 * T
    seen = yaw + np.deg2rad(90)
    turned = {f"pose__pose__{k.replace('.', '__')}": v for k, v in yaw_quaternion(seen).items()}
    made = channel(
        "/odom", "nav_msgs/msg/Odometry", T,
        pose__pose__position__x=2 * np.cos(yaw) - np.sin(yaw), pose__pose__position__y=2 * np.sin(yaw) + np.cos(yaw),
        **turned,
    )  # fmt: skip
    told = {"lever_arm_m": [2.0, 1.0, 0.0], "mounting_deg": [0.0, 0.0, 90.0]}
    log = of(files(a=(made, imu(0.0), fixes())), vehicles=[{"name": "a", "odometry": told}])
    for axis in ("forward_m", "left_m"):
        np.testing.assert_allclose(log.events["odometry"][axis], 0.0, atol=1e-9)
    np.testing.assert_allclose(log.events["odometry"]["yaw_change_rad"], 0.1)


def test_within_a_long_gap_of_its_only_source_the_truth_is_unknown() -> None:
    seen = np.concatenate([T[:15], T[15:] + 100])
    truth = channel(
        "/truth", "sensor_msgs/msg/NavSatFix", seen, latitude=LAT0 + 1e-5 * seen, longitude=LON0 + 0 * seen
    )
    every = np.arange(140.0)
    gps = channel(
        "/gps", "sensor_msgs/msg/NavSatFix", every, latitude=LAT0 + 0 * every, longitude=LON0 + 0 * every
    )
    told = {"fix": {"topic": "/gps"}, "truth": {"topic": "/truth"}}
    log = of(files(a=(gps, truth)), vehicles=[{"name": "a", **told}])
    assert log.truth is not None
    position = log.truth.position_m.sel(vehicle="a")
    assert np.isnan(position.interp(time=[20.0, 60.0, 110.0])).all()
    assert np.isfinite(position.interp(time=[10.5, 120.5])).all()


@pytest.mark.parametrize(
    ("role", "told"),
    [
        ("heading", {"lever_arm_m": [1.0, 0.0, 0.0]}),
        ("fix", {"mounting_deg": [0.0, 0.0, 10.0]}),
        ("turn_rate", {"mounting_deg": [0.0, 0.0, 10.0]}),
    ],
)
def test_a_lever_arm_or_mounting_without_effect_is_refused(role: str, told: dict[str, Any]) -> None:
    made = imu(0.0)
    with_rate = replace(made, columns={**made.columns, "angular_velocity.z": 0 * T})
    with pytest.raises(LogError, match=f"vehicle a: {role}: {next(iter(told))} has no effect"):
        of(files(a=(with_rate, fixes())), vehicles=[{"name": "a", role: told}])


@pytest.mark.parametrize(
    ("flag", "valid", "invalid"),
    [("pos", (0x04, 0x07, 0xFFFF), (0x00, 0x01, 0x03, 0xFFFB)), ("xy", (3, 7), (0, 1, 2, 4))],
)
def test_imc_states_validity_of_a_position_and_of_each_axis_by_bits(
    flag: str, valid: tuple[int, ...], invalid: tuple[int, ...]
) -> None:
    """IMC 5.4: of GpsFix 0x01 is a valid date, 0x02 a valid time, 0x04 a valid position."""
    from uwcoop.importers.readers.imc import _has_flag

    assert all(_has_flag(bits, flag) for bits in valid)
    assert not any(_has_flag(bits, flag) for bits in invalid)
