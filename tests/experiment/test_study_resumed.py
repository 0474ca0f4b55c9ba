"""Whatever ends a study or one of its workers: nothing is lost, nothing is there twice, no process stays."""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import time
from pathlib import Path

import pytest

from study_process import children, finished, gone, rows, study, wait_until


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """A study that nothing disturbed, and the seconds that it takes on this machine now."""
    out, start = tmp_path_factory.mktemp("whole") / "out", time.perf_counter()
    ended = finished(out, "--processes", 2)
    assert ended.returncode == 0, ended.stderr
    return out, time.perf_counter() - start


def check_ended(whole: tuple[Path, float], out: Path, moments: int, seed: int) -> None:
    rng = random.Random(seed)
    for _ in range(moments):
        number = rng.choice([signal.SIGKILL, signal.SIGTERM])
        with subprocess.Popen(
            study(out, "--resume", "--processes", 2), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        ) as started:
            time.sleep(rng.uniform(0.3, 1.0) * whole[1])
            below = children(started.pid)
            started.send_signal(number)
            started.communicate(timeout=120)
        wait_until(lambda: gone(below), 30)  # noqa: B023 - it is waited for here
    ended = finished(out, "--resume", "--processes", 2)
    assert ended.returncode == 0, ended.stderr
    assert rows(out) == rows(whole[0])


def test_ended_twice_a_study_equals_the_whole(whole: tuple[Path, float], tmp_path: Path) -> None:
    check_ended(whole, tmp_path / "out", 2, 1)


@pytest.mark.long
def test_ended_20_times_a_study_equals_the_whole(whole: tuple[Path, float], tmp_path: Path) -> None:
    check_ended(whole, tmp_path / "out", 20, 2)


def test_a_worker_that_is_killed_is_replaced(whole: tuple[Path, float], tmp_path: Path) -> None:
    out = tmp_path / "out"
    with subprocess.Popen(
        study(out, "--processes", 2), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as started:
        wait_until(lambda: (out / "runs.csv").exists() or started.poll() is not None)
        os.kill(children(started.pid)[-1], signal.SIGKILL)
        _, err = started.communicate(timeout=120)
        assert started.returncode == 0, err
    assert rows(out) == rows(whole[0])


def test_a_full_disk_ends_a_study_in_one_line_and_costs_one_mission(
    whole: tuple[Path, float], tmp_path: Path
) -> None:
    out, size = tmp_path / "out", (whole[0] / "runs.csv").stat().st_size

    def small_files() -> None:  # the write that would make the table longer fails, after a part of it
        resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, resource.RLIM_INFINITY))

    ended = finished(out, "--processes", 1, preexec_fn=small_files)
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[-1].startswith("error: "), ended.stderr
    assert "Traceback" not in ended.stderr
    kept = len(rows(out))
    assert 12 < kept < len(rows(whole[0])) - 12
    again = finished(out, "--resume", "--processes", 1)
    assert again.returncode == 0, again.stderr
    assert rows(out) == rows(whole[0])
