"""The origin state beside the filter that it replaces (Walls & Eustice 2012, Fig. 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.style import DPI, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

SHIFTING = ("mdeif-paper", "mdeif")
"""The first of them that took part is shown: as published, where the rounding of equation (6) shows."""
AGAINST = ("deif", "cekf-received", "cekf")
LEAST_M = 1e-16
"""Drawn for a difference of zero on the logarithmic axis."""


def origin_figure(tracks: xr.Dataset) -> Figure:
    """Above: difference in position at the times of arrival; then the signed correlation with the origin, and its age.

    The reference is `deif` where it took part, else `cekf-received`, else `cekf`. Correlation and age are the senders',
    of the newest node with the origin.

    Raises:
        TracksError: neither `mdeif-paper` nor `mdeif`, or no reference took part.
    """
    names = [str(n) for n in tracks["navigator"].values]
    reference = next((n for n in AGAINST if n in names), None)
    shifting = next((n for n in SHIFTING if n in names), None)
    if shifting is None or reference is None or "origin_correlation" not in tracks:
        raise TracksError(f"it needs the navigators {' or '.join(SHIFTING)} and one of {', '.join(AGAINST)}")
    one, other = names.index(shifting), names.index(reference)
    figure = matplotlib_figure()(figsize=(9.5, 8.0), dpi=DPI, layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    time = tracks["time"].values
    position = tracks["position_m"].values
    heard = tracks["heard"].values[one] & tracks["heard"].values[other]
    for j, vehicle in enumerate(tracks["vehicle"].values):
        colour = OKABE_ITO[j % 8]
        at = heard[j]
        if at.any():
            off = np.abs(position[one, j] - position[other, j])[at]
            for axis, (mark, label) in enumerate((("o", "east"), ("x", "north"))):
                top.plot(
                    time[at], np.maximum(off[:, axis], LEAST_M), ls="", marker=mark, ms=3.2, mew=0.8,
                    color=colour, mfc="none" if mark == "o" else colour, label=f"{vehicle}, {label}",
                )  # fmt: skip
        for axes, name in ((middle, "origin_correlation"), (bottom, "origin_age_s")):
            values = tracks[name].values[one, j]
            if np.isfinite(values).any() and _is_used(tracks, j):
                axes.plot(time, values, color=colour, lw=1.2, label=f"{vehicle}'s packets")
    top.set(yscale="log", ylabel=f"|{shifting} − {reference}| (m)")
    top.set_title("difference in position, at the times of arrival", fontsize=10)
    middle.set(ylabel="correlation (1)", ylim=(-1.05, 1.05))
    middle.set_title("correlation of the newest node with the origin", fontsize=10)
    bottom.set(ylabel="age (s)", xlabel="time (s)", xlim=(time[0], time[-1]))
    bottom.set_title("age of the origin", fontsize=10)
    for axes in (top, middle, bottom):
        axes.grid(alpha=0.3, lw=0.6)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(fontsize=8, loc="best", framealpha=0.85)
    figure.suptitle(f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: the origin state", fontsize=12)
    return figure


def _is_used(tracks: xr.Dataset, sender: int) -> bool:
    """Whether another vehicle received this navigator's packets; otherwise its origin is not used."""
    others = [k for k in range(tracks.sizes["vehicle"]) if k != sender]
    return bool(tracks["heard"].values[:, others].any())
