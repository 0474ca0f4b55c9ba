"""Each navigator's sigma over time, beside its error (Walls & Eustice 2012, Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.evaluation import metrics
from uwcoop.figures.style import DPI, LINE_STYLES, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Packets = Mapping[str, NDArray[Any]]


def uncertainty_figure(tracks: xr.Dataset, packets: Packets | None = None) -> Figure:
    """For each vehicle: above, the root of the trace of the position's covariance by navigator; below, the error.

    Where a navigator is consistent, its error is about as large as its sigma. Ticks at the top are arrivals of packets at
    the navigator that heard most. Lines that lie on each other are drawn thinner, one over the other.

    Raises:
        TracksError: no navigator states a covariance.
    """
    spread = np.sqrt(np.trace(tracks["covariance_m2"].values, axis1=-2, axis2=-1))
    if not np.isfinite(spread).any():
        raise TracksError("no navigator states a covariance")
    error = metrics.errors(tracks).values
    names = [str(n) for n in tracks["navigator"].values]
    vehicles = [str(v) for v in tracks["vehicle"].values]
    figure = matplotlib_figure()(figsize=(11.5, 2.9 * len(vehicles) + 1.6), dpi=DPI, layout="constrained")
    panels = figure.subplots(len(vehicles), 2, squeeze=False, sharex=True)
    time = tracks["time"].values
    for j, vehicle in enumerate(vehicles):
        tops = [_top(spread[:, j]), _top(error[:, j])]
        for axes, values in zip(panels[j], (spread, error), strict=True):
            _draw(axes, time, values[:, j], max(tops))
        _arrivals(panels[j, 0], packets, j, time)
        panels[j, 0].set_ylabel(f"{vehicle}\n√trace (m)")
        panels[j, 1].set_ylabel("error (m)")
    panels[0, 0].set_title("stated: root of the trace of the covariance", fontsize=10)
    panels[0, 1].set_title("true: distance from the estimate", fontsize=10)
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    handles = [line for line in panels[0, 0].get_lines() if not line.get_label().startswith("_")]
    for line, name in zip(handles, names, strict=True):
        line.set_label(name)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(names), 5), fontsize=8, frameon=False
    )
    figure.suptitle(
        f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: position uncertainty", fontsize=12
    )
    return figure


def _draw(axes: Axes, time: Floats, values: Floats, top: float) -> None:
    count = len(values)
    for i in range(count):
        # Later lines are thinner: one that is covered still shows on both sides.
        width = 2.6 - 1.9 * i / max(count - 1, 1)
        axes.plot(time, values[i], color=OKABE_ITO[i % 8], lw=width, ls=LINE_STYLES[i // 8 % 5], label=f"{i}")
    axes.set(xlim=(time[0], time[-1]), ylim=(0, top))
    axes.grid(alpha=0.3, lw=0.6)


def _top(values: Floats) -> float:
    """Room for all but the largest per mille."""
    finite = values[np.isfinite(values)]
    return 1.1 * float(np.quantile(finite, 0.999)) if finite.size else 1.0


def _arrivals(axes: Axes, packets: Packets | None, vehicle: int, time: Floats) -> None:
    if packets is None or not len(packets["toa_ns"]):
        return
    here = packets["received"].astype(bool) & (packets["receiver"] == vehicle) & (packets["bytes"] > 0)
    if not here.any():
        return
    counts = np.bincount(packets["navigator"][here])
    at = packets["toa_ns"][here & (packets["navigator"] == counts.argmax())] / 1e9
    inside = at[(at >= time[0]) & (at <= time[-1])]
    axes.plot(
        inside, np.ones(len(inside)), ls="", marker="|", ms=6, color="#555555", clip_on=False,
        transform=axes.get_xaxis_transform(), label="_arrivals",
    )  # fmt: skip
