"""Pictures: drawn without a display, nothing cut off, and what must be seen is there as pixels."""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np
import pytest

from fake_mission import mission

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from matplotlib.image import imread

from uwcoop.charts import Chart
from uwcoop.errors import MissingDependencyError
from uwcoop.evaluation.nees import CHI2_95_2D
from uwcoop.evaluation.per_instant import errors
from uwcoop.figures.errors import errors_figure
from uwcoop.figures.map import ellipse, hillshade, map_figure
from uwcoop.figures.style import OKABE_ITO, RECEIVED_COLOUR, REJECTED_COLOUR


def pixels(figure: Any) -> np.ndarray[Any, Any]:
    """RGB (rows, columns, 3) of 0 to 255 as saved by default."""
    file = io.BytesIO()
    figure.savefig(file, format="png")
    file.seek(0)
    return np.round(imread(file)[..., :3] * 255).astype(int)


def count(image: np.ndarray[Any, Any], colour: str, within: int = 12) -> int:
    """Pixels that are nearly of this colour."""
    rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(image - rgb).max(-1) <= within).sum())


def assert_whole(image: np.ndarray[Any, Any]) -> None:
    """A white margin all around: neither label nor legend is cut off by the picture's edge."""
    for edge in (image[:3], image[-3:], image[:, :3], image[:, -3:]):
        assert (edge > 250).all()


def test_map_shows_chart_paths_and_panels() -> None:
    m = mission(duration_s=300)
    figure = map_figure(m.tracks, m.chart)
    image = pixels(figure)
    assert_whole(image)
    assert image.shape[1] > 1500
    for colour in OKABE_ITO[:3]:
        assert count(image, colour) > 1500, colour  # three vehicles, three panels
    assert count(image, "#111111") > 3000  # true paths and marks
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles == ["dead-reckoning", "dmpf", "mpf"]
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:4] == ["auv-1", "auv-2", "auv-3", "true path"]
    bar = figure.axes[-1]
    assert bar.get_ylabel() == "water depth (m)"
    assert bar.get_ylim()[0] > bar.get_ylim()[1]  # deep is down


def test_map_without_tracks_drawn_would_differ() -> None:
    """Guards the pixel counts above: the chart alone has none of the vehicles' colours."""
    m = mission(duration_s=60, vehicles=1, navigators=("mpf",))
    m.tracks["position_m"][:] = np.nan
    m.tracks["truth_position_m"][:] = np.nan
    image = pixels(map_figure(m.tracks, m.chart))
    legend = count(image, OKABE_ITO[0])
    assert legend < 200
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 500  # the chart is there, shaded


def test_an_estimate_far_away_does_not_shrink_the_map() -> None:
    m = mission(duration_s=120)
    near = map_figure(m.tracks, m.chart).axes[0].get_xlim()
    m.tracks["position_m"][0, 1] += np.linspace(0, 30_000, m.tracks.sizes["time"])[:, None]
    figure = map_figure(m.tracks, m.chart)
    far = figure.axes[0].get_xlim()
    assert far[1] - far[0] < 3 * (near[1] - near[0])
    assert any("auv-2 leaves the frame by 29" in text.get_text() for text in figure.axes[0].texts)
    assert_whole(pixels(figure))


@pytest.mark.parametrize("count_of_navigators", [1, 4])
def test_map_in_rows(count_of_navigators: int) -> None:
    names = ("dead-reckoning", "dmpf", "terrain-only", "ranging-only", "mpf")[:count_of_navigators]
    m = mission(duration_s=80, navigators=names, vehicles=8, holes=False)
    figure = map_figure(m.tracks, m.chart)
    assert_whole(pixels(figure))
    assert [axes.get_title() for axes in figure.axes if axes.get_title()] == list(names)
    assert "no chart" not in [text.get_text() for text in figure.legends[0].get_texts()]


def test_ellipse_holds_95_percent() -> None:
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    outline = ellipse(np.array([10.0, -5.0]), covariance) - [10.0, -5.0]
    square = np.einsum("ni,ni->n", outline, np.linalg.solve(covariance, outline.T).T)
    np.testing.assert_allclose(square, CHI2_95_2D)
    assert pytest.approx(5.991464547) == CHI2_95_2D
    assert np.isnan(ellipse(np.zeros(2), np.array([[1.0, 2.0], [2.0, 1.0]]))).all()
    assert np.isnan(ellipse(np.zeros(2), np.full((2, 2), np.nan))).all()


def test_hillshade_is_lit_from_the_north_west() -> None:
    axis = np.arange(50.0)
    rises_north_west = (
        axis[None, :] - axis[:, None]
    )  # depth grows to the south-east: slope faces the south-east
    assert hillshade(rises_north_west, 1.0)[25, 25] < hillshade(-rises_north_west, 1.0)[25, 25]
    np.testing.assert_allclose(hillshade(np.zeros((5, 5)), 1.0), np.sqrt(0.5))


def panel(figure: Any, navigator: int, vehicle: int, vehicles: int = 3) -> Any:
    return figure.axes[navigator * vehicles + vehicle]


def test_errors_show_lines_ticks_and_spans() -> None:
    m = mission(duration_s=300)
    figure = errors_figure(m.tracks, m.packets)
    image = pixels(figure)
    assert_whole(image)
    for colour in OKABE_ITO[:3]:
        assert count(image, colour) > 2000, colour  # vehicles, whatever the navigator
    for colour in OKABE_ITO[3:7]:
        assert count(image, colour, 4) == 0, colour
    assert count(image, RECEIVED_COLOUR, 4) > 300
    assert count(image, REJECTED_COLOUR, 4) > 50
    assert [panel(figure, k, 0).get_ylabel() for k in range(3)] == [
        "dead-reckoning\n(m)",
        "dmpf\n(m)",
        "mpf\n(m)",
    ]
    assert [panel(figure, 0, k).get_title() for k in range(3)] == ["auv-1", "auv-2", "auv-3"]
    assert figure.axes[-1].get_xlabel() == "time (s)"
    assert {axes.get_yscale() for axes in figure.axes} == {"log"}
    assert len({axes.get_ylim() for axes in figure.axes}) == 1
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"packet received", "lost", "refused by the navigator", "settling, 50 s", "off the chart"} <= {
        *labels
    }


def test_lines_can_be_told_from_bands() -> None:
    """The band is a pale area, the error a strong line: neither is drawn as the other."""
    m = mission(duration_s=100, navigators=("mpf",), vehicles=1)
    axes = errors_figure(m.tracks, m.packets).axes[0]
    lines = {line.get_linewidth(): line for line in axes.lines}
    strongest = lines[max(lines)]
    np.testing.assert_allclose(strongest.get_ydata(), errors(m.tracks).values[0, 0])
    covariance = m.tracks["covariance_m2"].values[0, 0]
    (band,) = [c for c in axes.collections if c.get_alpha() == 0.16]
    edge = 2 * np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1])
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(edge.max())


def test_each_arrival_has_its_tick() -> None:
    m = mission(duration_s=200, navigators=("mpf",))
    figure = errors_figure(m.tracks, m.packets)
    for vehicle, axes in enumerate(figure.axes):
        drawn = {lines.get_gid(): len(lines.get_segments()) for lines in axes.collections if lines.get_gid()}
        own = m.packets["receiver"] == vehicle
        accepted, received = m.packets["accepted"][own], m.packets["received"][own]
        assert drawn == {
            "received": accepted.sum(), "refused": (received & ~accepted).sum(), "lost": (~received).sum()
        }  # fmt: skip
        assert drawn["lost"] > 0


def test_scale_is_linear_where_all_are_readable() -> None:
    m = mission(duration_s=200, navigators=("dmpf", "mpf"))
    figure = errors_figure(m.tracks)
    assert {axes.get_yscale() for axes in figure.axes} == {"linear"}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "lost" in labels
    assert "refused by the navigator" not in labels  # tracks alone cannot tell
    m.tracks["position_m"][0] += 5000.0
    assert {axes.get_yscale() for axes in errors_figure(m.tracks).axes} == {"log"}


def test_many_vehicles_go_on_in_further_rows() -> None:
    m = mission(duration_s=60, navigators=("dmpf", "mpf"), vehicles=8)
    figure = errors_figure(m.tracks, m.packets)
    assert_whole(pixels(figure))
    shown = [axes.get_title() for axes in figure.axes if axes.get_visible()]
    assert shown == [f"auv-{k}" for k in range(1, 9)] * 2


def test_without_truth_what_is_stated_is_drawn() -> None:
    m = mission(duration_s=200, navigators=("dmpf", "mpf"), vehicles=2)
    truth = m.tracks["truth_position_m"].copy()
    m.tracks["truth_position_m"][:] = np.nan
    fixes = {
        "t_ns": np.array([100, 150]) * 10**9, "vehicle": np.array([0, 0]), "navigator": np.array([1, 1]),
        "kind": np.array(["fix", "fix"], dtype=object), "fused": np.array([True, False]),
        "innovation_m": np.array([1.0, 40.0]), "sigma_m": np.array([3.0, 3.0]),
    }  # fmt: skip
    held = {
        "t_ns": np.array([120]) * 10**9, "vehicle": np.array([1]),
        "e_m": truth.values[1, 120, :1] + 2.0, "n_m": truth.values[1, 120, 1:],
    }  # fmt: skip
    figure = errors_figure(m.tracks, m.packets, fixes, held)
    assert_whole(pixels(figure))
    assert {axes.get_title() for axes in figure.axes} == {"auv-1: no truth", "auv-2: no truth", ""}
    assert "no truth is known" in figure._suptitle.get_text()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"fix, from the belief before it", "the same, gated", "fix held out"} <= set(labels)
    assert not any(label.startswith("error") for label in labels)
    drawn = [line for line in panel(figure, 1, 0, 2).lines if line.get_marker() == "o"]
    assert [line.get_xdata().tolist() for line in drawn] == [[100.0], [150.0]]
    top = panel(figure, 1, 0, 2).get_ylim()[1]
    assert top > 0.5, "the axis holds what is stated"
    diamonds = [line for line in panel(figure, 0, 1, 2).lines if line.get_marker() == "D"]
    assert len(diamonds) == 1
    whole = map_figure(m.tracks, m.chart, {**held, "vehicle": np.array([1])})
    assert_whole(pixels(whole))
    labels = [text.get_text() for text in whole.legends[0].get_texts()]
    assert "fix" in labels
    assert "true path" not in labels


def test_small_ellipses_are_enlarged_and_the_panel_says_so() -> None:
    m = mission(duration_s=200, navigators=("mpf", "dead-reckoning"), vehicles=1)
    figure = map_figure(m.tracks, m.chart)
    small, large = (" ".join(text.get_text() for text in axes.texts) for axes in figure.axes[:2])
    assert "95 % ellipses × " in small
    assert "ellipses" not in large
    assert " m" in small, "the first panel has the scale"


def test_pictures_of_broken_tracks_do_not_crash() -> None:
    m = mission(duration_s=60, vehicles=2)
    m.tracks["covariance_m2"][0] = np.nan
    m.tracks["covariance_m2"][1] = -1.0
    m.tracks["position_m"][2, 0, 30:] = np.nan
    m.tracks["truth_position_m"][1] = np.nan
    silent = {key: column[:0] for key, column in m.packets.items()}
    for figure in (map_figure(m.tracks, m.chart), errors_figure(m.tracks, silent)):
        assert_whole(pixels(figure))
    m.tracks["truth_position_m"][:] = np.nan
    for figure in (map_figure(m.tracks, m.chart), errors_figure(m.tracks, m.packets)):
        assert_whole(pixels(figure))


def test_the_global_backend_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures come from `Figure` directly: pyplot, and with it a display, is never asked for."""
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it now fails
    m = mission(duration_s=60, vehicles=1, navigators=("mpf",))
    assert_whole(pixels(map_figure(m.tracks, m.chart)))
    assert_whole(pixels(errors_figure(m.tracks, m.packets)))


def test_flat_and_faraway_charts() -> None:
    m = mission(duration_s=60, vehicles=1, navigators=("mpf",))
    flat = Chart(np.full((400, 400), 12.0), 200.0, 400.0, 1.0)
    assert_whole(pixels(map_figure(m.tracks, flat)))
    figure = map_figure(m.tracks, Chart(np.full((9, 9), 12.0), -9000.0, 0.0, 1.0))
    assert_whole(pixels(figure))
    assert "no chart" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    m = mission(duration_s=60, vehicles=1, navigators=("mpf",))
    with pytest.raises(MissingDependencyError, match=r"uwcoop\[figures\]"):
        map_figure(m.tracks, m.chart)
