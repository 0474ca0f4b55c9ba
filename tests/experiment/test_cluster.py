"""Studies on a Dask cluster: the same rows as here, whatever dies meanwhile; what is lost is flown again."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from study_process import children, finished, gone, rows, study, wait_until

pytest.importorskip("distributed")

TESTS = Path(__file__).parents[1]


@contextmanager
def cluster(workers: int = 2) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The program of a cluster and its address; all of it is gone afterwards."""
    program = [sys.executable, str(TESTS / "local_cluster.py"), str(workers)]
    with subprocess.Popen(
        program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as started:
        assert started.stdout is not None
        try:
            yield started, started.stdout.readline().strip()
        finally:
            below = children(started.pid)
            with suppress(subprocess.TimeoutExpired):
                started.communicate("", timeout=20)
            for pid in [started.pid, *below]:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)


def workers_of(address: str) -> list[int]:
    """Process ids of a cluster's workers."""
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        return list(client.run(os.getpid).values())


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "out"
    ended = finished(out, "--processes", 1)
    assert ended.returncode == 0, ended.stderr
    return out


def test_a_cluster_gives_the_same_rows_also_when_a_worker_dies(whole: Path, tmp_path: Path) -> None:
    with cluster() as (_, address):
        undisturbed = finished(tmp_path / "one", "--scheduler", address)
        assert undisturbed.returncode == 0, undisturbed.stderr
        assert rows(tmp_path / "one") == rows(whole)
        two = tmp_path / "two"
        with subprocess.Popen(study(two, "--scheduler", address), stdout=subprocess.DEVNULL) as started:
            wait_until(lambda: (two / "runs.csv").exists() or started.poll() is not None)
            os.kill(workers_of(address)[0], signal.SIGKILL)
            assert started.wait(120) == 0
        assert rows(two) == rows(whole)


def disturbed(address: str, out: Path, number: signal.Signals, after_s: float) -> None:
    arguments = study(out, "--resume", "--scheduler", address)
    with subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as started:
        time.sleep(after_s)
        started.send_signal(number)
        started.communicate(timeout=60)


def check_resumed(whole: Path, out: Path, moments: int, seed: int) -> None:
    """A study that is ended at random moments, and whose cluster is then killed, goes on here and equals the whole."""
    rng = random.Random(seed)
    with cluster() as (program, address):
        for _ in range(moments):
            number = rng.choice([signal.SIGKILL, signal.SIGTERM])
            disturbed(address, out, number, rng.uniform(1.0, 4.0))
        with subprocess.Popen(
            study(out, "--resume", "--scheduler", address),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        ) as started:
            wait_until(lambda: (out / "runs.csv").exists() or started.poll() is not None)
            below = children(program.pid)
            assert below
            program.kill()
            _, err = started.communicate(timeout=120)
            assert started.returncode in (0, 2)
            if started.returncode == 2:  # killed while it flew, or before the study had joined it
                said = ("error: the Dask scheduler at ", "error: no Dask scheduler answers at ")
                assert err.splitlines()[-1].startswith(said), err
        wait_until(lambda: gone(below), 30)
    ended = finished(out, "--resume", "--processes", 1)
    assert ended.returncode == 0, ended.stderr
    assert rows(out) == rows(whole)


def test_a_dead_scheduler_loses_nothing(whole: Path, tmp_path: Path) -> None:
    check_resumed(whole, tmp_path / "out", 1, 1)


@pytest.mark.long
def test_a_study_on_a_cluster_that_is_ended_20_times_equals_the_whole(whole: Path, tmp_path: Path) -> None:
    check_resumed(whole, tmp_path / "out", 20, 2)


def test_no_scheduler_there_is_said_in_one_line(tmp_path: Path) -> None:
    for address, says in (
        ("127.0.0.1:what", "is neither tcp://HOST:PORT"),
        ("tcp://127.0.0.1:9", "no Dask scheduler"),
    ):
        ended = finished(tmp_path / "out", "--scheduler", address)
        assert ended.returncode == 2
        assert says in ended.stderr.splitlines()[-1], ended.stderr
    both = finished(tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9", "--processes", 2)
    assert (both.returncode, both.stderr.count("\n")) == (2, 1)
    assert "scheduler and processes are both given" in both.stderr
    assert not (tmp_path / "out").exists()
