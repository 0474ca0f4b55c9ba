"""The pictures of missions without terrain: what they need, what they show, and why one is not drawn."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.errors import TracksError
from uwcoop.experiment.run import RunResult
from uwcoop.figures.bytes import bytes_figure, summarised
from uwcoop.figures.origin import origin_figure
from uwcoop.figures.setup import setup_figure
from uwcoop.figures.uncertainty import uncertainty_figure
from uwcoop.viewer import posegraph, write_replay
from uwcoop.viewer.stage import Stage


@cache
def flown() -> RunResult:
    world = scenario.load("ship-and-auv", ["duration_s=420"])
    return uwcoop.run(world, ["local-only", "deif", "mdeif", "nekf"], seed=1, clouds=False)


def test_uncertainty_has_a_line_for_each_navigator_in_each_panel() -> None:
    result = flown()
    figure = uncertainty_figure(result.tracks, result.packets)
    stated, true = figure.axes[2], figure.axes[3]
    lines = [line for line in stated.get_lines() if not line.get_label().startswith("_")]
    assert [line.get_label() for line in true.get_lines()] == ["0", "1", "2", "3"]
    spread = np.sqrt(np.trace(result.tracks.covariance_m2.values[2, 1], axis1=-2, axis2=-1))
    np.testing.assert_array_equal(lines[2].get_ydata(), spread)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "local-only",
        "deif",
        "mdeif",
        "nekf",
    ]


def test_the_origin_is_compared_at_arrivals_alone() -> None:
    result = flown()
    top, middle, bottom = origin_figure(result.tracks).axes
    heard = result.tracks.heard.sel(navigator="mdeif").values[1].sum()
    assert all(len(line.get_xdata()) == heard for line in top.get_lines())
    assert max(float(np.max(line.get_ydata())) for line in top.get_lines()) < 1e-6
    assert [text.get_text() for text in middle.get_legend().get_texts()] == ["ship's packets"]
    age = bottom.get_lines()[0].get_ydata()
    assert 10 < np.nanmax(age) < 300
    with pytest.raises(TracksError, match="needs the navigators mdeif-paper or mdeif and one of deif"):
        origin_figure(result.tracks.sel(navigator=["mdeif", "nekf"]))


def test_the_setup_shows_the_cycle_and_what_arrives() -> None:
    result = flown()
    figure = setup_figure(result.log, result.tracks)
    titles = [axes.get_title() or axes.get_title(loc="left") for axes in figure.get_axes()]
    assert "one cycle: 10 slots of 14.5 s, 145 s" in titles
    words = figure.get_axes()[-1].texts[0].get_text()
    assert "DVL" in words
    assert "25 Hz" in words
    assert "0.05 m/s" in words


def test_bytes_are_pooled_by_variant_and_navigator() -> None:
    row = {"rmse_m": 3.0, "anees": 2.0, "packet_bytes_mean": 47.0, "navigator": "nekf", "form": "f64"}
    rows = [row, {**row, "rmse_m": 4.0}, {**row, "navigator": "silent", "packet_bytes_mean": None}]
    found = summarised(rows, ["form"])
    assert found[0] == {
        "variant": "form f64", "navigator": "nekf", "rmse_m": pytest.approx(12.5**0.5), "anees": 2.0, "bytes": 47.0,
    }  # fmt: skip
    assert found[1]["bytes"] is None
    axes = bytes_figure(rows, ["form"], title="x").axes[0]
    assert axes.get_xscale() == "log"
    with pytest.raises(TracksError, match="no navigator sends packets"):
        bytes_figure(rows[2:], title="x")


def test_the_replay_holds_graphs_of_those_who_have_one(tmp_path: Path) -> None:
    result = flown()
    stage = Stage.of(result.tracks, None, result.log)
    paths = posegraph.kept(stage, result.tracks, result.packets)
    assert set(paths) == {"deif", "mdeif"}
    assert all("ship_at_auv" in path for path in paths["mdeif"])
    write_replay(tmp_path / "r.rrd", result.tracks, result.packets, None, None, result.log)
    from rerun.chunk import RrdReader

    names = {str(chunk.entity_path) for chunk in RrdReader(str(tmp_path / "r.rrd")).stream()}
    for part in ("nodes", "edges", "ranges"):
        assert any(name.endswith(f"mdeif/graph/ship_at_auv/{part}") for name in names), names
    assert any(name.endswith("mdeif/graph/ship_origin") for name in names)
