"""Covariances of the navigators along the paths, and the geometry of the ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.evaluation.nees import CHI2_95_2D
from uwcoop.figures.geometry import (
    aspect_and_trace,
    axis_of,
    bearings,
    draw_bearings,
    draw_over_time,
    sender_mark,
)
from uwcoop.figures.map import (
    chart_backdrop,
    draw_backdrop,
    ellipse,
    finite_points,
    frame_around,
    spread_evenly,
)
from uwcoop.figures.style import DPI, LINE_STYLES, MARKERS, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from numpy.typing import NDArray

    from uwcoop.charts import Chart

    Floats = NDArray[np.float64]
    Packets = Mapping[str, NDArray[Any]]

INK = "#111111"
MOST_NAVIGATORS = 3
"""Ellipses of more navigators hide each other."""
WAYPOINTS = 6
MAGNIFICATIONS = (0.2, 0.5, 1, 2, 5, 10, 20, 50)


def covariance_figure(
    tracks: xr.Dataset,
    packets: Packets | None = None,
    chart: Chart | None = None,
    *,
    navigators: Sequence[str] | None = None,
    waypoints: int = WAYPOINTS,
    parts: Sequence[str] = ("map", "time"),
) -> Figure:
    """95 % ellipses at waypoints along the paths, beside their aspect ratio, trace and the bearings of ranges.

    On the map the ellipses stand around the true places (around the estimates where truth is unknown), all
    magnified by the same factor, so that navigators can be compared in size and direction. Beside it, by
    vehicle and over time: the ratio of the ellipse's axes, the trace of the covariance, and the true
    bearing to the sender at each reception; numbers and dotted lines are the waypoints.

    Args:
        tracks: of a run.
        packets: of the run; without them there are no bearings.
        chart: behind the paths.
        navigators: which to overlay; None: the first `MOST_NAVIGATORS`, those that hear packets before the
            others.
        waypoints: ellipses along each path, evenly in time.
        parts: "map" for the ellipses, "time" for what is over time.

    Raises:
        TracksError: an unknown navigator, or tracks without a covariance.
    """
    figure_class = matplotlib_figure()
    shown = _shown(tracks, navigators)
    covariance = tracks["covariance_m2"].values
    aspect, trace = aspect_and_trace(covariance)
    if not np.isfinite(trace[shown]).any():
        raise TracksError("no navigator states a covariance")
    centre = _centres(tracks, shown)
    at = [spread_evenly(path, waypoints) for path in centre]
    heard = None if packets is None else bearings(tracks, packets, shown)
    high = max(6.6, 1.9 * tracks.sizes["vehicle"] + 1.6)
    widths = {"map": 7.4, "time": 9.1}
    figure = figure_class(figsize=(sum(widths[part] for part in parts), high), dpi=DPI, layout="constrained")
    drawn: Any = figure.subfigures(
        1, len(parts), squeeze=False, width_ratios=[widths[part] for part in parts], wspace=0.03
    )
    for part, name in zip(drawn[0], parts, strict=True):
        if name == "map":
            _draw_map(part, tracks, chart, shown, centre, at)
        else:
            _draw_panels(part, tracks, shown, at, aspect, trace, heard)
    _legend(figure, tracks, shown, heard if "time" in parts else None, paths="map" in parts)
    figure.suptitle(_title(tracks, shown, parts), fontsize=12)
    return figure


def _draw_panels(
    part: SubFigure,
    tracks: xr.Dataset,
    shown: Sequence[int],
    at: Sequence[NDArray[np.intp]],
    aspect: Floats,
    trace: Floats,
    heard: Mapping[str, NDArray[Any]] | None,
) -> None:
    columns = 3 if heard is not None and len(heard["toa_s"]) else 2
    panels = part.subplots(tracks.sizes["vehicle"], columns, squeeze=False, sharex=True)
    time = tracks["time"].values
    scales = [axis_of(aspect[shown], 1.0), axis_of(trace[shown], None)]
    for j, vehicle in enumerate(tracks["vehicle"].values):
        for axes, values, (log, limits) in zip(panels[j, :2], (aspect, trace), scales, strict=True):
            draw_over_time(axes, time, values[:, j], shown, log=log, limits=limits)
        if columns == 3 and heard is not None:
            draw_bearings(panels[j, 2], heard, j)
        for axes in panels[j]:
            _mark_waypoints(axes, time[at[j]], numbered=j == 0)
        panels[j, 0].set_ylabel(str(vehicle), fontsize=11)
    titles = (
        "axes of the ellipse, major / minor",
        "trace of the covariance (m²)",
        "true bearing to the sender heard",
    )
    for axes, text in zip(panels[0], titles[:columns], strict=True):
        axes.set_title(text, fontsize=10, pad=16)
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")


def magnification(semi_axes_m: Floats, navigator: Floats, size_m: float) -> float:
    """The largest of `MAGNIFICATIONS` that keeps ellipses apart.

    With it nine in ten ellipses stay below 15 % of the frame's size, and the typical one of the navigator
    with the smallest below 5 %, but no smaller than 1 %: the others are then cut by the frame.

    Args:
        semi_axes_m: major semi-axis of each ellipse, (N,).
        navigator: whose it is, (N,).
        size_m: longer side of the frame.
    """
    if not len(semi_axes_m):
        return 1
    smallest = min(float(np.median(semi_axes_m[navigator == n])) for n in np.unique(navigator))
    usual_most = float(np.quantile(semi_axes_m, 0.9))
    factor = min(0.15 * size_m / max(usual_most, 1e-9), 0.05 * size_m / max(smallest, 1e-9))
    factor = max(factor, 0.01 * size_m / max(smallest, 1e-9))
    return max([m for m in MAGNIFICATIONS if m <= factor], default=MAGNIFICATIONS[0])


def _shown(tracks: xr.Dataset, names: Sequence[str] | None) -> list[int]:
    every = [str(name) for name in tracks["navigator"].values]
    if names is not None:
        if unknown := [name for name in names if name not in every]:
            raise TracksError(f"the tracks hold no navigator {unknown[0]!r}: they hold {', '.join(every)}")
        return [every.index(name) for name in names]
    hears = np.asarray(tracks["heard"].values.any((1, 2)))
    return sorted(sorted(range(len(every)), key=lambda i: not hears[i])[:MOST_NAVIGATORS])


def _centres(tracks: xr.Dataset, shown: Sequence[int]) -> Floats:
    """True paths (vehicle, time, 2); the first shown navigator's estimates of vehicles without truth."""
    truth = tracks["truth_position_m"].values.astype(np.float64)
    known = np.asarray(np.isfinite(truth).any((1, 2)))
    return np.where(known[:, None, None], truth, tracks["position_m"].values[shown[0]])


def _draw_map(
    part: SubFigure,
    tracks: xr.Dataset,
    chart: Chart | None,
    shown: Sequence[int],
    centre: Floats,
    at: Sequence[NDArray[np.intp]],
) -> None:
    axes = part.subplots()
    covariance = tracks["covariance_m2"].values
    places = [(i, j, k) for i in shown for j in range(len(at)) for k in at[j]]
    semi: Floats = np.array([_semi_axis(covariance[place]) for place in places])
    finite = semi < np.inf  # false for NaN
    path = finite_points(centre)
    size = float(np.ptp(path, axis=0).max()) if len(path) else 1.0
    factor = magnification(semi[finite], np.array([p[0] for p in places])[finite], size)
    reach = factor * float(np.quantile(semi[finite], 0.9)) if finite.any() else 0.0
    view = frame_around(path if len(path) else np.zeros((1, 2)), 0.05 * size + min(reach, 0.3 * size) + 1.0)
    backdrop = None if chart is None else chart_backdrop(chart, view)
    if chart is not None:
        draw_backdrop(axes, backdrop)
    for j in range(len(centre)):
        axes.plot(*centre[j].T, color=INK, lw=0.8, ls=(0, (4, 2.5)), zorder=2.5)
        axes.plot(*centre[j, at[j]].T, ls="", marker=MARKERS[j % 8], ms=5, mfc="white", mec=INK, zorder=4)
        _number_waypoints(axes, centre[j, at[j]])
    for i, j, k in places:
        ring = ellipse(centre[j, k], factor**2 * covariance[i, j, k])
        axes.plot(*ring.T, color=OKABE_ITO[i % 8], lw=1.5, ls=LINE_STYLES[i % 5], zorder=3.5)
    axes.set(xlim=view[:2], ylim=view[2:], aspect="equal", xlabel="east (m)", ylabel="north (m)")
    around = "true positions" if np.isfinite(tracks["truth_position_m"].values).any() else "estimates"
    larger = "" if factor == 1 else f", drawn × {factor:g}"
    axes.set_title(f"95 % ellipses around the {around}{larger}", fontsize=10)
    if backdrop is not None:
        bar = part.colorbar(backdrop.shading, ax=axes, shrink=0.6, pad=0.02, aspect=30)
        bar.set_label("water depth (m)")
        bar.ax.invert_yaxis()


def _semi_axis(covariance: Floats) -> float:
    """Major semi-axis of the 95 % ellipse, m; NaN where there is none."""
    trace = aspect_and_trace(covariance)[1]
    return float(np.sqrt(CHI2_95_2D * np.linalg.eigvalsh(covariance)[1])) if np.isfinite(trace) else np.nan


def _number_waypoints(axes: Axes, points: Floats) -> None:
    from matplotlib.patheffects import Normal, Stroke

    halo = [Stroke(linewidth=2.2, foreground="white"), Normal()]
    for number, point in enumerate(points, 1):
        axes.annotate(
            str(number), point, (5, 4), textcoords="offset points", fontsize=8, zorder=5, path_effects=halo
        )


def _mark_waypoints(axes: Axes, times: Floats, *, numbered: bool) -> None:
    for number, time in enumerate(times, 1):
        axes.axvline(time, color="#888888", lw=0.7, ls=":", zorder=1)
        if numbered:
            axes.annotate(
                str(number), (time, 1), (0, 3), xycoords=axes.get_xaxis_transform(),
                textcoords="offset points", ha="center", fontsize=7, color="#555555", annotation_clip=False,
            )  # fmt: skip


def _title(tracks: xr.Dataset, shown: Sequence[int], parts: Sequence[str]) -> str:
    others = [str(n) for i, n in enumerate(tracks["navigator"].values) if i not in shown]
    left = f"\nnot shown: {', '.join(others)}" if others else ""
    what = "error covariances" + (" and bearings of ranges" if "time" in parts else "")
    return f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: {what}{left}"


def _legend(
    figure: Figure,
    tracks: xr.Dataset,
    shown: Sequence[int],
    heard: Mapping[str, NDArray[Any]] | None,
    *,
    paths: bool,
) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=OKABE_ITO[i % 8], ls=LINE_STYLES[i % 5], lw=1.6, label=str(name))
        for i, name in enumerate(tracks["navigator"].values)
        if i in shown
    ]
    handles += [
        Line2D(
            [], [], color=INK, lw=0.8, ls=(0, (4, 2)), marker=MARKERS[j % 8], mfc="white", ms=5,
            label=f"{name}: path, waypoints",
        )
        for j, name in enumerate(tracks["vehicle"].values)
        if paths
    ]  # fmt: skip
    if heard is not None:
        handles += [
            Line2D([], [], ls="", label=f"heard from {tracks['vehicle'].values[s]}", **sender_mark(int(s)))
            for s in np.unique(heard["sender"])
        ]
    figure.legend(
        handles=handles, loc="outside lower center", fontsize=8, frameon=False, handlelength=3.2,
        ncols=min(len(handles), round(figure.get_figwidth() / 1.8)),
    )  # fmt: skip
