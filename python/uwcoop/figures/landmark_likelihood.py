"""Fixes channel by channel: offset, and likelihood with its maximum (Matsuda et al. 2017, Figs. 10, 12, 13)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.landmark import landmark_spans
from uwcoop.figures.landmark_fixes import CHANNELS, fix_offsets
from uwcoop.figures.style import DPI, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

    Floats = NDArray[np.float64]

SIGMA = (0.66, np.radians(6.0), np.radians(1.0))
"""Table 4: range, m, and the directions by mover and landmark, rad."""
THRESHOLD = 3.0
"""Table 4: k of all channels."""
REACH = 6.0
"""Axes of offsets end at so many sigmas."""
NAMES = ("(a) range (m)", "(b) by the\nmover (°)", "(c) by the\nlandmark (°)")


def channel_likelihood(offset: Floats, sigma: float) -> Floats:
    """exp(k²/2 − z²/2), a channel's factor of (12) or (14), inside k sigmas; else 1. NaN where it was not measured."""
    z = offset / sigma
    inside = np.abs(z) < THRESHOLD
    value = np.where(inside, np.exp(0.5 * (THRESHOLD**2 - np.where(inside, z, 0.0) ** 2)), 1.0)
    return np.asarray(np.where(np.isnan(z), np.nan, value))


def likelihoods_figure(log: MissionLog, tracks: xr.Dataset) -> Figure:
    """Of each channel the offset from the mean estimate and the likelihood, with its maximum; by who moves.

    Table 4's sigmas and thresholds. Triangles at the edge: offsets beyond the axis. Vertical lines: exchanges of roles.

    Raises:
        TracksError: no vehicle takes the landmark's role, no fixes, or more than one navigator.
    """
    spans = landmark_spans(log)
    navigators = [str(name) for name in tracks["navigator"].values]
    if len(navigators) != 1 or "acoustic_fix" not in log.events:
        raise TracksError(f"it shows the fixes of one navigator, not of {len(navigators)}")
    fixes = log.events["acoustic_fix"]
    t_s = fixes["t_ns"] / 1e9
    found = fix_offsets(log, tracks, 0)
    figure = matplotlib_figure()(figsize=(10.5, 9.0), dpi=DPI, layout="constrained")
    panels = figure.subplots(6, 1, sharex=True, gridspec_kw={"height_ratios": [1.3, 1] * 3})
    for k, channel in enumerate(CHANNELS):
        scale = 1.0 if k == 0 else 180 / np.pi
        top, below = panels[2 * k], panels[2 * k + 1]
        likelihood = channel_likelihood(found[channel], SIGMA[k])
        for v, name in enumerate(log.vehicles):
            own = fixes["vehicle"] == v
            if own.any():
                _draw_offsets(top, t_s[own], scale * found[channel][own], scale * REACH * SIGMA[k], v, name)
                below.plot(t_s[own], likelihood[own], ls="", marker=".", ms=5, color=OKABE_ITO[v % 8])
        top.axhspan(
            -THRESHOLD * scale * SIGMA[k], THRESHOLD * scale * SIGMA[k], color="#999999", alpha=0.15, lw=0
        )
        below.axhline(np.exp(0.5 * THRESHOLD**2), color="#111111", lw=0.8, ls="--")
        top.set_ylabel(NAMES[k], fontsize=8)
        below.set_ylim(-4, 100)
        below.set_ylabel("likelihood", fontsize=8)
    for axes in panels:
        for span in spans[1:]:
            axes.axvline(span.start_s, color="#111111", lw=0.7, ls=(0, (1, 1.5)))
        axes.grid(alpha=0.25, lw=0.5)
        axes.tick_params(labelsize=8)
    panels[-1].set(xlabel="time (s)", xlim=(0, log.duration_ns / 1e9))
    panels[0].legend(fontsize=8, loc="upper left", ncols=2)
    figure.suptitle(
        f"{log.name}, seed {log.seed}: {navigators[0]}, offsets and likelihood by channel\n"
        f"shaded: ±{THRESHOLD:g} sigma; dashed: the likelihood's maximum; triangles: beyond the axis", fontsize=10,
    )  # fmt: skip
    return figure


def _draw_offsets(axes: Axes, t_s: Floats, values: Floats, reach: float, vehicle: int, name: str) -> None:
    colour = OKABE_ITO[vehicle % 8]
    inside = np.abs(values) <= reach
    axes.plot(
        t_s[inside], values[inside], ls="", marker="o", ms=3, mfc="none", color=colour, label=f"{name} moves"
    )
    for side, mark in ((1, "^"), (-1, "v")):
        beyond = side * values > reach
        axes.plot(
            t_s[beyond],
            np.full(int(beyond.sum()), side * 0.96 * reach),
            ls="",
            marker=mark,
            ms=5,
            color=colour,
        )
    axes.axhline(0, color="#666666", lw=0.5)
    axes.set_ylim(-reach, reach)
