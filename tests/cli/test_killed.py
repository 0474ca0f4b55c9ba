"""Ended at any moment, a command leaves old or new results, never a mixture, and its next start removes what it left."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.world.simulate import simulate

SMALL = ("--set", "duration_s=60", "--set", "navigator.all.particles=50")
STARTED_S = 300.0
"""A command that has not begun to work after this time, on a busy machine, never will."""


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "uwcoop", *map(str, arguments)]


def finished(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), capture_output=True, text=True, timeout=STARTED_S, check=False)


def run_arguments(seed: int, out: Path) -> tuple[object, ...]:
    return "run", "flat-bay", "-n", "dead-reckoning,mpf", "--seed", seed, *SMALL, "-o", out


def seed_of(out: Path) -> set[int]:
    """The seeds that a run's files tell: one, or none where there are no files."""
    import xarray as xr

    seeds = set()
    for name in ("summary.json", "scenario.json"):
        if (out / name).exists():
            seeds.add(int(json.loads((out / name).read_text())["seed"]))
    if (out / "tracks.nc").exists():
        with xr.open_dataset(out / "tracks.nc") as tracks:
            seeds.add(int(tracks.attrs["seed"]))
    return seeds


def left_over(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.rglob(".*"))


def processes_below(pid: int) -> set[int]:
    """Children of a process and theirs, as Linux lists them."""
    found: set[int] = set()
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found |= {child} | processes_below(child)
    return found


def running(pids: set[int]) -> set[int]:
    """Which of them still run; zombies that nobody has waited for do not."""
    alive = set()
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if state != "Z":
            alive.add(pid)
    return alive


def gone(pids: set[int]) -> bool:
    for _ in range(200):
        if not running(pids):
            return True
        time.sleep(0.05)
    return False


def killed_after(seconds: float, number: signal.Signals, *arguments: object) -> tuple[int, str, set[int]]:
    """Exit code, stderr and processes of a command that gets a signal after a time."""
    started = subprocess.Popen(
        command(*arguments), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    time.sleep(seconds)
    below = processes_below(started.pid)
    started.send_signal(number)
    _, err = started.communicate(timeout=STARTED_S)
    return started.returncode, err, below


@pytest.fixture(scope="module")
def old_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """A run of seed 1, and how long it takes on this machine now, so that random moments fall into it."""
    start = time.perf_counter()
    out = tmp_path_factory.mktemp("old") / "out"
    ended = finished(*run_arguments(1, out))
    assert ended.returncode == 0, ended.stderr
    return out, time.perf_counter() - start


def check_run(moments: int, old: tuple[Path, float], folder: Path, seed: int) -> None:
    rng = random.Random(seed)
    out, seconds = folder / "out", old[1]
    shutil.copytree(old[0], out)
    (out / "mine.txt").write_text("stays")
    for _ in range(moments):
        code, _, _ = killed_after(rng.uniform(0, 1.1 * seconds), signal.SIGKILL, *run_arguments(2, out))
        assert code in (0, -signal.SIGKILL)
        assert len(seed_of(out)) <= 1, "old and new side by side"
    assert finished(*run_arguments(3, out)).returncode == 0
    assert seed_of(out) == {3}
    assert not left_over(folder)
    assert (out / "mine.txt").read_text() == "stays"


def check_simulate(moments: int, old: tuple[Path, float], folder: Path, seed: int) -> None:
    rng, seconds = random.Random(seed), old[1]
    log = folder / "mission.mcap"
    write_log(simulate("flat-bay", 1), log)
    for _ in range(moments):
        arguments = ("simulate", "flat-bay", "--seed", 2, "-o", log)
        code, _, _ = killed_after(rng.uniform(0, seconds), signal.SIGKILL, *arguments)
        assert code in (0, -signal.SIGKILL)
        assert load_log(log).seed in (1, 2)
    assert finished("simulate", "flat-bay", "--seed", 3, "-o", log).returncode == 0
    assert load_log(log).seed == 3
    assert [p.name for p in folder.iterdir()] == ["mission.mcap"]


def study_arguments(out: Path) -> tuple[object, ...]:
    return "study", "flat-bay", "--runs", 4, "-n", "dead-reckoning", *SMALL, "--processes", 2, "-o", out


def summary(out: Path) -> list[dict[str, object]]:
    """What a study's summary says of each navigator, run times aside."""
    variants = json.loads((out / "summary.json").read_text())["variants"]
    return [
        {k: v for k, v in n.items() if k != "seconds"} for w in variants for n in w["navigators"].values()
    ]


def check_study(moments: int, old: tuple[Path, float], folder: Path, seed: int) -> None:
    rng, seconds = random.Random(seed), old[1]
    assert finished(*study_arguments(folder / "whole")).returncode == 0
    out = folder / "out"
    for _ in range(moments):
        arguments = (*study_arguments(out), "--resume")
        code, _, below = killed_after(rng.uniform(0, 2 * seconds), signal.SIGKILL, *arguments)
        assert code in (0, -signal.SIGKILL)
        assert gone(below), "workers outlive a study that was killed"
        if (out / "summary.json").exists():
            assert summary(out) == summary(folder / "whole")
    assert finished(*study_arguments(out), "--resume").returncode == 0
    assert not left_over(folder)
    rows = [(folder / name / "runs.csv").read_text().splitlines() for name in ("whole", "out")]
    assert len(rows[0]) == len(rows[1]) == 1 + 4 * 3


def test_killed_at_random_moments_old_or_new(old_run: tuple[Path, float], tmp_path: Path) -> None:
    for name, check in (("run", check_run), ("simulate", check_simulate), ("study", check_study)):
        (tmp_path / name).mkdir()
        check(1, old_run, tmp_path / name, 1)


@pytest.mark.long
@pytest.mark.parametrize(("check", "moments"), [(check_run, 34), (check_simulate, 33), (check_study, 33)])
def test_killed_at_100_random_moments_old_or_new(
    check: object, moments: int, old_run: tuple[Path, float], tmp_path: Path
) -> None:
    check(moments, old_run, tmp_path, 2)  # type: ignore[operator]


@contextmanager
def at_work(sign: Callable[[], bool], *arguments: object) -> Iterator[subprocess.Popen[str]]:
    """A command that has shown that it works; it does not outlive the block."""
    with subprocess.Popen(
        command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as started:
        try:
            end = time.monotonic() + STARTED_S
            while not sign():
                assert started.poll() is None, started.communicate()
                assert time.monotonic() < end
                time.sleep(0.02)
            yield started
        finally:
            if started.poll() is None:
                started.kill()


@pytest.mark.parametrize(("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")])
def test_a_signal_ends_a_study_in_one_line_with_its_workers(
    number: signal.Signals, word: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    arguments = ("study", "flat-bay", "--runs", 500, "-n", "mpf", "--processes", 2, "-o", out)
    with at_work((out / "runs.csv").exists, *arguments) as started:
        below = processes_below(started.pid)
        assert below
        second = finished(*study_arguments(out), "--resume")
        assert (second.returncode, second.stderr.count("\n")) == (2, 1)
        assert "is being written by another study" in second.stderr
        started.send_signal(number)
        stdout, stderr = started.communicate(timeout=STARTED_S)
    assert (started.returncode, stdout, stderr) == (128 + number, "", f"{word}\n")
    assert gone(below)
    assert not left_over(tmp_path)
    assert {p.name for p in out.iterdir()} == {"runs.csv", "study.json"}


@pytest.mark.parametrize(("number", "name"), [(signal.SIGINT, "tracks.nc"), (signal.SIGTERM, "replay.rrd")])
def test_a_signal_while_a_file_is_written_leaves_nothing(
    number: signal.Signals, name: str, tmp_path: Path
) -> None:
    arguments = ("run", "flat-bay", "-n", "dead-reckoning,mpf", "-o", tmp_path / "out")
    stem = name.partition(".")[0]
    with at_work(lambda: any(tmp_path.glob(f".out.*/*{stem}*")), *arguments) as started:
        started.send_signal(number)
        stdout, stderr = started.communicate(timeout=STARTED_S)
    lines = [line for line in stderr.splitlines() if not line.startswith("chart: ")]
    assert (started.returncode, stdout, len(lines)) == (128 + number, "", 1), stderr
    assert not os.listdir(tmp_path)
