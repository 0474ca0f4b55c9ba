"""A chart whose error grows with its slope: found from residuals, kept with the chart, handed to navigators."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uwcoop.charts import Chart, grid_and_judge, load_chart
from uwcoop.charts.gridding import Soundings
from uwcoop.charts.raster import Quality
from uwcoop.charts.slopes import node_sigma, slope_at
from uwcoop.errors import ChartError
from uwcoop.scenario import load
from uwcoop.world.simulate import simulate

STEEP, OFF_M = 0.3, 3.0


def half_steep() -> Chart:
    """Level in the west, a slope of 0.3 in the east."""
    east = np.broadcast_to(2.0 * np.arange(101.0), (51, 101))
    return Chart((20 + STEEP * np.maximum(east - 100, 0)).astype(np.float32), 0.0, 0.0, 2.0)


def surveyed(*, by_slope: bool) -> Chart:
    """Three surveys of it whose positions err by 3 m each, the depths by 5 cm."""
    rng = np.random.default_rng(4)
    parts = []
    for k in range(3):
        at = rng.uniform((0, 0), (200, 100), (1500, 2))
        shift = rng.normal(0, OFF_M, (10, 2))[(at[:, 1] // 10).astype(int)]
        depth = 20 + STEEP * np.maximum(at[:, 0] + shift[:, 0] - 100, 0) + rng.normal(0, 0.05, len(at))
        parts.append(np.column_stack([at, depth, np.full(len(at), k)]))
    e, n, z, survey = np.concatenate(parts).T
    quality = Quality(by_slope=by_slope)
    return grid_and_judge(Soundings(e, n, z, survey), cell_m=2.0, quality=quality).chart


def test_level_ground_errs_less_than_steep_ground() -> None:
    told, plain = surveyed(by_slope=True), surveyed(by_slope=False)
    assert (plain.horizontal_error_m, plain.level_sigma_m) == (0, 0)
    assert told.sigma_map_m == plain.sigma_map_m
    # 3 m each; the chart of the others averages them over neighbouring strips.
    assert 1.5 < told.horizontal_error_m < 4
    assert any("by slope" in note for note in told.notes)
    level, steep = told.sigma_at([[40, 50], [160, 50]])
    assert level < 0.2 < 0.5 < steep
    assert plain.sigma_at([[40, 50], [160, 50]]) == pytest.approx(plain.sigma_map_m)


def test_sigma_of_each_node_follows_the_slope() -> None:
    chart = replace(half_steep(), sigma_map_m=0.7, horizontal_error_m=4.0, level_sigma_m=0.1)
    sigma = node_sigma(chart)
    assert sigma[25, 10] == pytest.approx(0.1)
    assert sigma[25, 80] == pytest.approx(np.hypot(0.1, 4 * STEEP), rel=1e-4)
    assert sigma[0, 0] == pytest.approx(0.1), "at the edge the slope of one side"
    assert np.all(node_sigma(replace(chart, horizontal_error_m=0.0)) == 0.7)
    assert slope_at(chart, np.array([160.0]), np.array([50.0])) == pytest.approx([STEEP], rel=1e-4)


def test_a_chart_keeps_what_it_says_of_slopes() -> None:
    chart = replace(half_steep(), sigma_map_m=0.7)
    told = replace(chart, horizontal_error_m=4.0, level_sigma_m=0.1)
    assert told != chart
    again = Chart.from_bytes(told.to_bytes())
    assert again == told
    assert (again.horizontal_error_m, again.level_sigma_m) == (4.0, 0.1)
    assert b"horizontal" not in chart.to_bytes()
    with pytest.raises(ChartError, match="horizontal_error_m -1"):
        replace(chart, horizontal_error_m=-1)


def test_a_surveyed_chart_says_so_and_a_grid_cannot(tmp_path: Path) -> None:
    spec = ["duration_s=30", "chart.survey.each_mission=false"]
    by_slope = simulate(load("surveyed-bay", spec), 0).chart
    assert by_slope is not None
    assert by_slope.horizontal_error_m > 2 > by_slope.level_sigma_m > 0
    grid = tmp_path / "a.asc"
    grid.write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n5 5\n5 5\n")
    with pytest.raises(ChartError, match="error_by_slope are for soundings"):
        load_chart(grid, crs="local", positive="down", error_by_slope=True)
