"""Whether navigators are honest, judged without truth: by what they expected of each measurement before they used it.

An innovation is a measurement less what was expected of it; its normalised square (NIS) is χ² with as many degrees of
freedom as the measurement has numbers, if belief and sensor are as stated (Bar-Shalom, Li and Kirubarajan 2001, 5.4.2).
A mean above the band says that belief, sensor or chart is worse than stated; below it, that they are better. The band is
that of independent innovations. Soundings that share the chart's error, and ranges that share a clock's, are not: their
mean scatters more.

Statistics are over measurements after `settle_s`, those that were gated included: a gate is the navigator's own doubt.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation.nees import CHI2_95_2D, anees_bounds
from uwcoop.evaluation.per_instant import names_of, settled_instants, values_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog.labelled import Arrays

    Floats = NDArray[np.float64]
    Innovations = Mapping[str, NDArray[Any]]
    Outcomes = Mapping[str, Mapping[str, NDArray[np.int64]]]

__all__ = [
    "DEGREES",
    "LIMIT_95",
    "OUTCOMES",
    "consistency",
    "disagreement",
    "has_truth",
    "innovation_fit",
    "innovations_of",
    "stated_sigma_m",
]

DEGREES = {"fix": 2, "sounding": 1, "range": 1}
"""Kinds of measurements that are compared, with their degrees of freedom."""
LIMIT_95 = {1: 3.841458820694124, 2: CHI2_95_2D}
"""95 % quantile of χ² by degrees of freedom."""
OUTCOMES = ("fused", "noted", "gated", "rejected")
"""What becomes of an event: it changed the estimate; it did not; it contradicted the belief; it could not be read."""
_KIND = {
    "fix": "fix", "usbl": "fix", "water_depth": "sounding", "reception": "range", "beacon_range": "range",
}  # fmt: skip


def innovations_of(records: list[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    """The innovations that replays recorded, one row each.

    Columns: `navigator`, `vehicle`, `sender` (-1: no range), `t_ns`, `kind` (a key of `DEGREES`), `fused`,
    `innovation_m`, `sigma_m`, `squared` (NIS), `jump_m` (how far a fix moved the belief; NaN for other kinds).
    """
    tables = [record["innovations"] for record in records]
    names = ("vehicle", "sender", "t_ns", "fused", "innovation_m", "sigma_m", "squared", "jump_m")
    found = {name: np.concatenate([table[name] for table in tables]) for name in names}
    found["kind"] = np.array([_KIND[kind] for table in tables for kind in table["kind"]], dtype=object)
    counts = [len(table["t_ns"]) for table in tables]
    return {"navigator": np.repeat(np.arange(len(tables)), counts), **found}


def has_truth(tracks: Arrays) -> NDArray[np.bool_]:
    """(vehicle,) whether its true position is known at any instant that counts."""
    known = np.isfinite(values_of(tracks, "truth_position_m")).all(-1)
    return np.asarray((known & settled_instants(tracks)).any(-1))


def stated_sigma_m(tracks: Arrays) -> Floats:
    """Root of the trace of the stated covariance, m, (navigator, vehicle, time); NaN where it is none."""
    covariance = values_of(tracks, "covariance_m2")
    trace = covariance[..., 0, 0] + covariance[..., 1, 1]
    return np.asarray(np.sqrt(np.where(np.isfinite(trace) & (trace >= 0), trace, np.nan)))


def innovation_fit(squared: Floats, kind: str) -> dict[str, Any]:
    """How the normalised squares (N,) of one kind fit χ².

    Returns:
        `compared` N; `nis_per_dof` their mean by degree of freedom (1 is ideal) with its 95 % band `band_95` [low, high];
        `beyond_95_share` the share beyond the 95 % quantile (0.05 is ideal).
    """
    dof, count = DEGREES[kind], int(squared.size)
    if count == 0:
        return {"compared": 0, "nis_per_dof": None, "band_95": None, "beyond_95_share": None}
    low, high = anees_bounds(dof, count)
    mean = float(squared.mean()) / dof
    return {
        "compared": count,
        "nis_per_dof": mean if math.isfinite(mean) else None,
        "band_95": [low / dof, high / dof],
        "beyond_95_share": float((squared > LIMIT_95[dof]).mean()),
    }


def consistency(
    tracks: Arrays, innovations: Innovations, outcomes: Outcomes
) -> dict[str, dict[str, dict[str, Any]]]:
    """What `summary.json` holds of each navigator and vehicle under `consistency`.

    Keys of a vehicle: `sigma_m` (median, largest, final of the stated sigma over the instants that count), one of
    `DEGREES` each (`innovation_fit`; `fix` also with the median and the largest jump), and `outcomes`: by kind of
    event, how many were fused, noted, gated and rejected, from the start on. A navigator that does not say how a kind
    fitted has `compared` 0 for it.
    """
    sigma, settled = stated_sigma_m(tracks), settled_instants(tracks)
    late = innovations["t_ns"] > float(tracks.attrs["settle_s"]) * 1e9
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for i, navigator in enumerate(names_of(tracks, "navigator")):
        found[navigator] = {}
        for j, vehicle in enumerate(names_of(tracks, "vehicle")):
            own = late & (innovations["navigator"] == i) & (innovations["vehicle"] == j)
            entry: dict[str, Any] = {"sigma_m": _spread(sigma[i, j], settled)}
            for kind in DEGREES:
                rows = own & (innovations["kind"] == kind)
                entry[kind] = innovation_fit(innovations["squared"][rows], kind)
                if kind == "fix":
                    jump = innovations["jump_m"][rows]
                    jump = jump[np.isfinite(jump)]
                    entry[kind]["median_jump_m"] = float(np.median(jump)) if jump.size else None
                    entry[kind]["largest_jump_m"] = float(jump.max()) if jump.size else None
            entry["outcomes"] = {
                kind: dict(zip(OUTCOMES, counts[j].tolist(), strict=True))
                for kind, counts in outcomes[navigator].items()
                if counts[j].any()
            }
            found[navigator][vehicle] = entry
    return found


def disagreement(tracks: Arrays) -> dict[str, dict[str, dict[str, dict[str, float | None]]]]:
    """By navigator, vehicle and other navigator: `rms_m` of the distance between both estimates over the instants that
    count, and `apart_share`, the share of them at which the distance is beyond the 95 % ellipse of the sum of both
    covariances. Navigators of one vehicle share its sensors, so honest ones are nearer to each other than that: where the
    share is large, at least one of the two is wrong.
    """
    from uwcoop.evaluation.nees import normalised_square

    settled = settled_instants(tracks)
    position = values_of(tracks, "position_m")[:, :, settled]
    covariance = values_of(tracks, "covariance_m2")[:, :, settled]
    names, vehicles = names_of(tracks, "navigator"), names_of(tracks, "vehicle")
    found: dict[str, dict[str, dict[str, dict[str, float | None]]]] = {
        name: {vehicle: {} for vehicle in vehicles} for name in names
    }
    for i in range(len(names)):
        for k in range(i + 1, len(names)):
            apart = position[i] - position[k]
            square = normalised_square(apart, covariance[i] + covariance[k])
            for j, vehicle in enumerate(vehicles):
                distance2 = (apart[j] ** 2).sum(-1)
                distance2 = distance2[np.isfinite(distance2)]
                known = square[j][~np.isnan(square[j])]
                entry = {
                    "rms_m": float(np.sqrt(distance2.mean())) if distance2.size else None,
                    "apart_share": float((known > CHI2_95_2D).mean()) if known.size else None,
                }
                found[names[i]][vehicle][names[k]] = entry
                found[names[k]][vehicle][names[i]] = entry
    return found


def _spread(sigma_m: Floats, settled: NDArray[np.bool_]) -> dict[str, float | None]:
    known = sigma_m[settled]
    known = known[np.isfinite(known)]
    if not known.size:
        return {"median": None, "largest": None, "final": None}
    return {"median": float(np.median(known)), "largest": float(known.max()), "final": float(known[-1])}
