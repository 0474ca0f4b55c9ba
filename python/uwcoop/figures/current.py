"""The current that navigators estimate, beside the true one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.style import DPI, LINE_STYLES, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = ["current_figure"]

AXES = ("east", "north")


def current_figure(tracks: xr.Dataset, truth: xr.Dataset | None) -> Figure:
    """One row for each vehicle, east and north beside each other: each navigator's current with twice its sigma shaded,
    and the true one in black where it is known.

    Raises:
        TracksError: no navigator that took part estimates a current.
    """
    if "current_east_mps" not in tracks:
        raise TracksError("no navigator that took part estimates a current")
    vehicles = [str(v) for v in tracks["vehicle"].values]
    figure = matplotlib_figure()(figsize=(9.5, 2.4 * len(vehicles) + 1.0), dpi=DPI, layout="constrained")
    grid = figure.subplots(len(vehicles), 2, sharex=True, sharey=True, squeeze=False)
    time = tracks["time"].values
    for j, vehicle in enumerate(vehicles):
        for k, axis in enumerate(AXES):
            axes = grid[j, k]
            if truth is not None and "current_mps" in truth:
                known = truth["current_mps"].sel(vehicle=vehicle).values[:, k]
                axes.plot(truth["time"].values, known, color="black", lw=1.0, label="true")
            for i, name in enumerate(tracks["navigator"].values):
                mean = tracks[f"current_{axis}_mps"].values[i, j]
                sigma = tracks[f"sigma_current_{axis}_mps"].values[i, j]
                if not np.isfinite(mean).any():
                    continue
                colour = OKABE_ITO[(i + 1) % 8]
                axes.plot(
                    time, mean, color=colour, lw=1.0, ls=LINE_STYLES[i % len(LINE_STYLES)],
                    label=f"{name}, shaded: ± 2 sigma",
                )  # fmt: skip
                axes.fill_between(time, mean - 2 * sigma, mean + 2 * sigma, color=colour, alpha=0.15, lw=0)
            axes.set_title(f"{vehicle}, {axis}", fontsize=9)
            axes.grid(alpha=0.3, lw=0.6)
            if k == 0:
                axes.set_ylabel("current (m/s)")
            if j == len(vehicles) - 1:
                axes.set_xlabel("time (s)")
    # The prior's band at the start is much wider than what follows, and may leave the picture.
    half = _half_height_mps(tracks, truth)
    grid[0, 0].set_ylim(-half, half)
    grid[0, 0].legend(fontsize=7, loc="best", framealpha=0.85)
    figure.suptitle(
        f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: estimated and true current", fontsize=12
    )
    return figure


def _half_height_mps(tracks: xr.Dataset, truth: xr.Dataset | None) -> float:
    """Room for every mean and the true current, and for the bands that hold after the start."""
    largest = [0.1]
    for axis in AXES:
        mean, sigma = (tracks[f"{name}current_{axis}_mps"].values for name in ("", "sigma_"))
        known = np.isfinite(mean) & np.isfinite(sigma)
        if known.any():
            largest.append(float(np.abs(mean[known]).max()))
            largest.append(float(np.quantile(np.abs(mean[known]) + 2 * sigma[known], 0.95)))
    if truth is not None and "current_mps" in truth:
        largest.append(float(np.nanmax(np.abs(truth["current_mps"].values), initial=0.0)))
    return 1.1 * max(largest)
