"""Quantities of `Tracks` at each instant: distance from truth and NEES, and which instants count."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.evaluation.nees import normalised_square

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.missionlog.labelled import Arrays

    Floats = NDArray[np.float64]

__all__ = [
    "distances_m", "errors", "grid_instants", "names_of", "nees", "nees_values", "position_error", "settled_instants",
    "values_of",
]  # fmt: skip


def errors(tracks: Arrays) -> xr.DataArray:
    """Distance between estimate and truth, m, dims (navigator, vehicle, time).

    NaN where truth is unknown; infinite where truth is known and the estimate is not finite.
    """
    return _per_instant(tracks, distances_m(tracks), "error_m", "distance from truth", "m")


def nees(tracks: Arrays) -> xr.DataArray:
    """Normalised estimation error squared of the 2-D position, dims (navigator, vehicle, time); ideal mean 2.

    NaN where truth is unknown or the covariance is not one; infinite where the covariance rules the error
    out.
    """
    return _per_instant(tracks, nees_values(tracks), "nees", "position NEES (ideal mean 2)", "1")


def distances_m(tracks: Arrays) -> Floats:
    """The values of `errors`."""
    difference = position_error(tracks)
    return np.asarray(np.hypot(difference[..., 0], difference[..., 1]))


def nees_values(tracks: Arrays) -> Floats:
    """The values of `nees`."""
    return normalised_square(position_error(tracks), values_of(tracks, "covariance_m2"))


def values_of(tracks: Arrays, name: str) -> Floats:
    """A variable as float64.

    Raises:
        TracksError: there is no such variable.
    """
    if name not in tracks:
        raise TracksError(f"tracks lack the variable {name}")
    return np.asarray(tracks[name].values, dtype=np.float64)


def names_of(tracks: Arrays, dim: str) -> list[str]:
    """The coordinate of a dimension, as texts."""
    return [str(name) for name in tracks[dim].values]


def _per_instant(tracks: Arrays, values: Floats, name: str, long_name: str, units: str) -> xr.DataArray:
    import xarray as xr

    dims = ("navigator", "vehicle", "time")
    coords = {dim: (tracks[dim].dims, tracks[dim].values, dict(tracks[dim].attrs)) for dim in dims}
    return xr.DataArray(values, coords, dims, name, {"long_name": long_name, "units": units})


def position_error(tracks: Arrays) -> Floats:
    """Estimate minus truth, (navigator, vehicle, time, axis) m; NaN and infinite as `errors`."""
    truth = values_of(tracks, "truth_position_m")[None]
    estimate = values_of(tracks, "position_m")
    failed = np.isfinite(truth).all(-1, keepdims=True) & ~np.isfinite(estimate).all(-1, keepdims=True)
    return np.where(failed, np.inf, estimate - truth)


def grid_instants(tracks: Arrays) -> NDArray[np.bool_]:
    """Instants of the 1 Hz grid: whole seconds (arrivals between them are left out)."""
    time = values_of(tracks, "time")
    return np.asarray(np.abs(time - np.round(time)) < 1e-9)


def settled_instants(tracks: Arrays) -> NDArray[np.bool_]:
    """Instants of the 1 Hz grid after `settle_s`, (time,)."""
    return np.asarray(grid_instants(tracks) & (values_of(tracks, "time") > float(tracks.attrs["settle_s"])))
