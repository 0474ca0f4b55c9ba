"""Accuracy and consistency: the metrics of `uwcoop.evaluation.metric_registry`, for one run and over a study.

All statistics are over the instants of the 1 Hz grid strictly after `settle_s` (an attribute of the tracks), so that a
navigator with more arrivals is not weighted differently. What does not apply is `None` (null in JSON, empty in CSV): no
truth, no heading, no packets. What applies but went wrong is never dropped: an estimate that is not a number where
truth is known has an infinite error; a covariance that is singular against its error has an infinite NEES, one that is
not a covariance (NaN, negative variance) has NaN, and both are counted (`nees_not_finite`).

`tracks` is the Dataset of `uwcoop.run`. Beside its ordinary variables these are used when present:
`truth_yaw_rad (vehicle, time)`, `pose_covariance (navigator, vehicle, time, pose, pose_b)` of (east m, north m, yaw
rad), and `bound_m ([navigator,] vehicle, time)`, the root of the trace of the position's Cramér-Rao bound, with
`linearised_bound_m`, the same statistically linearised (`uwcoop.evaluation.cramer_rao`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from uwcoop.evaluation.metric_registry import METRICS, pooled_metrics, row_columns
from uwcoop.evaluation.metric_types import Column, Metric, Pooled
from uwcoop.evaluation.nees import anees_bounds, normalised_square
from uwcoop.evaluation.per_instant import errors, nees
from uwcoop.evaluation.pooling import LOST_BEYOND_M, Rows
from uwcoop.evaluation.vehicle_run import vehicle_runs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog.labelled import Arrays

__all__ = [
    "LOST_BEYOND_M",
    "METRICS",
    "Column",
    "Metric",
    "Pooled",
    "anees_bounds",
    "errors",
    "nees",
    "normalised_square",
    "pool",
    "pooled_metrics",
    "row_columns",
    "rows",
    "summarise",
    "summary_text",
]


def rows(
    tracks: Arrays,
    *,
    seconds: Mapping[str, float],
    packets: Mapping[str, NDArray[Any]] | None,
    run: int = 0,
) -> list[dict[str, Any]]:
    """A run's rows (keys `row_columns()`), one per navigator and vehicle; `seconds`: run time by navigator."""
    seed = int(tracks.attrs["seed"])
    return [
        {
            "run": run,
            "seed": seed,
            "navigator": navigator,
            "vehicle": vehicle,
            **{key: metric.measure(measured) for key, metric in METRICS.items()},
        }
        for navigator, vehicle, measured in vehicle_runs(tracks, seconds, packets)
    ]


def summarise(
    tracks: Arrays, *, seconds: Mapping[str, float], packets: Mapping[str, NDArray[Any]] | None
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
        vehicle = {key: _json(row[key]) for key, metric in METRICS.items() if metric.in_summary}
        if row["nees_not_finite"]:
            vehicle["nees_not_finite"] = row["nees_not_finite"]
        entry["vehicles"][row["vehicle"]] = vehicle
    return {"mission": tracks.attrs["mission"], "seed": int(tracks.attrs["seed"]), "navigators": navigators}


def pool(table: Rows) -> dict[str, dict[str, Any]]:
    """A variant's rows over all runs and vehicles, by navigator: the `navigators` of a study's `summary.json`.

    The keys are those of `pooled_metrics()`, whose texts say how each is pooled. None where no row has a value, and
    where the value is infinite.
    """
    pooled: dict[str, dict[str, Any]] = {}
    for navigator in dict.fromkeys(str(row["navigator"]) for row in table):
        own = [row for row in table if row["navigator"] == navigator]
        pooled[navigator] = {
            entry.key: _json(entry.pooling(own, key))
            for key, metric in METRICS.items()
            for entry in metric.pooled
        }
    return pooled


def summary_text(summary: Mapping[str, Any]) -> str:
    """A summary as the JSON that is written and printed."""
    return json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False)


def _json(value: float | None) -> float | None:
    return value if value is None or math.isfinite(value) else None
