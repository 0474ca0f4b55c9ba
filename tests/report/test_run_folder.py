"""A run's folder: the files of one run, all of them or none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from uwcoop.experiment.run import RunResult, run
from uwcoop.report import run_folder as output
from uwcoop.scenario import load, parse


@pytest.fixture(scope="module")
def result() -> RunResult:
    return run(load("st-john", ["duration_s=60", "navigator.all.particles=100"]), ["dead-reckoning", "dmpf"])


def test_a_writer_that_fails_leaves_the_folder_as_it_was(
    result: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise OSError(28, "No space left on device")

    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(output, "_write_map", failing)
        with pytest.raises(OSError, match="No space"):
            output.write_run(result, out, lambda line: None)
        assert not list(tmp_path.iterdir())
        out.mkdir()
        for name in ("summary.json", "covariance.png", "mine.txt"):
            (out / name).write_text("old")
        with pytest.raises(OSError, match="No space"):
            output.write_run(result, out, lambda line: None)
    assert {p.name: p.read_text() for p in out.iterdir()} == dict.fromkeys(
        ("summary.json", "covariance.png", "mine.txt"), "old"
    )
    written = output.write_run(result, out, lambda line: None)
    assert {p.name for p in out.iterdir()} == {*written, "mine.txt"}, "an earlier run's pictures are gone"
    assert set(written) < set(output.RUN_FILES)


def test_tracks_come_back_from_the_file_bit_for_bit(result: RunResult, tmp_path: Path) -> None:
    notes: list[str] = []
    written = output.write_run(result, tmp_path, notes.append)
    assert written == ["summary.json", "scenario.json", "tracks.nc", "errors.png", "map.png", "replay.rrd"]
    assert not notes
    with xr.open_dataset(tmp_path / "tracks.nc") as tracks:
        # Beside them there is what other programs want: places on Earth, depth, further attributes.
        for name, variable in result.tracks.variables.items():
            assert tracks[name].dims == variable.dims, name
            assert tracks[name].dtype == variable.dtype, name
            np.testing.assert_array_equal(tracks[name].values, variable.values, err_msg=str(name))
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


def test_pictures_have_the_format_that_is_asked_for(result: RunResult, tmp_path: Path) -> None:
    output.write_run(result, tmp_path, lambda line: None)
    written = output.write_run(result, tmp_path, lambda line: None, pictures="svg")
    assert written == ["summary.json", "scenario.json", "tracks.nc", "errors.svg", "map.svg", "replay.rrd"]
    assert {p.name for p in tmp_path.iterdir()} == set(written), "the earlier run's pictures are gone"
    assert "<svg" in (tmp_path / "map.svg").read_text(encoding="utf-8")[:500]
    with pytest.raises(ValueError, match="must be one of png, pdf, svg"):
        output.write_run(result, tmp_path, lambda line: None, pictures="gif")
