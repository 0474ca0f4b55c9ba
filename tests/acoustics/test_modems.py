"""Modems: packaged profiles, one's own as a table, and the half-duplex turn-around."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uwcoop import acoustics, scenario
from uwcoop.acoustics.modem import MODEMS
from uwcoop.errors import ScenarioError, ScheduleError
from uwcoop.scenario.acoustics import Acoustics


def table(**changes: Any) -> Acoustics:
    return Acoustics.model_validate(
        {"modem": "micromodem-64", "slot_s": 5.0, "max_range_m": 750.0, **changes}
    )


OWN = {
    "name": "mine",
    "frame_bytes": 16,
    "max_frames": 2,
    "frame_s": 0.5,
    "preamble_s": 0.1,
    "turnaround_s": 0.2,
}


@pytest.mark.parametrize("name", [name for name in MODEMS if name != "unlimited"])
def test_every_packaged_modem_has_figures_and_a_source(name: str) -> None:
    modem = MODEMS[name]
    assert modem.frame_bytes >= 1
    assert modem.bits_per_s > 0
    assert len(modem.source) > 40
    plan = table(modem=name, slot_s=30.0)
    link = acoustics.link_of(plan)
    assert link.modem == name
    assert (
        acoustics.slot_capacity_bytes(plan)
        == min(modem.max_frames, int((30.0 - plan.guard - modem.preamble_s) / modem.frame_s + 1e-9))
        * modem.frame_bytes
    )


@pytest.mark.parametrize(
    ("name", "count", "air_s"),
    [
        ("seatrac", 31, 31 * 0.08),  # 80 ms a byte
        ("nanomodem-v3", 64, 8 * 64 / 463),  # the throughput of its specification
        ("waterlinked-m64", 8, 1.0),
        ("micromodem-32", 32, 0.3 + 3.2),
    ],
)
def test_profiles_give_the_air_times_of_their_sources(name: str, count: int, air_s: float) -> None:
    link = acoustics.link_of(table(modem=name))
    assert acoustics.air_time_s(link, acoustics.frames_of(link, count)) == pytest.approx(air_s, rel=2e-3)


def test_a_table_is_a_modem_and_survives_the_resolved_scenario() -> None:
    made = scenario.load(
        "flat-bay", ["acoustics.modem={frame_bytes=31, bits_per_s=100, preamble_s=0.1}", "acoustics.slot_s=6"]
    )
    link = acoustics.link_of(made.acoustics)
    assert (link.modem, link.frame_bytes, link.max_frames, link.preamble_s) == ("own", 31, 1, 0.1)
    assert link.frame_s == pytest.approx(2.48)
    again = scenario.parse(made.resolved())
    assert acoustics.link_of(again.acoustics) == link


def test_a_profile_can_be_the_start_of_ones_own() -> None:
    plan = table(modem={"profile": "seatrac", "preamble_s": 0.25})
    assert plan.modem_profile.frame_bytes == 31
    assert plan.modem_profile.preamble_s == 0.25
    timed = table(modem={"profile": "seatrac", "frame_s": 3.1})
    assert acoustics.link_of(timed).frame_s == pytest.approx(3.1)


@settings(deadline=None, max_examples=60)
@given(
    frame_bytes=st.integers(1, 512), max_frames=st.integers(1, 8), frame_s=st.floats(0.01, 5),
    preamble_s=st.floats(0, 1), turnaround_s=st.floats(0, 1), count=st.integers(0, 5000),
)  # fmt: skip
def test_a_packet_fits_exactly_when_the_sum_says_so(
    frame_bytes: int, max_frames: int, frame_s: float, preamble_s: float, turnaround_s: float, count: int
) -> None:
    modem = {"frame_bytes": frame_bytes, "max_frames": max_frames, "frame_s": frame_s, "preamble_s": preamble_s,
             "turnaround_s": turnaround_s}  # fmt: skip
    plan = table(modem=modem, slot_s=10.0)
    frames = max(1, -(-count // frame_bytes))
    needed = preamble_s + frames * frame_s + 0.5 + turnaround_s
    try:
        acoustics.check_packet(plan, count)
        fits = True
    except ScheduleError:
        fits = False
    if abs(needed - 10.0) > 1e-6:
        assert fits == (frames <= max_frames and needed <= 10.0)


def test_the_turnaround_lengthens_the_guard_and_is_in_the_arithmetic() -> None:
    plan = table(modem=OWN, slot_s=1.1)
    assert plan.guard == pytest.approx(0.5 + 0.2)
    with pytest.raises(
        ScheduleError, match=r"guard 0\.70 s \(750 m / 1500 m/s \+ turn-around 0\.2 s\) = 1\.30 s"
    ):
        acoustics.slot_frames(plan)
    two_way = table(modem=OWN, slot_s=9.0, ranging="two-way")
    poll_s = acoustics.poll_air_s(two_way)
    assert acoustics.slot_needed_s(two_way, 1) == pytest.approx(poll_s + 0.5 + 0.2 + 0.6 + 0.7)


def test_a_vehicle_that_has_just_sent_hears_nothing_within_its_turnaround() -> None:
    from uwcoop.acoustics.channel import _clear, _Launches

    on_air = _Launches(np.array([0, 1]), np.array([0.0, 1.05]), np.array([1.0, 1.0]))
    arrival_s = np.array([[0.0, 0.01], [1.06, 1.05]])
    assert _clear(on_air, arrival_s, 0.0).all()
    late = _clear(on_air, arrival_s, 0.1)
    assert not late[1, 0]
    assert not late[0, 1]
    assert _clear(on_air, arrival_s, 0.03).all()


@pytest.mark.parametrize(
    ("modem", "says"),
    [
        ("seatrack", "acoustics.modem is 'seatrack': must be one of 'micromodem-32', "),
        ({"frame_bytes": 16}, "acoustics.modem needs bits_per_s or frame_s, one of the two"),
        (
            {"frame_bytes": 16, "bits_per_s": 9.0, "frame_s": 1.0},
            "acoustics.modem needs bits_per_s or frame_s",
        ),
        ({"profile": "unlimited"}, "acoustics.modem profile is 'unlimited': it has no air time to change"),
        ({"profile": "x"}, "acoustics.modem is 'x': must be one of"),
        ({"frame_bytes": 0, "frame_s": 1.0}, "acoustics.modem.frame_bytes is 0: must be at least 1"),
        ({"frames": 0, "frame_bytes": 3, "frame_s": 1.0}, "unknown key 'acoustics.modem.frames'"),
    ],
)
def test_modems_that_cannot_be_are_refused(modem: Any, says: str) -> None:
    tables = {**scenario.load("flat-bay").resolved()}
    tables["acoustics"] = {**tables["acoustics"], "modem": modem}
    with pytest.raises(ScenarioError) as caught:
        scenario.parse(tables)
    assert says in str(caught.value)
