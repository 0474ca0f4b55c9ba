"""Tracks as other programs read them: conventions CF-1.11, with latitude, longitude, depth and dates.

`latitude`, `longitude`, `truth_latitude`, `truth_longitude` are there where the log's origin is known and pyproj is
installed, `time_utc` where its epoch is. `crs` is the grid mapping: `easting` and `northing` are positions in the
projection that it states, `position_m` the same from the local origin on.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import MissingDependencyError
from uwcoop.missionlog.depths import depths_m

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

__all__ = ["CONVENTIONS", "cf_tracks", "epoch_text"]

CONVENTIONS = "CF-1.11"
_LAT = {"standard_name": "latitude", "long_name": "latitude, WGS 84", "units": "degrees_north"}
_LON = {"standard_name": "longitude", "long_name": "longitude, WGS 84", "units": "degrees_east"}
_LONG_NAMES = {
    "position_m": "estimated position, east and north of the local origin",
    "covariance_m2": "covariance of the estimated position",
    "truth_position_m": "true position, east and north of the local origin",
    "yaw_rad": "estimated yaw, counter-clockwise from east",
    "truth_yaw_rad": "true yaw, counter-clockwise from east",
    "time": "time since the start of the mission",
    "axis": "direction",
    "axis_b": "direction",
    "navigator": "name of the navigator",
    "vehicle": "name of the vehicle",
    "pose": "part of a pose",
    "pose_b": "part of a pose",
}
_NO_UDUNIT = {"nat": "1", "m2, m rad, rad2": None}
"""Units that UDUNITS does not know: the names and texts of these variables say them."""


def epoch_text(epoch_ns: int) -> str:
    """UTC of an epoch, ISO 8601 to the microsecond."""
    whole = datetime.fromtimestamp(epoch_ns // 1_000_000_000, UTC)
    return whole.replace(microsecond=epoch_ns % 1_000_000_000 // 1000).isoformat().replace("+00:00", "Z")


def cf_tracks(tracks: xr.Dataset, log: MissionLog) -> xr.Dataset:
    """A copy of a run's tracks with what CF-1.11 wants beside them; no value of a variable changes."""
    found = tracks.copy()
    for name, variable in found.variables.items():
        attributes = dict(variable.attrs)
        if attributes.get("units") in _NO_UDUNIT:
            units = _NO_UDUNIT[attributes.pop("units")]
            attributes |= {} if units is None else {"units": units}
        if str(name) in _LONG_NAMES:
            attributes.setdefault("long_name", _LONG_NAMES[str(name)])
        if variable.dtype.kind in "bif" and name != "pose_covariance":
            attributes.setdefault("units", "1")
        found[name].attrs = attributes
    time_s = np.asarray(tracks["time"].values, dtype=np.float64)
    found["depth_m"] = (
        ("vehicle", "time"),
        depths_m(log, time_s),
        {
            "standard_name": "depth",
            "long_name": "depth below the surface",
            "units": "m",
            "positive": "down",
        },
    )
    found.attrs = {
        **tracks.attrs,
        "Conventions": CONVENTIONS,
        "title": f"{log.name}: estimated positions of {len(log.vehicles)} vehicles",
        "institution": "not stated",
        "source": "uwcoop: navigators replayed over a mission log",
        "history": "written by uwcoop run",
        "comment": "positions are local metres, east and north",
        "references": "https://github.com/uwcoop/uwcoop",
    }
    if log.counterfactual:
        found.attrs["counterfactual"] = ", ".join(log.counterfactual)
    if log.epoch_ns is not None:
        found = found.assign_coords(time_utc=("time", time_s, _utc(log.epoch_ns)))
        found.attrs["epoch"] = epoch_text(log.epoch_ns)
    return _with_places(found, log)


def _utc(epoch_ns: int) -> dict[str, str]:
    return {
        "standard_name": "time",
        "long_name": "UTC",
        "units": f"seconds since {epoch_text(epoch_ns).replace('T', ' ').rstrip('Z')}",
        "calendar": "proleptic_gregorian",
        "units_metadata": "leap_seconds: none",
    }


def _with_places(found: xr.Dataset, log: MissionLog) -> xr.Dataset:
    if log.origin.latitude_deg is None:
        return found
    from uwcoop.frames import LocalFrame, crs_of

    frame = LocalFrame(log.origin)
    try:
        attributes: dict[str, Any] = {
            str(k): v
            for k, v in crs_of(frame.crs_text).to_cf().items()
            if isinstance(v, str | float | int | list)
        }
        east_m, north_m = frame.offset_m
        places = {
            name: _degrees(frame, found[variable].values)
            for name, variable in (("", "position_m"), ("truth_", "truth_position_m"))
        }
    except MissingDependencyError:
        return found
    attributes |= {
        "origin_latitude_deg": float(frame.origin.latitude_deg or 0.0),
        "origin_longitude_deg": float(frame.origin.longitude_deg or 0.0),
        "origin_easting_m": east_m,
        "origin_northing_m": north_m,
    }
    found["crs"] = ((), np.int32(0), attributes)
    for name in ("position_m", "covariance_m2", "truth_position_m"):
        found[name].attrs["grid_mapping"] = "crs"
    for axis, (name, offset_m) in enumerate((("easting", east_m), ("northing", north_m))):
        about = {"standard_name": f"projection_{'xy'[axis]}_coordinate", "long_name": name, "units": "m"}
        values = found["position_m"].values[..., axis] + offset_m
        found = found.assign_coords({name: (("navigator", "vehicle", "time"), values, about)})
    for name, (latitude, longitude) in places.items():
        dims = ("navigator", "vehicle", "time") if name == "" else ("vehicle", "time")
        if np.isfinite(latitude).any():
            found = found.assign_coords(
                {f"{name}latitude": (dims, latitude, _LAT), f"{name}longitude": (dims, longitude, _LON)}
            )
    return found


def _degrees(frame: Any, position_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Latitude and longitude of positions (..., 2); NaN where they are unknown."""
    flat = position_m.reshape(-1, 2)
    known = np.isfinite(flat).all(1)
    degrees = np.full_like(flat, np.nan)
    degrees[known] = frame.to_geographic(flat[known])
    shape = position_m.shape[:-1]
    return degrees[:, 0].reshape(shape), degrees[:, 1].reshape(shape)
