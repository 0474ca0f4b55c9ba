"""A short mission for nodes, and how it is flown in this process or by processes of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import uwcoop
from uwcoop import scenario as scenarios
from uwcoop.missionlog import MissionLog
from uwcoop.onboard import Journal, Node, VehicleNavigator, event_of
from uwcoop.onboard.channel import Water, sensor_messages
from uwcoop.onboard.messages import Message
from uwcoop.scenario.models import Scenario

SECOND_NS = 1_000_000_000
SETTINGS = ("duration_s=60", 'navigators=["team"]', "navigator.team.particles=300")


def scenario(*more: str) -> Scenario:
    return scenarios.load("flat-bay", [*SETTINGS, *more])


def tracks_by_time(log: MissionLog, navigator: str = "team") -> dict[int, tuple[NDArray, NDArray]]:
    """(positions, covariances) of all vehicles as `uwcoop run` gives them, by time in ns."""
    tracks = uwcoop.run(log, [navigator], clouds=False).tracks
    times = np.round(tracks.time.to_numpy() * 1e9).astype(np.int64).tolist()
    position = tracks.position_m.sel(navigator=navigator).to_numpy()
    covariance = tracks.covariance_m2.sel(navigator=navigator).to_numpy()
    return {t_ns: (position[:, k], covariance[:, k]) for k, t_ns in enumerate(times)}


def assert_same(said: list[Message], expected: dict[int, tuple[NDArray, NDArray]]) -> int:
    """Every estimate is the replay's to the last bit; gives how many were compared."""
    compared = 0
    for message in said:
        if message["type"] != "estimate":
            continue
        position, covariance = (rows[message["vehicle"]] for rows in expected[message["t_ns"]])
        if message["mean_m"] == [None, None]:
            assert np.isnan(position).all()
        else:
            assert message["mean_m"] == position.tolist(), message
            assert message["covariance_m2"] == covariance.ravel().tolist(), message
        compared += 1
    return compared


class Dive:
    """A mission's nodes in this process, stepped together; a node can be dropped and made anew from its journal."""

    def __init__(self, log: MissionLog, mission: Scenario, folder: Path | None = None) -> None:
        self.log, self.mission, self.folder = log, mission, folder
        self.water = Water(log)
        self.said: list[Message] = []
        self.launched: list[Message] = []
        self._arriving: list[Message] = []
        self.nodes = [self.make(k) for k in range(len(log.vehicles))]

    def make(self, vehicle: int) -> Node:
        made = VehicleNavigator.from_scenario(self.mission, vehicle)
        journal = None if self.folder is None else Journal(self.folder / str(vehicle), made.digest, 20_000)
        return Node(made, self._out, journal)

    def kill(self, vehicle: int) -> None:
        """The process is gone, its file descriptors with it; a new one takes its place."""
        journal = self.nodes[vehicle].journal
        assert journal is not None
        os.close(journal._file)
        os.close(journal._lock)
        self.nodes[vehicle] = self.make(vehicle)

    def _out(self, message: Message) -> None:
        if message["type"] == "launch":
            self.launched.append(message)
            packet = bytes.fromhex(message["bytes"])
            self._arriving += self.water.launch(message["vehicle"], message["tol_ns"], packet)
        else:
            self.said.append(message)

    def fly(self, before_step=lambda t_ns: None) -> None:
        streams = [sensor_messages(self.log, k) for k in range(len(self.log.vehicles))]
        heads = [next(stream, None) for stream in streams]
        instants = sorted(
            {*range(0, self.log.duration_ns + 1, SECOND_NS), *self.log.slots["tol_ns"].tolist()}
        )
        for t_ns in instants:
            before_step(t_ns)
            for k, node in enumerate(self.nodes):
                while (head := heads[k]) is not None and head["t_ns"] <= t_ns:
                    assert node.take(event_of(head))
                    heads[k] = next(streams[k], None)
                for message in [m for m in self._arriving if m["vehicle"] == k and m["t_ns"] <= t_ns]:
                    self._arriving.remove(message)
                    assert node.take(event_of(message))
                node.advance(t_ns)


def free_ports(count: int) -> int:
    """The first of so many consecutive UDP ports that are free now."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            base = probe.getsockname()[1]
        if base + count >= 65500:
            continue
        try:
            for port in range(base, base + count):
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                    probe.bind(("127.0.0.1", port))
        except OSError:
            continue
        return base


def program(*arguments: str, folder: Path, **more) -> subprocess.Popen:
    """`uwcoop ARGUMENTS` in a folder."""
    command = [sys.executable, "-m", "uwcoop", *arguments]
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, **more)
