"""The smallest covariance that a team's estimates can have: its Cramér-Rao bound along a mission's true tracks.

Joint over the team and centralised: each sounding and range is available in one place as soon as it is measured. The
model is that of `mpf` with the scenario's options, with `team`'s options for the current and the tide that vehicles
share. The bound holds for those priors and noises.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop import _native
from uwcoop.charts.native import native_chart
from uwcoop.navigators import options_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog
    from uwcoop.missionlog.model import Columns

    Floats = NDArray[np.float64]

__all__ = ["BOUNDS", "bound_covariance_m2", "bound_m", "bounds_of"]

MODEL_OF = "mpf"
"""The packaged navigator whose options are the bound's priors and noises."""

SHARED_OF = "team"
"""The one whose options state what the vehicles' currents and tides have in common."""

UNKNOWN_TO_IT = ("ground_velocity", "water_velocity", "odometry", "usbl", "beacon_range")
"""Kinds of events that terrain navigators use and the bound does not: with them it is none."""
_NONE = {"t_ns": np.zeros(0, dtype=np.int64)}

BOUNDS = {
    "bound_m": "root of the trace of the team's Cramér-Rao bound",
    "linearised_bound_m": "the same, statistically linearised over its own spread",
}
"""Variables of the tracks that hold bounds."""


def bounds_of(log: MissionLog, sample_ns: NDArray[np.int64]) -> dict[str, Floats]:
    """Every variable of `BOUNDS` at the instants of a record, (vehicle, time), m; none without chart or truth."""
    found = {}
    for name in BOUNDS:
        values = bound_m(log, sample_ns, linearised=name == "linearised_bound_m")
        if values is not None:
            found[name] = values
    return found


def bound_m(
    log: MissionLog,
    sample_ns: NDArray[np.int64],
    *,
    terrain: bool = True,
    ranges: bool = True,
    linearised: bool = False,
) -> Floats | None:
    """Root of the trace of each vehicle's bound, (vehicles, samples), m; as `bound_covariance_m2`."""
    covariance = bound_covariance_m2(log, sample_ns, terrain=terrain, ranges=ranges, linearised=linearised)
    return None if covariance is None else np.sqrt(covariance[..., 0] + covariance[..., 2])


def bound_covariance_m2(
    log: MissionLog,
    sample_ns: NDArray[np.int64],
    *,
    terrain: bool = True,
    ranges: bool = True,
    linearised: bool = False,
) -> Floats | None:
    """Posterior Cramér-Rao bound of every vehicle's position (Tichavský, Muravchik & Nehorai 1998).

    Args:
        log: a mission with chart and truth; without either there is no bound.
        sample_ns: ascending instants, ns.
        terrain: count soundings, with the slope of the log's chart at the true position; over its holes there are none.
        ranges: count the range of every signal whose first frame arrived.
        linearised: take the slope that the chart shows over the bound's own spread of positions instead, and what does
            not fit that slope as noise.

    Returns:
        (vehicles, samples, 3): ee, en, nn in m²; NaN before a vehicle's first fix. None without chart, where the
        truth of a vehicle is not known throughout, or where navigators are told more than the bound knows
        (`UNKNOWN_TO_IT`).
    """
    truth = log.known_truth
    told_more = any(len(log.events.get(kind, _NONE)["t_ns"]) for kind in UNKNOWN_TO_IT)
    if log.chart is None or truth is None or told_more:
        return None
    position = truth["position_m"].transpose("vehicle", "time", "axis").to_numpy()
    span_s = truth["time"].to_numpy()[[0, -1]]
    if not np.isfinite(position).all() or span_s[0] > 0 or span_s[1] * 1e9 < sample_ns[-1]:
        return None
    stated = tuple(options_of(name, log.setup).stated() for name in (MODEL_OF, SHARED_OF))
    return _native.bound(
        native_chart(log.chart),
        np.round(truth["time"].to_numpy() * 1e9).astype(np.int64),
        np.ascontiguousarray(position, dtype=np.float64),
        {kind: log.events[kind] for kind in ("fix", "water_depth", "motion") if kind in log.events},
        _ranges(log),
        (stated[0], stated[1]),
        (terrain, ranges, linearised),
        np.ascontiguousarray(sample_ns, dtype=np.int64),
    )


def _ranges(log: MissionLog) -> Columns:
    """Sender, receiver, launch and arrival of every signal of which a packet of one frame would have arrived."""
    names = ("sender", "receiver", "tol_ns", "toa_ns")
    parts = []
    if log.opportunities:
        arrived = log.opportunities["draws"][:, 0] < log.opportunities["survive_probability"]
        parts.append({name: log.opportunities[name][arrived] for name in names})
    if log.receptions:
        parts.append({name: log.receptions[name] for name in names})
    empty = np.zeros(0, np.int64)
    return {name: np.concatenate([empty, *(part[name] for part in parts)]) for name in names}
