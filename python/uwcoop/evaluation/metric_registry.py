"""The registry of metrics: how each is measured, pooled over a study, and shown.

`METRICS` is the only list: rows (`runs.csv`), `summary.json` of runs and studies, the terminal's tables and the tables
of the documentation are made from it. A new column is one entry. A measure answers None where it does not apply.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.evaluation import pooling
from uwcoop.evaluation.metric_types import Column, Metric, Pooled
from uwcoop.evaluation.nees import normalised_square
from uwcoop.evaluation.nees_samples import NEES_SAMPLES
from uwcoop.evaluation.per_instant import position_error, values_of
from uwcoop.evaluation.pooling import LOST_BEYOND_M, quantile, root_mean_square
from uwcoop.evaluation.sensor_misfit import SENSOR_MISFITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.evaluation.vehicle_run import VehicleRun

    Floats = NDArray[np.float64]

__all__ = ["METRICS", "pooled_metrics", "row_columns"]


def _instants(run: VehicleRun) -> int:
    """Settled instants with truth."""
    return int(run.error_m.size)


def _rmse_m(run: VehicleRun) -> float | None:
    """Root of the mean square distance."""
    return root_mean_square(run.error_m)


def _median_error_m(run: VehicleRun) -> float | None:
    """Median distance."""
    return quantile(run.error_m, 0.5)


def _p95_error_m(run: VehicleRun) -> float | None:
    """95 % quantile of the distance."""
    return quantile(run.error_m, 0.95)


def _final_error_m(run: VehicleRun) -> float | None:
    """Distance at the last instant of the grid with truth."""
    known = run.grid_error_m[~np.isnan(run.grid_error_m)]
    return float(known[-1]) if known.size else None


def _nees_instants(run: VehicleRun) -> int:
    """Instants with a NEES, infinite ones included."""
    return int((~np.isnan(run.nees)).sum())


def _nees_not_finite(run: VehicleRun) -> int:
    """Instants at which the NEES is infinite or undefined."""
    return int((~np.isfinite(run.nees)).sum())


def _anees(run: VehicleRun) -> float | None:
    """Mean of the defined NEES."""
    defined = run.nees[~np.isnan(run.nees)]
    return float(defined.mean()) if defined.size else None


def _state_anees_per_dof(run: VehicleRun) -> float | None:
    """Mean NEES of east, north and yaw, by degree of freedom."""
    if not {"pose_covariance", "truth_yaw_rad"} <= set(run.tracks.data_vars):
        return None
    here = (run.navigator, run.vehicle)
    error = np.concatenate([position_error(run.tracks)[here], _yaw_error_rad(run)[:, None]], axis=1)
    square = normalised_square(error, run.values("pose_covariance"))[run.settled]
    square = square[~np.isnan(square)]
    return float(square.mean()) / error.shape[1] if square.size else None


def _yaw_rmse_deg(run: VehicleRun) -> float | None:
    """Root mean square error of the yaw."""
    if "truth_yaw_rad" not in run.tracks:
        return None
    error = _yaw_error_rad(run)[run.settled]
    rms = root_mean_square(error[~np.isnan(error)])
    return None if rms is None else math.degrees(rms)


def _rejected(run: VehicleRun) -> int | None:
    """Measurements gated and packets refused, by the end."""
    count = run.values("rejected")[-1]
    return int(count) if np.isfinite(count) else None


def _unsent(run: VehicleRun) -> int | None:
    """Slots left silent by the end because the packet did not fit; None where it was not recorded."""
    return int(run.values("unsent")[-1]) if "unsent" in run.tracks else None


def _rmse_over_bound(run: VehicleRun) -> float | None:
    """RMSE over the root mean square of the Cramér-Rao bound."""
    return _over_bound(run, "bound_m")


def _rmse_over_linearised_bound(run: VehicleRun) -> float | None:
    """The same over the statistically linearised bound."""
    return _over_bound(run, "linearised_bound_m")


def _packet_bytes_mean(run: VehicleRun) -> float | None:
    """Mean size of the packets that the whole team sent."""
    sent = _packet_bytes(run)
    return float(sent.mean()) if sent.size else None


def _packet_bytes_max(run: VehicleRun) -> int | None:
    """Largest of them."""
    sent = _packet_bytes(run)
    return int(sent.max()) if sent.size else None


def _seconds(run: VehicleRun) -> float:
    """Run time of the whole team's navigators."""
    return run.seconds


def _packet_bytes(run: VehicleRun) -> Floats:
    """Sizes of the packets sent; a packet to many receivers counts once, silence not at all."""
    packets = run.packets
    if packets is not None and len(packets["tol_ns"]):
        own = (packets["navigator"] == run.navigator) & (packets["bytes"] > 0)
        sent = np.unique(np.stack([packets[k][own] for k in ("sender", "tol_ns", "bytes")]), axis=1)[2]
        return np.asarray(sent, dtype=np.float64)
    every = values_of(run.tracks, "packet_bytes")[run.navigator]
    return np.asarray(every[every > 0])


def _yaw_error_rad(run: VehicleRun) -> Floats:
    error = run.values("yaw_rad") - values_of(run.tracks, "truth_yaw_rad")[run.vehicle]
    return np.asarray((error + np.pi) % (2 * np.pi) - np.pi)


def _over_bound(run: VehicleRun, name: str) -> float | None:
    rmse = _rmse_m(run)
    if name not in run.tracks or rmse is None:
        return None
    known = np.isfinite(values_of(run.tracks, "truth_position_m")[run.vehicle]).all(-1) & run.settled
    bound = values_of(run.tracks, name)
    own = (bound[run.navigator, run.vehicle] if bound.ndim == 3 else bound[run.vehicle])[known]
    # Before its first fix a vehicle has no bound.
    rms = root_mean_square(own[np.isfinite(own)])
    return rmse / rms if rms is not None and rms > 0 else None


_POSE_ANEES = Column("state\nANEES\n/dof (1)")
_YAW_RMSE = Column("yaw\nRMSE\n(°)")
_OVER_BOUND = Column("RMSE\n/\nbound")
_OVER_LINEARISED_BOUND = Column("/ lin.\nbound")

METRICS: dict[str, Metric] = {
    "instants": Metric(
        "1",
        "instants of the 1 Hz grid with truth after settling: the weight of errors",
        _instants,
        int,
        in_summary=False,
    ),
    "rmse_m": Metric(
        "m",
        "root mean square distance from truth",
        _rmse_m,
        column=Column("RMSE\n(m)", always=True),
        pooled=(
            Pooled(
                "median_rmse_m", pooling.median, "median over runs and vehicles", Column("RMSE\nmedian\n(m)")
            ),
            Pooled("rmse_m", pooling.rms_by_weight("instants"), "over all instants, runs and vehicles"),
        ),
    ),
    "median_error_m": Metric(
        "m", "median distance from truth", _median_error_m, column=Column("median\n(m)")
    ),
    "p95_error_m": Metric(
        "m", "95 % quantile of the distance from truth", _p95_error_m, column=Column("95 %\n(m)")
    ),
    "final_error_m": Metric(
        "m",
        "distance from truth at the end",
        _final_error_m,
        column=Column("final\n(m)", always=True),
        pooled=(
            Pooled(
                "median_final_error_m",
                pooling.median,
                "median over runs and vehicles",
                Column("final\nmedian\n(m)", always=True),
            ),
            Pooled(
                "p95_final_error_m",
                pooling.p95,
                "95 % quantile over runs and vehicles",
                Column("final\n95 %\n(m)"),
            ),
            Pooled(
                "lost_share",
                pooling.lost_share,
                f"share of vehicles more than {LOST_BEYOND_M:g} m off at the end",
                Column("lost\n\n(%)", "percent", always=True),
            ),
        ),
    ),
    "nees_instants": Metric(
        "1", "those of the instants with a NEES: the weight of `anees`", _nees_instants, int, in_summary=False
    ),
    "nees_not_finite": Metric(
        "1", "instants with an infinite or undefined NEES", _nees_not_finite, int, in_summary=False
    ),
    "anees": Metric(
        "1",
        "mean NEES of the position; 2 is ideal",
        _anees,
        column=Column("ANEES\n(2)", always=True, marks_consistency=True),
        pooled=(
            Pooled(
                "anees",
                pooling.mean_by_weight("nees_instants"),
                "mean over all instants, runs and vehicles; 2 is ideal",
                Column("ANEES\nmean\n(2)", always=True, marks_consistency=True),
            ),
            Pooled(
                "anees_median",
                pooling.median,
                "median over runs and vehicles of the mean over time: a typical vehicle's",
                Column("ANEES\nmedian\n(2)", marks_consistency=True),
            ),
        ),
    ),
    **NEES_SAMPLES,
    "state_anees_per_dof": Metric(
        "1",
        "mean NEES of the whole pose by degree of freedom; 1 is ideal",
        _state_anees_per_dof,
        column=_POSE_ANEES,
        pooled=(
            Pooled(
                "state_anees_per_dof",
                pooling.mean_by_weight("instants"),
                "mean over all instants, runs and vehicles; 1 is ideal",
                _POSE_ANEES,
            ),
        ),
    ),
    "yaw_rmse_deg": Metric(
        "°",
        "root mean square error of the yaw",
        _yaw_rmse_deg,
        column=_YAW_RMSE,
        pooled=(
            Pooled(
                "yaw_rmse_deg",
                pooling.rms_by_weight("instants"),
                "over all instants, runs and vehicles",
                _YAW_RMSE,
            ),
        ),
    ),
    "rejected": Metric(
        "1",
        "measurements gated and packets refused",
        _rejected,
        int,
        column=Column("re-\njected", "whole"),
    ),
    "unsent": Metric(
        "1",
        "slots left silent because what there was to say did not fit",
        _unsent,
        int,
        column=Column("un-\nsent", "whole", only_if_any=True),
    ),
    **SENSOR_MISFITS,
    "rmse_over_bound": Metric(
        "1",
        "RMSE over the root mean square of the team's Cramér-Rao bound",
        _rmse_over_bound,
        column=_OVER_BOUND,
        pooled=(Pooled("rmse_over_bound", pooling.median, "median over runs and vehicles", _OVER_BOUND),),
    ),
    "rmse_over_linearised_bound": Metric(
        "1",
        "the same over the bound that is statistically linearised",
        _rmse_over_linearised_bound,
        column=_OVER_LINEARISED_BOUND,
        pooled=(
            Pooled(
                "rmse_over_linearised_bound",
                pooling.median,
                "median over runs and vehicles",
                _OVER_LINEARISED_BOUND,
            ),
        ),
    ),
    "packet_bytes_mean": Metric(
        "byte", "mean size of the team's packets", _packet_bytes_mean, in_summary=False
    ),
    "packet_bytes_max": Metric(
        "byte",
        "largest of the team's packets",
        _packet_bytes_max,
        int,
        in_summary=False,
        pooled=(
            Pooled("packet_bytes_max", pooling.largest, "over all runs", Column("sent\nmax\n(B)", "whole")),
        ),
    ),
    "seconds": Metric(
        "s",
        "run time of the team's navigators",
        _seconds,
        in_summary=False,
        pooled=(Pooled("seconds", pooling.mean_over_runs, "mean over runs", Column("run\ntime\n(s)")),),
    ),
}
"""Metrics by key, in the order of `runs.csv`, `summary.json` and the tables."""


def row_columns() -> dict[str, type]:
    """Columns of a row (one per run, navigator and vehicle) and of a study's CSV, in order, with the type of a value.

    A value may be None (empty in CSV); `inf` is written as `inf`. A study adds columns for what it varies.
    """
    return {"run": int, "seed": int, "navigator": str, "vehicle": str} | {
        key: metric.type for key, metric in METRICS.items()
    }


def pooled_metrics() -> list[Pooled]:
    """All pooled metrics, in the order of a study's `summary.json` and table."""
    return [pooled for metric in METRICS.values() for pooled in metric.pooled]
