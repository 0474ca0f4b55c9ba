"""Paths on Earth: latitude and longitude on a map, where the mission's origin is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import MissingDependencyError
from uwcoop.viewer.stage import Stage, entity, rgb, time_column

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

__all__ = ["EARTH", "known", "send"]

TRUTH_COLOUR = (70, 70, 70)
"""Dark: maps are light."""

EARTH = "earth"
"""Its entities: `earth/truth/VEHICLE`, `earth/NAVIGATOR/VEHICLE/{path,now}`."""


def known(log: MissionLog) -> bool:
    """Whether local metres can be told in degrees: the origin is known and pyproj is installed."""
    return _frame(log) is not None


def send(recording: Any, stage: Stage, tracks: xr.Dataset, log: MissionLog) -> None:
    """Truth as a dark line, estimates as lines in the vehicle's colour and a point that moves along."""
    import rerun as rr

    frame = _frame(log)
    if frame is None:
        return
    for j, vehicle in enumerate(stage.vehicles):
        truth = stage.truth_m[j]
        truth = truth[np.isfinite(truth).all(-1)]
        if len(truth) > 1:
            line = rr.GeoLineStrings(
                lat_lon=[frame.to_geographic(truth)], colors=[TRUTH_COLOUR], radii=rr.Radius.ui_points(1.0)
            )
            recording.log(entity(EARTH, "truth", vehicle), line, static=True)
        for i, navigator in enumerate(stage.navigators):
            estimate: NDArray[np.float64] = tracks["position_m"].values[i, j, stage.at]
            at = np.isfinite(estimate).all(-1)
            if not at.any():
                continue
            degrees = frame.to_geographic(estimate[at])
            if len(degrees) > 1:
                line = rr.GeoLineStrings(lat_lon=[degrees], colors=[rgb(j)], radii=rr.Radius.ui_points(1.6))
                recording.log(entity(EARTH, navigator, vehicle, "path"), line, static=True)
            now = entity(EARTH, navigator, vehicle, "now")
            recording.log(
                now, rr.GeoPoints.from_fields(colors=[rgb(j)], radii=rr.Radius.ui_points(7.0)), static=True
            )
            recording.send_columns(
                now,
                indexes=[time_column(stage.time_s[at])],
                columns=rr.GeoPoints.columns(positions=degrees),
            )


def _frame(log: MissionLog) -> Any:
    if log.origin.latitude_deg is None:
        return None
    from uwcoop.frames import LocalFrame

    try:
        return LocalFrame(log.origin)
    except MissingDependencyError:
        return None
