"""CPU time of `landmark-paper` against its number of particles: a mission, and the compression at an exchange."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from uwcoop import scenario
from uwcoop.experiment.run import native_mission, replay_for
from uwcoop.missionlog import MissionLog
from uwcoop.world.simulate import simulate

__all__ = ["cost"]


def cost(name: str, particles: Sequence[int], repeats: int) -> list[dict[str, Any]]:
    """For each number of particles `mission_s`, `compression_s` and `rate` (times real time), the least of `repeats`."""
    rows = []
    for count in particles:
        loaded = scenario.load(name, [f"navigator.landmark-paper.particles={count}"])
        log = simulate(loaded, 0)
        spent = [_once(log) for _ in range(repeats)]
        whole, compression = (min(s[k] for s in spent) for k in (0, 1))
        rows.append({"particles": count, "mission_s": whole, "compression_s": compression,
                     "rate": loaded.duration_s / whole})  # fmt: skip
    return rows


def _once(log: MissionLog) -> tuple[float, float]:
    none = np.array([log.duration_ns], dtype=np.int64)
    replay = replay_for(log, native_mission(log), "landmark-paper", None, log.seed, none)
    total, slots = 0.0, []
    for tol_ns in log.slots["tol_ns"].tolist():
        total += _timed(replay, tol_ns)
        slots.append(_timed(replay, tol_ns + 1))
    total += sum(slots) + _timed(replay, 2**62)
    return total, float(np.median(slots))


def _timed(replay: Any, until_ns: int) -> float:
    start = time.process_time()
    replay.run(until_ns)
    return time.process_time() - start
