"""The current that navigators estimate, beside the true one, and the alarms of their health monitors, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.viewer.stage import Stage, entity, rgb, series

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

AXES = ("east", "north")
CURRENT, ALARMS = "current_mps", "alarms"
_TRUE = (200, 200, 200)
_LEAST_TOP_MPS = 0.1


def is_estimated(tracks: xr.Dataset) -> bool:
    """Whether any navigator states a current."""
    return "current_east_mps" in tracks and bool(np.isfinite(tracks["current_east_mps"].values).any())


def has_alarms(tracks: xr.Dataset) -> bool:
    """Whether any health monitor raised an alarm."""
    return ALARMS in tracks and bool((tracks[ALARMS].values > 0).any())


def send(recording: Any, stage: Stage, tracks: xr.Dataset, log: MissionLog) -> None:
    """Log each navigator's current with thin lines twice its sigma above and below, the true current, and the number of
    alarms so far."""
    for j, vehicle in enumerate(stage.vehicles):
        for k, axis in enumerate(AXES):
            if not is_estimated(tracks):
                continue
            where = (CURRENT, vehicle, axis)
            series(recording, entity(*where, "true"), "true", _TRUE, stage.time_s, _true(stage, log, j, k))
            for i, navigator in enumerate(stage.navigators):
                mean, sigma = (
                    tracks[f"{name}current_{axis}_mps"].values[i, j, stage.at] for name in ("", "sigma_")
                )
                path = entity(*where, navigator)
                series(recording, path, navigator, rgb(i), stage.time_s, mean)
                for side, factor in (("above", 2.0), ("below", -2.0)):
                    label = f"{navigator} {'+' if factor > 0 else '−'} 2 sigma"
                    edge = entity(*where, navigator, side)
                    series(recording, edge, label, rgb(i), stage.time_s, mean + factor * sigma, width=0.5)
        if has_alarms(tracks):
            for i, navigator in enumerate(stage.navigators):
                counted = tracks[ALARMS].values[i, j, stage.at]
                series(
                    recording, entity(ALARMS, vehicle, navigator), navigator, rgb(i), stage.time_s, counted
                )


def range_mps(tracks: xr.Dataset) -> float:
    """Half the height of the plots: the largest mean, with room for the narrowest band."""
    largest = []
    for axis in AXES:
        mean, sigma = (tracks[f"{name}current_{axis}_mps"].values for name in ("", "sigma_"))
        known = np.isfinite(mean) & np.isfinite(sigma)
        if known.any():
            largest.append(float(np.abs(mean[known]).max() + 2 * np.quantile(sigma[known], 0.25)))
    return max([_LEAST_TOP_MPS, *largest])


def _true(stage: Stage, log: MissionLog, vehicle: int, axis: int) -> NDArray[np.float64]:
    """The true current at the stage's instants; NaN where it is unknown."""
    if log.truth is None or "current_mps" not in log.truth:
        return np.full(len(stage.time_s), np.nan)
    known_s = log.truth["time"].to_numpy()
    values = log.truth["current_mps"].to_numpy()[vehicle, :, axis]
    return np.asarray(np.interp(stage.time_s, known_s, values, left=np.nan, right=np.nan))
