"""Losses: each model loses what it says, where and when it says so, and changes no other draw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from uwcoop import acoustics, scenario
from uwcoop.acoustics.losses import burst_states, off_bow_rad
from uwcoop.errors import ScenarioError
from uwcoop.scenario.acoustics import Acoustics
from uwcoop.scenario.losses import BurstLoss
from uwcoop.world.vehicles import Motion

MANY = 100_000
BASE: dict[str, Any] = {
    "name": "bay",
    "duration_s": 60,
    "chart": {"source": "synthetic:st-john"},
    "vehicles": [{"name": "ship"}, {"name": "auv"}],
    "acoustics": {"modem": "unlimited", "slot_s": 5.0, "max_range_m": 1000.0},
}


def table(**keys: Any) -> Acoustics:
    base = {"modem": "unlimited", "slot_s": 1.0, "max_range_m": 900.0, "range_sigma_m": 0.0}
    return Acoustics.model_validate(base | keys)


def still(point: tuple[float, float], steps: int, yaw: Any = 0.0, depth: float = 0.0) -> Motion:
    zero = np.zeros(steps + 1)
    position = np.tile(np.array(point, dtype=float), (steps + 1, 1))
    return Motion(position, zero + depth, zero + yaw, position * 0, zero, position * 0)


def heard(
    settings: Acoustics, motion: list[Motion], seed: int = 0, names: tuple[str, ...] = ("V1", "V2", "V3")
) -> dict[str, Any]:
    names = names[: len(motion)]
    slots = acoustics.schedule(settings, names, motion[0].end_s)
    return acoustics.opportunities(settings, slots, motion, seed, names)


def lost(table_: dict[str, Any], where: Any = slice(None)) -> float:
    """Share of first frames that are lost."""
    return float(1 - (table_["draws"][where, 0] < table_["survive_probability"][where]).mean())


# --- aspect ---


@pytest.mark.parametrize("end", ["sender", "receiver"])
def test_a_shadow_loses_its_share_in_its_sector_and_nothing_beside_it(end: str) -> None:
    turning = 2 * math.pi * 0.6180339887 * np.arange(MANY + 2)  # every bearing alike
    yaw = (turning, 0.0) if end == "sender" else (0.0, turning)
    motion = [still((0, 0), MANY + 1, yaw[0]), still((0, 300), MANY + 1, yaw[1])]
    sector = {"bearing_deg": 180, "width_deg": 90, "loss": 0.9, "end": end}
    table_ = heard(table(order=["V1"], loss={"model": "aspect", "sectors": [sector]}), motion)
    second = (table_["tol_ns"] if end == "sender" else table_["toa_ns"]) // 1_000_000_000
    other = 0.0 if end == "sender" else 180.0  # the receiver is north of the sender
    heading = 90 - np.rad2deg(turning[second])
    astern = np.abs((other - heading) % 360 - 180) <= 45
    assert len(astern) >= MANY
    assert lost(table_, astern) == pytest.approx(0.9, rel=0.02)
    assert lost(table_, ~astern) == 0
    assert lost(table_) == pytest.approx(0.25 * 0.9, rel=0.02)


def test_shadows_at_both_ends_multiply_and_may_belong_to_one_vehicle() -> None:
    motion = [still((0, 0), 40, math.pi / 2), still((0, -300), 40, -math.pi / 2)]  # stern to stern
    astern = {"width_deg": 60, "loss": 0.5}
    both = heard(table(loss={"model": "aspect", "sectors": [astern]}), motion)
    np.testing.assert_allclose(both["survive_probability"], 0.25)
    of_one = heard(table(loss={"model": "aspect", "sectors": [astern | {"vehicles": ["V2"]}]}), motion)
    np.testing.assert_allclose(of_one["survive_probability"], 0.5)
    sent = heard(
        table(loss={"model": "aspect", "sectors": [astern | {"vehicles": ["V2"], "end": "sender"}]}), motion
    )
    np.testing.assert_allclose(sent["survive_probability"], np.where(sent["sender"] == 1, 0.5, 1.0))


def test_bearings_are_clockwise_from_the_bow() -> None:
    # Heading north at the origin; others ahead, to starboard (east), astern, to port.
    others = np.array([[0.0, 9.0], [9.0, 0.0], [0.0, -9.0], [-9.0, 0.0]])
    off = np.rad2deg(off_bow_rad(np.full(4, math.pi / 2), np.zeros((4, 2)), others))
    np.testing.assert_allclose(off, [0, 90, -180, -90], atol=1e-9)
    starboard = {"bearing_deg": 90, "width_deg": 20, "loss": 1.0, "end": "sender", "vehicles": ["V1"]}
    settings = table(order=["V1"], loss={"model": "aspect", "sectors": [starboard]})
    north = still((0, 0), 20, math.pi / 2)
    assert set(heard(settings, [north, still((300, 0), 20)])["survive_probability"]) == {0.0}
    assert set(heard(settings, [north, still((-300, 0), 20)])["survive_probability"]) == {1.0}
    wrapped = table(
        order=["V1"],
        loss={"model": "aspect", "sectors": [{"bearing_deg": -270, "width_deg": 20, "loss": 1.0}]},
    )
    assert heard(wrapped, [north, still((300, 0), 20)])["survive_probability"].max() == 0


# --- bursts ---


def test_a_burst_channel_loses_its_nominal_share() -> None:
    burst = {"model": "burst", "p_good_to_bad": 0.1, "p_bad_to_good": 0.3, "loss_good": 0.05, "loss_bad": 0.9}
    motion = [still((0, 0), 2 * MANY + 1), still((300, 0), 2 * MANY + 1)]
    table_ = heard(table(loss=burst), motion, seed=1)
    nominal = 0.75 * 0.05 + 0.25 * 0.9
    assert 1 - acoustics.survive_probability(table(loss=burst)) == pytest.approx(nominal)
    for sender in (0, 1):  # each direction of the pair has a channel of its own
        mine = table_["sender"] == sender
        assert mine.sum() >= MANY - 1
        assert lost(table_, mine) == pytest.approx(nominal, rel=0.02)
        assert set(np.round(table_["survive_probability"][mine], 12)) == {0.95, 0.1}
    forth = table_["survive_probability"][table_["sender"] == 0][: MANY - 1]
    back = table_["survive_probability"][table_["sender"] == 1][: MANY - 1]
    assert abs(np.corrcoef(forth, back)[0, 1]) < 0.02


@pytest.mark.parametrize(
    ("to_bad", "to_good"), [(0.05, 0.2), (0.02, 0.02), (0.9, 0.7), (0.3, 0.7), (1.0, 1.0)]
)
def test_burst_states_are_the_markov_chain(to_bad: float, to_good: float) -> None:
    loss = BurstLoss(model="burst", p_good_to_bad=to_bad, p_bad_to_good=to_good)
    bad = burst_states(loss, 400_000, np.random.default_rng(5))
    before, after = bad[:-1], bad[1:]
    assert after[~before].mean() == pytest.approx(to_bad, abs=0.005)
    assert (~after[before]).mean() == pytest.approx(to_good, abs=0.005)
    assert bad.mean() == pytest.approx(to_bad / (to_bad + to_good), abs=0.01)
    for lag in (1, 2, 5):
        expected = (1 - to_bad - to_good) ** lag
        assert np.corrcoef(bad[:-lag], bad[lag:])[0, 1] == pytest.approx(expected, abs=0.02)
    edges = np.flatnonzero(np.diff(bad.astype(int)))
    stays = np.diff(edges)[bad[edges[:-1] + 1]]  # lengths of whole bursts
    assert stays.mean() == pytest.approx(1 / to_good, rel=0.03)


def test_a_burst_starts_in_its_long_run_mixture() -> None:
    loss = BurstLoss(model="burst", p_good_to_bad=0.01, p_bad_to_good=0.03)
    first = [burst_states(loss, 1, np.random.default_rng(seed))[0] for seed in range(3000)]
    assert np.mean(first) == pytest.approx(0.25, abs=0.03)
    assert burst_states(loss, 0, np.random.default_rng(0)).size == 0


def test_a_burst_evolves_in_time_whatever_the_schedule() -> None:
    burst = {"model": "burst", "p_good_to_bad": 0.3, "p_bad_to_good": 0.3, "step_s": 4.0}
    motion = [still((0, 0), 2000), still((300, 0), 2000)]
    every, seldom = (
        heard(table(slot_s=slot, order=["V1"], loss=burst), motion, seed=2) for slot in (1.0, 4.0)
    )
    chance = every["survive_probability"][: 4 * 499].reshape(-1, 4)
    assert (chance == chance[:, :1]).all()  # constant over each step of 4 s
    assert 0.2 < (chance[:, 0] == 0).mean() < 0.8
    np.testing.assert_array_equal(chance[:499, 0], seldom["survive_probability"][:499])


def test_frames_of_one_packet_share_the_state_of_a_burst() -> None:
    settings = table(
        loss={"model": "burst", "p_good_to_bad": 0.1, "p_bad_to_good": 0.3, "loss_bad": 0.5},
        max_range_m=300.0,
    )
    assert acoustics.packet_survival(settings, 3) == pytest.approx(0.75 + 0.25 * 0.5**3)
    both = settings.model_copy(update={"losses": table(loss={"probability": 0.2}).all_losses})
    assert acoustics.packet_survival(both, 2) == pytest.approx((0.75 + 0.25 * 0.25) * 0.64)


# --- blackouts, distance, combinations ---


def test_a_blackout_loses_its_share_in_its_window_and_direction() -> None:
    window = {"from_s": 1000, "to_s": 1000 + 2 * MANY, "senders": ["V1"], "receivers": ["V2"], "loss": 0.7}
    steps = 2 * MANY + 3000
    motion = [still((0, 0), steps), still((300, 0), steps)]
    table_ = heard(table(loss={"model": "blackout", "windows": [window]}), motion)
    t = table_["tol_ns"] / 1e9
    inside = (table_["sender"] == 0) & (t >= 1000) & (t < 1000 + 2 * MANY)
    assert inside.sum() == MANY
    assert lost(table_, inside) == pytest.approx(0.7, rel=0.02)
    assert lost(table_, ~inside) == 0
    np.testing.assert_array_equal(table_["survive_probability"][~inside], 1.0)


def test_a_blackout_without_names_silences_everyone_from_start_to_just_before_its_end() -> None:
    motion = [still((0, 0), 60), still((300, 0), 60), still((0, 300), 60)]
    table_ = heard(table(loss={"model": "blackout", "windows": [{"from_s": 10, "to_s": 20}]}), motion)
    silent = table_["survive_probability"] == 0
    assert set(table_["tol_ns"][silent] // 1_000_000_000) == set(range(10, 20))
    assert silent.sum() == 20


def test_loss_with_distance_follows_its_table() -> None:
    rows = [[0, 1.0], [200, 0.8], [400, 0.9], [600, 0.1]]  # 0.8 and 0.9 pool to 0.85
    for at, share in [(100, 0.925), (200, 0.85), (300, 0.85), (500, 0.475), (700, 0.1)]:
        motion = [still((0, 0), 20), still((0.6 * at, 0.8 * at), 20)]
        table_ = heard(table(loss={"model": "distance", "table": rows}), motion)
        np.testing.assert_allclose(table_["survive_probability"], share)
    deep = [still((0, 0), 20), still((300, 0), 20, depth=400.0)]  # slant 500 m
    np.testing.assert_allclose(
        heard(table(loss={"model": "distance", "table": rows}), deep)["survive_probability"], 0.475
    )
    settings = table(loss={"model": "distance", "table": rows}, max_range_m=500.0)
    assert acoustics.packet_survival(settings, 2) == pytest.approx(
        0.475**2
    )  # at the schedule's longest range


def test_losses_multiply() -> None:
    motion = [still((0, 0), 60, math.pi), still((300, 0), 60)]  # stern to stern
    losses = [
        {"model": "aspect", "sectors": [{"width_deg": 90, "loss": 0.5, "end": "receiver"}]},
        {"model": "distance", "table": [[0, 1], [600, 0]]},
        {"model": "blackout", "windows": [{"from_s": 30, "to_s": 60, "loss": 0.2}]},
        {"model": "none"},
    ]
    table_ = heard(table(loss={"probability": 0.1}, losses=losses), motion)
    late = table_["tol_ns"] >= 30e9
    np.testing.assert_allclose(table_["survive_probability"], 0.9 * 0.5 * 0.5 * np.where(late, 0.8, 1.0))


ALL_LOSSES: list[dict[str, Any]] = [
    {"model": "burst", "p_good_to_bad": 0.1, "p_bad_to_good": 0.3},
    {"model": "burst", "p_good_to_bad": 0.1, "p_bad_to_good": 0.3, "loss_bad": 0.5},
    {"model": "aspect", "sectors": [{"width_deg": 90, "loss": 0.5}]},
    {"model": "distance", "table": [[0, 1], [600, 0]]},
    {"model": "blackout", "windows": [{"from_s": 30, "to_s": 60}]},
]


def test_losses_change_no_draw_and_a_third_vehicle_no_channel_of_the_others() -> None:
    two = [still((0, 0), 300, 1.0), still((300, 0), 300)]
    three = [*two, still((0, 300), 300)]
    order = {"order": ["V1", "V2"], "range_sigma_m": 1.0}
    plain, lossy = heard(table(**order), two), heard(table(losses=ALL_LOSSES, **order), two)
    joined = heard(table(losses=ALL_LOSSES, **order), three)
    pair = joined["receiver"] < 2
    assert lossy["survive_probability"].std() > 0.1
    for name in ("tol_ns", "toa_ns", "draws"):
        np.testing.assert_array_equal(plain[name], lossy[name])
    for name in ("tol_ns", "toa_ns", "draws", "survive_probability"):
        np.testing.assert_array_equal(lossy[name], joined[name][pair])


def test_two_burst_channels_of_one_list_are_independent() -> None:
    steps = 20_000
    motion = [still((0, 0), steps), still((300, 0), steps)]
    first, second = (
        heard(table(order=["V1"], losses=losses), motion)["survive_probability"]
        for losses in ([ALL_LOSSES[0]], [{"model": "none"}, ALL_LOSSES[0]])
    )
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05


# --- what is refused ---

WRONG = [
    ("loss={model='burst'}", "key 'acoustics.loss.p_good_to_bad' is missing"),
    (
        "loss={model='burst', p_good_to_bad=0, p_bad_to_good=0}",
        "acoustics.loss p_good_to_bad and p_bad_to_good are both 0: one must be above 0",
    ),
    (
        "loss={model='burst', p_good_to_bad=1.5, p_bad_to_good=0}",
        "acoustics.loss.p_good_to_bad is 1.5: must be at most 1",
    ),
    ("loss={model='aspect', sectors=[]}", "acoustics.loss.sectors has 0 entries: must have at least 1"),
    (
        "losses=[{model='aspect', sectors=[{width_deg=400, loss=1}]}]",
        "acoustics.losses.0.sectors.0.width_deg is 400: must be at most 360",
    ),
    (
        "loss={model='aspect', sectors=[{width_deg=90, loss=1, end='bow'}]}",
        "acoustics.loss.sectors.0.end is 'bow': must be one of 'sender', 'receiver', 'both'",
    ),
    (
        "loss={model='aspect', sectors=[{width_deg=90, loss=1, vehicles=['shipp']}]}",
        "acoustics.losses names 'shipp': no such vehicle, did you mean 'ship'?",
    ),
    (
        "loss={model='blackout', windows=[{from_s=0, to_s=9, receivers=['auvv']}]}",
        "acoustics.losses names 'auvv': no such vehicle, did you mean 'auv'?",
    ),
    (
        "loss={model='blackout', windows=[{from_s=20, to_s=10}]}",
        "acoustics.loss.windows.0 to_s is 10: must be above from_s, 20",
    ),
    ("loss={model='distance'}", "key 'acoustics.loss.table' is missing"),
    (
        "loss={model='distance', table=[[100, 1.2]]}",
        "acoustics.loss reception table row 1: share 1.2 must be within 0 to 1",
    ),
    (
        "loss={model='distance', table=[[100, 0.2], [-3, 0.2]]}",
        "acoustics.loss reception table row 2: distance_m -3 must be finite and at least 0",
    ),
    (
        "loss={model='distance', table=[[100, 0.2]], weights=[1, 2]}",
        "acoustics.loss reception table has 1 distances, 1 shares and 2 weights: must be as many, at least 1",
    ),
    (
        "loss={model='distance', table=[[100, 0.2], [200, 0.4]], fit='logistic'}",
        "acoustics.loss logistic fit to shares that do not fall with distance",
    ),
    (
        "loss={model='distance', table=[[100, 0.2]], fit='logistic'}",
        "acoustics.loss logistic fit to 1 distance: needs at least 2",
    ),
    (
        "loss={model='distance', file='nowhere.csv'}",
        "acoustics.loss range test nowhere.csv: nowhere.csv cannot be read: No such file or directory",
    ),
    (
        "loss={model='distance', file='nowhere.csv', columns={distanc='r'}}",
        "acoustics.loss columns: did you mean 'distance'?",
    ),
    ("range_outlier_share=1.0", "acoustics.range_outlier_share is 1: must be below 1"),
    (
        "range_outlier_m={distribution='uniform', low=9, high=3}",
        "acoustics.range_outlier_m high is 3: must be above low, 9",
    ),
    (
        "range_outlier_m={distribution='normal'}",
        "acoustics.range_outlier_m.distribution is 'normal': must be one of 'exponential', 'uniform'",
    ),
    ("ranging='three-way'", "acoustics.ranging is 'three-way': must be one of 'one-way', 'two-way'"),
    (
        "sound_speed={model='mackenzie', temperature_c=45, salinity_psu=35}",
        "acoustics.sound_speed.temperature_c is 45: must be at most 30",
    ),
    (
        "sound_speed={model='mackenzie', temperature_c=20, salinity_psu=1}",
        "acoustics.sound_speed.salinity_psu is 1: must be at least 25",
    ),
]


@pytest.mark.parametrize(("key", "says"), WRONG)
def test_what_is_wrong_is_said_in_one_line(key: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.parse(scenario.apply_overrides(BASE, [f"acoustics.{key}"]), "bay.toml")
    message = str(caught.value)
    assert message.startswith(f"bay.toml: {says}")
    assert "\n" not in message
