"""Pictures in the manner of Tan et al. (2016): what is drawn is what was given, and what cannot be drawn says so."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from fake_mission import Mission, mission

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from matplotlib.image import imread

from uwcoop.errors import MissingDependencyError, TracksError
from uwcoop.evaluation import error_series, metrics
from uwcoop.evaluation.nees import CHI2_95_2D
from uwcoop.figures.averages import averages, errors_over_time_figure, quantiles
from uwcoop.figures.boxes import box_statistics, boxes_figure
from uwcoop.figures.covariance import covariance_figure, magnification
from uwcoop.figures.geometry import aspect_and_trace, bearings, position_at
from uwcoop.figures.information import binned, gains_of, information_figure
from uwcoop.figures.study import NO_TRACES, study_figures
from uwcoop.figures.style import OKABE_ITO
from uwcoop.figures.traffic import LINKS, traffic_figure, velocities

KEY = "current.speed_mps"


def assert_whole(figure: Any) -> None:
    """A white margin all around: neither label nor legend is cut off by the picture's edge."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=60)
    file.seek(0)
    image = imread(file)[..., :3]
    for edge in (image[:1], image[-1:], image[:, :1], image[:, -1:]):
        assert (edge > 0.98).all()


def lines(axes: Any, colour: str, **style: Any) -> list[Any]:
    return [
        line
        for line in axes.lines
        if line.get_color() == colour and all(getattr(line, f"get_{k}")() == v for k, v in style.items())
    ]


# ---------------------------------------------------------------------------------------------- boxes


def rows(values: dict[Any, dict[str, list[float | None]]]) -> list[dict[str, Any]]:
    """Rows of a study over `KEY`: errors by value and navigator, one run for each error, one vehicle."""
    return [
        {KEY: key, "run": k, "navigator": name, "vehicle": "V1", "final_error_m": e, "rmse_m": e and e / 2}
        for key, by_name in values.items()
        for name, errors in by_name.items()
        for k, e in enumerate(errors)
    ]


def test_box_statistics_are_quartiles_and_the_last_values_within_reach() -> None:
    values = np.array([1.0, 2, 3, 4, 5, 6, 7, 8, 30])
    got = box_statistics(values)
    assert (got["q1"], got["med"], got["q3"]) == tuple(np.quantile(values, [0.25, 0.5, 0.75]))
    assert (got["whislo"], got["whishi"]) == (1, 8)
    assert list(got["fliers"]) == [30]
    # Three of eight far off: no value lies between the box's top and its reach.
    split = box_statistics(np.array([1.0, 1, 1, 1, 1, 1, 50, 90]))
    assert split["whishi"] >= split["q3"]
    infinite = box_statistics(np.array([1.0, 2, np.inf, np.inf]))
    assert infinite["med"] == np.inf
    assert infinite["q3"] == np.inf


def test_boxes_stand_at_the_quartiles_of_the_rows() -> None:
    rng = np.random.default_rng(0)
    data = {v: {n: list(rng.gamma(2, s, 20)) for n, s in (("dr", 90.0), ("dmpf", 2.0))} for v in (0.0, 0.5)}
    data[0.5]["dmpf"][:5] = [40.0] * 5
    figure = boxes_figure(rows(data), [KEY], title="bay", settle_s=50)
    assert_whole(figure)
    for axes, scale in zip(figure.axes, (1.0, 0.5), strict=True):
        medians = [
            float(line.get_ydata()[0]) for line in axes.lines if line.get_linewidth() == 2.0
        ]  # one thick line in each box
        expected = [np.median(data[v][n]) * scale for v in data for n in ("dr", "dmpf")]
        np.testing.assert_allclose(medians, expected)
        boxes = [patch.get_path().vertices[:, 1] for patch in axes.patches]
        for box, (v, n) in zip(boxes, [(v, n) for v in data for n in ("dr", "dmpf")], strict=True):
            quartiles = np.quantile(data[v][n], [0.25, 0.75]) * scale
            np.testing.assert_allclose((box.min(), box.max()), quartiles)
        assert axes.get_yscale() == "log"
    assert len({patch.get_hatch() for patch in figure.axes[0].patches}) == 2  # told apart in greyscale
    texts = [text.get_text() for text in figure.axes[0].texts]
    lost = [f"{100 * np.mean(np.array(data[v][n]) > 30):.0f} %" for v in data for n in ("dr", "dmpf")]
    assert texts[texts.index("lost") + 1 :][:4] == lost
    assert lost[3] == "25 %"
    assert figure.get_suptitle() == "bay: 20 runs of 1 vehicle"
    assert [t.get_text() for t in figure.axes[-1].get_xticklabels()] == ["0.0", "0.5"]
    assert figure.axes[-1].get_xlabel() == KEY


def test_boxes_without_varied_keys_scale_linearly_and_name_the_navigators() -> None:
    data = {0: {"dmpf": [1.0, 2.0, 4.0], "mpf": [1.0, 1.5, np.inf]}}
    figure = boxes_figure(rows(data), title="bay", settle_s=50)
    assert [t.get_text() for t in figure.axes[-1].get_xticklabels()] == ["dmpf", "mpf"]
    axes = figure.axes[0]
    assert axes.get_yscale() == "linear"
    (beyond,) = lines(axes, "#111111", marker="^")  # the infinite one, at the upper edge
    assert list(beyond.get_xdata()) == [1.0]
    assert axes.get_ylim()[1] == beyond.get_ydata()[0]
    with pytest.raises(TracksError, match="no run has an error"):
        boxes_figure(rows({0: {"dmpf": [None]}}), title="bay", settle_s=50)


# ---------------------------------------------------------------------------------------------- averages


@pytest.fixture(scope="module")
def missions() -> list[Mission]:
    return [mission(duration_s=120, seed=seed, navigators=("dead-reckoning", "dmpf")) for seed in (0, 1, 2)]


@pytest.fixture(scope="module")
def gathered(missions: list[Mission]) -> xr.Dataset:
    found = error_series.gather(
        {("", k): error_series.error_series_of(m.tracks) for k, m in enumerate(missions)}, [""], [0, 1, 2]
    )
    assert found is not None
    return found


def test_a_trace_holds_each_seconds_error_and_arrivals(missions: list[Mission]) -> None:
    tracks = missions[0].tracks
    trace = error_series.error_series_of(tracks)
    assert list(trace["time"].values) == list(range(121))
    error = metrics.errors(tracks).sel(time=trace["time"].values)
    np.testing.assert_allclose(trace["error_m"], error, rtol=1e-6)
    assert trace["heard"].sum() == tracks["heard"].sum()
    assert (trace["arrivals"].sum("time") == tracks["received"].sum("time")).all()
    when = tracks["time"].values[tracks["heard"].values[1, 0]]
    assert trace["heard"].values[1, 0][np.ceil(when).astype(int)].all()
    assert "mutual_information" not in trace


def test_quantiles_leave_out_what_is_unknown_and_keep_what_is_infinite() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(9, 4))
    np.testing.assert_allclose(quantiles(values, (0.1, 0.9)), np.quantile(values, [0.1, 0.9], axis=0))
    values[::2, 1] = np.nan
    values[:, 2] = np.nan
    values[:5, 3] = np.inf
    low, high = quantiles(values, (0.0, 0.9))
    assert low[1] == np.nanmin(values[:, 1])
    assert np.isnan(low[2])
    assert np.isfinite(low[3])
    assert high[3] == np.inf


def test_lines_are_the_means_over_runs_and_the_band_their_quantiles(gathered: xr.Dataset) -> None:
    figure = errors_over_time_figure(gathered, title="bay")
    assert_whole(figure)
    assert figure.axes[0].get_title() == "3 runs"
    error = gathered["error_m"].values[0].astype(float)
    for j, axes in enumerate(figure.axes[::2]):
        for i in range(2):
            (line,) = lines(axes, OKABE_ITO[i])
            np.testing.assert_allclose(line.get_ydata(), error[:, i, j].mean(0))
            band = axes.collections[i].get_paths()[0].vertices[:, 1]
            expected = np.quantile(error[:, i, j], [0.1, 0.9], axis=0)
            assert np.isin(np.round(expected, 9), np.round(band, 9)).all()


def test_strips_show_the_share_of_packets_that_was_used(gathered: xr.Dataset) -> None:
    figure = errors_over_time_figure(gathered, title="bay")
    strip = figure.axes[1]  # of the first vehicle; only dmpf talks
    possible, used = (lines.get_segments() for lines in strip.collections)
    arrivals = gathered["arrivals"].values[0, :, 1, 0].sum(0, dtype=int)
    heard = gathered["heard"].values[0, :, 1, 0].sum(0, dtype=int)
    assert [segment[0][0] for segment in possible] == list(np.flatnonzero(arrivals))
    heights = np.array([segment[1][1] - segment[0][1] for segment in used]) / 0.84
    np.testing.assert_allclose(heights, (heard / np.maximum(arrivals, 1))[arrivals > 0], atol=1e-12)
    assert 0 < heights.mean() < 1
    assert [text.get_text() for text in strip.texts] == ["dmpf"]


def test_missing_runs_are_counted_and_teams_may_differ(missions: list[Mission], tmp_path: Path) -> None:
    smaller = error_series.error_series_of(
        mission(duration_s=60, vehicles=2, navigators=("dead-reckoning", "dmpf")).tracks
    )
    kept = {("a = 1", 4): error_series.error_series_of(missions[0].tracks), ("a = 2", 5): smaller}
    error_series.write_error_series(kept, tmp_path)
    again = error_series.read_error_series(tmp_path)
    assert again.keys() == kept.keys()
    both = error_series.gather(again, ["a = 1", "a = 2", "a = 3"], [4, 5])
    assert both is not None
    assert both["stored"].values.tolist() == [[True, False], [False, True], [False, False]]
    np.testing.assert_array_equal(both["error_m"][0, 0], kept["a = 1", 4]["error_m"])
    np.testing.assert_array_equal(both["error_m"][1, 1, :, :2, :61], smaller["error_m"])
    assert both["error_m"][1, 1, :, 2].isnull().all()
    assert both["error_m"][1, 1, :, :, 61:].isnull().all()
    figure = errors_over_time_figure(both, title="bay")
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles == ["a = 1 (1 of 2 runs)", "a = 2 (1 of 2 runs)", "a = 3 (0 of 2 runs)"]
    assert error_series.gather(again, ["a = 7"], [4]) is None
    assert error_series.read_error_series(tmp_path / "nowhere") == {}
    (tmp_path / error_series.FILE).write_text("not NetCDF")
    with pytest.raises(TracksError, match=r"a study's errors .*errors\.nc cannot be read"):
        error_series.read_error_series(tmp_path)


def test_a_failed_estimate_makes_the_mean_infinite() -> None:
    error = np.array([[[1.0, np.inf, np.nan]], [[3.0, 1.0, np.nan]]])[None]
    mean, low, _ = averages(error)
    assert mean[0, 0, 0] == 2
    assert mean[0, 0, 1] == np.inf
    assert np.isnan(mean[0, 0, 2])
    assert np.isnan(low[0, 0, 2])


# ---------------------------------------------------------------------------------------------- information


def with_information(tracks: xr.Dataset) -> xr.Dataset:
    """Gains that grow with time, for the second navigator; its error is 10 m everywhere, the first's 30 m."""
    told = np.full(tracks["heard"].shape, np.nan)
    told[1] = np.where(tracks["heard"].values[1], tracks["time"].values / 100, np.nan)
    out = tracks.assign(mutual_information=(("navigator", "vehicle", "time"), told))
    position = np.repeat(out["truth_position_m"].values[None], 2, axis=0)
    position[..., 0] += np.array([30.0, 10.0])[:, None, None]
    return out.assign(position_m=(out["position_m"].dims, position))


def test_information_is_drawn_against_the_error_after_it(missions: list[Mission]) -> None:
    tracks = with_information(missions[0].tracks)
    silent, talking = gains_of(tracks)
    assert (silent.navigator, silent.heard_by, talking.heard_by) == (0, 1, 1)
    late = tracks["heard"].values[1] & (tracks["time"].values > 50)
    np.testing.assert_allclose(np.sort(talking.information_nat), np.sort(np.nonzero(late)[1] * 0 + np.tile(
        tracks["time"].values, (3, 1))[late] / 100))  # fmt: skip
    np.testing.assert_allclose(talking.error_m, 10)
    np.testing.assert_allclose(silent.error_m, 30)
    figure = information_figure(tracks, title="bay")
    assert_whole(figure)
    drawn = {
        line.get_color(): line
        for line in figure.axes[0].lines
        if len(line.get_xdata()) == len(talking.error_m)
    }
    np.testing.assert_array_equal(np.sort(drawn[OKABE_ITO[1]].get_xdata()), np.sort(talking.information_nat))
    x, y, spread = binned(talking.information_nat, talking.error_m)
    marks = next(line for line in figure.axes[0].lines if line.get_marker() == "s")
    np.testing.assert_array_equal(marks.get_xdata(), x)
    np.testing.assert_array_equal(marks.get_ydata(), y)
    np.testing.assert_allclose(spread, 0, atol=1e-9)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[0] == "dead-reckoning at the receptions of dmpf"


def test_without_information_the_figure_says_what_to_set(
    missions: list[Mission], gathered: xr.Dataset
) -> None:
    for tracks in (missions[0].tracks, gathered):
        with pytest.raises(TracksError, match=r"diagnostics\.entropy = at_updates or at_reception"):
            information_figure(tracks, title="bay")
    trace = error_series.error_series_of(with_information(missions[0].tracks))
    many = error_series.gather({("", 0): trace, ("", 1): trace}, [""], [0, 1])
    assert many is not None
    assert len(gains_of(many)[1].error_m) == 2 * len(gains_of(trace)[1].error_m)


# ---------------------------------------------------------------------------------------------- covariance


def test_aspect_and_trace_of_known_covariances() -> None:
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    covariance = np.stack(
        [turn @ np.diag([36.0, 4.0]) @ turn.T, np.eye(2), np.full((2, 2), np.nan), np.diag([1.0, -1.0])]
    )
    aspect, trace = aspect_and_trace(covariance)
    np.testing.assert_allclose(aspect, [3, 1, np.nan, np.nan])
    np.testing.assert_allclose(trace, [40, 2, np.nan, np.nan])
    assert aspect_and_trace(np.diag([1.0, 0.0])[None])[0][0] == np.inf


def test_covariances_are_drawn_around_the_truth_and_over_time(missions: list[Mission]) -> None:
    m = missions[0]
    figure = covariance_figure(m.tracks, m.packets, m.chart, waypoints=3)
    assert_whole(figure)
    world, panels = figure.axes[0], [axes for axes in figure.axes if axes.get_xlim()[1] == 120.0]
    rings = [line.get_xydata() for line in world.lines if len(line.get_xdata()) == 41]
    assert len(rings) == 2 * 3 * 3  # navigators, vehicles, waypoints
    factor = float(world.get_title().partition("× ")[2] or 1)
    ring = rings[1] - m.tracks["truth_position_m"].values[0, len(m.tracks["time"]) // 2]
    covariance = m.tracks["covariance_m2"].values[0, 0, len(m.tracks["time"]) // 2]
    square = np.einsum("ni,ni->n", ring, np.linalg.solve(covariance, ring.T).T)
    np.testing.assert_allclose(square, factor**2 * CHI2_95_2D)
    aspect, trace = aspect_and_trace(m.tracks["covariance_m2"].values)
    heard = bearings(m.tracks, m.packets, [0, 1])
    assert len(panels) == 9
    for j in range(3):
        for axes, values in zip(panels[3 * j : 3 * j + 2], (aspect, trace), strict=True):
            for i in range(2):
                (line,) = lines(axes, OKABE_ITO[i])
                np.testing.assert_array_equal(line.get_ydata(), values[i, j])
        marks = [line for line in panels[3 * j + 2].lines if line.get_linestyle() == "None"]
        drawn = np.concatenate([line.get_ydata() for line in marks])
        np.testing.assert_array_equal(np.sort(drawn), np.sort(heard["bearing_deg"][heard["receiver"] == j]))


def test_covariance_map_and_curves_apart(missions: list[Mission]) -> None:
    m = missions[0]
    world = covariance_figure(m.tracks, m.packets, m.chart, parts=["map"])
    curves = covariance_figure(m.tracks, m.packets, m.chart, parts=["time"])
    for figure in (world, curves):
        assert_whole(figure)
    assert [axes.get_ylabel() for axes in world.axes] == ["north (m)", "water depth (m)"]
    assert len(curves.axes) == 9
    told = [{text.get_text() for text in figure.legends[0].get_texts()} for figure in (world, curves)]
    assert {"waypoints" in text for text in told[0] if ":" in text} == {True}
    assert not any("heard" in text for text in told[0])
    assert any("heard from" in text for text in told[1])
    assert not any("waypoints" in text for text in told[1])


def test_bearings_are_from_the_receiver_to_where_the_sender_was(missions: list[Mission]) -> None:
    m = missions[0]
    heard = bearings(m.tracks, m.packets, [1])
    taken = m.packets["received"] & (m.packets["navigator"] == 1)
    assert len(heard["toa_s"]) == taken.sum()
    k = 7
    row = np.flatnonzero(taken & (m.packets["toa_ns"] / 1e9 == heard["toa_s"][k]))[0]
    sent = m.packets["tol_ns"][row : row + 1] / 1e9
    there = position_at(m.tracks, heard["sender"][k : k + 1], sent)[0]
    here = position_at(m.tracks, heard["receiver"][k : k + 1], heard["toa_s"][k : k + 1])[0]
    expected = np.degrees(np.arctan2(*(there - here))) % 360  # east over north: clockwise from north
    np.testing.assert_allclose(heard["bearing_deg"][k], expected)


def test_which_navigators_are_overlaid_and_how_large() -> None:
    m = mission(duration_s=60, vehicles=1, navigators=("dead-reckoning", "terrain-only", "dmpf", "mpf"))
    m.tracks["heard"][2:, 0, 5] = True
    figure = covariance_figure(m.tracks)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["dead-reckoning", "dmpf", "mpf", "auv-1: path, waypoints"]
    assert "not shown: terrain-only" in figure.get_suptitle()
    chosen = covariance_figure(m.tracks, navigators=["mpf", "terrain-only"]).legends[0].get_texts()
    assert {text.get_text() for text in chosen} == {"terrain-only", "mpf", "auv-1: path, waypoints"}
    with pytest.raises(TracksError, match="no navigator 'ekf'"):
        covariance_figure(m.tracks, navigators=["ekf"])
    m.tracks["covariance_m2"][:] = np.nan
    with pytest.raises(TracksError, match="states a covariance"):
        covariance_figure(m.tracks)
    assert magnification(np.array([1.0, 1.2]), np.array([0, 0]), 500.0) == 20
    assert magnification(np.array([100.0, 120.0]), np.array([0, 0]), 500.0) == 0.2
    assert magnification(np.array([]), np.array([]), 500.0) == 1


# ---------------------------------------------------------------------------------------------- traffic


def motion_of(m: Mission, velocity_mps: tuple[float, float]) -> dict[str, np.ndarray[Any, Any]]:
    seconds = np.repeat(np.arange(120), 3)
    return {
        "t_ns": seconds * 10**9,
        "vehicle": np.tile(np.arange(3), 120),
        "velocity_e_mps": np.full(360, velocity_mps[0]),
        "velocity_n_mps": np.full(360, velocity_mps[1]),
    }


def test_receptions_stand_where_the_receiver_was(missions: list[Mission]) -> None:
    m = missions[0]
    figure = traffic_figure(m.tracks, m.packets, m.chart, motion_of(m, (1.0, 0.0)))
    assert_whole(figure)
    world = figure.axes[0]
    assert world.get_title() == "packets of dmpf"
    own = m.packets["navigator"] == 1
    lost = [line for line in world.lines if line.get_marker() == "x"]
    for j in range(3):
        here = own & (m.packets["receiver"] == j)
        place = position_at(m.tracks, m.packets["receiver"][here], m.packets["toa_ns"][here] / 1e9)
        received = m.packets["received"][here]
        np.testing.assert_array_equal(lost[j].get_xydata(), place[~received])
        marks = [line for line in world.lines if line.get_markerfacecolor() == OKABE_ITO[j]
                 and line.get_linestyle() == "None"]  # fmt: skip
        np.testing.assert_array_equal(marks[0].get_xydata(), place[received])
        links = [line.get_xydata() for line in lines(world, OKABE_ITO[j]) if len(line.get_xdata()) == 2]
        assert len(links) == LINKS
        assert all((np.abs(place - link[0]).max(1) < 1e-9).any() for link in links)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    here = own & (m.packets["receiver"] == 0)
    assert labels[0] == f"auv-1: received {m.packets['received'][here].sum()} of {here.sum()}"
    assert "velocity commanded" in labels


def test_velocities_are_means_between_the_times(missions: list[Mission]) -> None:
    m = missions[0]
    motion = motion_of(m, (1.0, -0.5))
    motion["velocity_e_mps"][motion["t_ns"] >= 20 * 10**9] = 2.0
    edges = np.array([0.0, 10.5, 30.0])
    commanded, ground = velocities(m.tracks, motion, 1, edges)
    np.testing.assert_allclose(commanded, [[1.0, -0.5], [(9.5 * 1 + 10 * 2) / 19.5, -0.5]])
    truth = position_at(m.tracks, np.full(3, 1), edges)
    np.testing.assert_allclose(ground, np.diff(truth, axis=0) / np.diff(edges)[:, None])


def test_traffic_without_commands_or_packets_or_truth(missions: list[Mission]) -> None:
    m = missions[0]
    figure = traffic_figure(m.tracks, m.packets)
    assert len(figure.axes) == 1
    assert "velocity commanded" not in [text.get_text() for text in figure.legends[0].get_texts()]
    with pytest.raises(TracksError, match="dead-reckoning sends no packets"):
        traffic_figure(m.tracks, m.packets, navigator="dead-reckoning")
    with pytest.raises(TracksError, match="no navigator sends packets"):
        traffic_figure(m.tracks, {key: column[:0] for key, column in m.packets.items()})
    unknown = m.tracks.assign(truth_position_m=m.tracks["truth_position_m"] * np.nan)
    with pytest.raises(TracksError, match="true paths are unknown"):
        traffic_figure(unknown, m.packets)


# ---------------------------------------------------------------------------------------------- a study


def test_a_study_draws_what_its_data_allow(gathered: xr.Dataset) -> None:
    table = rows({0: {"dmpf": [1.0, 2.0]}})
    alone = dict(study_figures(table, title="bay", settle_s=50))
    assert not isinstance(alone["boxes.png"], str)
    assert alone["errors_over_time.png"] == alone["information.png"] == NO_TRACES
    many = xr.concat([gathered.isel(variant=0)] * 5, "variant").assign_coords(variant=list("abcde"))
    drawn = dict(study_figures(table, error_series=many, title="bay", settle_s=50))
    assert list(drawn) == [
        "boxes.png",
        "bytes.png",
        "errors_over_time.png",
        "errors_over_time-2.png",
        "information.png",
    ]
    assert "no navigator sends" in str(drawn["bytes.png"])
    assert "diagnostics.entropy" in str(drawn["information.png"])
    titles = [axes.get_title() for axes in drawn["errors_over_time-2.png"].axes if axes.get_title()]  # type: ignore[union-attr]
    assert titles == ["e (3 runs)"]


def test_study_and_run_write_the_pictures(tmp_path: Path) -> None:
    from uwcoop.experiment.run import run
    from uwcoop.experiment.study import study
    from uwcoop.report import run_folder as output
    from uwcoop.scenario import load

    small = ["duration_s=80", "navigator.all.particles=100", "diagnostics.entropy=at_reception"]
    notes: list[str] = []
    result = study("st-john", 2, ["dead-reckoning", "dmpf"], out=tmp_path, overrides=small, keep_errors=True,
                   processes=1)  # fmt: skip
    written = output.write_study_figures(result, tmp_path, notes.append)
    assert written == ["boxes.png", "bytes.png", "errors_over_time.png", "information.png"]
    assert not notes
    assert result.errors is not None
    final = [row["final_error_m"] for row in result.rows if row["navigator"] == "dmpf"]
    np.testing.assert_allclose(
        result.errors["error_m"].sel(navigator="dmpf")[0, ..., -1].values.ravel(), final, rtol=1e-6
    )
    # One more run without its errors: told apart, not flown again.
    study("st-john", 3, ["dead-reckoning", "dmpf"], out=tmp_path, overrides=small, resume=True, processes=1)
    again = study("st-john", 3, ["dead-reckoning", "dmpf"], out=tmp_path, overrides=small, resume=True,
                  keep_errors=True, processes=1)  # fmt: skip
    assert again.errors is not None
    assert again.errors["stored"].values.tolist() == [[True, True, False]]

    flown = run(load("st-john", small), ["dead-reckoning", "dmpf"], clouds=False)
    folder = tmp_path / "run"
    files = output.write_run(flown, folder, notes.append, figures=True)
    drawn = ["covariance.png", "traffic.png", "information.png", "setup.png", "uncertainty.png"]
    assert [name for name in files if name in drawn] == drawn
    assert all((folder / name).stat().st_size > 10_000 for name in drawn)


def test_without_matplotlib_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, missions: list[Mission]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r"uwcoop\[figures\]"):
        covariance_figure(missions[0].tracks)
    with pytest.raises(MissingDependencyError, match=r"uwcoop\[figures\]"):
        list(study_figures(rows({0: {"dmpf": [1.0]}}), title="bay", settle_s=50))
