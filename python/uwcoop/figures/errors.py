"""Error over time: one row per vehicle, one line per navigator, and what each heard and lost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation import metrics
from uwcoop.figures.style import (
    DPI,
    LINE_STYLES,
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

    Packets = Mapping[str, NDArray[Any]]


BOUND_LINES: tuple[tuple[str, Any, str], ...] = (
    ("bound_m", "-", "Cramér–Rao bound of the team"),
    ("linearised_bound_m", (0, (2, 1.5)), "the same over its own spread"),
)
"""Variables of the tracks that bound the error from below, if they are there, with line style and label."""

_LOG_ABOVE = 12.0
"""When navigators' typical errors differ by more than this factor, the axis is logarithmic."""

_ROW_INCH, _STRIP_INCH = 1.9, 0.14


def errors_figure(tracks: xr.Dataset, packets: Packets | None = None) -> Figure:
    """Distance from truth over time, with 2·sqrt(trace of covariance) as a thin line in the same colour.

    Under each vehicle's row there is a strip for each navigator that communicates: a tick for each packet
    that arrived, another colour and height for a lost one and for one that the navigator refused (from
    `packets`; without them, from the tracks' `received` and `heard`). Shaded: the time before `settle_s`,
    which no statistic counts, and, in the navigator's colour and hatched, spans in which it dead-reckons
    off the chart. The error axis is logarithmic when the navigators differ by more than a factor 12. Save
    with `figure.savefig(path)`; needs no display.
    """
    figure_class = matplotlib_figure()
    navigators = [str(n) for n in tracks["navigator"].values]
    vehicles = [str(v) for v in tracks["vehicle"].values]
    arrivals = [_arrivals(tracks, packets, i) for i in range(len(navigators))]
    talking = [i for i, arrival in enumerate(arrivals) if arrival is not None]
    strip_inch = _STRIP_INCH * max(len(talking), 1) + 0.05
    figure = figure_class(
        figsize=(11.0, (_ROW_INCH + strip_inch + 0.12) * len(vehicles) + 1.5), dpi=DPI, layout="constrained"
    )
    panels = figure.subplots(
        2 * len(vehicles),
        1,
        squeeze=False,
        sharex=True,
        height_ratios=[_ROW_INCH, strip_inch] * len(vehicles),
    )[:, 0]
    error_m = metrics.errors(tracks).values
    error_m = np.where(np.isfinite(error_m), error_m, np.nan)
    log, limits = _scale(error_m, tracks)
    for j, vehicle in enumerate(vehicles):
        axes, strip = panels[2 * j], panels[2 * j + 1]
        _draw_errors(axes, tracks, error_m, j)
        axes.set_yscale("log" if log else "linear")
        if log:
            axes.yaxis.set_major_formatter("{x:g}")
        axes.set(ylim=limits, ylabel=f"{vehicle}\nerror (m)")
        axes.grid(alpha=0.3, lw=0.6)
        axes.tick_params(labelbottom=False)
        _draw_strip(strip, [(navigators[i], i, arrivals[i]) for i in talking], j)
    time = tracks["time"].values
    panels[-1].set(xlim=(time[0], time[-1]), xlabel="time (s)")
    panels[-1].tick_params(labelbottom=True)
    _legend(figure, tracks, bool(talking), packets is not None)
    figure.suptitle(
        f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: distance from truth", fontsize=12
    )
    return figure


def _draw_errors(axes: Axes, tracks: xr.Dataset, error_m: NDArray[np.float64], vehicle: int) -> None:
    time = tracks["time"].values
    covariance = tracks["covariance_m2"].values[:, vehicle]
    trace = covariance[..., 0, 0] + covariance[..., 1, 1]
    spread = 2 * np.sqrt(np.where(np.isfinite(trace) & (trace >= 0), trace, np.nan))
    axes.axvspan(time[0], float(tracks.attrs["settle_s"]), color="#000000", alpha=0.07, lw=0, zorder=0)
    axes.axvline(float(tracks.attrs["settle_s"]), color="#666666", lw=0.8, ls="--", zorder=1)
    width = 1.3 if len(error_m) < 4 else 1.0
    _draw_bounds(axes, tracks, vehicle)
    for i in range(error_m.shape[0]):
        colour = OKABE_ITO[i % 8]
        axes.plot(time, spread[i], color=colour, lw=0.7, alpha=0.75, zorder=2)
        axes.plot(time, error_m[i, vehicle], color=colour, lw=width, ls=LINE_STYLES[i % 5], zorder=3)
        for start, end in _spans(time, tracks["off_chart"].values[i, vehicle]):
            axes.axvspan(
                start, end, facecolor=colour, edgecolor=colour, alpha=0.15, lw=0, hatch="///", zorder=0.5
            )


def _draw_bounds(axes: Axes, tracks: xr.Dataset, vehicle: int) -> None:
    """The Cramér-Rao bound, in black."""
    for name, style, _ in BOUND_LINES:
        if name in tracks and tracks[name].ndim == 2:
            axes.plot(
                tracks["time"].values, tracks[name].values[vehicle], color="black", lw=1.1, ls=style, zorder=4
            )


def _draw_strip(axes: Axes, talking: list[tuple[str, int, Any]], vehicle: int) -> None:
    """Ticks of one vehicle's arrivals, a line for each navigator; lost ones hang lower than received ones."""
    axes.set_ylim(len(talking) or 1, 0)
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
    axes.tick_params(bottom=False, labelbottom=False)
    for line, (navigator, i, (receiver, toa_s, received, accepted)) in enumerate(talking):
        own = receiver == vehicle
        for which, colour, top, bottom in (
            (own & received & accepted, RECEIVED_COLOUR, 0.08, 0.6),
            (own & received & ~accepted, REJECTED_COLOUR, 0.08, 0.92),
            (own & ~received, LOST_COLOUR, 0.4, 0.92),
        ):
            axes.vlines(toa_s[which], line + top, line + bottom, color=colour, lw=1.0)
        axes.text(
            -0.006, line + 0.5, navigator, color=OKABE_ITO[i % 8], fontsize=6.5, ha="right", va="center",
            transform=axes.get_yaxis_transform(),
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


def _scale(error_m: NDArray[np.float64], tracks: xr.Dataset) -> tuple[bool, tuple[float, float]]:
    """Logarithmic or not, and limits common to all rows, so that vehicles can be compared."""
    after = error_m[..., tracks["time"].values > float(tracks.attrs["settle_s"])]
    after = after if np.isfinite(after).any() else error_m
    if not np.isfinite(after).any():
        return False, (0.0, 1.0)
    typical = [float(np.nanmedian(a)) for a in after if np.isfinite(a).any()]
    top = float(np.nanmax(error_m))
    log = max(typical) > _LOG_ABOVE * max(min(typical), 1e-3)
    if not log:
        # A first fix far off must not flatten the rest.
        return False, (0.0, 1.08 * max(min(top, 3 * float(np.nanquantile(after, 0.99))), 1e-3))
    return True, (max(min(typical) / 10, 0.01), 1.3 * top)


def _spans(time: NDArray[np.float64], flag: NDArray[np.bool_]) -> list[tuple[float, float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flag.astype(bool), [False]]).astype(np.int8)))
    return [(float(time[a]), float(time[min(b, len(time) - 1)])) for a, b in edges.reshape(-1, 2)]


def _legend(figure: Figure, tracks: xr.Dataset, strips: bool, told_apart: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=OKABE_ITO[i % 8], ls=LINE_STYLES[i % 5], lw=1.5, label=str(name))
        for i, name in enumerate(tracks["navigator"].values)
    ]
    handles.append(Line2D([], [], color="#777777", lw=0.7, label="2·√trace of its covariance"))
    handles += [
        Line2D([], [], color="black", lw=1.1, ls=style, label=label)
        for name, style, label in BOUND_LINES
        if name in tracks
    ]
    handles.append(Patch(facecolor="#000000", alpha=0.1, label=f"settling, {tracks.attrs['settle_s']:g} s"))
    if tracks["off_chart"].values.any():
        handles.append(
            Patch(facecolor="#cccccc", edgecolor="#777777", hatch="///", lw=0, label="off the chart")
        )
    if strips:
        ticks = [("packet received", RECEIVED_COLOUR), ("lost", LOST_COLOUR)]
        ticks += [("refused by the navigator", REJECTED_COLOUR)] if told_apart else []
        handles += [
            Line2D([], [], color=colour, ls="", marker="|", ms=8, mew=1.2, label=label)
            for label, colour in ticks
        ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 5), fontsize=8, frameon=False,
        handlelength=3.2,
    )  # fmt: skip
