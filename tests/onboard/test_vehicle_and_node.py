"""A vehicle's navigator and a node in one process: the bits of `uwcoop run`, kills, what is refused."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import uwcoop
from onboard_dive import SECOND_NS, Dive, assert_same, scenario, tracks_by_time
from uwcoop.errors import LogError, NavigatorError, ScenarioError
from uwcoop.onboard import (
    Journal,
    MessageError,
    Node,
    VehicleNavigator,
    event_message,
    event_of,
    read_black_box,
    write_black_box,
)
from uwcoop.onboard.channel import sensor_messages
from uwcoop.onboard.messages import decode, encode


@pytest.fixture(scope="module")
def log():
    return uwcoop.simulate(scenario())


@pytest.fixture(scope="module")
def expected(log):
    return tracks_by_time(log)


def test_nodes_give_the_bits_of_the_replay(log, expected) -> None:
    dive = Dive(log, scenario())
    dive.fly()
    assert assert_same(dive.said, expected) == 61 * 3
    assert sum(node.counts["fused"] for node in dive.nodes) > 300
    assert not any(node.counts["late"] for node in dive.nodes)


@pytest.mark.parametrize("tag_bytes", [0, 4])
def test_killed_at_any_moment_a_node_goes_on_with_the_same_bits(tmp_path, tag_bytes) -> None:
    key = [f"acoustics.authentication={{tag_bytes={tag_bytes}, key_hex='{'5a' * 16}', mission=3}}"] * bool(
        tag_bytes
    )
    mission = scenario(*key)
    log = uwcoop.simulate(mission)
    dive = Dive(log, mission, tmp_path)
    chance = random.Random(tag_bytes)
    kills = 0

    def before_step(t_ns: int) -> None:
        nonlocal kills
        if chance.random() < 0.15:
            dive.kill(chance.randrange(3))
            kills += 1
        if chance.random() < 0.1:
            dive.nodes[chance.randrange(3)].checkpoint()

    dive.fly(before_step)
    assert kills >= 5
    assert assert_same(dive.said, tracks_by_time(log)) >= 61 * 3
    launched = [(message["vehicle"], message["tol_ns"]) for message in dive.launched]
    assert len(set(launched)) == len(launched) >= 15
    assert len(list((tmp_path / "0").glob("journal-*"))) > 1, "the journal was rotated"


def test_the_black_box_replays_to_the_same_bits(log, expected, tmp_path) -> None:
    dive = Dive(log, scenario(), tmp_path)
    dive.fly()
    for k, node in enumerate(dive.nodes):
        box = write_black_box(tmp_path / str(k), node.vehicle, tmp_path / f"{k}.mcap")
        assert box.difference(uwcoop.load_log(tmp_path / f"{k}.mcap")) is None
        replayed = tracks_by_time(box)
        common = replayed.keys() & expected.keys()
        assert len(common) > 60
        for t_ns in common:
            for mine, theirs in zip(replayed[t_ns], expected[t_ns], strict=True):
                np.testing.assert_array_equal(mine[k], theirs[k])
        assert len(box.payloads) > 5


def test_a_refused_event_is_in_the_journal_and_not_in_the_black_box(tmp_path) -> None:
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    node = Node(made, lambda message: None, Journal(tmp_path, made.digest))
    reception = {"sender": 0, "tol_ns": 0, "toa_ns": SECOND_NS, "bytes": b"\0" * 8}  # from itself
    node.take(uwcoop.Event(SECOND_NS, 0, "motion", velocity_e_mps=1.0, velocity_n_mps=0.0))
    node.take(uwcoop.Event(2 * SECOND_NS, 0, "reception", **reception))
    node.advance(3 * SECOND_NS)
    assert node.counts["refused"] == 1
    assert "event refused" in node.alarms
    box = read_black_box(tmp_path, made)
    assert box.payloads == []
    assert box.events["motion"]["t_ns"].tolist() == [SECOND_NS]


def test_a_sensor_event_that_came_twice_is_fused_once(tmp_path) -> None:
    """Also one that comes again after it was fused, or after a restart; the same value at another time is not a copy."""
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    said = []
    node = Node(made, said.append, Journal(tmp_path, made.digest))

    def fix(t_ns: int) -> uwcoop.Event:
        return uwcoop.Event(t_ns, 0, "fix", e_m=0.0, n_m=0.0, cov_ee_m2=9.0, cov_en_m2=0.0, cov_nn_m2=9.0)

    assert node.take(fix(0))
    assert not node.take(fix(0))
    node.advance(0)
    assert not node.take(fix(0))
    assert node.take(fix(1))
    node.advance(2 * SECOND_NS)
    assert node.counts["fused"] == 2
    assert node.counts["duplicate"] == 2
    assert [m["alarm"] for m in said if m["type"] == "diagnostic"] == ["duplicate event"]
    node.journal.close()
    again = Node(
        VehicleNavigator.from_scenario(scenario(), "V1"), said.append, Journal(tmp_path, made.digest)
    )
    assert not again.take(fix(1))
    assert again.counts["duplicate"] == 1
    assert again.vehicle.save() == node.vehicle.save()


def test_events_outside_the_mission_are_counted_and_not_used(tmp_path) -> None:
    """Sensors speak before the start and after the end; the black box holds the mission."""
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    node = Node(made, lambda message: None, Journal(tmp_path, made.digest))
    end_ns = made.mission.duration_ns
    for t_ns in (-1, 0, SECOND_NS, end_ns, end_ns + 1):
        node.take(uwcoop.Event(t_ns, 0, "motion", velocity_e_mps=1.0, velocity_n_mps=0.0))
    assert not node.take(uwcoop.Event(0, 1, "motion", velocity_e_mps=1.0, velocity_n_mps=0.0))
    node.advance(end_ns + SECOND_NS)
    assert node.counts["before the start"] == node.counts["after the end"] == node.counts["misaddressed"] == 1
    box = write_black_box(tmp_path, made, tmp_path / "dive.mcap")
    assert box.events["motion"]["t_ns"].tolist() == [0, SECOND_NS, end_ns]


def test_what_is_known_again_is_bounded_in_number_and_time() -> None:
    import uwcoop.onboard.node as module

    node = Node(VehicleNavigator.from_scenario(scenario("duration_s=200"), "V1"), lambda message: None)
    for k in range(module.QUEUE_LIMIT + 100):
        assert node.take(uwcoop.Event(k, 0, "depth", depth_m=2.0, sigma_m=0.1))
        if k % 1000 == 0:
            node.advance(k)
    assert len(node._recent) == module.QUEUE_LIMIT
    for t_s in (100, 101):
        assert node.take(uwcoop.Event(t_s * SECOND_NS, 0, "depth", depth_m=2.0, sigma_m=0.1))
        node.advance(t_s * SECOND_NS)
    assert len(node._recent) == 2
    assert node.counts["duplicate"] == 0


def test_late_events_are_counted_and_said_and_change_nothing() -> None:
    said = []
    node = Node(VehicleNavigator.from_scenario(scenario(), "V1"), said.append)
    event = {"velocity_e_mps": 1.0, "velocity_n_mps": 0.0}
    node.take(uwcoop.Event(5 * SECOND_NS, 0, "motion", **event))
    node.advance(6 * SECOND_NS)
    state = node.vehicle.save()
    assert not node.take(uwcoop.Event(4 * SECOND_NS, 0, "motion", **event))
    node.advance(6 * SECOND_NS)
    assert node.vehicle.save() == state
    assert node.counts["late"] == 1
    assert [m["alarm"] for m in said if m["type"] == "diagnostic"][-1] == "late event"


def _shuffled(events: list, chance: random.Random, late_s: float) -> list:
    """Each comes up to so much after its stamp."""
    return sorted(events, key=lambda message: message["t_ns"] + chance.random() * late_s * SECOND_NS)


def test_with_the_option_late_a_node_puts_events_in_their_place(log, tmp_path) -> None:
    """Estimates at the end are those of everything in order, also of a node that was killed on the way."""
    mission = scenario('navigator.team.late="replay"', "navigator.team.lag_s=10")
    messages = list(sensor_messages(log, 0))
    came = _shuffled(messages, random.Random(4), 8.0)
    orderly = Node(VehicleNavigator.from_scenario(mission, "V1"), lambda message: None)
    for message in messages:
        assert orderly.take(event_of(message))
    orderly.advance(log.duration_ns)

    def flown(folder, killed_after: int | None) -> Node:
        made = VehicleNavigator.from_scenario(mission, "V1")
        node = Node(made, lambda message: None, Journal(folder, made.digest))
        for k, message in enumerate(came):
            if k == killed_after:
                node.journal.close()
                made = VehicleNavigator.from_scenario(mission, "V1")
                node = Node(made, lambda message: None, Journal(folder, made.digest))
            assert node.take(event_of(message))
            node.advance(max(node.now_ns, message["t_ns"]), launch_from_ns=0)
        node.advance(log.duration_ns, launch_from_ns=0)
        return node

    for name, killed_after in (("whole", None), ("killed", len(came) // 2)):
        node = flown(tmp_path / name, killed_after)
        if killed_after is None:
            assert node.counts["late"] > 20
            assert node.counts["refused"] == node.counts["rejected"] == 0
        t_ns = log.duration_ns
        found, expected_ = node.vehicle.estimate(t_ns), orderly.vehicle.estimate(t_ns)
        assert found.mean_m.tolist() == expected_.mean_m.tolist()
        assert found.covariance_m2.tolist() == expected_.covariance_m2.tolist()
        assert not any(node.take(event_of(message)) for message in came[-50:])


def test_a_late_event_is_used_within_the_lag_once_and_after_a_restart_only_if_it_is_no_copy(tmp_path) -> None:
    mission = scenario('navigator.team.late="replay"', "navigator.team.lag_s=10")

    def node() -> Node:
        made = VehicleNavigator.from_scenario(mission, "V1")
        return Node(made, said.append, Journal(tmp_path, made.digest))

    def depth(t_s: float) -> uwcoop.Event:
        return uwcoop.Event(round(t_s * SECOND_NS), 0, "depth", depth_m=2.0, sigma_m=0.1)

    said: list = []
    first = node()
    for t_s in (0, 5, 20):
        assert first.take(depth(t_s))
        first.advance(t_s * SECOND_NS)
    assert first.take(depth(12))
    assert not first.take(depth(12))
    assert not first.take(depth(9))
    assert (first.counts["late"], first.counts["duplicate"]) == (2, 1)
    assert first.done[0] == 20 * SECOND_NS
    first.checkpoint()
    first.journal.close()
    again = node()
    assert again.done == first.done
    assert not again.take(depth(12)), "it was fused before the checkpoint"
    again.journal.close()


def test_a_node_hands_over_odometry_after_the_other_sensors_of_its_instant() -> None:
    """As the replay does: what a heading tells holds at the end of the odometry."""
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    handed: list[str] = []
    node = Node(made, lambda message: None)
    handle = made.handle
    made.handle = lambda event: (handed.append(event.kind), handle(event))[1]
    odometry = dict.fromkeys(("forward_m", "left_m", "yaw_change_rad", "cov_fl", "cov_fy", "cov_ly"), 0.0)
    node.take(uwcoop.Event(0, 0, "odometry", **odometry, cov_ff=1.0, cov_ll=1.0, cov_yy=1.0))
    node.take(uwcoop.Event(0, 0, "heading", yaw_rad=0.0, sigma_rad=0.1))
    node.take(
        uwcoop.Event(
            0, 0, "usbl", measured_ns=0, e_m=0.0, n_m=0.0, cov_ee_m2=1.0, cov_en_m2=0.0, cov_nn_m2=1.0
        )
    )
    node.take(uwcoop.Event(0, 0, "motion", velocity_e_mps=0.0, velocity_n_mps=0.0))
    node.advance(0)
    assert handed == ["motion", "heading", "usbl", "odometry"]


def test_a_silent_sensor_and_a_missed_slot_raise_alarms_once() -> None:
    said = []
    node = Node(VehicleNavigator.from_scenario(scenario(), "V1"), said.append, silent_after_s=4.0)
    for second in (0, 1, 2):
        node.take(uwcoop.Event(second * SECOND_NS, 0, "depth", depth_m=2.0, sigma_m=0.1))
    node.advance(12 * SECOND_NS)
    node.take(uwcoop.Event(13 * SECOND_NS, 0, "depth", depth_m=2.0, sigma_m=0.1))
    node.advance(13 * SECOND_NS)
    told = [(m["alarm"], m["raised"]) for m in said if m["type"] == "diagnostic"]
    assert told.count(("depth silent", True)) == 1
    assert told.count(("depth silent", False)) == 1
    assert told.count(("slot missed", True)) == 1
    assert node.counts["missed"] == 2  # of the slots at 0, 9 s; that at 18 s is to come
    assert node.next_slot_ns == 18 * SECOND_NS


def test_a_state_belongs_to_its_mission_vehicle_and_navigator() -> None:
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    state = made.save()
    for other in (
        VehicleNavigator.from_scenario(scenario(), "V2"),
        VehicleNavigator.from_scenario(scenario(), "V1", "mpf"),
        VehicleNavigator.from_scenario(scenario(), "V1", seed=5),
        VehicleNavigator.from_scenario(scenario("navigator.team.particles=301"), "V1"),
    ):
        with pytest.raises(NavigatorError, match="saved for another"):
            other.restore(state)
    with pytest.raises(NavigatorError, match="no state"):
        made.restore(b"junk")
    with pytest.raises(NavigatorError):
        made.restore(state[:-9])
    assert made.save() == state


@pytest.mark.parametrize(
    ("more", "vehicle", "navigator", "line"),
    [
        ((), "V9", None, "not in the team"),
        ((), 3, None, "must be 0 to 2"),
        ((), "V1", "deif", "no vehicle has"),
        ((), "V1", "teem", "did you mean 'team'"),
        (("acoustics.authentication={tag_bytes=4}",), "V1", None, "no key"),
        (("acoustics.ranging='two-way'", "acoustics.slot_s=8"), "V1", None, "one-way"),
    ],
)
def test_what_a_node_cannot_run_is_refused(more, vehicle, navigator, line) -> None:
    with pytest.raises((ScenarioError, NavigatorError), match=line):
        VehicleNavigator.from_scenario(scenario(*more), vehicle, navigator)
    with pytest.raises(ScenarioError, match="exchange"):
        VehicleNavigator.from_scenario("seafloor-survey", 0)


def test_damaged_journals(tmp_path) -> None:
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    journal = Journal(tmp_path, made.digest)
    with pytest.raises(LogError, match="another node"):
        Journal(tmp_path, made.digest)
    node = Node(made, lambda message: None, journal)
    node.take(uwcoop.Event(0, 0, "motion", velocity_e_mps=1.0, velocity_n_mps=0.0))
    node.advance(0)
    node.checkpoint()
    state = made.save()
    journal.close()
    with pytest.raises(LogError, match="another scenario"):
        Journal(tmp_path, "0" * 64)
    path = next(tmp_path.glob("journal-*"))
    with path.open("ab") as file:
        file.write(b'{"type":"event","t_ns":1000')  # power went
    again = VehicleNavigator.from_scenario(scenario(), "V1")
    node = Node(again, lambda message: None, Journal(tmp_path, made.digest))
    assert again.save() == state
    assert "journal cut" in node.alarms
    node.journal.close()
    checkpoint = tmp_path / "checkpoint"
    checkpoint.write_bytes(checkpoint.read_bytes()[:-1] + b"\0\0")
    journal = Journal(tmp_path, made.digest)
    with pytest.raises(LogError, match="SHA-256"):
        Node(VehicleNavigator.from_scenario(scenario(), "V1"), lambda message: None, journal)


FLOAT = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e3, max_value=1e3)


@given(FLOAT, FLOAT, st.integers(0, 10**15), st.binary(max_size=40))
@settings(max_examples=60)
def test_messages_come_back_bit_for_bit(e_m, n_m, t_ns, packet) -> None:
    for event in (
        uwcoop.Event(t_ns, 1, "motion", velocity_e_mps=e_m / 100, velocity_n_mps=n_m / 100),
        uwcoop.Event(t_ns + 9, 2, "reception", sender=0, tol_ns=t_ns, toa_ns=t_ns + 5, bytes=packet),
        uwcoop.Event(
            t_ns + 9, 0, "acoustic_fix", peer=1, transmit_ns=t_ns, range_m=abs(e_m) + 1,
            own_bearing_rad=float("nan"), peer_bearing_rad=float("nan"), peer_depth_m=float("nan"),
        ),
    ):  # fmt: skip
        (message,) = decode(encode(event_message(event)))
        assert repr(event_of(message)) == repr(event)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text("ab01", max_size=4),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("ab01", max_size=4), inner, max_size=3)
    ),
    max_leaves=6,
)
NAMES = st.sampled_from(
    ["t_ns", "vehicle", "velocity_e_mps", "velocity_n_mps", "sender", "bytes", "depth_m", "x"]
)


@given(
    st.dictionaries(NAMES, JSON, max_size=5),
    st.sampled_from(["motion", "reception", "depth", "", "fix", 3, None]),
)
@settings(max_examples=200)
def test_no_message_does_harm(fields, kind) -> None:
    try:
        event = event_of({"type": "event", "kind": kind, **fields})
    except MessageError:
        return
    assert isinstance(event, uwcoop.Event)


def test_the_journal_is_not_ahead_of_its_files(tmp_path) -> None:
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    journal = Journal(tmp_path, made.digest)
    journal.append({"type": "slot", "tol_ns": 0, "capacity_bytes": 32}, sync=True)
    journal.checkpoint(made.save(), {"done": [0, 2, 0], "counts": {}, "heard_ns": {}})
    journal.close()
    path = next(tmp_path.glob("journal-*"))
    path.write_bytes(path.read_bytes().splitlines(keepends=True)[0])
    with pytest.raises(LogError, match="ahead of its journal"):
        Node(made, lambda message: None, Journal(tmp_path, made.digest))
