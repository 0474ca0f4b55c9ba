"""How far off, and how honest: errors, NEES and bytes of `Tracks`, for one run and pooled over a study.

All statistics are over the instants of the 1 Hz grid strictly after `settle_s` (an attribute of the
tracks), so that a navigator with more arrivals is not weighted differently. What does not apply is `None`
(null in JSON, empty in CSV): no truth, no heading, no packets. What applies but went wrong is never
dropped: an estimate that is not a number where truth is known has an infinite error; a covariance that is
singular against its error has an infinite NEES, one that is not a covariance (NaN, negative variance) has
NaN, and both are counted (`nees_not_finite`).

`tracks` is the Dataset of `uwcoop.run`. Beside its ordinary variables these are used when present:
`truth_yaw_rad (vehicle, time)`, `pose_covariance (navigator, vehicle, time, pose, pose_b)` of (east m,
north m, yaw rad), and `bound_m ([navigator,] vehicle, time)`, the root of the trace of the position's
Cramér-Rao bound, with `linearised_bound_m`, the same statistically linearised (`uwcoop.evaluation.cramer_rao`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from uwcoop.errors import TracksError
from uwcoop.evaluation.nees import anees_bounds, normalised_square

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

__all__ = [
    "LOST_BEYOND_M",
    "ROW_COLUMNS",
    "anees_bounds",
    "errors",
    "nees",
    "normalised_square",
    "pool",
    "rows",
    "summarise",
]

LOST_BEYOND_M = 30.0
"""A vehicle that is further off than this at the end counts as lost."""

ROW_COLUMNS: dict[str, type] = {
    "run": int,
    "seed": int,
    "navigator": str,
    "vehicle": str,
    "instants": int,
    "rmse_m": float,
    "median_error_m": float,
    "p95_error_m": float,
    "final_error_m": float,
    "nees_instants": int,
    "nees_not_finite": int,
    "anees": float,
    "state_anees_per_dof": float,
    "yaw_rmse_deg": float,
    "rejected": int,
    "unsent": int,
    "rmse_over_bound": float,
    "rmse_over_linearised_bound": float,
    "packet_bytes_mean": float,
    "packet_bytes_max": int,
    "seconds": float,
}
"""Columns of a row (one per run, navigator and vehicle) and of a study's CSV, in order, with the type of a
value.

`instants`: grid instants with truth after settling (the weight of `rmse_m`, `yaw_rmse_deg`,
`state_anees_per_dof`); `nees_instants`: those of them with a NEES, infinite ones included (the weight of
`anees`). A value may be None (empty in CSV); `inf` is written as `inf`. A study adds columns for what it
varies.
"""

_VEHICLE_KEYS = (
    "rmse_m",
    "median_error_m",
    "p95_error_m",
    "final_error_m",
    "anees",
    "state_anees_per_dof",
    "yaw_rmse_deg",
    "rejected",
    "unsent",
    "rmse_over_bound",
    "rmse_over_linearised_bound",
)


# ------------------------------------------------------------------------------------- errors and consistency


def errors(tracks: xr.Dataset) -> xr.DataArray:
    """Distance between estimate and truth, m, dims (navigator, vehicle, time).

    NaN where truth is unknown; infinite where truth is known and the estimate is not finite.
    """
    difference = _position_error(tracks)
    distance = np.hypot(difference[..., 0], difference[..., 1])
    return _per_instant(tracks, distance, "error_m", "distance from truth", "m")


def nees(tracks: xr.Dataset) -> xr.DataArray:
    """Normalised estimation error squared of the 2-D position, dims (navigator, vehicle, time); ideal mean 2.

    NaN where truth is unknown or the covariance is not one; infinite where the covariance rules the error
    out.
    """
    values = normalised_square(_position_error(tracks), _values(tracks, "covariance_m2"))
    return _per_instant(tracks, values, "nees", "position NEES (ideal mean 2)", "1")


# ---------------------------------------------------------------------------------------------- one run


def rows(
    tracks: xr.Dataset,
    *,
    seconds: Mapping[str, float],
    packets: Mapping[str, NDArray[Any]] | None,
    run: int = 0,
) -> list[dict[str, Any]]:
    """A run's rows (keys `ROW_COLUMNS`), one per navigator and vehicle; `seconds`: run time by navigator."""
    grid = _settled(tracks)
    error_m = errors(tracks).values[..., grid]
    nees_values = nees(tracks).values[..., grid]
    known = ~np.isnan(error_m)
    last = errors(tracks).values[..., _grid(tracks)]
    table: list[dict[str, Any]] = []
    for i, navigator in enumerate(_names(tracks, "navigator")):
        mean_bytes, max_bytes = _packet_bytes(tracks, packets, i)
        for j, vehicle in enumerate(_names(tracks, "vehicle")):
            at = known[i, j]
            e, square = error_m[i, j, at], nees_values[i, j, at]
            defined = square[~np.isnan(square)]
            rmse_m = _rms(e)
            table.append(
                {
                    "run": run,
                    "seed": int(tracks.attrs["seed"]),
                    "navigator": navigator,
                    "vehicle": vehicle,
                    "instants": int(at.sum()),
                    "rmse_m": rmse_m,
                    "median_error_m": _quantile(e, 0.5),
                    "p95_error_m": _quantile(e, 0.95),
                    "final_error_m": _last(last[i, j]),
                    "nees_instants": int(defined.size),
                    "nees_not_finite": int((~np.isfinite(square)).sum()),
                    "anees": float(defined.mean()) if defined.size else None,
                    "state_anees_per_dof": _state_anees_per_dof(tracks, i, j, grid),
                    "yaw_rmse_deg": _yaw_rmse_deg(tracks, i, j, grid),
                    "rejected": _count(tracks, "rejected", i, j),
                    "unsent": _count(tracks, "unsent", i, j),
                    "rmse_over_bound": _over_bound(tracks, "bound_m", i, j, grid, rmse_m),
                    "rmse_over_linearised_bound": _over_bound(
                        tracks, "linearised_bound_m", i, j, grid, rmse_m
                    ),
                    "packet_bytes_mean": mean_bytes,
                    "packet_bytes_max": max_bytes,
                    "seconds": float(seconds[navigator]),
                }
            )
    return table


def summarise(
    tracks: xr.Dataset, *, seconds: Mapping[str, float], packets: Mapping[str, NDArray[Any]] | None
) -> dict[str, Any]:
    """The content of `summary.json`: strict JSON, None for what does not apply or is infinite.

    `seconds` holds each navigator's run time; `speedup` is the mission's seconds over it. A vehicle has the
    further key `nees_not_finite` (a count of instants) only if its NEES was infinite or undefined at some.
    """
    time = tracks["time"].values
    mission_s = float(time[-1] - time[0])
    navigators: dict[str, Any] = {}
    for row in rows(tracks, seconds=seconds, packets=packets):
        entry = navigators.setdefault(
            row["navigator"],
            {
                "seconds": row["seconds"],
                "speedup": mission_s / row["seconds"] if row["seconds"] > 0 else None,
                "packet_bytes": {"mean": row["packet_bytes_mean"], "max": row["packet_bytes_max"]},
                "vehicles": {},
            },
        )
        vehicle = {key: _json(row[key]) for key in _VEHICLE_KEYS}
        if row["nees_not_finite"]:
            vehicle["nees_not_finite"] = row["nees_not_finite"]
        entry["vehicles"][row["vehicle"]] = vehicle
    return {"mission": tracks.attrs["mission"], "seed": int(tracks.attrs["seed"]), "navigators": navigators}


# ---------------------------------------------------------------------------------------------- a study


def pool(table: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """A variant's rows over all runs and vehicles, by navigator: the `navigators` of a study's
    `summary.json`.

    `rmse_m`, `yaw_rmse_deg` are root mean squares and `anees`, `state_anees_per_dof` means over instants,
    runs and vehicles (rows weighted by their instants); the medians and `p95_final_error_m` are over rows;
    `lost_share` is the share of rows with truth that end more than 30 m off (`LOST_BEYOND_M`; an infinite
    error is lost); `seconds` is the mean over runs. None where no row has a value, and where the value is
    infinite.
    """
    pooled: dict[str, dict[str, Any]] = {}
    for navigator in dict.fromkeys(str(row["navigator"]) for row in table):
        own = [row for row in table if row["navigator"] == navigator]
        final = _column(own, "final_error_m")
        sizes = _column(own, "packet_bytes_max")
        anees = _column(own, "anees")
        one_per_run = {row["run"]: row for row in own}
        pooled[navigator] = {
            "median_final_error_m": _json(_quantile(final, 0.5)),
            "p95_final_error_m": _json(_quantile(final, 0.95)),
            "median_rmse_m": _json(_quantile(_column(own, "rmse_m"), 0.5)),
            "rmse_m": _json(_root(_weighted_mean(own, "rmse_m", "instants", power=2))),
            "anees": _json(_weighted_mean(own, "anees", "nees_instants")),
            "anees_median": _json(_quantile(anees, 0.5)),
            "state_anees_per_dof": _json(_weighted_mean(own, "state_anees_per_dof", "instants")),
            "lost_share": float((final > LOST_BEYOND_M).mean()) if final.size else None,
            "rmse_over_bound": _json(_quantile(_column(own, "rmse_over_bound"), 0.5)),
            "rmse_over_linearised_bound": _json(_quantile(_column(own, "rmse_over_linearised_bound"), 0.5)),
            "yaw_rmse_deg": _json(_root(_weighted_mean(own, "yaw_rmse_deg", "instants", power=2))),
            "packet_bytes_max": int(sizes.max()) if sizes.size else None,
            "seconds": _mean(_column(list(one_per_run.values()), "seconds")),
        }
    return pooled


def _column(table: Sequence[Mapping[str, Any]], key: str) -> Floats:
    """The values that are there: None and NaN mean "does not apply"; infinity stays."""
    values = np.array([np.nan if row[key] is None else float(row[key]) for row in table], dtype=np.float64)
    return values[~np.isnan(values)]


def _weighted_mean(
    table: Sequence[Mapping[str, Any]], key: str, weight: str, *, power: int = 1
) -> float | None:
    present = [row for row in table if row[key] is not None and not math.isnan(row[key]) and row[weight] > 0]
    total = sum(row[weight] for row in present)
    return sum(row[weight] * row[key] ** power for row in present) / total if total else None


# ---------------------------------------------------------------------------------------------- pieces


def _values(tracks: xr.Dataset, name: str) -> Floats:
    if name not in tracks:
        raise TracksError(f"tracks lack the variable {name}")
    return np.asarray(tracks[name].values, dtype=np.float64)


def _names(tracks: xr.Dataset, dim: str) -> list[str]:
    return [str(name) for name in tracks[dim].values]


def _per_instant(tracks: xr.Dataset, values: Floats, name: str, long_name: str, units: str) -> xr.DataArray:
    dims = ("navigator", "vehicle", "time")
    coords = {dim: tracks[dim] for dim in dims}
    return xr.DataArray(values, coords, dims, name, {"long_name": long_name, "units": units})


def _position_error(tracks: xr.Dataset) -> Floats:
    truth = _values(tracks, "truth_position_m")[None]
    estimate = _values(tracks, "position_m")
    failed = np.isfinite(truth).all(-1, keepdims=True) & ~np.isfinite(estimate).all(-1, keepdims=True)
    return np.where(failed, np.inf, estimate - truth)


def _grid(tracks: xr.Dataset) -> NDArray[np.bool_]:
    """Instants of the 1 Hz grid: whole seconds (arrivals between them are left out)."""
    time = _values(tracks, "time")
    return np.asarray(np.abs(time - np.round(time)) < 1e-9)


def _settled(tracks: xr.Dataset) -> NDArray[np.bool_]:
    return np.asarray(_grid(tracks) & (_values(tracks, "time") > float(tracks.attrs["settle_s"])))


def _packet_bytes(
    tracks: xr.Dataset, packets: Mapping[str, NDArray[Any]] | None, navigator: int
) -> tuple[float | None, int | None]:
    """Mean and largest size of the packets sent; one to many receivers counts once, silence not at all."""
    if packets is not None and len(packets["tol_ns"]):
        own = (packets["navigator"] == navigator) & (packets["bytes"] > 0)
        sent = np.unique(np.stack([packets[k][own] for k in ("sender", "tol_ns", "bytes")]), axis=1)[2]
    else:
        every = _values(tracks, "packet_bytes")[navigator]
        sent = every[every > 0]
    return (float(sent.mean()), int(sent.max())) if sent.size else (None, None)


def _state_anees_per_dof(tracks: xr.Dataset, i: int, j: int, grid: NDArray[np.bool_]) -> float | None:
    if not {"pose_covariance", "truth_yaw_rad"} <= set(tracks.data_vars):
        return None
    yaw = _wrap(_values(tracks, "yaw_rad")[i, j] - _values(tracks, "truth_yaw_rad")[j])
    error = np.concatenate([_position_error(tracks)[i, j], yaw[:, None]], axis=1)
    square = normalised_square(error, _values(tracks, "pose_covariance")[i, j])[grid]
    square = square[~np.isnan(square)]
    return float(square.mean()) / error.shape[1] if square.size else None


def _yaw_rmse_deg(tracks: xr.Dataset, i: int, j: int, grid: NDArray[np.bool_]) -> float | None:
    if "truth_yaw_rad" not in tracks:
        return None
    error = _wrap(_values(tracks, "yaw_rad")[i, j] - _values(tracks, "truth_yaw_rad")[j])[grid]
    rms = _rms(error[~np.isnan(error)])
    return None if rms is None else math.degrees(rms)


def _over_bound(
    tracks: xr.Dataset, name: str, i: int, j: int, grid: NDArray[np.bool_], rmse_m: float | None
) -> float | None:
    if name not in tracks or rmse_m is None:
        return None
    known = np.isfinite(_values(tracks, "truth_position_m")[j]).all(-1) & grid
    bound = _values(tracks, name)
    own = (bound[i, j] if bound.ndim == 3 else bound[j])[known]
    # Before its first fix a vehicle has no bound.
    rms = _rms(own[np.isfinite(own)])
    return rmse_m / rms if rms is not None and rms > 0 else None


def _count(tracks: xr.Dataset, name: str, i: int, j: int) -> int | None:
    """The last value of a count; None where it was not recorded."""
    if name not in tracks:
        return None
    count = _values(tracks, name)[i, j, -1]
    return int(count) if np.isfinite(count) else None


def _wrap(angle_rad: Floats) -> Floats:
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


def _last(values: Floats) -> float | None:
    known = values[~np.isnan(values)]
    return float(known[-1]) if known.size else None


def _rms(values: Floats) -> float | None:
    return math.sqrt(float(np.mean(values**2))) if values.size else None


def _root(value: float | None) -> float | None:
    return None if value is None else math.sqrt(value)


def _mean(values: Floats) -> float | None:
    return float(values.mean()) if values.size else None


def _quantile(values: Floats, share: float) -> float | None:
    """Linear interpolation between order statistics (NumPy's default), infinite errors at the top."""
    if not values.size:
        return None
    ordered = np.sort(values)
    at = share * (ordered.size - 1)
    below, above = ordered[math.floor(at)], ordered[math.ceil(at)]
    return float(below if above == below else below + (at - math.floor(at)) * (above - below))


def _json(value: float | None) -> float | None:
    return value if value is None or math.isfinite(value) else None


def summary_text(summary: Mapping[str, Any]) -> str:
    """A summary as the JSON that is written and printed."""
    return json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False)
