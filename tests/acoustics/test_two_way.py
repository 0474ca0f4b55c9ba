"""Two-way ranging: poll and reply share a slot, and no clock enters the range."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import acoustics, scenario
from uwcoop.acoustics.schedule import RESIDENCE_BYTES, lead_s
from uwcoop.errors import LogError, ScheduleError
from uwcoop.experiment.packet_budget import budget
from uwcoop.missionlog.mcap import write_log
from uwcoop.missionlog.validate import validate
from uwcoop.scenario.acoustics import Acoustics
from uwcoop.world.simulate import simulate
from uwcoop.world.vehicles import Motion

CLOCKS = {"offset_sigma_s": 0.05, "drift_sigma_ppm": 50.0}


def table(**keys: Any) -> Acoustics:
    base = {
        "modem": "micromodem-64", "slot_s": 5.0, "max_range_m": 900.0, "range_sigma_m": 0.0,
        "ranging": "two-way",
    }  # fmt: skip
    return Acoustics.model_validate(base | keys)


def moving(
    start: tuple[float, float], velocity: tuple[float, float] = (0, 0), depth: float = 0.0, steps: int = 600
) -> Motion:
    t, zero = np.arange(steps + 1.0), np.zeros(steps + 1)
    position = np.array(start) + t[:, None] * np.array(velocity)
    return Motion(position, zero + depth, zero, position * 0, zero, position * 0)


def heard(settings: Acoustics, motion: list[Motion], seed: int = 0) -> dict[str, Any]:
    names = [f"V{k + 1}" for k in range(len(motion))]
    slots = acoustics.schedule(settings, names, motion[0].end_s)
    return acoustics.opportunities(settings, slots, motion, seed, names)


def ranges(table_: dict[str, Any]) -> Any:
    return 1500.0 * (table_["toa_ns"] - table_["tol_ns"]) / 1e9


THREE = [moving((0, 0)), moving((600, 0)), moving((0, 500), depth=40.0)]


def test_a_slot_holds_poll_turn_around_and_reply() -> None:
    # poll 0.3 s + 2 bytes at 250 bit/s, guard 0.6 s, turn-around 0.1 s; reply 0.3 s + 2.048 s a frame; guard
    settings = table()
    assert acoustics.poll_air_s(settings) == pytest.approx(0.364)
    assert lead_s(settings) == pytest.approx(0.364 + 0.6 + 0.1)
    assert acoustics.slot_needed_s(settings, 1) == pytest.approx(1.064 + 2.348 + 0.6)
    slots = acoustics.schedule(settings, ["a", "b"], 22.0)
    assert slots["tol_ns"].tolist() == [1_064_000_000 + k * 5_000_000_000 for k in range(4)]
    assert set(slots["capacity_bytes"]) == {64 - RESIDENCE_BYTES}
    wide = {"slot_s": 6.1}
    assert acoustics.slot_capacity_bytes(table(**wide)) == 2 * 64 - RESIDENCE_BYTES
    assert acoustics.slot_capacity_bytes(table(**wide, ranging="one-way")) == 2 * 64
    between = {"slot_s": 5.5}  # two frames need 4.996 s one-way, 6.06 s two-way
    assert acoustics.slot_capacity_bytes(table(**between, ranging="one-way")) == 128
    assert acoustics.slot_capacity_bytes(table(**between)) == 64 - RESIDENCE_BYTES


def test_a_slot_too_short_for_both_is_refused_with_the_arithmetic() -> None:
    acoustics.check_fits(table(slot_s=3.0, ranging="one-way"), 1)
    with pytest.raises(ScheduleError) as caught:
        acoustics.schedule(table(slot_s=3.0), ["a", "b"], 60.0)
    assert str(caught.value) == (
        "slot of 3.00 s is shorter than poll 0.36 s + guard 0.60 s + turn-around 0.10 s + 1 frame x 2.05 s "
        "(micromodem-64) + preamble 0.30 s + guard 0.60 s (900 m / 1500 m/s) = 4.01 s"
    )
    acoustics.check_packet(table(), 61)
    assert [acoustics.packet_frames(table(), size) for size in (61, 62)] == [1, 2]
    with pytest.raises(ScheduleError, match=r"packet of 62 bytes \+ 3 for the poll's time: slot of 5\.00 s"):
        acoustics.check_packet(table(), 62)
    with pytest.raises(ScheduleError, match=r"190 bytes \+ 3 for the poll's time needs 4 frames of 64 bytes"):
        acoustics.check_packet(table(), 190)


def test_polls_of_any_size_and_turn_around_count() -> None:
    longer = table(two_way={"poll_bytes": 12, "turnaround_s": 0.4})
    assert lead_s(longer) - lead_s(table()) == pytest.approx(10 * 8 / 250 + 0.3)
    with pytest.raises(ValueError, match="poll_bytes"):
        table(two_way={"poll_bytes": 0})


def test_teammates_poll_in_turn_and_the_poller_alone_has_the_range() -> None:
    table_ = heard(table(), THREE)
    slots = acoustics.schedule(table(), ["V1", "V2", "V3"], 600.0)
    assert len(table_["tol_ns"]) == len(slots["tol_ns"]) == 120
    assert len(set(table_["tol_ns"])) == 120
    pairs = list(zip(table_["sender"][:6].tolist(), table_["receiver"][:6].tolist(), strict=True))
    assert pairs == [(0, 1), (1, 0), (2, 0), (0, 2), (1, 2), (2, 1)]
    assert (table_["survive_probability"] == 1).all()
    apart = {(0, 1): 600.0, (0, 2): np.hypot(500, 40), (1, 2): np.sqrt(600**2 + 500**2 + 40**2)}
    for s, r, measured in zip(table_["sender"], table_["receiver"], ranges(table_), strict=True):
        assert measured == pytest.approx(apart[min(s, r), max(s, r)], abs=1e-4)


def test_no_clock_enters_the_range() -> None:
    plain, wrong = heard(table(), THREE, seed=3), heard(table(clock=CLOCKS), THREE, seed=3)
    np.testing.assert_allclose(ranges(wrong), ranges(plain), atol=1e-5)
    np.testing.assert_array_equal(wrong["survive_probability"], 1.0)
    one_way = heard(table(ranging="one-way", clock=CLOCKS), THREE, seed=3)
    off = np.abs(ranges(one_way) - ranges(heard(table(ranging="one-way"), THREE, seed=3)))
    assert np.median(off) > 10  # the same clocks are metres wrong one-way
    # Vehicles that move are elsewhere when their clocks are wrong, by metres per second x 50 ms and no more.
    swift = [moving((0, 0), (1.5, 0)), moving((300, 0), (0, 0.5)), moving((0, 500), (-0.3, -0.3))]
    np.testing.assert_allclose(
        ranges(heard(table(clock=CLOCKS), swift, seed=3)), ranges(heard(table(), swift, seed=3)), atol=0.5
    )


def test_the_range_is_the_mean_of_the_way_there_and_the_way_back() -> None:
    motion = [moving((0, 0), (1.5, 0)), moving((700, 0), (-1.0, 0.0))]  # closing at 2.5 m/s
    table_ = heard(table(), motion)
    lead = lead_s(table())
    first = table_["tol_ns"] < 60_000_000_000
    for tol_ns, measured, sender in zip(
        table_["tol_ns"][first], ranges(table_)[first], table_["sender"][first], strict=True
    ):
        tol = tol_ns / 1e9
        speed = 1.0 if sender == 1 else 1.5  # of the replier, towards the poll
        there = (700 - 2.5 * (tol - lead)) / (1500 + speed) * 1500
        back_speed = 2.5 - speed  # of the poller, towards the reply
        back = (700 - 2.5 * tol) / (1500 + back_speed) * 1500
        assert measured == pytest.approx((there + back) / 2, abs=1e-3)


def test_noise_and_outliers_count_once() -> None:
    motion = [moving((0, 0), steps=30_000), moving((600, 0), steps=30_000)]
    error = ranges(heard(table(range_sigma_m=2.0), motion)) - 600.0
    assert error.size == 6000
    assert error.std() == pytest.approx(2.0, rel=0.05)
    late = ranges(heard(table(range_outlier_share=0.2), motion)) - 600.0
    assert (late > 1e-4).mean() == pytest.approx(0.2, abs=0.02)


def test_a_poll_that_is_lost_is_not_answered() -> None:
    deaf = {
        "model": "blackout",
        "windows": [{"from_s": 100, "to_s": 300, "senders": ["V1"], "receivers": ["V2"]}],
    }
    table_ = heard(table(loss=deaf), [moving((0, 0)), moving((600, 0))])
    inside = (table_["tol_ns"] > 102e9) & (table_["tol_ns"] < 300e9)
    # V1's own packets do not reach V2, and V1's polls neither: both directions of the range fail.
    assert (table_["survive_probability"][inside] == 0).all()
    assert (table_["survive_probability"][~inside & (table_["tol_ns"] > 302e9)] == 1).all()


def test_polls_are_lost_as_often_as_frames() -> None:
    motion = [moving((0, 0), steps=60_000), moving((600, 0), steps=60_000)]
    table_ = heard(table(loss={"probability": 0.3}), motion)
    answered = table_["survive_probability"] > 0
    assert answered.mean() == pytest.approx(0.7, abs=0.02)
    np.testing.assert_allclose(table_["survive_probability"][answered], 0.7)
    draws = heard(table(), motion)["draws"]
    np.testing.assert_array_equal(table_["draws"], draws)  # paired with the mission without losses


def test_beyond_the_guard_the_poll_comes_too_late() -> None:
    far = [moving((0, 0)), moving((1000, 0))]
    assert (heard(table(), far)["survive_probability"] == 0).all()
    assert (heard(table(max_range_m=1000.0), far)["survive_probability"] == 1).all()


def test_a_vehicle_alone_has_nobody_to_poll_it() -> None:
    table_ = heard(table(), [moving((0, 0))])
    assert all(len(column) == 0 for column in table_.values())


def test_an_order_of_ones_own_is_polled_by_the_others_in_turn() -> None:
    table_ = heard(table(order=["V2", "V2", "V1"]), THREE)
    pairs = list(zip(table_["sender"][:6].tolist(), table_["receiver"][:6].tolist(), strict=True))
    assert pairs == [(1, 0), (1, 2), (0, 1), (1, 0), (1, 2), (0, 2)]


def test_a_two_way_mission_is_a_valid_log() -> None:
    keys = [
        "acoustics.ranging=two-way",
        "acoustics.slot_s=5",
        "duration_s=120",
        "acoustics.clock.offset_sigma_s=0.1",
    ]
    log = simulate(scenario.load("flat-bay", keys), seed=0)
    validate(log)
    assert len(log.opportunities["tol_ns"]) == len(log.slots["tol_ns"]) == 24
    assert set(log.slots["capacity_bytes"]) == {61}


LOSSY = [
    "acoustics.ranging=two-way",
    "acoustics.slot_s=5",
    "acoustics.max_range_m=900",
    "duration_s=300",
    "acoustics.loss.probability=0.3",
]


def test_one_way_has_no_polls() -> None:
    assert simulate(scenario.load("flat-bay", ["duration_s=60"]), seed=0).polls == {}
    slots = acoustics.schedule(table(), ["a"], 60.0)
    assert acoustics.polls(table(), slots, [moving((0, 0))], 0) == {}


def test_every_slot_is_polled_once_and_the_log_says_who_answered() -> None:
    log = simulate(scenario.load("flat-bay", LOSSY), seed=0)
    validate(log)
    polls = log.polls
    assert polls["tol_ns"].tolist() == log.slots["tol_ns"].tolist()
    assert polls["sender"].tolist() == log.slots["sender"].tolist()
    assert (polls["t_ns"] == polls["tol_ns"] - round(lead_s(table()) * 1e9)).all()
    assert set(polls["poll_bytes"]) == {2}
    assert set(polls["reply_bytes"]) == {RESIDENCE_BYTES}
    assert set(polls["air_time_ns"]) == {364_000_000}
    assert (polls["poller"] != polls["sender"]).all()
    assert 0 < polls["answered"].mean() < 1
    # An opportunity is the poller's, and can survive only where its poll was heard.
    chance = dict(
        zip(log.opportunities["tol_ns"].tolist(), log.opportunities["survive_probability"], strict=True)
    )
    for tol_ns, answered in zip(polls["tol_ns"].tolist(), polls["answered"], strict=True):
        assert (chance[tol_ns] > 0) == answered


def test_polls_come_back_from_a_file(tmp_path: Any) -> None:
    log = simulate(scenario.load("flat-bay", LOSSY), seed=0)
    write_log(log, tmp_path / "m.mcap")
    assert uwcoop.load_log(tmp_path / "m.mcap").difference(log) is None


def test_polls_and_replies_are_counted_in_bytes_and_air_time() -> None:
    log = simulate(scenario.load("flat-bay", LOSSY), seed=0)
    run = uwcoop.run(log, ["mpf", "mpf-terrain-only"], clouds=False)
    slots, answered = len(log.slots["tol_ns"]), int(log.polls["answered"].sum())
    assert answered < slots
    air_s = slots * 0.364 + answered * (0.3 + 2.048)  # one frame each
    sent = run.sent["mpf"]
    assert sent["polls"] == slots
    assert sent["bytes"] == slots * 2 + answered * (15 + RESIDENCE_BYTES)
    assert sent["air_time_s"] == pytest.approx(air_s)
    assert int(run.tracks["packet_bytes"].sel(navigator="mpf").sum()) == sent["bytes"]
    assert run.sent["mpf-terrain-only"] == {"bytes": 0, "air_time_s": 0.0, "polls": 0}
    assert run.summary["navigators"]["mpf"]["sent"] == sent
    assert run.summary["navigators"]["mpf"]["packet_bytes"] == {"mean": 18.0, "max": 18}


def test_the_budget_states_poll_and_reply() -> None:
    cost = budget(scenario.load("flat-bay", LOSSY), ["mpf"])
    assert (cost.poll_bytes, cost.reply_bytes) == (2, RESIDENCE_BYTES)
    one = cost.costs["mpf"]
    assert one is not None
    assert one.air_time_s == pytest.approx(0.364 + 0.3 + 2.048)
    assert one.slot_needed_s == pytest.approx(lead_s(table()) + 0.3 + 2.048 + cost.guard_s, abs=0.2)
    plain = budget(scenario.load("flat-bay"), ["mpf"])
    assert (plain.poll_bytes, plain.poll_air_s, plain.reply_bytes) == (0, 0.0, 0)


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        ("poller", 9, "poller 9 at t"),
        ("tol_ns", 0, "tol_ns 0 s"),
        ("poll_bytes", -1, "poll_bytes -1"),
        ("air_time_ns", -1, "air_time_ns"),
    ],
)
def test_damaged_polls_are_refused(column: str, value: int, says: str) -> None:
    log = simulate(scenario.load("flat-bay", LOSSY), seed=0)
    log.polls = {name: values.copy() for name, values in log.polls.items()}
    log.polls[column][3] = value
    with pytest.raises(LogError, match=says):
        validate(log)
