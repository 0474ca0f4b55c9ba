"""Missions with a landmark: paths with particles and measured positions, and ground velocities with roles.

Matsuda et al. (2017), Figs. 7, 8, 9, 11 and 14.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.map import finite_points, frame_around
from uwcoop.figures.style import DPI, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

    Floats = NDArray[np.float64]

LANDED_MARKER, INK = "s", "#111111"
BY_LANDMARK, BY_MOVER = "#009E73", "#111111"
"""Positions measured by the landmark (its bearing), and by the mover (its own)."""
ROLE_ALPHA = 0.16


@dataclass(frozen=True)
class Span:
    """One vehicle as the landmark, seconds."""

    vehicle: int
    start_s: float
    end_s: float


def landmark_spans(log: MissionLog) -> list[Span]:
    """Which vehicle was the landmark at which times, by the log's events.

    Raises:
        TracksError: no vehicle took the role.
    """
    table = log.events.get("role_taken")
    if table is None or not table["landmark"].any():
        raise TracksError("no vehicle takes the landmark's role in this mission")
    taken = table["landmark"]
    starts = [*(table["t_ns"][taken] / 1e9).tolist(), log.duration_ns / 1e9]
    return [Span(int(v), starts[k], starts[k + 1]) for k, v in enumerate(table["vehicle"][taken])]


def trajectories_figure(log: MissionLog, tracks: xr.Dataset, clouds: xr.Dataset | None) -> Figure:
    """True and estimated paths, particles at their instants, and positions measured by mutual positioning.

    One column for each navigator; above, positions by range and the landmark's bearing, below, by range and the
    mover's own (Figs. 9 and 11). Measured positions start from the estimates of the two vehicles' navigators. A square
    is a place where a vehicle landed. Save with `figure.savefig(path)`; needs no display.

    Raises:
        TracksError: no vehicle takes the landmark's role.
    """
    figure_class = matplotlib_figure()
    landmark_spans(log)
    navigators = [str(n) for n in tracks["navigator"].values]
    truth = finite_points(tracks["truth_position_m"].values)
    around = truth if len(truth) else finite_points(tracks["position_m"].values)
    fixes = [measured_positions(log, tracks, i) for i in range(len(navigators))]
    around = np.vstack([around, *(_most(each) for one in fixes for each in one.values())])
    view = frame_around(around, 0.05 * float(np.ptp(around, axis=0).max()) + 1.0)
    tall = float(np.clip((view[3] - view[2]) / (view[1] - view[0]), 0.25, 1.6))
    width = max(3.6, 7.2 / max(len(navigators), 1))
    figure = figure_class(
        figsize=(width * len(navigators) + 0.8, 2 * width * tall + 2.0), dpi=DPI, layout="constrained"
    )
    panels = figure.subplots(2, len(navigators), squeeze=False, sharex=True, sharey=True)
    for i, navigator in enumerate(navigators):
        measured = fixes[i]
        for row, name in enumerate(("peer", "own")):
            axes = panels[row, i]
            _draw_paths(axes, log, tracks, i)
            _draw_clouds(axes, clouds, i)
            colour = BY_LANDMARK if name == "peer" else BY_MOVER
            axes.plot(*measured[name].T, ls="", marker="+", ms=4.5, mew=0.9, color=colour, zorder=2.6)
            axes.set(xlim=view[:2], ylim=view[2:], aspect="equal")
            axes.tick_params(labelsize=8)
        panels[0, i].set_title(navigator, fontsize=10)
        panels[1, i].set_xlabel("east (m)")
    panels[0, 0].set_ylabel("by the landmark's bearing\nnorth (m)")
    panels[1, 0].set_ylabel("by the mover's own bearing\nnorth (m)")
    _legend(figure, log, clouds)
    figure.suptitle(
        f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: paths and measured positions", fontsize=12
    )
    return figure


def _most(points: Floats) -> Floats:
    """Corners of the frame that holds 98 % of the points on each axis; none where there are none."""
    finite = finite_points(points)
    return np.quantile(finite, [0.01, 0.99], axis=0) if len(finite) else np.empty((0, 2))


def measured_positions(log: MissionLog, tracks: xr.Dataset, navigator: int) -> dict[str, Floats]:
    """Where fixes put the mover, (K, 2) each: "peer" by range and the landmark's bearing, "own" by the mover's own.

    The landmark's pose is the mover's estimate of it (or that of the landmark's own navigator, where the mover has none),
    the heading is the mover's estimate; navigators without a yaw take the true one where it is known.
    """
    fixes = log.events.get("acoustic_fix")
    empty = np.empty((0, 2))
    if fixes is None or not len(fixes["t_ns"]):
        return {"peer": empty, "own": empty}
    t_s = fixes["t_ns"] / 1e9
    believed = Believed(log, tracks, navigator)
    stands, points = believed.landmark(fixes["vehicle"], fixes["peer"], t_s)
    bearing = points + fixes["peer_bearing_rad"]
    back = believed.yaw_rad(fixes["vehicle"], t_s) + fixes["own_bearing_rad"] + math.pi
    return {
        name: _polar(stands, fixes["range_m"], angle) for name, angle in (("peer", bearing), ("own", back))
    }


class Believed:
    """Estimates of one kind of navigator for any vehicle at any time, between the tracks' instants."""

    def __init__(self, log: MissionLog, tracks: xr.Dataset, navigator: int) -> None:
        self._time = np.asarray(tracks["time"].values, dtype=np.float64)
        self._position = np.asarray(tracks["position_m"].values[navigator], dtype=np.float64)
        self._yaw = np.asarray(tracks["yaw_rad"].values[navigator], dtype=np.float64)
        names = ("landmark_e_m", "landmark_n_m", "landmark_yaw_rad")
        hears = bool(tracks["heard"].values[navigator].any())  # else its landmark stays the first one
        self._landmark = [tracks[name].values[navigator] for name in names if hears and name in tracks]
        if not np.isfinite(self._yaw).any() and "truth_yaw_rad" in tracks:
            self._yaw = np.asarray(tracks["truth_yaw_rad"].values, dtype=np.float64)

    def position_m(self, vehicle: NDArray[np.int64], t_s: Floats) -> Floats:
        """(K, 2) east and north."""
        axes = [self._between(self._position[:, :, axis], vehicle, t_s) for axis in (0, 1)]
        return np.column_stack(axes)

    def yaw_rad(self, vehicle: NDArray[np.int64], t_s: Floats) -> Floats:
        """(K,), along the shorter arc."""
        return self._between(np.unwrap(np.nan_to_num(self._yaw), axis=1), vehicle, t_s)

    def landmark(
        self, mover: NDArray[np.int64], landmark: NDArray[np.int64], t_s: Floats
    ) -> tuple[Floats, Floats]:
        """Position (K, 2) and yaw (K,) of the landmark as the mover estimated them before these times."""
        position, yaw = self.position_m(landmark, t_s), self.yaw_rad(landmark, t_s)
        if len(self._landmark) == 3:
            before = np.maximum(np.searchsorted(self._time, t_s, side="right") - 1, 0)
            east, north, points = (values[mover, before] for values in self._landmark)
            known = np.isfinite(east) & np.isfinite(north) & np.isfinite(points)
            position = np.where(known[:, None], np.column_stack([east, north]), position)
            yaw = np.where(known, points, yaw)
        return position, yaw

    def _between(self, values: Floats, vehicle: NDArray[np.int64], t_s: Floats) -> Floats:
        out = np.empty(len(t_s))
        for v in np.unique(vehicle):
            own = vehicle == v
            out[own] = np.interp(t_s[own], self._time, values[v])
        return out


def velocities_figure(log: MissionLog) -> Figure:
    """Ground speed of each vehicle as its DVL read it, with its roles: shaded where it was the landmark (Fig. 8).

    Thin vertical lines are landings; numbers count the exchanges. Save with `figure.savefig(path)`; needs no display.

    Raises:
        TracksError: no vehicle takes the landmark's role, or no velocities are logged.
    """
    figure_class = matplotlib_figure()
    spans = landmark_spans(log)
    table = log.events.get("ground_velocity")
    if table is None:
        raise TracksError("the mission has no ground velocities")
    count = len(log.vehicles)
    figure = figure_class(figsize=(10.0, 1.6 * count + 1.4), dpi=DPI, layout="constrained")
    panels = figure.subplots(count, 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    for v, axes in enumerate(panels):
        mine = table["vehicle"] == v
        t_s = table["t_ns"][mine] / 1e9
        speed = np.hypot(table["forward_mps"][mine], table["left_mps"][mine])
        for k, span in enumerate(spans):
            if span.vehicle == v:
                axes.axvspan(span.start_s, span.end_s, color=OKABE_ITO[v % 8], alpha=ROLE_ALPHA, lw=0)
                if k:
                    axes.text(
                        span.start_s,
                        0.97,
                        f" {k}",
                        transform=axes.get_xaxis_transform(),
                        va="top",
                        fontsize=8,
                    )
        landed = log.events.get("landed")
        for t_ns in [] if landed is None else landed["t_ns"][landed["vehicle"] == v]:
            axes.axvline(t_ns / 1e9, color=INK, lw=0.8, ls=(0, (4, 2)))
        axes.plot(t_s, speed, color=OKABE_ITO[v % 8], lw=0.7)
        axes.set(ylabel=f"{log.vehicles[v]}\nspeed (m/s)", ylim=(0, None))
        axes.grid(alpha=0.3, lw=0.6)
        axes.tick_params(labelsize=8)
    panels[-1].set(xlabel="time (s)", xlim=(0, log.duration_ns / 1e9))
    _roles_legend(figure)
    figure.suptitle(f"{log.name}, seed {log.seed}: ground velocity by DVL, and roles", fontsize=12)
    return figure


def _polar(start: Floats, range_m: Floats, angle_rad: Floats) -> Floats:
    points = start + range_m[:, None] * np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])
    return np.asarray(points[np.isfinite(points).all(axis=1)])


def _draw_paths(axes: Axes, log: MissionLog, tracks: xr.Dataset, navigator: int) -> None:
    time = np.asarray(tracks["time"].values, dtype=np.float64)
    landed = log.events.get("landed")
    for j in range(len(log.vehicles)):
        truth = tracks["truth_position_m"].values[j]
        axes.plot(*truth.T, color=INK, lw=0.8, ls=(0, (4, 2.5)), zorder=3.2)
        axes.plot(*tracks["position_m"].values[navigator, j].T, color=OKABE_ITO[j % 8], lw=1.2, zorder=3)
        if landed is not None:
            when = landed["t_ns"][landed["vehicle"] == j] / 1e9
            at = np.clip(np.searchsorted(time, when), 0, len(time) - 1)
            axes.plot(
                *truth[at].T,
                ls="",
                marker=LANDED_MARKER,
                ms=6,
                mfc="white",
                mec=OKABE_ITO[j % 8],
                mew=1.4,
                zorder=4,
            )


def _draw_clouds(axes: Axes, clouds: xr.Dataset | None, navigator: int) -> None:
    if clouds is None:
        return
    particles = clouds["particles_m"].values[navigator]
    for j in range(particles.shape[0]):
        points = finite_points(particles[j, ::2, :: max(1, particles.shape[2] // 150)])
        axes.plot(*points.T, ls="", marker=".", ms=1.2, color=OKABE_ITO[j % 8], alpha=0.25, zorder=2)


def _legend(figure: Figure, log: MissionLog, clouds: xr.Dataset | None) -> None:
    from matplotlib.lines import Line2D

    handles: list[Any] = [
        Line2D([], [], color=OKABE_ITO[j % 8], lw=1.3, label=name) for j, name in enumerate(log.vehicles)
    ]
    handles += [
        Line2D([], [], color=INK, lw=0.9, ls=(0, (4, 2)), label="true path"),
        Line2D([], [], color="#555555", ls="", marker=LANDED_MARKER, mfc="white", ms=6, label="landed"),
        Line2D([], [], color=BY_LANDMARK, ls="", marker="+", ms=7, label="measured by the landmark"),
        Line2D([], [], color=BY_MOVER, ls="", marker="+", ms=7, label="measured by the mover"),
    ]
    if clouds is not None:
        handles.append(Line2D([], [], color="#888888", ls="", marker=".", ms=4, label="particles"))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 5), fontsize=8, frameon=False
    )


def _roles_legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(facecolor="#888888", alpha=2 * ROLE_ALPHA, label="landmark (numbers: exchanges)"),
        Line2D([], [], color=INK, lw=0.8, ls=(0, (4, 2)), label="landed"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
