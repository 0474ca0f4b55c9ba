"""A long dive of three nodes: memory stays, the journal is rotated, and a node resumes from its last file."""

from __future__ import annotations

import os

import pytest

import uwcoop
from onboard_dive import SECOND_NS, Dive, scenario
from uwcoop.onboard.journal import journal_files

HOURS = 4
"""Shortened: what grows with events shows in a sixth of a day."""


def resident_bytes() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class QuietDive(Dive):
    """Keeps nothing of what is said but how much it was."""

    estimates = 0

    def _out(self, message) -> None:
        super()._out(message)
        self.estimates += message["type"] == "estimate"
        self.said.clear()
        self.launched.clear()


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs /proc")
def test_memory_is_flat_over_hours_and_the_journal_is_rotated(tmp_path) -> None:
    mission = scenario(f"duration_s={HOURS * 3600}")
    dive = QuietDive(uwcoop.simulate(mission), mission, tmp_path)
    seen: dict[int, int] = {}
    quarter_ns = HOURS * 900 * SECOND_NS

    def before_step(t_ns: int) -> None:
        if t_ns % (30 * SECOND_NS) == 0:
            for node in dive.nodes:
                node.checkpoint()
        if t_ns % quarter_ns == 0:
            seen[t_ns // quarter_ns] = resident_bytes()

    dive.fly(before_step)
    assert dive.estimates == 3 * (HOURS * 3600 + 1)
    # Three nodes, and the water's list of launches. What grows with the events grows in the second half as in the first;
    # before it, the allocator's pools fill up.
    assert seen[4] - seen[2] < 4e6, seen
    assert seen[4] - seen[1] < 16e6, seen
    files = journal_files(tmp_path / "0")
    assert len(files) > 20
    assert max(path.stat().st_size for path in files) < 20_000 + 10_000
    state = dive.nodes[0].vehicle.save()
    dive.kill(0)
    assert dive.nodes[0].vehicle.save() == state
    assert dive.nodes[0].resumed < 200
