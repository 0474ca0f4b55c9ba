"""Receptions along the tracks: where each packet was heard or lost, and how the water moved the vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.geometry import position_at
from uwcoop.figures.map import chart_backdrop, draw_backdrop, finite_points, frame_around
from uwcoop.figures.style import DPI, MARKERS, OKABE_ITO, matplotlib_figure
from uwcoop.frames import heading_from_yaw

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.charts import Chart

    Floats = NDArray[np.float64]
    Columns = Mapping[str, NDArray[Any]]

INK, LOST = "#111111", "#444444"
LINKS = 8
"""Lines to the sender that are drawn for each receiver."""
BEGINNING_S = 100.0
"""The velocities are those of the mission's beginning."""
ARROWS = 5

_MOST_INSETS = 4


def traffic_figure(
    tracks: xr.Dataset,
    packets: Columns,
    chart: Chart | None = None,
    motion: Columns | None = None,
    *,
    navigator: str | None = None,
) -> Figure:
    """The map of what was heard where, with the velocities at the beginning beside it.

    Along each true path a filled mark where a packet was received and a cross where one was lost, thin lines
    from some receptions to where the sender was, and the time. Beside it, for each vehicle, the first
    `BEGINNING_S` seconds: the velocity that was commanded through the water, as the navigators know it, and
    the true one over ground, with their mean difference.

    Args:
        tracks: of a run, with truth.
        packets: of the run.
        chart: behind the paths.
        motion: the log's `motion` events; without them there are no velocities.
        navigator: whose packets; None: the first whose packets were heard. Larger packets are lost more often.

    Raises:
        TracksError: no truth, an unknown navigator, or no packets were sent.
    """
    figure_class = matplotlib_figure()
    truth = tracks["truth_position_m"].values
    if not np.isfinite(truth).any():
        raise TracksError("the true paths are unknown")
    own, name = _packets_of(tracks, packets, navigator)
    path = finite_points(truth)
    size = float(np.ptp(path, axis=0).max())
    view = frame_around(path, 0.08 * size + 1.0)
    moving = [] if motion is None else [v for v in range(len(truth)) if (motion["vehicle"] == v).any()]
    insets = moving[:_MOST_INSETS]
    height = float(np.clip(8.0 * (view[3] - view[2]) / (view[1] - view[0]), 5.0, 10.0)) + 1.4
    figure = figure_class(
        figsize=(13.5 if insets else 9.5, max(height, 2.4 * len(insets) + 1.2)), dpi=DPI, layout="constrained"
    )
    parts: Any = figure.subfigures(1, 2, width_ratios=(2.2, 1)) if insets else (figure, None)
    left, right = parts
    axes = left.subplots()
    backdrop = None if chart is None else chart_backdrop(chart, view)
    if chart is not None:
        draw_backdrop(axes, backdrop)
    for j in range(len(truth)):
        _draw_vehicle(axes, tracks, own, j)
    axes.set(xlim=view[:2], ylim=view[2:], aspect="equal", xlabel="east (m)", ylabel="north (m)")
    axes.set_title(f"packets of {name}", fontsize=10)
    if backdrop is not None:
        bar = left.colorbar(backdrop.shading, ax=axes, shrink=0.6, pad=0.02, aspect=30)
        bar.set_label("water depth (m)")
        bar.ax.invert_yaxis()
    if right is not None and motion is not None:
        panels = right.subplots(len(insets), 1, squeeze=False)[:, 0]
        for inset, j in zip(panels, insets, strict=True):
            _draw_velocities(inset, tracks, motion, j)
        panels[-1].set_xlabel("east (m)", fontsize=8)
    _legend(figure, tracks, own, bool(insets))
    figure.suptitle(
        f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: receptions along the tracks", fontsize=12
    )
    return figure


def _packets_of(tracks: xr.Dataset, packets: Columns, name: str | None) -> tuple[Columns, str]:
    """Columns of one navigator's packets, and its name."""
    names = [str(n) for n in tracks["navigator"].values]
    if name is not None and name not in names:
        raise TracksError(f"the tracks hold no navigator {name!r}: they hold {', '.join(names)}")
    sends = [n for i, n in enumerate(names) if ((packets["navigator"] == i) & (packets["bytes"] > 0)).any()]
    chosen = name if name is not None else next(iter(sends), None)
    if chosen is None or chosen not in sends:
        raise TracksError("no navigator sends packets" if chosen is None else f"{chosen} sends no packets")
    own = (packets["navigator"] == names.index(chosen)) & (packets["bytes"] > 0)
    return {key: column[own] for key, column in packets.items()}, chosen


def _draw_vehicle(axes: Axes, tracks: xr.Dataset, packets: Columns, vehicle: int) -> None:
    from matplotlib.patheffects import Normal, Stroke

    colour, marker = OKABE_ITO[vehicle % 8], MARKERS[vehicle % 8]
    truth, time = tracks["truth_position_m"].values[vehicle], tracks["time"].values
    halo = [Stroke(linewidth=2.4, foreground="white", alpha=0.8), Normal()]
    axes.plot(*truth.T, color=colour, lw=1.0, path_effects=halo, zorder=3)
    here = packets["receiver"] == vehicle
    place = position_at(tracks, packets["receiver"][here], packets["toa_ns"][here] / 1e9)
    received = packets["received"][here].astype(bool)
    size = 4.8 if len(place) <= 80 else 3.4
    axes.plot(*place[~received].T, ls="", marker="x", ms=size, mec=LOST, mew=1.0, zorder=3.6)
    axes.plot(*place[received].T, ls="", marker=marker, ms=size, mfc=colour, mec=INK, mew=0.4, zorder=4)
    sender = position_at(tracks, packets["sender"][here], packets["tol_ns"][here] / 1e9)
    some = np.flatnonzero(received)
    for k in some[np.unique(np.linspace(0, max(len(some) - 1, 0), min(LINKS, len(some))).astype(int))]:
        axes.plot(*np.stack([place[k], sender[k]]).T, color=colour, lw=0.7, alpha=0.75, zorder=2.5)
    start = np.flatnonzero(np.isfinite(truth).all(1))[:1]
    axes.plot(*truth[start].T, ls="", marker=marker, ms=9, mfc="white", mec=INK, mew=1.4, zorder=5)
    _draw_times(axes, time, truth, colour)


def _draw_times(axes: Axes, time: Floats, truth: Floats, colour: str) -> None:
    """The time at round moments along a path, in the vehicle's colour."""
    from matplotlib.patheffects import Normal, Stroke

    halo = [Stroke(linewidth=2.4, foreground="white"), Normal()]
    every = _round_step(float(time[-1] - time[0]) / 8)
    for moment in np.arange(every, time[-1], every):
        point = truth[int(np.searchsorted(time, moment))]
        if np.isfinite(point).all():
            axes.plot(*point[:, None], ls="", marker=".", ms=6, mfc="white", mec=INK, mew=0.7, zorder=5)
            axes.annotate(
                f"{moment:g} s", point, (6, 5), textcoords="offset points", fontsize=7.5, color=colour,
                weight="bold", path_effects=halo, zorder=6,
            )  # fmt: skip


def velocities(tracks: xr.Dataset, motion: Columns, vehicle: int, edges_s: Floats) -> tuple[Floats, Floats]:
    """Mean velocity commanded and mean true velocity over ground between successive times, (N - 1, 2), m/s."""
    own = motion["vehicle"] == vehicle
    since = motion["t_ns"][own] / 1e9
    commanded = np.column_stack([motion["velocity_e_mps"][own], motion["velocity_n_mps"][own]])
    # A command holds until the next one: the way commanded up to a time is piecewise linear.
    way = np.vstack([np.zeros(2), np.cumsum(commanded[:-1] * np.diff(since)[:, None], axis=0)])
    held = np.clip(np.searchsorted(since, edges_s, side="right") - 1, 0, len(since) - 1)
    way_at = way[held] + commanded[held] * (edges_s - since[held])[:, None]
    place = position_at(tracks, np.full(len(edges_s), vehicle), edges_s)
    lasts = np.diff(edges_s)[:, None]
    return np.diff(way_at, axis=0) / lasts, np.diff(place, axis=0) / lasts


def _draw_velocities(axes: Axes, tracks: xr.Dataset, motion: Columns, vehicle: int) -> None:
    colour, time = OKABE_ITO[vehicle % 8], tracks["time"].values
    truth = tracks["truth_position_m"].values[vehicle]
    first = float(time[np.flatnonzero(np.isfinite(truth).all(1))[0]])
    last = min(first + BEGINNING_S, float(time[-1]))
    part = (time >= first) & (time <= last)
    axes.plot(*truth[part].T, color="#888888", lw=0.8, ls=(0, (4, 2.5)), zorder=2)
    edges = np.linspace(first, last, ARROWS + 1)
    commanded, ground = velocities(tracks, motion, vehicle, edges)
    place = position_at(tracks, np.full(ARROWS, vehicle), edges[:-1])
    lasts = float(edges[1] - edges[0])
    tips = []
    for vectors, ink, width, z in ((ground, colour, 0.014, 3), (commanded, INK, 0.006, 4)):
        axes.quiver(
            *place.T, *(vectors * lasts).T, angles="xy", scale_units="xy", scale=1, color=ink, width=width,
            headwidth=3, headlength=4, headaxislength=3.6, zorder=z,
        )  # fmt: skip
        tips.append(place + vectors * lasts)
    points = finite_points(np.concatenate([place, *tips]))
    middle, half = (points.min(0) + points.max(0)) / 2, 0.58 * float(np.ptp(points, axis=0).max()) + 1.0
    axes.set(
        xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half), box_aspect=1
    )
    axes.set_ylabel("north (m)", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.locator_params(nbins=5)
    axes.ticklabel_format(useOffset=False)
    name = tracks["vehicle"].values[vehicle]
    axes.set_title(
        f"{name}, {first:g}–{last:g} s\n{_spoken('commanded', commanded)}, {_spoken('over ground', ground)}\n"
        f"{_spoken('difference', ground - commanded)}",
        fontsize=8,
    )


def _spoken(what: str, vectors: Floats) -> str:
    """Mean velocity in words; the direction is where it goes to, clockwise from north."""
    mean = vectors.mean(0)
    toward = float(heading_from_yaw(np.arctan2(mean[1], mean[0])))
    return f"{what} {np.hypot(*mean):.2f} m/s to {toward:.0f}°"


def _round_step(least: float) -> float:
    """The next of 1, 2, 5, 10, … seconds."""
    power = 10.0 ** np.floor(np.log10(max(least, 1.0)))
    return float(next(power * m for m in (1, 2, 5, 10) if power * m >= least * 0.999))


def _legend(figure: Figure, tracks: xr.Dataset, packets: Columns, insets: bool) -> None:
    from matplotlib.lines import Line2D

    handles: list[Any] = []
    for j, name in enumerate(tracks["vehicle"].values):
        here = packets["receiver"] == j
        heard = int(packets["received"][here].sum())
        handles.append(
            Line2D(
                [], [], color=OKABE_ITO[j % 8], lw=1.2, marker=MARKERS[j % 8], ms=5, mec=INK, mew=0.4,
                label=f"{name}: received {heard} of {int(here.sum())}",
            )
        )  # fmt: skip
    handles += [
        Line2D([], [], ls="", marker="x", ms=5, mec=LOST, mew=1.0, label="lost"),
        Line2D([], [], color="#888888", lw=0.8, label="from a reception to its sender (some)"),
        Line2D([], [], ls="", marker="o", ms=8, mfc="white", mec=INK, mew=1.4, label="start"),
    ]
    if insets:
        arrow: dict[str, Any] = {"ls": "", "marker": r"$\rightarrow$", "ms": 13}
        handles += [
            Line2D([], [], color=INK, label="velocity commanded", **arrow),
            Line2D([], [], color=OKABE_ITO[0], label="true velocity over ground", **arrow),
        ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 5), fontsize=8, frameon=False
    )
