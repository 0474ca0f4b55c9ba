"""Missions with a landmark: roles, landings, exchanges, positioning and sensors, against the truth that made them."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.errors import ScenarioError, ScheduleError
from uwcoop.frames import wrap_angle
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.missionlog.model import Columns, MissionLog
from uwcoop.missionlog.validate import validate
from uwcoop.world.simulate import simulate

SHORT = [
    "seafloor-survey",
    "seafloor-survey-bias",
    "seafloor-survey-outliers",
    "seafloor-survey-kidnap",
    "seafloor-survey-team",
]
EXCHANGES = dict.fromkeys(SHORT, 3) | {"seafloor-survey-team": 5, "seafloor-survey-1km": 66}
SEEDS = range(50)


@lru_cache(maxsize=400)
def flown(name: str, seed: int = 0, *overrides: str) -> MissionLog:
    return simulate(scenario.load(name, overrides), seed)


def truth(log: MissionLog, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    assert log.truth is not None
    return np.asarray(log.truth[name].to_numpy())


def at(log: MissionLog, vehicle: int, t_ns: Any) -> Any:
    """True position (K, 2) and yaw (K,) by interpolation over the truth, which is exact within a step."""
    assert log.truth is not None
    known = log.truth["time"].to_numpy()
    t = np.asarray(t_ns) / 1e9
    position = np.column_stack([np.interp(t, known, axis) for axis in truth(log, "position_m")[vehicle].T])
    return position, np.interp(t, known, np.unwrap(truth(log, "yaw_rad")[vehicle]))


def roles(log: MissionLog) -> list[tuple[float, int]]:
    """Since when who is the landmark."""
    table = log.events["role_taken"]
    mine = table["landmark"]
    return list(zip((table["t_ns"][mine] / 1e9).tolist(), table["vehicle"][mine].tolist(), strict=True))


def grounded(log: MissionLog, vehicle: int) -> list[tuple[float, float]]:
    """From when to when a vehicle stands on the seabed."""
    down, up = (
        log.events[kind]["t_ns"][log.events[kind]["vehicle"] == vehicle] / 1e9
        for kind in ("landed", "lifted_off")
    )
    ends = [*up.tolist(), log.duration_ns / 1e9]
    return list(zip(down.tolist(), ends[: len(down)], strict=True))


@pytest.mark.parametrize("name", [*SHORT, "seafloor-survey-1km"])
def test_every_mission_is_valid_and_has_its_exchanges(name: str) -> None:
    log = flown(name)
    validate(log)
    since = roles(log)
    assert len(since) == 1 + EXCHANGES[name]
    assert [v for _, v in since] == [k % 2 for k in range(len(since))]
    assert {"fix", "heading", "depth", "ground_velocity", "turn_rate", "acoustic_fix"} < set(log.events)
    assert "motion" not in log.events  # no compass to command by


def test_the_log_comes_back_from_its_file_bit_for_bit(tmp_path: Path) -> None:
    for name in ("seafloor-survey", "seafloor-survey-team"):
        log = flown(name)
        write_log(log, tmp_path / "mission.mcap")
        assert log.difference(load_log(tmp_path / "mission.mcap")) is None


def test_the_same_seed_gives_the_same_bits_and_another_one_another_mission() -> None:
    s = scenario.load("seafloor-survey-team")
    assert simulate(s, 4).difference(simulate(s, 4)) is None
    assert simulate(s, 4).difference(simulate(s, 5)) is not None


def test_the_first_landmark_is_the_frame_and_the_others_start_from_their_prior() -> None:
    errors = []
    for seed in SEEDS:
        log = flown("seafloor-survey", seed)
        fix, heading = log.events["fix"], log.events["heading"]
        assert fix["t_ns"].tolist() == heading["t_ns"].tolist() == [0, 0]
        assert (fix["e_m"][0], fix["n_m"][0], heading["yaw_rad"][0]) == (0.0, 0.0, 0.0)
        assert 0 < fix["cov_ee_m2"][0] < 1e-5
        assert fix["cov_ee_m2"][1] == 1.0
        assert np.degrees(heading["sigma_rad"][1]) == pytest.approx(5)
        position, yaw = at(log, 1, [0])
        errors.append([*(fix["e_m"][1:] - position[:, 0]), *(fix["n_m"][1:] - position[:, 1]),
                       *(np.degrees(heading["yaw_rad"][1:] - yaw) / 5)])  # fmt: skip
    # 150 standard normals: their mean square has a sigma of 0.115.
    assert np.mean(np.square(errors)) == pytest.approx(1, abs=0.4)


@pytest.mark.parametrize("name", SHORT)
def test_a_vehicle_on_the_seabed_stands_still_and_the_landmark_is_on_it(name: str) -> None:
    log = flown(name)
    assert log.truth is not None
    t = log.truth["time"].to_numpy()
    for vehicle in (0, 1):
        for down, up in grounded(log, vehicle):
            stands = (t >= down) & (t <= up)
            assert np.ptp(truth(log, "position_m")[vehicle][stands], axis=0).max() < 1e-9
            assert np.ptp(truth(log, "yaw_rad")[vehicle][stands]) < 1e-9
            assert np.abs(truth(log, "depth_m")[vehicle][stands] - 30).max() < 1e-9
    since = [*roles(log), (log.duration_ns / 1e9, -1)]
    for (start, vehicle), (end, _) in pairwise(since):
        assert any(down <= start and up >= end for down, up in grounded(log, vehicle))
    moving = np.diff(truth(log, "position_m")[0], axis=0)
    assert np.hypot(*moving.T).max() * 5 == pytest.approx(0.15, rel=0.02)


def test_an_exchange_comes_after_enough_static_fixes_and_changes_roles_at_the_end_of_its_slot() -> None:
    for seed in SEEDS:
        log = flown("seafloor-survey", seed, "exchange.static_fixes=6")
        fixes, slots = log.events["acoustic_fix"], log.slots
        changes = roles(log)[1:]
        assert changes
        for k, (when, new) in enumerate(changes):
            tries = (slots["sender"] == new) & (slots["tol_ns"] / 1e9 < when)
            tries &= slots["tol_ns"] / 1e9 > (0 if k == 0 else changes[k - 1][0])
            first = slots["tol_ns"][tries][0] / 1e9
            assert slots["tol_ns"][tries][-1] / 1e9 + 12 == when
            down = max(d for d, _ in grounded(log, new) if d < first)
            mine = (
                (fixes["vehicle"] == new)
                & (fixes["transmit_ns"] / 1e9 >= down)
                & (fixes["t_ns"] / 1e9 < first)
            )
            assert (np.isfinite(fixes["range_m"][mine])).sum() >= 6
            old = 1 - new
            lifts = log.events["lifted_off"]
            after = lifts["t_ns"][(lifts["vehicle"] == old) & (lifts["t_ns"] / 1e9 >= when)] / 1e9
            assert after.size == 0 or after[0] == pytest.approx(when + 1)


def decided(log: MissionLog, packet_bytes: int) -> list[tuple[float, int, dict[int, bool]]]:
    """Each try: when, by whom, and who gets a packet of so many bytes."""
    frames, heard = -(-packet_bytes // 8), log.opportunities
    got = (heard["draws"][:, :frames] < heard["survive_probability"][:, None]).all(axis=1)
    tries = []
    for tol, sender in zip(log.slots["tol_ns"], log.slots["sender"], strict=True):
        mine = heard["tol_ns"] == tol
        tries.append(
            (
                tol / 1e9,
                int(sender),
                dict(zip(heard["receiver"][mine].tolist(), got[mine].tolist(), strict=True)),
            )
        )
    return tries


def test_roles_change_just_when_the_old_landmark_has_the_packet() -> None:
    kept = 0
    for seed in SEEDS:
        log = flown("seafloor-survey", seed, "acoustics.loss.probability=0.2", "exchange.tries=2")
        landmark = 0
        changes = dict(roles(log)[1:])
        for tol, sender, got in decided(log, 32):
            assert set(got) == {landmark}
            assert sender == 1 - landmark
            assert ((tol + 12) in changes) == got[landmark]
            if got[landmark]:
                assert changes.pop(tol + 12) == sender
                landmark = sender
            else:
                kept += 1
        assert not changes
    assert kept > 50


def test_signals_are_lost_as_often_as_the_scenario_says() -> None:
    logs = [flown("seafloor-survey", s, "acoustics.loss.probability=0.2", "exchange.tries=2") for s in SEEDS]
    draws = np.concatenate([log.opportunities["draws"].ravel() for log in logs])
    chance = np.concatenate([log.opportunities["survive_probability"] for log in logs])
    np.testing.assert_allclose(chance, 0.8)
    assert (draws < 0.8).mean() == pytest.approx(0.8, abs=4 * np.sqrt(0.16 / draws.size))
    first = [decided(log, 32)[0][2][0] for log in logs]
    assert np.mean(first) == pytest.approx(0.8**4, abs=0.25)


def test_a_packet_too_long_for_the_slot_is_refused() -> None:
    with pytest.raises(ScheduleError, match="exchange packet of 128 bytes"):
        flown("seafloor-survey", 0, "exchange.packet_bytes=128", "acoustics.slot_s=10")


def test_with_a_channel_that_loses_all_roles_stay_and_positioning_goes_on() -> None:
    log = flown("seafloor-survey", 0, "acoustics.loss.probability=1.0")
    assert roles(log) == [(0.0, 0)]
    assert len(log.slots["tol_ns"]) > 6
    assert log.events["acoustic_fix"]["t_ns"][-1] / 1e9 > 1000
    gaps = np.diff(log.slots["tol_ns"]) / 1e9
    assert set(gaps[gaps < 20].tolist()) == {12.0}
    assert (gaps > 100).sum() >= 2  # another twelve fixes before the next series


def depth_at(log: MissionLog, vehicle: int, t_ns: np.ndarray) -> np.ndarray:
    """True depth, m, between the truth's instants."""
    assert log.truth is not None
    known_s = log.truth["time"].to_numpy()
    return np.interp(t_ns / 1e9, known_s, log.truth["depth_m"].to_numpy()[vehicle])


def test_the_reply_tells_the_peers_depth() -> None:
    fixes = flown("seafloor-survey-team").events["acoustic_fix"]
    log = flown("seafloor-survey-team")
    told = np.array(
        [depth_at(log, p, np.array([t]))[0] for p, t in zip(fixes["peer"], fixes["t_ns"], strict=True)]
    )
    assert np.abs(fixes["peer_depth_m"] - told).max() < 0.1
    subs = np.array(
        [depth_at(log, v, np.array([t]))[0] for v, t in zip(fixes["vehicle"], fixes["t_ns"], strict=True)]
    )
    assert np.abs(told - subs).max() > 1.0  # some are at another depth than the landmark


def residuals(log: MissionLog) -> Columns:
    """Fixes against the truth, in sigmas: range, own bearing, peer's bearing."""
    fixes = log.events["acoustic_fix"]
    out = {name: np.full(len(fixes["t_ns"]), np.nan) for name in ("range", "own", "peer")}
    for mover, landmark in set(zip(fixes["vehicle"].tolist(), fixes["peer"].tolist(), strict=True)):
        k = (fixes["vehicle"] == mover) & (fixes["peer"] == landmark)
        asked, _ = at(log, mover, fixes["transmit_ns"][k])
        received, yaw = at(log, mover, fixes["t_ns"][k])
        stands, heard = at(log, landmark, fixes["t_ns"][k])
        back, away = stands - received, asked - stands
        below = depth_at(log, landmark, fixes["t_ns"][k]) - depth_at(log, mover, fixes["t_ns"][k])
        way = (np.hypot(np.hypot(*back.T), below) + np.hypot(np.hypot(*away.T), below)) / 2
        out["range"][k] = (fixes["range_m"][k] - way) / 0.66
        own = np.arctan2(back[:, 1], back[:, 0]) - yaw
        peer = np.arctan2(away[:, 1], away[:, 0]) - heard
        out["own"][k] = np.degrees(wrap_angle(fixes["own_bearing_rad"][k] - own)) / 6
        out["peer"][k] = np.degrees(wrap_angle(fixes["peer_bearing_rad"][k] - peer)) / 1
    return out


@pytest.mark.parametrize("name", ["seafloor-survey", "seafloor-survey-kidnap", "seafloor-survey-team"])
def test_ranges_and_bearings_fit_the_geometry(name: str) -> None:
    values = [residuals(flown(name, seed)) for seed in range(6)]
    for channel in ("range", "own", "peer"):
        r = np.concatenate([v[channel] for v in values])
        r = r[np.isfinite(r)]
        # Six sigma of the moments of so many normals; a wrong sign, delay or frame is tens of sigmas.
        assert abs(r.mean()) < 6 / np.sqrt(r.size), channel
        assert r.std() == pytest.approx(1, abs=6 / np.sqrt(2 * r.size)), channel
        assert np.abs(r).max() < 5.5, channel


def test_a_fix_takes_the_reply_and_the_way_there_and_back() -> None:
    log = flown("seafloor-survey")
    fixes = log.events["acoustic_fix"]
    delay = (fixes["t_ns"] - fixes["transmit_ns"]) / 1e9
    assert delay.min() > 0.84
    assert delay.max() < 0.84 + 2 * 40 / 1500
    assert set(np.mod(fixes["transmit_ns"], 10**10).tolist()) == {0}


def test_dropouts_and_outliers_have_their_shares() -> None:
    replies, asked, missing, wild, count = 0, 0, 0, 0, 0
    for seed in SEEDS:
        log = flown(
            "seafloor-survey-outliers", seed, "mutual.dropout_share=0.1", "mutual.channel_dropout_share=0.05"
        )
        fixes = log.events["acoustic_fix"]
        replies += len(fixes["t_ns"])
        silent = sum(1 for t in np.arange(30, 1070, 10) if any(
            tol - 1.5 <= t < tol + 12 for tol in log.slots["tol_ns"] / 1e9))  # fmt: skip
        asked += len(np.arange(30, 1070, 10)) - silent
        r = residuals(log)
        for channel in r.values():
            missing += int(np.isnan(channel).sum())
            count += channel.size
        wild += int((np.abs(r["peer"]) > 5).sum())
    assert replies / asked == pytest.approx(0.9, abs=0.03)
    assert missing / count == pytest.approx(0.05, abs=0.01)
    # Ten in a hundred, of which one in 36 falls within five degrees of the truth; a twentieth is missing.
    assert wild / (count / 3) == pytest.approx(0.1 * (1 - 10 / 360) * 0.95, abs=0.015)


def dead_reckoned(log: MissionLog, vehicle: int) -> Any:
    """Position and yaw at the end, by sensors alone from the true start, as (5) and (7) sum them up."""
    velocity, rate = log.events["ground_velocity"], log.events["turn_rate"]
    v, w = velocity["vehicle"] == vehicle, rate["vehicle"] == vehicle
    position, yaw = at(log, vehicle, [0])
    turns = np.concatenate([yaw, yaw[0] + np.cumsum(rate["yaw_rate_radps"][w] * 0.2)])
    c, s = np.cos(turns[:-1]), np.sin(turns[:-1])
    forward, left = velocity["forward_mps"][v], velocity["left_mps"][v]
    moved = 0.2 * np.column_stack([c * forward - s * left, s * forward + c * left])
    return position[0] + moved.sum(axis=0), turns[-1]


QUIET = (
    "sensors.ground_velocity.sigma_mps=0.0", "sensors.ground_velocity.sigma_per_root_mps=0.0",
    "sensors.turn_rate.sigma_degps=0.0", "hover.landing_shift_sigma_m=0.0",
)  # fmt: skip


def test_sensors_without_noise_sum_up_to_the_truth() -> None:
    log = flown("seafloor-survey", 3, *QUIET)
    for vehicle in (0, 1):
        position, yaw = dead_reckoned(log, vehicle)
        true_position, true_yaw = at(log, vehicle, [log.duration_ns])
        np.testing.assert_allclose(position, true_position[0], atol=1e-8)
        assert abs(wrap_angle(yaw - true_yaw[0])) < 1e-9


def test_what_turns_a_vehicle_unseen_is_missing_in_its_gyro_and_nowhere_else() -> None:
    log = flown("seafloor-survey-kidnap", 3, *QUIET)
    _, yaw = dead_reckoned(log, 0)
    _, true_yaw = at(log, 0, [log.duration_ns])
    assert np.degrees(wrap_angle(true_yaw[0] - yaw)) == pytest.approx(20)
    _, before_after = at(log, 0, [399_800_000_000, 400_000_000_000])
    assert np.degrees(np.diff(before_after)[0]) == pytest.approx(20)
    assert np.degrees(
        wrap_angle(at(log, 1, [log.duration_ns])[1][0] - dead_reckoned(log, 1)[1])
    ) == pytest.approx(0)


def test_the_dvl_does_not_see_what_touching_down_does_and_the_gyro_does() -> None:
    quiet = [o for o in QUIET if "landing" not in o]
    log = flown(
        "seafloor-survey", 3, *quiet, "hover.landing_shift_sigma_m=0.5", "hover.landing_turn_sigma_deg=5"
    )
    position, yaw = dead_reckoned(log, 1)
    true_position, true_yaw = at(log, 1, [log.duration_ns])
    assert np.hypot(*(position - true_position[0])) > 0.1
    assert abs(wrap_angle(yaw - true_yaw[0])) < 1e-9


def test_dvl_noise_grows_with_speed_as_table_4_says() -> None:
    log = flown("seafloor-survey")
    sigma = log.events["ground_velocity"]["sigma_mps"]
    assert sigma.min() == pytest.approx(0.00084 + 0.038 * np.sqrt(0.05))
    moving = sigma[sigma > 1.01 * sigma.min()]
    assert np.median(moving) == pytest.approx(0.00084 + 0.038 * np.sqrt(0.15), rel=0.05)
    forward = log.events["ground_velocity"]["forward_mps"][log.events["ground_velocity"]["vehicle"] == 0]
    assert forward[:1500].std() == pytest.approx(sigma.min(), rel=0.1)  # the landmark stands


def test_biases_are_drawn_for_each_vehicle_and_mission() -> None:
    biases = []
    for seed in SEEDS:
        log = flown("seafloor-survey-bias", seed)
        rate = log.events["turn_rate"]
        still = [rate["yaw_rate_radps"][(rate["vehicle"] == 0) & (rate["t_ns"] < 300 * 10**9)]]
        biases.append(float(np.degrees(still[0].mean())))
    # 1,500 samples of 0.0745 deg/s leave 0.0019 deg/s.
    assert np.std(biases) == pytest.approx(0.0102, rel=0.35)


def test_landing_by_distance_and_by_the_clock() -> None:
    log = flown("seafloor-survey-1km")
    starts = np.array(
        [truth(log, "position_m")[v][int(d * 5)] for v in (0, 1) for d, _ in grounded(log, v)[:4]]
    )
    np.testing.assert_allclose(np.diff(starts[:4, 0]), 30, atol=0.5)
    np.testing.assert_allclose(np.diff(starts[4:, 0]), [15, 30, 30], atol=0.5)
    log = flown("seafloor-survey", 0, 'exchange.land={at = "times", times_s = [150, 420, 700]}')
    landed = log.events["landed"]["t_ns"] / 1e9
    # Sinking 2 m at 0.15 m/s and touching down for 1 s.
    np.testing.assert_allclose(landed[2:5], np.array([150, 420, 700]) + 14.4, atol=0.01)


def test_a_held_heading_is_held_by_surge_and_sway() -> None:
    log = flown("seafloor-survey", 0, "hover.hold_heading_deg=30.0", "hover.landing_turn_sigma_deg=0.0")
    yaw = truth(log, "yaw_rad")[1]
    np.testing.assert_allclose(yaw, np.radians(60), atol=1e-9)
    assert np.abs(log.events["ground_velocity"]["left_mps"]).max() > 0.1


def test_a_further_sub_changes_no_other_vehicles_noise() -> None:
    team = flown("seafloor-survey-team")
    fewer = scenario.load("seafloor-survey-team")
    resolved = fewer.resolved()
    resolved["vehicles"] = resolved["vehicles"][:4]
    four = simulate(scenario.parse(resolved), 0)
    for kind in ("turn_rate", "ground_velocity"):
        for column in team.events[kind]:
            mine, theirs = (
                log.events[kind][column][log.events[kind]["vehicle"] == 2] for log in (team, four)
            )
            np.testing.assert_array_equal(mine, theirs)


def test_no_event_says_more_than_a_sensor_can() -> None:
    """What events state as sigmas must not let the truth be read off them."""
    log = flown("seafloor-survey")
    table = log.events["ground_velocity"]
    read = np.hypot(table["forward_mps"], table["left_mps"])
    stated = 0.00084 + 0.038 * np.sqrt(np.clip(read, 0.05, 0.5))
    np.testing.assert_allclose(table["sigma_mps"], stated)


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (["exchange.static_fixes=5"], "exchange.static_fixes is 5: must be at least 6"),
        (["exchange.main=[\"TT\", \"TT\"]"], "exchange.main names 'TT' twice"),
        (["exchange.main=[\"TT\", \"TX\"]"], "exchange.main names 'TX': no such vehicle"),
        (["kidnap={time_s = 5, vehicle = \"X\"}"], "kidnap.vehicle names 'X': no such vehicle"),
        (["vehicles.TD.path={kind = \"random-lawnmower\"}"], "needs waypoints or a lawnmower"),
        (["vehicles.TT.path.waypoints_m=[[1, 0], [2, 0]]"], "starts at [1, 0]: the first landmark's pose is the frame"),
        (["mutual.outlier_range_m=[5, 5]"], "must be two lengths above 0 in ascending order"),
        (["exchange.land={at = \"times\", times_s = [5, 4]}"], "times_s must ascend"),
        (["deployment.latitude_deg=35"], "needs both latitude_deg and longitude_deg"),
    ],
)  # fmt: skip
def test_what_cannot_be_flown_is_refused_in_one_line(overrides: list[str], line: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.load("seafloor-survey", overrides)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_tables_of_landmarks_need_an_exchange() -> None:
    with pytest.raises(ScenarioError, match="has a table mutual but no table exchange"):
        scenario.load("st-john", ["mutual.outlier_share=0.1"])
    assert "mutual" not in scenario.load("st-john").resolved()


def test_the_frame_can_be_placed_on_the_globe() -> None:
    pytest.importorskip("pyproj")
    log = flown("seafloor-survey", 0, "deployment.latitude_deg=35.0", "deployment.longitude_deg=139.7")
    assert (log.origin.latitude_deg, log.origin.longitude_deg) == (35.0, 139.7)
