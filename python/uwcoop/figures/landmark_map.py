"""Maps of a mission with a landmark: roles and events on the paths (Matsuda et al. 2017, Fig. 7), and particles at
named times (Fig. 14)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.landmark import landmark_spans
from uwcoop.figures.map import finite_points, frame_around
from uwcoop.figures.style import DPI, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

    Floats = NDArray[np.float64]

SHOWN = 9
"""Times in the map of particles."""
_NUMBERED = {"boxstyle": "circle,pad=0.2", "fc": "white", "lw": 0.9}


def roles_figure(log: MissionLog, tracks: xr.Dataset) -> Figure:
    """Estimated paths of one navigator, squares where a vehicle stands as the landmark. A number in a circle
    is the event in which the path was made, as exchanges follow each other.

    Raises:
        TracksError: no vehicle takes the landmark's role.
    """
    spans = landmark_spans(log)
    time = tracks["time"].values
    position = tracks["position_m"].values[0]
    view = frame_around(finite_points(position), 3.0)
    tall = float(np.clip((view[3] - view[2]) / (view[1] - view[0]), 0.3, 1.5))
    figure = matplotlib_figure()(figsize=(9.0, 8.0 * tall + 1.4), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    for k, span in enumerate(spans):
        at = (time >= span.start_s) & (time < span.end_s)
        for v, name in enumerate(log.vehicles):
            colour, path = OKABE_ITO[v % 8], position[v, at]
            if not len(finite_points(path)):
                continue
            if v == span.vehicle:
                stands = np.nanmedian(path, axis=0)
                axes.plot(*stands, marker="s", ms=10, mfc="white", mec=colour, mew=1.6, zorder=4)
                axes.annotate(
                    f"{name}: landmark {k + 1}", stands, xytext=(9, 7), textcoords="offset points", fontsize=8
                )
            else:
                axes.plot(*path.T, color=colour, lw=2.0, zorder=3)
                middle = finite_points(path)[len(finite_points(path)) // 3]
                axes.text(
                    float(middle[0]),
                    float(middle[1]),
                    f"{k + 1}",
                    fontsize=9,
                    zorder=5,
                    bbox=_NUMBERED | {"ec": colour},
                )
    for v, name in enumerate(log.vehicles):
        axes.plot([], [], color=OKABE_ITO[v % 8], lw=2, label=f"{name} moves (number: event)")
    axes.plot([], [], ls="", marker="s", ms=8, mfc="white", mec="#555555", label="stands as the landmark")
    axes.set(xlim=view[:2], ylim=view[2:], aspect="equal", xlabel="east (m)", ylabel="north (m)")
    axes.grid(alpha=0.3, lw=0.6)
    axes.legend(fontsize=8, loc="best")
    navigator = str(tracks["navigator"].values[0])
    axes.set_title(f"{log.name}, seed {log.seed}: {navigator}, roles and events", fontsize=11)
    return figure


def _name_time(axes: Axes, label: str, at: Floats, *, above: bool) -> None:
    """Beside the clouds, which lie along the path: every other one on its other side, with a line to its place."""
    from matplotlib.patheffects import Normal, Stroke

    axes.annotate(
        label, (float(at[0]), float(at[1])), xytext=(-34, 44) if above else (34, -44),
        textcoords="offset points", fontsize=8, ha="right" if above else "left", va="center", zorder=6,
        arrowprops={"arrowstyle": "-", "lw": 0.7, "color": "#444444", "shrinkB": 4},
        path_effects=[Stroke(linewidth=2.5, foreground="white"), Normal()],
    )  # fmt: skip


def particles_figure(log: MissionLog, around: xr.Dataset, navigator: str) -> Figure:
    """The mover's particles after each of nine fixes about a reconstruction, with their times and what the landmark
    measured, in one map.

    Args:
        log: the mission.
        around: what `uwcoop.experiment.particles_at_fixes.around_fixes` gives.
        navigator: for the title.

    Raises:
        TracksError: no reconstruction in this mission.
    """
    counts = around["reconstructions"].values
    jumps = np.flatnonzero(counts[:, 1] > counts[:, 0])
    if not jumps.size:
        raise TracksError(f"{navigator} reconstructs no particles in this mission")
    first = max(0, int(jumps[0]) - 2)
    shown = np.arange(first, min(len(counts), first + SHOWN))
    figure = matplotlib_figure()(figsize=(9.5, 8.0), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    kept = []
    for place, k in enumerate(shown):
        colour = OKABE_ITO[place % 8]
        points = finite_points(around["particles_m"].values[k, 1])
        points = points[:: max(1, len(points) // 800)]
        axes.plot(*points.T, ls="", marker=".", ms=1.8, color=colour, alpha=0.4)
        measured, truth = around["measured_m"].values[k], around["truth_m"].values[k]
        axes.plot(*measured, ls="", marker="+", ms=12, mew=1.8, color="#111111")
        axes.plot(*truth, ls="", marker="x", ms=7, mew=1.4, color="#B00020")
        new = ", reconstruction" if counts[k, 1] > counts[k, 0] else ""
        label = f"{around['t_s'].values[k]:.0f} s{new}"
        _name_time(axes, label, truth, above=place % 2 == 0)
        kept.append(
            np.vstack(
                [
                    *np.quantile(points, [0.01, 0.99], axis=0),
                    truth,
                    np.where(np.isfinite(measured), measured, truth),
                ]
            )
        )
    view = frame_around(np.vstack(kept), 1.6)
    axes.set(xlim=view[:2], ylim=view[2:], aspect="equal", xlabel="east (m)", ylabel="north (m)")
    axes.plot([], [], ls="", marker="+", ms=10, mew=1.8, color="#111111", label="measured by the landmark")
    axes.plot([], [], ls="", marker="x", ms=7, color="#B00020", label="true position")
    axes.legend(fontsize=8, loc="best")
    axes.grid(alpha=0.3, lw=0.6)
    axes.set_title(f"{log.name}, seed {log.seed}: {navigator}'s particles at fixes", fontsize=11)
    return figure
