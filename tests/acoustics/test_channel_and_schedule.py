"""Acoustics: schedules and their arithmetic, travel times, clocks, half duplex, collisions, losses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uwcoop import acoustics
from uwcoop.errors import ScheduleError
from uwcoop.scenario.acoustics import Acoustics
from uwcoop.world.vehicles import Motion


def table(**keys: Any) -> Acoustics:
    base = {"modem": "unlimited", "slot_s": 5.0, "max_range_m": 1500.0, "range_sigma_m": 0.0}
    return Acoustics.model_validate(base | keys)


def moving(
    start: tuple[float, float], velocity: tuple[float, float], depth: float = 0.0, steps: int = 300
) -> Motion:
    t = np.arange(steps + 1.0)
    zero = np.zeros(steps + 1)
    position = np.array(start) + t[:, None] * np.array(velocity)
    return Motion(position, zero + depth, zero, np.zeros_like(position), zero, np.zeros_like(position))


def heard(settings: Acoustics, motion: list[Motion], seed: int = 0) -> dict[str, Any]:
    names = [f"V{k + 1}" for k in range(len(motion))]
    slots = acoustics.schedule(settings, names, motion[0].end_s)
    return acoustics.opportunities(settings, slots, motion, seed)


@pytest.mark.parametrize(
    ("modem", "frame_bytes", "max_frames", "frame_s"),
    [
        ("micromodem-32", 32, 1, 3.2),
        ("micromodem-64", 64, 3, 2.048),
        ("micromodem-256", 256, 2, 256 * 8 / 1200),
        ("aloc", 8, 16, 0.64),
        ("unlimited", 2**31 - 1, 1, 0.0),
    ],
)
def test_modem_profiles(modem: str, frame_bytes: int, max_frames: int, frame_s: float) -> None:
    link = acoustics.link_of(table(modem=modem, sound_speed_mps=1480.0))
    assert (link.frame_bytes, link.max_frames, link.sound_speed_mps) == (frame_bytes, max_frames, 1480.0)
    assert link.frame_s == pytest.approx(frame_s)


def test_four_aloc_signals_take_the_papers_2_56_seconds() -> None:
    link = acoustics.link_of(table(modem="aloc"))
    assert acoustics.frames_of(link, 32) == 4
    assert acoustics.air_time_s(link, 4) == pytest.approx(2.56)


@pytest.mark.parametrize(("size", "frames"), [(0, 1), (1, 1), (64, 1), (65, 2), (192, 3)])
def test_frames_of_a_packet(size: int, frames: int) -> None:
    assert acoustics.frames_of(acoustics.link_of(table(modem="micromodem-64")), size) == frames


def test_round_robin_uses_whole_slots_only() -> None:
    slots = acoustics.schedule(table(slot_s=3.0), ["a", "b", "c"], 20.0)
    assert slots["tol_ns"].tolist() == [k * 3_000_000_000 for k in range(6)]
    assert slots["sender"].tolist() == [0, 1, 2, 0, 1, 2]
    assert all(slots[name].dtype == np.int64 for name in slots)


def test_an_order_of_ones_own_and_a_first_slot() -> None:
    settings = table(slot_s=2.5, first_slot_s=1.0, order=["b", "a", "b"])
    slots = acoustics.schedule(settings, ["a", "b", "silent"], 12.0)
    assert slots["tol_ns"].tolist() == [1_000_000_000, 3_500_000_000, 6_000_000_000, 8_500_000_000]
    assert slots["sender"].tolist() == [1, 0, 1, 1]


@pytest.mark.parametrize(
    ("slot_s", "capacity"), [(3.0, 64), (5.38, 64), (5.40, 128), (7.45, 192), (60.0, 192)]
)
def test_capacity_is_whole_frames_before_the_guard(slot_s: float, capacity: int) -> None:
    # preamble 0.3 s + guard 1.0 s (1500 m at 1500 m/s) + 2.048 s a frame; 3 s need a shorter guard
    max_range_m = 950.0 if slot_s == 3.0 else 1500.0
    settings = table(modem="micromodem-64", slot_s=slot_s, max_range_m=max_range_m)
    assert set(acoustics.schedule(settings, ["a", "b"], 600.0)["capacity_bytes"]) == {capacity}


def test_the_unlimited_modem_has_no_limit() -> None:
    assert acoustics.schedule(table(), ["a"], 10.0)["capacity_bytes"].min() >= 2**30


def test_a_slot_shorter_than_a_frame_is_refused_with_the_arithmetic() -> None:
    settings = table(modem="micromodem-32", slot_s=3.0, max_range_m=1200.0)
    with pytest.raises(ScheduleError) as caught:
        acoustics.schedule(settings, ["a"], 60.0)
    assert str(caught.value) == (
        "slot of 3.00 s is shorter than 1 frame x 3.20 s (micromodem-32) + preamble 0.30 s "
        "+ guard 0.80 s (1200 m / 1500 m/s) = 4.30 s"
    )


def test_a_slot_that_fits_exactly_is_accepted() -> None:
    settings = table(modem="micromodem-32", slot_s=4.3, max_range_m=1200.0)
    assert acoustics.slot_frames(settings) == 1
    with pytest.raises(ScheduleError):
        acoustics.slot_frames(table(modem="micromodem-32", slot_s=4.299, max_range_m=1200.0))


def test_even_the_unlimited_modem_needs_its_guard() -> None:
    with pytest.raises(ScheduleError, match=r"slot of 0\.50 s is shorter than .* guard 1\.00 s .* = 1\.00 s"):
        acoustics.schedule(table(slot_s=0.5), ["a"], 60.0)


def test_a_guard_of_ones_own_is_shown_without_a_range() -> None:
    with pytest.raises(ScheduleError, match=r"\+ guard 0\.60 s = 4\.10 s$"):
        acoustics.slot_frames(table(modem="micromodem-32", slot_s=4.0, guard_s=0.6))


def test_a_packet_longer_than_its_slot_is_refused_with_the_arithmetic() -> None:
    settings = table(modem="micromodem-64", slot_s=3.0, max_range_m=900.0)
    acoustics.check_packet(settings, 64)
    with pytest.raises(ScheduleError) as caught:
        acoustics.check_packet(settings, 65, "packet of mpf")
    assert str(caught.value) == (
        "packet of mpf of 65 bytes: slot of 3.00 s is shorter than 2 frames x 2.05 s (micromodem-64) "
        "+ preamble 0.30 s + guard 0.60 s (900 m / 1500 m/s) = 5.00 s"
    )
    with pytest.raises(ScheduleError, match="needs 4 frames of 64 bytes: micromodem-64 sends at most 3"):
        acoustics.check_packet(settings, 193)
    with pytest.raises(ScheduleError, match=r"packet of 65 bytes: slot of 3\.00 s"):
        acoustics.schedule(settings.model_copy(update={"packet_bytes": 65}), ["a"], 60.0)


def test_travel_time_is_the_slant_range_from_launch_to_arrival() -> None:
    motion = [
        moving((0, 0), (1.5, 0.0), depth=2.0),
        moving((400, 300), (-1.0, 1.1), depth=30.0),
        moving((-200, 900), (0.0, -1.5), depth=5.0),
    ]
    table_ = heard(table(sound_speed_mps=1480.0), motion)
    assert len(table_["tol_ns"]) > 100
    for tol, toa, s, r in zip(*(table_[k] for k in ("tol_ns", "toa_ns", "sender", "receiver")), strict=True):
        at_launch, at_arrival = np.array([tol / 1e9]), np.array([toa / 1e9])
        apart = motion[s].position_at(at_launch) - motion[r].position_at(at_arrival)
        down = motion[s].depth_at(at_launch) - motion[r].depth_at(at_arrival)
        slant = np.sqrt((apart**2).sum() + down[0] ** 2)
        assert abs(1480.0 * (toa - tol) / 1e9 - slant) < 1480.0 * 1e-6


def test_the_receivers_motion_during_travel_counts() -> None:
    # Closing at 10 m/s over 1500 m: it arrives where the receiver is 1500 / 1510 s later.
    motion = [moving((0, 0), (0, 0), steps=40), moving((1500, 0), (-10, 0), steps=40)]
    first = heard(table(), motion)
    assert first["toa_ns"][0] == pytest.approx(1500 / 1510 * 1e9, abs=2)


def test_range_noise_has_its_sigma() -> None:
    motion = [moving((0, 0), (0, 0), steps=20000), moving((600, 0), (0, 0), steps=20000)]
    table_ = heard(table(range_sigma_m=2.0), motion)
    error = 1500.0 * (table_["toa_ns"] - table_["tol_ns"]) / 1e9 - 600.0
    assert error.size > 3900
    assert abs(error.mean()) < 5 * 2.0 / np.sqrt(error.size)
    assert error.std() == pytest.approx(2.0, rel=0.05)


def test_a_signal_is_never_stamped_before_its_slot() -> None:
    motion = [moving((0, 0), (0, 0)), moving((0.5, 0), (0, 0))]
    table_ = heard(table(range_sigma_m=5.0), motion)
    assert (table_["toa_ns"] >= table_["tol_ns"]).all()


def test_a_sound_speed_error_scales_the_measured_range() -> None:
    motion = [moving((0, 0), (0, 0)), moving((750, 0), (0, 0))]
    table_ = heard(table(sound_speed_error_mps=15.0), motion)
    measured = 1500.0 * (table_["toa_ns"] - table_["tol_ns"]) / 1e9
    np.testing.assert_allclose(measured, 750.0 * 1500.0 / 1515.0, atol=1e-5)
    speeds = [
        acoustics.true_sound_speed_mps(table(sound_speed_error_sigma_mps=3.0), seed) for seed in range(2000)
    ]
    assert np.std(speeds) == pytest.approx(3.0, rel=0.06)
    assert abs(np.mean(speeds) - 1500) < 0.3


def test_clock_offsets_cancel_between_the_two_directions_and_drift_grows() -> None:
    motion = [moving((0, 0), (0, 0)), moving((900, 0), (0, 0))]
    table_ = heard(table(clock={"offset_sigma_s": 0.01}), motion, seed=3)
    error = 1500.0 * (table_["toa_ns"] - table_["tol_ns"]) / 1e9 - 900.0
    forth, back = error[table_["sender"] == 0], error[table_["sender"] == 1]
    assert abs(forth[0]) > 0.1
    np.testing.assert_allclose(forth[: len(back)], -back[: len(forth)], atol=1e-5)
    table_ = heard(table(clock={"drift_sigma_ppm": 20.0}), motion, seed=3)
    error = 1500.0 * (table_["toa_ns"] - table_["tol_ns"]) / 1e9 - 900.0
    rate = error / (1500.0 * table_["tol_ns"].clip(1) / 1e9)  # receiver's drift minus the sender's
    forth, back = rate[table_["sender"] == 0][5:], rate[table_["sender"] == 1][5:]
    assert 1e-6 < abs(forth[-1]) < 1e-4
    np.testing.assert_allclose(forth, forth[-1], rtol=0.05)
    np.testing.assert_allclose(back, -forth[-1], rtol=0.05)


def test_within_the_guard_nothing_collides_and_beyond_it_half_duplex_bites() -> None:
    near = [moving((0, 0), (0, 0)), moving((900, 0), (0, 0))]
    settings = table(modem="micromodem-64", slot_s=3.0, max_range_m=950.0)
    assert (heard(settings, near)["survive_probability"] == 1).all()
    # 1100 m: 0.733 s of travel + 2.348 s of signal run into the receiver's own slot at 3 s.
    far = [moving((0, 0), (0, 0)), moving((1100, 0), (0, 0))]
    table_ = heard(settings, far)
    assert table_["survive_probability"].size > 90
    last = table_["tol_ns"] == table_["tol_ns"].max()
    assert (table_["survive_probability"][~last] == 0).all()


def test_signals_that_overlap_at_a_receiver_are_both_lost() -> None:
    # The third vehicle hears the far first one until 3.1 s, the near second one from 3.01 s on.
    motion = [moving((0, 0), (0, 0)), moving((1130, 15), (0, 0)), moving((1130, 0), (0, 0))]
    settings = table(modem="micromodem-64", slot_s=3.0, max_range_m=950.0, order=["V1", "V2"])
    table_ = heard(settings, motion)
    at_third = table_["receiver"] == 2
    assert (table_["survive_probability"][at_third][:-1] == 0).all()
    # With slots long enough for this distance everything arrives.
    spread = table(modem="micromodem-64", slot_s=6.0, max_range_m=950.0, order=["V1", "V2"])
    assert (heard(spread, motion)["survive_probability"] == 1).all()


def test_loss_probability_is_met_over_many_frames() -> None:
    motion = [moving((0, 0), (0, 0), steps=60000), moving((600, 0), (0, 0), steps=60000)]
    settings = table(modem="micromodem-64", slot_s=7.5, loss={"probability": 0.3})
    table_ = heard(settings, motion)
    assert table_["draws"].shape == (len(table_["tol_ns"]), 3)
    np.testing.assert_allclose(table_["survive_probability"], 0.7)
    arrives = table_["draws"] < table_["survive_probability"][:, None]
    n = arrives.size
    assert abs(arrives.mean() - 0.7) < 5 * np.sqrt(0.21 / n)
    # frames independent of each other
    assert abs(arrives.all(axis=1).mean() - 0.7**3) < 5 * np.sqrt(0.343 * 0.657 / len(arrives))


@pytest.mark.parametrize(
    ("loss", "survives"),
    [({}, None), ({"model": "none"}, 1.0), ({"model": "independent", "probability": 1.0}, 0.0)],
)
def test_loss_models(loss: dict[str, Any], survives: float | None) -> None:
    if survives is None:
        with pytest.raises(ValueError, match="probability"):
            table(loss=loss)
        return
    motion = [moving((0, 0), (0, 0)), moving((600, 0), (0, 0))]
    assert set(heard(table(loss=loss), motion)["survive_probability"]) == {survives}


def test_draws_of_a_pair_do_not_depend_on_the_loss_model_the_modem_or_a_third_vehicle() -> None:
    two = [moving((0, 0), (1, 0)), moving((500, 0), (0, 1))]
    three = [*two, moving((0, 300), (1, 1))]
    alone = heard(table(slot_s=6.0, order=["V1", "V2"], range_sigma_m=1.0), two)
    lossy = heard(table(slot_s=6.0, order=["V1", "V2"], range_sigma_m=1.0, loss={"probability": 0.5}), two)
    joined = heard(table(slot_s=6.0, order=["V1", "V2"], range_sigma_m=1.0), three)
    framed = heard(table(modem="micromodem-64", slot_s=6.0, order=["V1", "V2"], range_sigma_m=1.0), two)
    pair = joined["receiver"] < 2
    for name in ("tol_ns", "toa_ns", "draws"):
        np.testing.assert_array_equal(alone[name], lossy[name])
        np.testing.assert_array_equal(alone[name], joined[name][pair])
    np.testing.assert_array_equal(alone["draws"][:, 0], framed["draws"][:, 0])


def test_receivers_of_one_signal_have_noise_and_luck_of_their_own() -> None:
    motion = [
        moving((0, 0), (0, 0), steps=3000),
        moving((600, 0), (0, 0), steps=3000),
        moving((0, 600), (0, 0), steps=3000),
    ]
    table_ = heard(table(range_sigma_m=1.0, order=["V1"]), motion)
    to = [table_["receiver"] == receiver for receiver in (1, 2)]
    noise = [(table_["toa_ns"] - table_["tol_ns"])[here] for here in to]
    draws = [table_["draws"][here, 0] for here in to]
    assert len(noise[0]) == 600
    assert abs(np.corrcoef(noise)[0, 1]) < 4 / np.sqrt(600)
    assert abs(np.corrcoef(draws)[0, 1]) < 4 / np.sqrt(600)


def test_arrivals_after_the_end_of_the_mission_are_left_out() -> None:
    motion = [moving((0, 0), (0, 0), steps=30), moving((12000, 0), (0, 0), steps=30)]  # 8 s away
    table_ = heard(table(), motion)
    assert table_["tol_ns"].tolist() == [k * 5_000_000_000 for k in range(5)]  # not the slot at 25 s


def test_opportunities_are_sorted_and_end_with_the_mission() -> None:
    motion = [moving((100 * k, 0), (0, 0), steps=59) for k in range(4)]
    table_ = heard(table(modem="aloc", slot_s=4.0, max_range_m=600.0), motion)
    key = list(zip(table_["tol_ns"], table_["receiver"], strict=True))
    assert key == sorted(key)
    air = acoustics.air_time_s(acoustics.link_of(table(modem="aloc")), 5)
    assert (table_["toa_ns"] / 1e9 + air <= 59).all()
    assert set(table_["sender"]) == {0, 1, 2, 3}
    assert (table_["sender"] != table_["receiver"]).all()


def test_one_vehicle_has_nobody_to_hear() -> None:
    table_ = heard(table(), [moving((0, 0), (0, 0))])
    assert all(len(column) == 0 for column in table_.values())
    assert table_["draws"].shape == (0, 1)
