"""A small study as a command of its own, and the processes below it: for tests in which things are killed."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SMALL = ("--set", "duration_s=60", "--set", "navigator.all.particles=100")
RUNS = 24
LONGEST_S = 300.0


def study(out: Path, *more: object) -> list[str]:
    """The command."""
    arguments = ("study", "flat-bay", "--runs", RUNS, "-n", "dead-reckoning,mpf", *SMALL, "-o", out, *more)
    return [sys.executable, "-m", "uwcoop", *map(str, arguments)]


def finished(out: Path, *more: object, **how: Any) -> subprocess.CompletedProcess[str]:
    """The command, run to its end."""
    return subprocess.run(
        study(out, *more), capture_output=True, text=True, timeout=LONGEST_S, check=False, **how
    )


def rows(out: Path) -> list[str]:
    """The lines of a study's table without the run time, which stands last."""
    return [line.rpartition(",")[0] for line in (out / "runs.csv").read_text().splitlines()]


def children(pid: int) -> list[int]:
    """Processes below one, as Linux lists them."""
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found += [child, *children(child)]
    return found


def wait_until(sign: Callable[[], bool], seconds: float = 120.0) -> None:
    """Fail if a sign does not show in time."""
    end = time.monotonic() + seconds
    while not sign():
        assert time.monotonic() < end
        time.sleep(0.02)


def gone(pids: list[int]) -> bool:
    """Whether none of the processes runs; zombies that nobody has waited for do not."""
    return all(_state(pid) in ("", "Z") for pid in pids)


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return ""
