"""Fixes one by one: offsets and likelihood over time, and particles before and after a reconstruction.

Matsuda et al. (2017), Figs. 10, 12, 13 and 15.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.landmark import Believed, Span, landmark_spans
from uwcoop.figures.map import finite_points, frame_around
from uwcoop.figures.style import DPI, LINE_STYLES, MARKERS, OKABE_ITO, matplotlib_figure
from uwcoop.frames import wrap_angle

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

    Floats = NDArray[np.float64]

CHANNELS = ("range_m", "own_bearing_rad", "peer_bearing_rad")
LABELS = ("range\noffset (m)", "mover's bearing\noffset (deg)", "landmark's bearing\noffset (deg)")
BEFORE, AFTER = "#D55E00", "#009E73"
"""Particles before and after a fix."""
BEYOND = 6.0
"""Offsets are drawn up to so many times those of the best navigator."""
PANELS = 9
"""Fixes shown around a reconstruction: the paper shows (a) to (i)."""


def fix_offsets(log: MissionLog, tracks: xr.Dataset, navigator: int) -> dict[str, Floats]:
    """Signed offsets of every fix from the navigators' predictions, by (10), (11) and (13): metres and radians, (K,).

    Poses are the mover's beliefs, between the tracks' instants. NaN: not measured.
    """
    fixes = log.events.get("acoustic_fix")
    if fixes is None:
        raise TracksError("the mission has no mutual positioning")
    believed = Believed(log, tracks, navigator)
    asked_s, t_s = fixes["transmit_ns"] / 1e9, fixes["t_ns"] / 1e9
    stands, points = believed.landmark(fixes["vehicle"], fixes["peer"], t_s)
    back = stands - believed.position_m(fixes["vehicle"], t_s)
    out = stands - believed.position_m(fixes["vehicle"], asked_s)
    own = np.arctan2(back[:, 1], back[:, 0]) - believed.yaw_rad(fixes["vehicle"], t_s)
    peer = np.arctan2(-out[:, 1], -out[:, 0]) - points
    return {
        "range_m": fixes["range_m"] - (np.hypot(*back.T) + np.hypot(*out.T)) / 2,
        "own_bearing_rad": np.asarray(wrap_angle(fixes["own_bearing_rad"] - own)),
        "peer_bearing_rad": np.asarray(wrap_angle(fixes["peer_bearing_rad"] - peer)),
    }


def offsets_figure(log: MissionLog, tracks: xr.Dataset) -> Figure:
    """Offsets of range and both bearings over time, and, of navigators that monitor it, the likelihood.

    A row for each measurement, a colour for each navigator; below, the share ln(mean likelihood) / ln(largest)
    of the mover with the threshold of the log reading, and each reconstruction or reset as a vertical line.
    Shaded: two sigmas of the scenario. Thin vertical lines: exchanges. What lies far beyond the best navigator's
    offsets is cut off. Save with `figure.savefig(path)`; needs no display.

    Raises:
        TracksError: no vehicle takes the landmark's role, or there are no fixes.
    """
    figure_class = matplotlib_figure()
    spans = landmark_spans(log)
    navigators = [str(n) for n in tracks["navigator"].values]
    monitored = [i for i in range(len(navigators)) if _likelihood(tracks, i) is not None]
    rows = len(CHANNELS) + bool(monitored)
    figure = figure_class(figsize=(11.0, 1.75 * rows + 1.2), dpi=DPI, layout="constrained")
    panels = figure.subplots(rows, 1, squeeze=False, sharex=True)[:, 0]
    t_s = log.events["acoustic_fix"]["t_ns"] / 1e9 if "acoustic_fix" in log.events else np.empty(0)
    sigma = _sigmas(log)
    reach: list[list[float]] = [[] for _ in CHANNELS]
    for i in range(len(navigators)):
        offsets = fix_offsets(log, tracks, i)
        for k, (axes, channel) in enumerate(zip(panels, CHANNELS, strict=False)):
            values = offsets[channel] if k == 0 else np.degrees(offsets[channel])
            # Later ones are smaller and on top: where methods agree their marks are concentric.
            size = 2.6 + 1.5 * (len(navigators) - 1 - i)
            style: dict[str, Any] = {
                "ls": "",
                "marker": MARKERS[i % 8],
                "mfc": "none",
                "color": OKABE_ITO[i % 8],
            }
            axes.plot(t_s, values, ms=size, mew=0.9, zorder=3, **style)
            finite = np.abs(values[np.isfinite(values)])
            reach[k].append(float(np.quantile(finite, 0.98)) if finite.size else 0.0)
    for k, axes in enumerate(panels[: len(CHANNELS)]):
        axes.axhspan(-2 * sigma[k], 2 * sigma[k], color="#999999", alpha=0.18, lw=0)
        top = 1.15 * max(min(max(reach[k]), BEYOND * min(reach[k])), 3 * sigma[k])
        axes.set(ylim=(-top, top), ylabel=LABELS[k])
        axes.axhline(0, color="#666666", lw=0.5)
    for i in monitored:
        _draw_likelihood(panels[-1], tracks, i, spans)
    for axes in panels:
        for span in spans[1:]:
            axes.axvline(span.start_s, color="#111111", lw=0.7, ls=(0, (1, 1.5)))
        axes.grid(alpha=0.25, lw=0.5)
        axes.tick_params(labelsize=8)
    panels[-1].set(xlabel="time (s)", xlim=(0, log.duration_ns / 1e9))
    _offsets_legend(figure, navigators)
    figure.suptitle(
        f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: fixes against beliefs", fontsize=12
    )
    return figure


def reconstruction_figure(log: MissionLog, around: xr.Dataset, navigator: str) -> Figure:
    """The mover's particles immediately before and after each of nine fixes, from one before a reconstruction (Fig. 15).

    Args:
        log: the mission.
        around: what `uwcoop.experiment.particles_at_fixes.around_fixes` gives.
        navigator: for the title.

    Raises:
        TracksError: no reconstruction in this mission.
    """
    figure_class = matplotlib_figure()
    counts = around["reconstructions"].values
    jumps = np.flatnonzero(counts[:, 1] > counts[:, 0])
    if not jumps.size:
        raise TracksError(f"{navigator} reconstructs no particles in this mission")
    shown = np.arange(max(0, jumps[0] - 2), min(len(counts), max(0, jumps[0] - 2) + PANELS))
    figure = figure_class(figsize=(9.6, 10.2), dpi=DPI, layout="constrained")
    panels = figure.subplots(3, 3, squeeze=False).ravel()
    for spare in panels[len(shown) :]:
        spare.set_axis_off()
    for panel, (axes, k) in enumerate(zip(panels, shown, strict=False)):
        before, after = (around["particles_m"].values[k, side] for side in (0, 1))
        thin = max(1, len(after) // 1500)
        axes.plot(*finite_points(before[::thin]).T, ls="", marker=".", ms=1.6, color=BEFORE, alpha=0.5)
        axes.plot(*finite_points(after[::thin]).T, ls="", marker=".", ms=1.6, color=AFTER, alpha=0.5)
        truth = around["truth_m"].values[k]
        axes.plot(*truth, marker="x", ms=8, mew=1.8, color="#111111", ls="")
        measured = around["measured_m"].values[k]
        axes.plot(*measured, marker="+", ms=11, mew=1.6, color="#0072B2", ls="")
        points = np.vstack([finite_points(p) for p in (before, after, truth[None], measured[None])])
        low, high = np.quantile(points, [0.005, 0.995], axis=0)
        box = np.vstack([low, high, truth, np.where(np.isfinite(measured), measured, truth)])
        view = _square(frame_around(box, 0.4))
        new = int(counts[k, 1] - counts[k, 0])
        note = ", reconstruction" if new else ""
        axes.set(xlim=view[:2], ylim=view[2:], aspect="equal")
        axes.set_title(f"({'abcdefghi'[panel]}) {around['t_s'].values[k]:.0f} s{note}", fontsize=9)
        axes.tick_params(labelsize=7)
        axes.locator_params(nbins=5)
        axes.grid(alpha=0.25, lw=0.5)
    for panel in range(3):
        panels[6 + panel].set_xlabel("east (m)", fontsize=9)
        panels[3 * panel].set_ylabel("north (m)", fontsize=9)
    _particles_legend(figure)
    figure.suptitle(
        f"{log.name}, seed {log.seed}: {navigator}'s particles around a reconstruction", fontsize=12
    )
    return figure


def _square(view: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    east, north = (view[0] + view[1]) / 2, (view[2] + view[3]) / 2
    half = max(view[1] - view[0], view[3] - view[2]) / 2
    return east - half, east + half, north - half, north + half


def _sigmas(log: MissionLog) -> Floats:
    """Of range (m) and both bearings (deg), as the scenario or the data set states them; 0: not stated."""
    stated = log.setup.positioning
    if stated is None:
        return np.zeros(3)
    return np.array([stated.range_m, stated.own_bearing_deg, stated.peer_bearing_deg])


def _likelihood(tracks: xr.Dataset, navigator: int) -> Floats | None:
    """ln(mean likelihood) / ln(largest), (vehicle, time); None for a navigator without a monitor."""
    if not {"likelihood_log_mean", "likelihood_log_max"} <= set(tracks.data_vars):
        return None
    mean, most = (tracks[f"likelihood_log_{name}"].values[navigator] for name in ("mean", "max"))
    if not np.isfinite(mean).any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(most > 0, mean / most, np.nan), dtype=np.float64)


def _draw_likelihood(axes: Axes, tracks: xr.Dataset, navigator: int, spans: list[Span]) -> None:
    time = tracks["time"].values
    share = _likelihood(tracks, navigator)
    assert share is not None
    for span in spans:  # who is the landmark measures nothing
        share[span.vehicle, (time >= span.start_s) & (time < span.end_s)] = np.nan
    for j in range(share.shape[0]):
        axes.plot(time, share[j], color=OKABE_ITO[navigator % 8], lw=0.9, ls=LINE_STYLES[j % 5])
        for name, style in (("reconstructions", "-"), ("resets", "--")):
            if name in tracks:
                count = tracks[name].values[navigator, j]
                for k in np.flatnonzero(np.diff(np.nan_to_num(count)) > 0):
                    axes.axvline(time[k + 1], color=OKABE_ITO[navigator % 8], lw=1.0, ls=style, alpha=0.8)
    axes.axhline(0.6, color="#666666", lw=0.7, ls="--")
    axes.set(ylabel="ln mean likelihood\n/ ln largest", ylim=(-0.1, 1.05))


def _offsets_legend(figure: Figure, navigators: list[str]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], ls="", marker=MARKERS[i % 8], ms=6, mfc="none", color=OKABE_ITO[i % 8], label=name)
        for i, name in enumerate(navigators)
    ]
    handles += [
        Patch(facecolor="#999999", alpha=0.3, label="±2σ"),
        Line2D([], [], color="#111111", lw=0.8, ls=(0, (1, 1.5)), label="exchange of roles"),
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 6), fontsize=8, frameon=False
    )


def _particles_legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D

    handles: list[Any] = [
        Line2D([], [], ls="", marker=".", ms=7, color=BEFORE, label="particles before the fix"),
        Line2D([], [], ls="", marker=".", ms=7, color=AFTER, label="particles after it"),
        Line2D([], [], ls="", marker="x", ms=7, mew=1.8, color="#111111", label="true position"),
        Line2D([], [], ls="", marker="+", ms=9, mew=1.6, color="#0072B2", label="measured by the landmark"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
