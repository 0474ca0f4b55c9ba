"""Error over time, or what is stated of it: a row for each navigator, a column for each vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation import metrics
from uwcoop.evaluation.consistency_without_truth import has_truth, stated_sigma_m
from uwcoop.figures.style import (
    DPI,
    INK,
    LOST_COLOUR,
    OKABE_ITO,
    RECEIVED_COLOUR,
    REJECTED_COLOUR,
    matplotlib_figure,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.missionlog import Columns

    Floats = NDArray[np.float64]
    Packets = Mapping[str, NDArray[Any]]
    Innovations = Mapping[str, NDArray[Any]]


BOUND_LINES: tuple[tuple[str, Any, str], ...] = (
    ("bound_m", "-", "Cramér–Rao bound of the team"),
    ("linearised_bound_m", (0, (2, 1.5)), "the same over its own spread"),
)
"""Variables of the tracks that bound the error from below, if they are there, with line style and label."""

MOST_COLUMNS = 6
"""More vehicles go on in further rows."""

_LOG_ABOVE = 12.0
"""When navigators' typical errors differ by more than this factor, the axis is logarithmic."""
_ROW_INCH, _WIDTH_INCH = 1.25, 11.0
_STRIP = 0.13
"""Part of a panel's height that the packets' ticks take."""


def errors_figure(
    tracks: xr.Dataset,
    packets: Packets | None = None,
    innovations: Innovations | None = None,
    held_out: Columns | None = None,
) -> Figure:
    """Distance from truth over time as a line in the vehicle's colour, above a band up to 2·√trace of its covariance.

    Without truth of a vehicle its panels show the band, and the distance of each fix from the belief before it was
    used, on a stem as long as 2 sigma of belief and fix together (from `innovations`, as `RunResult` has them). Fixes
    that were `held_out` are diamonds at their distance from the estimate. Along the lower edge there is a tick for
    each packet that arrived, a black, hanging one for a lost one, a tall one for one that the navigator refused (from
    `packets`; without them, from the tracks' `received` and `heard`). Shaded: the time before `settle_s`, which no
    statistic counts, and, hatched, spans in which it dead-reckons off the chart. All panels have one axis,
    logarithmic when the navigators differ by more than a factor 12. Save with `figure.savefig(path)`; needs no
    display.
    """
    figure_class = matplotlib_figure()
    navigators, vehicles = ([str(n) for n in tracks[dim].values] for dim in ("navigator", "vehicle"))
    columns = min(len(vehicles), MOST_COLUMNS)
    lines = math.ceil(len(vehicles) / columns)
    rows = len(navigators) * lines
    figure = figure_class(
        figsize=(_WIDTH_INCH, _ROW_INCH * max(rows, 2) + 1.5), dpi=DPI, layout="constrained"
    )
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    known = has_truth(tracks)
    shown = _shown(tracks, known)
    log, limits = _scale(shown, tracks)
    for i, navigator in enumerate(navigators):
        arrivals = _arrivals(tracks, packets, i)
        for j, vehicle in enumerate(vehicles):
            axes = panels[i * lines + j // columns, j % columns]
            _draw_panel(axes, tracks, shown, (i, j), limits[0])
            if not known[j] and innovations is not None:
                _draw_fixes(axes, innovations, (i, j), limits)
            if held_out is not None and len(held_out["t_ns"]):
                _draw_held_out(axes, tracks, held_out, (i, j), limits)
            if arrivals is not None:
                _draw_ticks(axes, arrivals, j)
            if i == 0 or lines > 1:
                axes.set_title(vehicle if known[j] else f"{vehicle}: no truth", fontsize=9, pad=3)
        for line in range(lines):
            panels[i * lines + line, 0].set_ylabel(f"{navigator}\n(m)", fontsize=8)
    time = tracks["time"].values
    for axes in panels.flat:
        axes.set_yscale("log" if log else "linear")
        if log:
            axes.yaxis.set_major_formatter("{x:g}")
        axes.set(xlim=(time[0], time[-1]), ylim=limits)
        axes.grid(alpha=0.3, lw=0.6)
        axes.tick_params(labelsize=7)
    for k in range(len(vehicles), lines * columns):
        for i in range(len(navigators)):
            panels[i * lines + k // columns, k % columns].set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("time (s)", fontsize=8)
    _legend(figure, tracks, packets, known, innovations, held_out)
    what = "distance from truth" if known.any() else "stated uncertainty; no truth is known"
    figure.suptitle(f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: {what}", fontsize=11)
    return figure


def _shown(tracks: xr.Dataset, known: NDArray[np.bool_]) -> Floats:
    """The line of each panel: the error; what is stated where no truth is known."""
    error_m = metrics.errors(tracks).values
    error_m = np.where(np.isfinite(error_m), error_m, np.nan)
    return np.where(known[None, :, None], error_m, 2 * stated_sigma_m(tracks))


def _draw_panel(axes: Axes, tracks: xr.Dataset, shown: Floats, place: tuple[int, int], bottom: float) -> None:
    time, colour = tracks["time"].values, OKABE_ITO[place[1] % 8]
    band = 2 * stated_sigma_m(tracks)[place]
    settle_s = float(tracks.attrs["settle_s"])
    axes.axvspan(time[0], settle_s, color="#000000", alpha=0.07, lw=0, zorder=0)
    axes.axvline(settle_s, color="#666666", lw=0.7, ls="--", zorder=1)
    axes.fill_between(time, bottom, band, color=colour, alpha=0.16, lw=0, zorder=1.5)
    axes.plot(time, band, color=colour, lw=0.5, alpha=0.55, zorder=1.6)
    for name, style, _ in BOUND_LINES:
        if name in tracks and tracks[name].ndim == 2:
            axes.plot(time, tracks[name].values[place[1]], color=INK, lw=0.9, ls=style, zorder=2)
    if has_truth(tracks)[place[1]]:
        axes.plot(time, shown[place], color=colour, lw=1.1, zorder=3)
    for start, end in _spans(time, tracks["off_chart"].values[place]):
        axes.axvspan(start, end, facecolor="none", edgecolor="#777777", lw=0, hatch="///", zorder=0.5)


def _draw_fixes(
    axes: Axes, innovations: Innovations, place: tuple[int, int], limits: tuple[float, float]
) -> None:
    """How far each fix was from the belief before it was used; those beyond the axis stand at its upper edge."""
    own = (
        (innovations["kind"] == "fix")
        & (innovations["navigator"] == place[0])
        & (innovations["vehicle"] == place[1])
    )
    distance = np.minimum(innovations["innovation_m"][own], 0.97 * limits[1])
    fused = innovations["fused"][own]
    time = innovations["t_ns"][own] / 1e9
    axes.vlines(time, limits[0], 2 * innovations["sigma_m"][own], color="#777777", lw=0.6, zorder=3.5)
    for which, face in ((fused, "white"), (~fused, REJECTED_COLOUR)):
        axes.plot(
            time[which], distance[which], ls="", marker="o", ms=3.2, mfc=face, mec=INK, mew=0.7, zorder=4
        )  # fmt: skip


def _draw_held_out(
    axes: Axes, tracks: xr.Dataset, fixes: Columns, place: tuple[int, int], limits: tuple[float, float]
) -> None:
    own = fixes["vehicle"] == place[1]
    time_s = fixes["t_ns"][own] / 1e9
    at = np.searchsorted(tracks["time"].values, time_s - 5e-10)
    off = np.column_stack([fixes["e_m"][own], fixes["n_m"][own]]) - tracks["position_m"].values[place][at]
    distance = np.minimum(np.hypot(*off.T), 0.97 * limits[1])
    axes.plot(time_s, distance, ls="", marker="D", ms=3.2, mfc="#FFFFFF", mec=INK, mew=0.7, zorder=4.1)


def _draw_ticks(axes: Axes, arrivals: tuple[NDArray[Any], ...], vehicle: int) -> None:
    """One vehicle's arrivals along the lower edge; lost ones hang."""
    receiver, toa_s, received, accepted = arrivals
    own = receiver == vehicle
    across = axes.get_xaxis_transform()
    for which, name, colour, bottom, top in (
        (own & received & accepted, "received", RECEIVED_COLOUR, 0.0, 0.45),
        (own & received & ~accepted, "refused", REJECTED_COLOUR, 0.0, 0.95),
        (own & ~received, "lost", LOST_COLOUR, 0.5, 0.95),
    ):
        axes.vlines(
            toa_s[which], bottom * _STRIP, top * _STRIP, color=colour, lw=0.8 if name == "received" else 1.2,
            transform=across, gid=name, zorder=2.5,
        )  # fmt: skip


def _arrivals(tracks: xr.Dataset, packets: Packets | None, navigator: int) -> tuple[NDArray[Any], ...] | None:
    """Receiver, arrival (s), received, accepted of one navigator's packets; None if it is silent."""
    if packets is None:
        heard = tracks["heard"].values[navigator]
        if not heard.any():
            return None
        receiver, at = np.nonzero(tracks["received"].values)
        took = heard[receiver, at]
        return receiver, tracks["time"].values[at], took, took
    own = (packets["navigator"] == navigator) & (packets["bytes"] > 0)
    if not own.any():
        return None
    return (
        packets["receiver"][own],
        packets["toa_ns"][own] / 1e9,
        packets["received"][own].astype(bool),
        packets["accepted"][own].astype(bool),
    )


def _scale(shown: Floats, tracks: xr.Dataset) -> tuple[bool, tuple[float, float]]:
    """Logarithmic or not, and limits common to all panels, with room for the ticks below."""
    after = shown[..., tracks["time"].values > float(tracks.attrs["settle_s"])]
    after = after if np.isfinite(after).any() else shown
    if not np.isfinite(after).any():
        return False, (-_STRIP, 1.0)
    typical = [float(np.nanmedian(a)) for a in after if np.isfinite(a).any()]
    top = float(np.nanmax(shown))
    log = max(typical) > _LOG_ABOVE * max(min(typical), 1e-3)
    if not log:
        # A first fix far off must not flatten the rest.
        top = 1.08 * max(min(top, 3 * float(np.nanquantile(after, 0.99))), 1e-3)
        return False, (-_STRIP / (1 - _STRIP) * top, top)
    least, top = max(min(typical) / 10, 0.01), 1.3 * top
    return True, (least * (least / top) ** (_STRIP / (1 - _STRIP)), top)


def _spans(time: Floats, flag: NDArray[np.bool_]) -> list[tuple[float, float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flag.astype(bool), [False]]).astype(np.int8)))
    return [(float(time[a]), float(time[min(b, len(time) - 1)])) for a, b in edges.reshape(-1, 2)]


def _legend(
    figure: Figure,
    tracks: xr.Dataset,
    packets: Packets | None,
    known: NDArray[np.bool_],
    innovations: Innovations | None,
    held_out: Columns | None,
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    if known.any():
        handles.append(Line2D([], [], color="#777777", lw=1.4, label="error (colour: vehicle)"))
    handles.append(
        Patch(facecolor="#DDDDDD", edgecolor="#AAAAAA", lw=0.6, label="up to 2·√trace of its covariance")
    )
    handles += [
        Line2D([], [], color=INK, lw=0.9, ls=style, label=label)
        for name, style, label in BOUND_LINES
        if name in tracks
    ]
    if not known.all() and innovations is not None and (innovations["kind"] == "fix").any():
        marker: dict[str, Any] = {"ls": "", "marker": "o", "ms": 4, "mec": INK, "mew": 0.7}
        handles.append(Line2D([], [], mfc="white", label="fix, from the belief before it", **marker))
        handles.append(Line2D([], [], mfc=REJECTED_COLOUR, label="the same, gated", **marker))
        handles.append(Line2D([], [], color="#777777", lw=0.8, label="up to 2σ of fix and belief"))
    if held_out is not None and len(held_out["t_ns"]):
        handles.append(Line2D([], [], ls="", marker="D", ms=4, mfc="white", mec=INK, label="fix held out"))
    handles.append(Patch(facecolor="#000000", alpha=0.1, label=f"settling, {tracks.attrs['settle_s']:g} s"))
    if tracks["off_chart"].values.any():
        handles.append(Patch(facecolor="none", edgecolor="#777777", hatch="///", lw=0, label="off the chart"))
    talking = [i for i in range(tracks.sizes["navigator"]) if _arrivals(tracks, packets, i) is not None]
    if talking:
        ticks = [("packet received", RECEIVED_COLOUR), ("lost", LOST_COLOUR)]
        ticks += [("refused by the navigator", REJECTED_COLOUR)] if packets is not None else []
        handles += [
            Line2D([], [], color=colour, ls="", marker="|", ms=8, mew=1.2, label=label)
            for label, colour in ticks
        ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 5), fontsize=8, frameon=False,
        handlelength=2.4,
    )  # fmt: skip
