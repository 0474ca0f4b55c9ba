"""Nodes and channel as processes on loopback: bits, kills, hostile datagrams, start, load and memory."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import uwcoop
from onboard_dive import SECOND_NS, assert_same, free_ports, program, scenario, tracks_by_time
from uwcoop.onboard import VehicleNavigator
from uwcoop.onboard.channel import Channel
from uwcoop.onboard.messages import decode
from uwcoop.onboard.service import NodeService, SystemClock
from uwcoop.onboard.transports import UdpTransport, default_addresses

NAMES = ("V1", "V2", "V3")


def written(folder: Path, *more: str) -> Path:
    """The scenario and its mission as files."""
    from uwcoop.missionlog.mcap import write_log

    mission = scenario(*more)
    path = folder / "team.json"
    path.write_text(json.dumps(mission.resolved()))
    write_log(uwcoop.simulate(str(path)), folder / "mission.mcap")
    return path


def node(name: str, folder: Path, base: int):
    return program(
        "node", "--vehicle", name, "--scenario", "team.json", "--state", f"state-{name}", "--base-port", str(base),
        "--black-box", f"{name}.mcap", "--checkpoint-s", "1", folder=folder,
    )  # fmt: skip


class Heard:
    """What the nodes say to the watch."""

    def __init__(self, base: int) -> None:
        addresses = default_addresses(NAMES, base)
        self.wires = UdpTransport(addresses.pop("watch"), addresses)
        self.messages: list[dict] = []

    def listen(self, timeout_s: float = 0.05) -> None:
        for _, datagram in self.wires.receive(timeout_s):
            self.messages += decode(datagram)


def test_three_nodes_and_a_channel_at_twenty_times_real_time_give_the_bits_of_the_replay(tmp_path) -> None:
    written(tmp_path)
    base = free_ports(5)
    heard = Heard(base)
    nodes = [node(name, tmp_path, base) for name in NAMES]
    channel = program(
        "channel", "--play", "mission.mcap", "--speed", "20", "--base-port", str(base), "--wait-s", "120",
        "--patience-s", "60", folder=tmp_path,
    )  # fmt: skip
    while any(process.poll() is None for process in (*nodes, channel)):
        heard.listen()
    heard.listen()
    heard.wires.close()
    said = [process.communicate()[1] for process in (*nodes, channel)]
    assert [process.returncode for process in (*nodes, channel)] == [0] * 4, said
    expected = tracks_by_time(uwcoop.load_log(tmp_path / "mission.mcap"))
    assert assert_same(heard.messages, expected) == 61 * 3
    assert not [m for m in heard.messages if m["type"] == "diagnostic"]
    for k, name in enumerate(NAMES):
        replayed = tracks_by_time(uwcoop.load_log(tmp_path / f"{name}.mcap"))
        for t_ns in replayed.keys() & expected.keys():
            np.testing.assert_array_equal(replayed[t_ns][0][k], expected[t_ns][0][k])


class KillingChannel(Channel):
    """Kills nodes at moments of the mission and starts them again; each is away for the same time of the mission.

    The channel has the clock: it waits for a node that is starting when its time away is over, so that a machine's load
    does not decide for how long a vehicle is blind.
    """

    away_s = 5.0

    def __init__(self, log, wires, folder: Path, base: int, moments: list[tuple[int, str]]) -> None:
        self.said: list[str] = []
        super().__init__(log, wires, self.said.append)
        self.folder, self.base, self.moments = folder, base, moments
        self.nodes = {name: node(name, folder, base) for name in NAMES}
        self.back_ns: dict[int, int] = {}

    def _step(self, t_ns, due, patience_s) -> None:
        while self.moments and self.moments[0][0] <= t_ns:
            _, name = self.moments.pop(0)
            vehicle = NAMES.index(name)
            # In the middle of its work: what is due was sent, its answer is not waited for.
            self._send(vehicle, due[vehicle])
            self._tell(vehicle, t_ns)
            due[vehicle] = []
            self.nodes[name].kill()
            self.nodes[name].communicate()
            self.nodes[name] = node(name, self.folder, self.base)
            self.away.add(vehicle)
            self.back_ns[vehicle] = t_ns + round(self.away_s * SECOND_NS)
        for vehicle in [v for v, back_ns in self.back_ns.items() if back_ns <= t_ns]:
            del self.back_ns[vehicle]
            until_s = time.monotonic() + 120
            while vehicle in self.away and time.monotonic() < until_s:
                self._receive(0.1)
            assert vehicle not in self.away, f"{NAMES[vehicle]} did not come back"
        super()._step(t_ns, due, patience_s)

    def _message(self, source, message) -> None:
        # A node that is killed may have said hello before: it is back when its time is over.
        if message["type"] == "hello" and message["vehicle"] in self.back_ns:
            return
        super()._message(source, message)


def fly_with_kills(folder: Path, kills: int) -> tuple[list[dict], str]:
    """A dive whose nodes are killed at random moments and started again; what was said, and what the channel said."""
    chance = random.Random(11)
    base = free_ports(5)
    heard = Heard(base)
    log = uwcoop.load_log(folder / "mission.mcap")
    moments = sorted(
        (round(chance.uniform(0.1, 0.7) * log.duration_ns), chance.choice(NAMES)) for _ in range(kills)
    )
    addresses = default_addresses(NAMES, base)
    wires = UdpTransport(addresses.pop("channel"), addresses)
    channel = KillingChannel(log, wires, folder, base, moments)
    playing = threading.Thread(target=channel.play, args=(0.0,), kwargs={"wait_s": 120, "patience_s": 60})
    playing.start()
    while playing.is_alive():
        heard.listen()
    for process in channel.nodes.values():
        process.communicate(timeout=60)
    heard.listen()
    heard.wires.close()
    wires.close()
    assert not channel.moments
    assert not channel.back_ns
    return heard.messages, "\n".join([*channel.said, f"{channel.refused} refused in all"])


def check_kills(folder: Path, said: list[dict], line: str) -> None:
    """Nothing was launched or accepted twice, and at the end every node is as good as without kills."""
    assert "launched twice" not in line
    assert line.endswith("\n0 refused in all")
    for name in NAMES:
        slots, receptions = [], []
        for path in sorted((folder / f"state-{name}").glob("journal-*.jsonl")):
            for text in path.read_text().splitlines():
                message = json.loads(text)
                if message["type"] == "slot":
                    slots.append(message["tol_ns"])
                elif message.get("kind") == "reception":
                    receptions.append((message["sender"], message["tol_ns"]))
        assert slots == sorted(set(slots))
        assert len(receptions) == len(set(receptions)) > 3
    log = uwcoop.load_log(folder / "mission.mcap")
    whole = tracks_by_time(log)
    truth = log.truth.position_m.to_numpy()
    last = {m["vehicle"]: m for m in said if m["type"] == "estimate" and m["mean_m"][0] is not None}
    for vehicle in range(3):
        errors = [
            np.hypot(*(positions[0][vehicle] - truth[vehicle, t_ns // SECOND_NS]))
            for t_ns, positions in whole.items()
            if t_ns % SECOND_NS == 0
        ]
        found = last[vehicle]
        error_m = np.hypot(*(np.array(found["mean_m"]) - truth[vehicle, found["t_ns"] // SECOND_NS]))
        assert error_m <= max(np.nanpercentile(errors, 95), 3 * np.sqrt(found["covariance_m2"][0])), (
            vehicle,
            error_m,
        )


def test_killed_nodes_resume_and_nothing_is_sent_or_accepted_twice(tmp_path) -> None:
    written(tmp_path)
    check_kills(tmp_path, *fly_with_kills(tmp_path, kills=2))


@pytest.mark.long
def test_twenty_kills(tmp_path) -> None:
    written(tmp_path, "duration_s=600")
    check_kills(tmp_path, *fly_with_kills(tmp_path, kills=20))


def storm(count: int) -> tuple[NodeService, bytes, float]:
    """A node under a storm of hostile datagrams; with its state before, and the share of a core that it takes after."""
    base = free_ports(5)
    addresses = default_addresses(NAMES, base)
    own = addresses.pop("V1")
    made = VehicleNavigator.from_scenario(scenario(), "V1")
    service = NodeService(made, UdpTransport(own, addresses))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as known:
        known.bind(addresses["channel"])
        lines = b'{"type":"event","t_ns":0,"vehicle":0,"kind":"depth","depth_m":2.0,"sigma_m":0.1}\n'
        known.sendto(lines + b'{"type":"clock","t_ns":0,"sent":1}\n', own)
        for source, datagram in service.transport.receive(1.0):
            service.datagram(source, datagram)
        state = made.save()
        chance = random.Random(5)
        good = b'{"type":"clock","t_ns":5000000000,"sent":9}'
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for k in range(count):
                kind = k % 5
                hostile = bytearray(lines if kind else good)
                for _ in range(kind):
                    hostile[chance.randrange(len(hostile))] = chance.randrange(256)
                stranger.sendto(hostile, own)  # well-formed ones too: the address is nobody's
                if k % 10 == 0:
                    # From a known address, what is not a message: cut off, too large numbers, nested, of another type.
                    junk = (bytes(lines[: chance.randrange(1, 70)]), b"[" * 5000, b'{"type":"clock","t_ns":1e999}',
                            b'{"type":"event","t_ns":' + b"9" * 400 + b"}", b'{"type":7}', os.urandom(40))  # fmt: skip
                    known.sendto(junk[k // 10 % len(junk)], own)
                if k % 64 == 63:
                    for source, datagram in service.transport.receive(0.0):
                        service.datagram(source, datagram)
    while found := service.transport.receive(0.1):
        for source, datagram in found:
            service.datagram(source, datagram)
    began_s, cpu_s = time.monotonic(), time.process_time()
    while time.monotonic() - began_s < 1.0:
        service.transport.receive(0.25)
    return service, state, time.process_time() - cpu_s


@pytest.mark.parametrize("count", [20_000, pytest.param(1_000_000, marks=pytest.mark.long)])
def test_hostile_datagrams_change_nothing(count) -> None:
    service, state, after_s = storm(count)
    assert service.transport.dropped > count // 4, "the storm came through"
    assert service.node.counts["malformed"] > 100
    assert service.node.vehicle.save() == state
    assert service.node.now_ns == 0
    assert after_s < 0.2
    service.transport.close()


def test_a_datagram_beyond_the_queue_is_refused_and_said() -> None:
    import uwcoop.onboard.node as module

    made = VehicleNavigator.from_scenario(scenario(), "V1")
    queue = module.Node(made, lambda message: None)
    for k in range(module.QUEUE_LIMIT + 5):
        queue.take(uwcoop.Event(k, 0, "depth", depth_m=2.0, sigma_m=0.1))
    assert queue.counts["overflowed"] == 5


def test_the_system_clock_states_its_epoch_and_notices_a_step(monkeypatch) -> None:
    clock = SystemClock(time.time_ns() - 7 * SECOND_NS)
    assert 7 <= clock.now_ns() / SECOND_NS < 9
    assert abs(clock.step_s()) < 0.05
    real = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: real() + 3 * SECOND_NS)
    assert clock.step_s() == pytest.approx(3.0, abs=0.05)
    assert clock.now_ns() / SECOND_NS < 9, "a step is not followed"


def test_a_node_imports_nothing_heavy(tmp_path) -> None:
    written(tmp_path)
    code = (
        "import sys\nfrom uwcoop.onboard.vehicle import VehicleNavigator\n"
        "from uwcoop.onboard.service import NodeService\nVehicleNavigator.from_scenario('team.json', 'V1')\n"
        "heavy = ('xarray', 'pandas', 'rosbags', 'mcap', 'h5netcdf', 'scipy', 'matplotlib')\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_sigterm_ends_a_node_in_one_line(tmp_path) -> None:
    written(tmp_path)
    process = node("V1", tmp_path, free_ports(5))
    assert "V1: team" in process.stderr.readline()
    process.send_signal(signal.SIGTERM)
    assert process.communicate(timeout=60)[1].splitlines()[-1] == "terminated"
    assert process.returncode == 143
