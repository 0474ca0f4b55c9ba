"""The map of a mission: chart, true paths and, in one panel per navigator, each vehicle's estimates."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwcoop.figures.map_paths import draw_paths, draw_scale, ellipse, finite_points, spread_evenly
from uwcoop.figures.style import DEPTH_COLOURS, DPI, INK, MARKERS, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.missionlog import Columns

__all__ = [
    "Backdrop",
    "chart_backdrop",
    "depth_colormap",
    "draw_backdrop",
    "ellipse",
    "finite_points",
    "frame_around",
    "hillshade",
    "map_figure",
    "spread_evenly",
]

_PANEL_INCH = 4.4
_NODES_DRAWN = 700
"""A panel has no more pixels than this along its longer side."""


def map_figure(tracks: xr.Dataset, chart: Chart | None, fixes: Columns | None = None) -> Figure:
    """Chart, if any, with hillshade, true and estimated paths, 95 % covariance ellipses; metres east and north.

    The panels share one frame, around all true paths (where none is known, around the fixes and estimates) and around the
    estimates as far as half the true paths' size outside them; an estimate further out is cut at the edge, and the
    panel's note says by how much. Ellipses stand at nine instants; where they are too small to be seen, they are
    enlarged, and the panel's note says so. `fixes` are drawn as crosses. Save with `figure.savefig(path)`; needs no
    display.
    """
    figure_class = matplotlib_figure()
    navigators = [str(n) for n in tracks["navigator"].values]
    columns = 2 if len(navigators) == 4 else min(len(navigators), 3)
    view = _view(tracks, chart, fixes)
    backdrop = None if chart is None else chart_backdrop(chart, view)
    panels, bar_place, figure = _panels(figure_class, view, len(navigators), columns, backdrop is not None)
    for i, navigator in enumerate(navigators):
        axes = panels[i]
        if chart is not None:
            draw_backdrop(axes, backdrop)
        draw_paths(axes, tracks, i, view, fixes)
        axes.set(xlim=view[:2], ylim=view[2:], aspect="equal")
        axes.set_title(navigator, fontsize=11, pad=4)
        axes.tick_params(labelsize=8)
        if i % columns == 0:
            axes.set_ylabel("north (m)")
        else:
            axes.tick_params(labelleft=False)
        if i + columns >= len(navigators):
            axes.set_xlabel("east (m)")
        else:
            axes.tick_params(labelbottom=False)
    draw_scale(panels[0], view)
    if backdrop is not None:
        bar = figure.colorbar(backdrop.shading, cax=bar_place)
        bar.set_label("water depth (m)")
        bar.ax.invert_yaxis()
    _legend(figure, tracks, chart is not None and _shows_no_chart(chart, view), fixes)
    return figure


_LEFT, _RIGHT, _TOP, _BOTTOM, _GAP_X, _GAP_Y, _BAR = 0.85, 0.3, 0.75, 1.25, 0.15, 0.36, 1.0
"""Inches around and between panels, and for the colour bar."""


def _panels(
    figure_class: Any, view: tuple[float, float, float, float], count: int, columns: int, with_bar: bool
) -> tuple[list[Any], Any, Figure]:
    """Panels of the frame's own shape, placed by the inch so that no title meets another; the colour bar's place."""
    rows = math.ceil(count / columns)
    tall = float(np.clip((view[3] - view[2]) / (view[1] - view[0]), 0.35, 2.5))
    wide_in = _PANEL_INCH * max(1.0, 1.3 / columns)
    high_in = wide_in * tall
    width = _LEFT + columns * wide_in + (columns - 1) * _GAP_X + _RIGHT + (_BAR if with_bar else 0.0)
    height = _TOP + rows * high_in + (rows - 1) * _GAP_Y + _BOTTOM
    figure = figure_class(figsize=(width, height), dpi=DPI)
    panels = []
    for k in range(count):
        row, column = divmod(k, columns)
        left = _LEFT + column * (wide_in + _GAP_X)
        bottom = _BOTTOM + (rows - 1 - row) * (high_in + _GAP_Y)
        place = (left / width, bottom / height, wide_in / width, high_in / height)
        panels.append(figure.add_axes(place))
    if not with_bar:
        return panels, None, figure
    left = width - _BAR
    span = rows * high_in + (rows - 1) * _GAP_Y
    bar = figure.add_axes((left / width, (_BOTTOM + 0.1 * span) / height, 0.16 / width, 0.8 * span / height))
    return panels, bar, figure


# ---------------------------------------------------------------------------------------------- chart


class Backdrop(NamedTuple):
    """The chart in the frame, thinned to what a panel can show: computed once, drawn in each panel."""

    depth_m: NDArray[np.float64]
    east_m: NDArray[np.float64]
    north_m: NDArray[np.float64]
    rgba: NDArray[np.float64]
    shading: Any


def chart_backdrop(chart: Chart, view: tuple[float, float, float, float]) -> Backdrop | None:
    """Pale depths under soft hillshade, holes transparent; None where the frame shows none of the chart."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    j, i = _nodes(view[:2], chart.east0_m, chart, 1), _nodes(view[2:], chart.north0_m, chart, 0)
    depth = np.asarray(chart.depth_m[i, j], dtype=np.float64)
    thin = max(1, math.ceil(max(depth.shape) / _NODES_DRAWN))
    depth = depth[::thin, ::thin]
    if min(depth.shape) < 2 or np.isnan(depth).all():
        return None
    norm = Normalize(float(np.nanmin(depth)), float(np.nanmax(depth)))
    cmap = depth_colormap()
    rgba = np.asarray(cmap(norm(depth)))
    rgba[..., :3] *= (0.82 + 0.18 * hillshade(depth, chart.cell_m * thin))[..., None]
    rgba[np.isnan(depth)] = (1, 1, 1, 0)
    step = chart.cell_m * thin
    return Backdrop(
        depth,
        chart.east0_m + chart.cell_m * j.start + step * np.arange(depth.shape[1]),
        chart.north0_m + chart.cell_m * i.start + step * np.arange(depth.shape[0]),
        np.clip(rgba, 0, 1),
        ScalarMappable(norm, cmap),
    )


def _nodes(span: tuple[float, ...], origin_m: float, chart: Chart, axis: int) -> slice:
    """Rows (axis 0) or columns (1) of the chart that a span of the frame shows."""
    size = chart.depth_m.shape[axis]
    first, last = ((x - origin_m) / chart.cell_m for x in span)
    return slice(int(np.clip(math.floor(first), 0, size)), int(np.clip(math.ceil(last) + 1, 0, size)))


def draw_backdrop(axes: Axes, backdrop: Backdrop | None) -> None:
    """Shaded depths and thin contours, on hatching that shows where there is no chart."""
    axes.patch.set(facecolor="white", edgecolor="#bbbbbb", hatch="////", linewidth=0)
    if backdrop is None:
        return
    x, y, depth = backdrop.east_m, backdrop.north_m, backdrop.depth_m
    half = (x[1] - x[0]) / 2
    axes.imshow(
        backdrop.rgba,
        origin="lower",
        extent=(x[0] - half, x[-1] + half, y[0] - half, y[-1] + half),
        interpolation="nearest",
        zorder=0,
    )
    if np.nanmax(depth) > np.nanmin(depth):
        coarse = max(1, max(depth.shape) // 250)
        axes.contour(
            x[::coarse], y[::coarse], depth[::coarse, ::coarse],
            levels=8, colors="#33475b", linewidths=0.35, alpha=0.45, zorder=0.6,
        )  # fmt: skip


def hillshade(depth_m: NDArray[np.float64], cell_m: float) -> NDArray[np.float64]:
    """Light from the north-west at 45°, 0 to 1, on relief scaled until the 95 % slope is 1; holes 1."""
    d_north, d_east = np.gradient(-depth_m, cell_m)
    slope = np.hypot(d_north, d_east)
    steep = float(np.nanquantile(slope, 0.95)) if np.isfinite(slope).any() else 0.0
    scale = 1 / steep if steep > 0 else 0.0
    e, n = d_east * scale, d_north * scale
    light = (e - n + math.sqrt(2.0)) / (2 * np.sqrt(1 + e**2 + n**2))
    return np.where(np.isfinite(light), np.clip(light, 0, 1), 1.0)


def depth_colormap() -> Any:
    """Pale shallow to mid-blue deep; luminance falls evenly, and every track colour stands out on it."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("uwcoop-depth", DEPTH_COLOURS)


# ---------------------------------------------------------------------------------------------- paths


def _view(
    tracks: xr.Dataset, chart: Chart | None, fixes: Columns | None
) -> tuple[float, float, float, float]:
    """West, east, south, north of the common frame."""
    truth = finite_points(tracks["truth_position_m"].values)
    if not len(truth):
        # The estimates of the navigators that are nearest to each other, half of them at each instant, stand in for it.
        believed = tracks["position_m"].values
        truth = np.nanmedian(believed[:, np.isfinite(believed).all(-1).any(0)], axis=0).reshape(-1, 2)
        if fixes is not None:
            truth = np.vstack([truth, np.column_stack([fixes["e_m"], fixes["n_m"]])])
    estimate = finite_points(tracks["position_m"].values)
    cell_m = 1.0 if chart is None else chart.cell_m
    if len(truth):
        reach = 0.5 * float(np.ptp(truth, axis=0).max()) + 10 * cell_m
        estimate = np.clip(estimate, truth.min(0) - reach, truth.max(0) + reach)
    points = np.vstack([truth, estimate])
    if not len(points):
        points = np.zeros((1, 2)) if chart is None else np.array([chart.extent[:2], chart.extent[2:]])
    return frame_around(points, 0.1 * float(np.ptp(points, axis=0).max()) + 3 * cell_m)


def frame_around(points: NDArray[np.float64], pad_m: float) -> tuple[float, float, float, float]:
    """West, east, south, north of a frame around points (N, 2) with a margin."""
    (west, south), (east, north) = points.min(0) - pad_m, points.max(0) + pad_m
    return float(west), float(east), float(south), float(north)


def _shows_no_chart(chart: Chart, view: tuple[float, float, float, float]) -> bool:
    """Whether the frame reaches past the chart or over a hole in it."""
    west, south, east, north = chart.extent
    if view[0] < west or view[1] > east or view[2] < south or view[3] > north:
        return True
    j, i = _nodes(view[:2], west, chart, 1), _nodes(view[2:], south, chart, 0)
    return bool(np.isnan(chart.depth_m[i, j]).any())


def _legend(figure: Figure, tracks: xr.Dataset, holes: bool, fixes: Columns | None) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D(
            [], [], color=OKABE_ITO[j % 8], marker=MARKERS[j % 8], mfc="white", lw=1.3, ms=5, label=str(name)
        )
        for j, name in enumerate(tracks["vehicle"].values)
    ]
    known = bool(np.isfinite(tracks["truth_position_m"].values).any())
    if known:
        handles.append(Line2D([], [], color=INK, lw=0.9, ls=(0, (4, 2)), label="true path"))
    handles += [
        Line2D(
            [], [], color="#555555", ls="", marker="o", mfc="#DDDDDD", ms=9, mew=1.0, label="95 % ellipse"
        ),
        Line2D([], [], color=INK, ls="", marker="o", mfc="white", ms=8, mew=1.4, label="start"),
        Line2D([], [], color=INK, ls="", marker="o", mfc="#999999", ms=6.5, label="end, estimated"),
    ]
    if known:
        handles.append(Line2D([], [], color=INK, ls="", marker="x", ms=7, mew=1.8, label="end, true"))
    if fixes is not None and len(fixes["t_ns"]):
        handles.append(Line2D([], [], color=INK, ls="", marker="+", ms=7, mew=1.0, label="fix"))
    if holes:
        handles.append(Patch(facecolor="white", edgecolor="#bbbbbb", hatch="////", label="no chart"))
    height = float(figure.get_size_inches()[1])
    figure.legend(
        handles=handles, loc="lower center", ncols=min(len(handles), 5), fontsize=8, frameon=False,
        bbox_to_anchor=(0.5, 0.1 / height),
    )  # fmt: skip
    without = "" if known else "; no truth is known"
    figure.suptitle(
        f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}{without}", fontsize=12, y=1 - 0.22 / height
    )
