"""Thousands of damaged logs, recordings, tracks and scenarios: each is read, or refused in one line and little memory."""

from __future__ import annotations

import gzip
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from scipy.io import savemat

from sample_log import rewrite, sample_chart, sample_log
from uwcoop.missionlog.mcap import write_log

HERE = Path(__file__).parent
READERS = HERE.parent / "mutated_files.py"
PEAK_MB, SLOWEST_S = 500, 10
SCENARIO = """\
name = "small"
duration_s = 20
[[vehicles]]
name = "a"
[vehicles.track]
file = "track.csv"
columns = { time = "t", east = "e", north = "n", sounding = "depth" }
[acoustics]
modem = "micromodem-64"
slot_s = 3.0
max_range_m = 950.0
[navigator.all]
particles = 20
"""


def beside(name: str) -> Any:
    """A test module of this folder, for what it makes up."""
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def corpus(folder: Path) -> Path:
    """A folder for each kind of file, with how the command line gets it."""

    def kind(name: str, *arguments: str) -> Path:
        (folder / name).mkdir(parents=True)
        (folder / name / "argument").write_text(
            json.dumps(["run", *arguments, "--navigator", "dead-reckoning"])
        )
        return folder / name

    log = sample_log(seconds=12, chart=sample_chart())
    write_log(log, kind("log", str(folder / "log/mission.mcap")) / "mission.mcap")
    content = (folder / "log/mission.mcap").read_bytes()
    for compression in CompressionType:
        name = f"log-{compression.name.lower()}-without-crc"
        path = folder / name / "mission.mcap"
        kind(name, str(path))
        path.write_bytes(rewrite(content, compression=compression))
    graph = kind("graph", str(folder / "graph/made.pyfg")) / "made.pyfg"
    graph.write_text(beside("test_datasets").graph_text(count=30))
    for name, packed in (("plaza", False), ("plaza-packed", True)):
        savemat(
            kind(name, str(folder / name / "Plaza1_.mat")) / "Plaza1_.mat", plaza(), do_compression=packed
        )
    for name, packed in (("robots", False), ("robots-packed", True)):
        kind(name, str(folder / name))
        beside("test_mrclam").made(folder / name, gz=packed)
    for name, packed in (("track", False), ("track-packed", True)):
        home = kind(name, str(folder / name / "scenario.toml"))
        rows = "t,e,n,depth\n" + "".join(f"{t},{0.5 * t},{0.1 * t},{8 + 0.1 * t}\n" for t in range(25))
        (home / ("track.csv.gz" if packed else "track.csv")).write_bytes(
            gzip.compress(rows.encode()) if packed else rows.encode()
        )
        (home / "scenario.toml").write_text(
            SCENARIO.replace("track.csv", "track.csv.gz") if packed else SCENARIO
        )
    return folder


def plaza() -> dict[str, np.ndarray[Any, Any]]:
    t = np.arange(40.0)
    one = np.ones(40)
    return {
        "DR": np.column_stack([t, 0.5 * one, 0.02 * one]),
        "GT": np.column_stack([t, 0.5 * t, 0.1 * t, 0.02 * t]),
        "TD": np.column_stack([t, 3 * one, 1 + t % 2, 30 + t]),
        "TL": np.array([[1.0, 0.0, 30.0], [2.0, 40.0, 0.0]]),
    }


def read_mutated(count: int, seed: int, folder: Path, timeout_s: float) -> dict[str, Any]:
    command = [sys.executable, str(READERS), str(seed), str(count), str(folder)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
    assert ended.returncode == 0, ended.stderr[-3000:]
    told: dict[str, Any] = json.loads(ended.stdout)
    return told


def check(told: dict[str, Any], count: int) -> None:
    assert len(told["unharmed"]) == 11
    assert set(map(tuple, told["unharmed"].values())) == {(0,)}, "a file of the corpus is not read as it is"
    assert told["bad"] == []
    assert told["refused"] + told["read"] == count
    assert told["refused"] > 0.4 * count, "mutations must damage"
    assert told["peak_mb"] <= PEAK_MB


def test_200_mutated_files_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    check(read_mutated(200, 1, corpus(tmp_path / "corpus"), 300), 200)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_10000_mutated_files_are_read_or_refused_in_one_line(seed: int, tmp_path: Path) -> None:
    told = read_mutated(1000, 100 + seed, corpus(tmp_path / "corpus"), 3000)
    check(told, 1000)
    assert told["slowest_s"] <= SLOWEST_S, told["slowest"]
