"""The map of a mission: chart, true paths and, in one panel per navigator, each vehicle's estimates."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwcoop.evaluation.nees import CHI2_95_2D
from uwcoop.figures.style import DEPTH_COLOURS, DPI, MARKERS, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.charts import Chart

_PANEL_INCH = 4.4
_NODES_DRAWN = 700
"""A panel has no more pixels than this along its longer side."""


def map_figure(tracks: xr.Dataset, chart: Chart | None) -> Figure:
    """Chart, if any, with hillshade, true and estimated paths, 95 % covariance ellipses; metres east and north.

    The panels share one frame, around all true paths and around the estimates as far as half the true
    paths' size outside them; an estimate further out is cut at the edge, and the panel's note says by how
    much. Ellipses stand at ten instants. Save with `figure.savefig(path)`; needs no display.
    """
    figure_class = matplotlib_figure()
    navigators = [str(n) for n in tracks["navigator"].values]
    columns = 2 if len(navigators) == 4 else min(len(navigators), 3)
    panel_rows = math.ceil(len(navigators) / columns)
    view = _view(tracks, chart)
    backdrop = None if chart is None else chart_backdrop(chart, view)
    tall = float(np.clip((view[3] - view[2]) / (view[1] - view[0]), 0.35, 2.5))
    panel = _PANEL_INCH * max(1.0, 1.3 / columns)
    figure = figure_class(
        figsize=(panel * columns + 1.2, panel * tall * panel_rows + 1.5),
        dpi=DPI,
        layout="compressed",
    )
    panels = figure.subplots(panel_rows, columns, squeeze=False, sharex=True, sharey=True)
    for spare in panels.flat[len(navigators) :]:
        spare.set_axis_off()
    used = list(panels.flat[: len(navigators)])
    for i, (axes, navigator) in enumerate(zip(used, navigators, strict=True)):
        if chart is not None:
            draw_backdrop(axes, backdrop)
        _draw_paths(axes, tracks, i, view)
        axes.set(xlim=view[:2], ylim=view[2:], aspect="equal", title=navigator)
        axes.tick_params(labelsize=8)
        if i % columns == 0:
            axes.set_ylabel("north (m)")
        if i + columns >= len(navigators):
            axes.set_xlabel("east (m)")
            axes.tick_params(labelbottom=True)
    if backdrop is not None:
        bar = figure.colorbar(backdrop.shading, ax=panels, shrink=0.85, pad=0.02, aspect=30)
        bar.set_label("water depth (m)")
        bar.ax.invert_yaxis()
    _legend(figure, tracks, chart is not None and _shows_no_chart(chart, view))
    figure.suptitle(f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}", fontsize=12)
    return figure


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


def _view(tracks: xr.Dataset, chart: Chart | None) -> tuple[float, float, float, float]:
    """West, east, south, north of the common frame."""
    truth = finite_points(tracks["truth_position_m"].values)
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


def _draw_paths(axes: Axes, tracks: xr.Dataset, navigator: int, view: tuple[float, ...]) -> None:
    from matplotlib.patheffects import Normal, Stroke

    halo = [Stroke(linewidth=2.6, foreground="white", alpha=0.8), Normal()]
    notes = []
    for j, vehicle in enumerate(tracks["vehicle"].values):
        colour, marker = OKABE_ITO[j % 8], MARKERS[j % 8]
        truth = tracks["truth_position_m"].values[j]
        estimate = tracks["position_m"].values[navigator, j]
        covariance = tracks["covariance_m2"].values[navigator, j]
        axes.plot(*truth.T, color="#111111", lw=0.8, ls=(0, (4, 2.5)), zorder=3.2)
        axes.plot(*estimate.T, color=colour, lw=1.3, path_effects=halo, zorder=3)
        at = spread_evenly(estimate, 10)
        for k in at:
            ring = ellipse(estimate[k], covariance[k])
            axes.plot(*ring.T, color=colour, lw=0.8, alpha=0.9, zorder=3.5)
        axes.plot(
            *estimate[at[1:-1]].T, ls="", marker=marker, ms=4, mfc="white", mec=colour, mew=1.0, zorder=4
        )
        _ends(axes, truth, estimate, colour, marker)
        beyond = _beyond(estimate, view)
        if beyond > 0:
            notes.append(f"{vehicle} leaves the frame by {beyond:.0f} m")
    if notes:
        axes.text(
            0.02, 0.02, "\n".join(notes), transform=axes.transAxes, fontsize=7, va="bottom", zorder=6,
            bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 2},
        )  # fmt: skip


def _ends(
    axes: Axes, truth: NDArray[np.float64], estimate: NDArray[np.float64], colour: str, marker: str
) -> None:
    """Start: large filled marker. End: a cross on the truth, joined to the filled end of the estimate."""
    known = truth[np.isfinite(truth).all(1)]
    believed = estimate[np.isfinite(estimate).all(1)]
    start = known[:1] if len(known) else believed[:1]
    axes.plot(*start.T, ls="", marker=marker, ms=8, mfc="white", mec="#111111", mew=1.4, zorder=5)
    if len(believed):
        axes.plot(
            *believed[-1:].T, ls="", marker=marker, ms=6.5, mfc=colour, mec="#111111", mew=0.8, zorder=5.2
        )
    if len(known):
        axes.plot(*known[-1:].T, ls="", marker="x", ms=7, mec="#111111", mew=1.8, zorder=5.4)
    if len(known) and len(believed):
        axes.plot(*np.stack([known[-1], believed[-1]]).T, color="#111111", lw=0.8, ls=":", zorder=5)


def ellipse(mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Closed outline (41, 2) of the 95 % region of a 2-D Gaussian; NaN where the covariance is not one."""
    if not (np.isfinite(covariance).all() and np.isfinite(mean).all()):
        return np.full((41, 2), np.nan)
    eigenvalues, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    if eigenvalues[0] < -1e-9 * max(float(eigenvalues[1]), 1e-300):
        return np.full((41, 2), np.nan)
    angle = np.linspace(0, 2 * np.pi, 41)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    axes = vectors * np.sqrt(CHI2_95_2D * np.maximum(eigenvalues, 0))
    return np.asarray(mean + (axes @ circle).T)


def spread_evenly(path: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """`count` indices evenly spread over the path's finite part, ends included."""
    finite = np.flatnonzero(np.isfinite(path).all(1))
    if not len(finite):
        return finite
    return finite[np.unique(np.linspace(0, len(finite) - 1, count).astype(np.intp))]


def _beyond(path: NDArray[np.float64], view: tuple[float, ...]) -> float:
    finite = finite_points(path)
    if not len(finite):
        return 0.0
    outside = np.maximum(
        np.array([view[0], view[2]]) - finite.min(0), finite.max(0) - np.array([view[1], view[3]])
    )
    return float(max(outside.max(), 0.0))


def finite_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of the points (..., 2) that are known, (N, 2)."""
    flat = points.reshape(-1, 2)
    return flat[np.isfinite(flat).all(1)]


def _legend(figure: Figure, tracks: xr.Dataset, holes: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    ink = "#111111"
    handles: list[Any] = [
        Line2D(
            [], [], color=OKABE_ITO[j % 8], marker=MARKERS[j % 8], mfc="white", lw=1.3, ms=5, label=str(name)
        )
        for j, name in enumerate(tracks["vehicle"].values)
    ]
    handles += [
        Line2D([], [], color=ink, lw=0.9, ls=(0, (4, 2)), label="true path"),
        Line2D([], [], color="#555555", ls="", marker="o", mfc="none", ms=9, mew=0.8, label="95 % ellipse"),
        Line2D([], [], color=ink, ls="", marker="o", mfc="white", ms=8, mew=1.4, label="start"),
        Line2D([], [], color=ink, ls="", marker="o", mfc="#999999", ms=6.5, label="end, estimated"),
        Line2D([], [], color=ink, ls="", marker="x", ms=7, mew=1.8, label="end, true"),
    ]
    if holes:
        handles.append(Patch(facecolor="white", edgecolor="#bbbbbb", hatch="////", label="no chart"))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 5), fontsize=8, frameon=False
    )
