"""How deep each vehicle was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog.model import MissionLog

    Floats = NDArray[np.float64]

__all__ = ["depths_m"]


def depths_m(log: MissionLog, time_s: Floats) -> Floats:
    """(vehicle, time) depth, positive down: the true one, else what the depth sensor measured, else the surface, 0."""
    depth = np.zeros((len(log.vehicles), len(time_s)))
    table = log.events.get("depth")
    for j in range(len(log.vehicles)):
        if table is not None and (own := table["vehicle"] == j).any():
            depth[j] = np.interp(time_s, table["t_ns"][own] / 1e9, table["depth_m"][own])
    if log.truth is not None and "depth_m" in log.truth:
        known_s = log.truth["time"].values
        true = [
            np.interp(time_s, known_s, own) for own in np.asarray(log.truth["depth_m"].values, np.float64)
        ]
        depth = np.where(np.isfinite(true), true, depth)
    return depth
