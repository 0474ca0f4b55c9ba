"""A run's folder: each file whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from uwcoop.experiment.run import RunResult, run
from uwcoop.report import run_folder as output
from uwcoop.report.atomic_files import atomic_write
from uwcoop.scenario import load, parse


@pytest.fixture(scope="module")
def result() -> RunResult:
    return run(load("st-john", ["duration_s=60", "navigator.all.particles=100"]), ["dead-reckoning", "dmpf"])


def _interrupted(target: Path) -> None:
    with atomic_write(target) as partial:
        partial.write_text("half")
        assert partial.suffix == ".txt"
        raise KeyboardInterrupt


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        _interrupted(target)
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert target.read_text() == "old"
    with atomic_write(target) as partial:
        partial.write_text("new")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert target.read_text() == "new"


def test_a_writer_that_fails_leaves_the_other_files_whole(
    result: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(output, "_write_map", failing)
    with pytest.raises(OSError, match="No space"):
        output.write_run(result, tmp_path / "out", lambda line: None)
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"summary.json", "scenario.json", "tracks.nc", "errors.png"}


def test_tracks_come_back_from_the_file_bit_for_bit(result: RunResult, tmp_path: Path) -> None:
    notes: list[str] = []
    written = output.write_run(result, tmp_path, notes.append)
    assert written == ["summary.json", "scenario.json", "tracks.nc", "errors.png", "map.png", "replay.rrd"]
    assert not notes
    with xr.open_dataset(tmp_path / "tracks.nc") as tracks:
        assert tracks.identical(result.tracks)
        assert tracks["position_m"].attrs["units"] == "m"
        assert tracks["received"].dtype == np.bool_
    assert json.loads((tmp_path / "summary.json").read_text(encoding="utf-8")) == result.summary


def test_the_resolved_scenario_states_every_option_of_who_took_part(result: RunResult) -> None:
    resolved = output.resolved_scenario(result)
    assert resolved["navigator"]["dmpf"]["window"] == 14
    assert resolved["navigator"]["dmpf"]["particles"] == 100
    assert "mpf" not in resolved["navigator"] or "monitor" not in resolved["navigator"]["mpf"]
    assert parse(resolved).seed == result.log.seed


def test_a_mission_without_a_chart_has_a_map_and_a_replay_all_the_same(
    result: RunResult, tmp_path: Path
) -> None:
    from dataclasses import replace

    bare = replace(result, log=replace(result.log, chart=None))
    notes: list[str] = []
    written = output.write_run(bare, tmp_path, notes.append)
    assert set(written) == {
        "summary.json",
        "scenario.json",
        "tracks.nc",
        "errors.png",
        "map.png",
        "replay.rrd",
    }
    assert not notes
