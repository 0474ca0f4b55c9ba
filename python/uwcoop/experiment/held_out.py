"""Fixes that are withheld from the navigators and scored: a withheld fix is a truth with a sigma.

Fixes come in groups: a vehicle surfaces and has one each second. A group is withheld whole, since a fix whose neighbour
was used says nothing. A group ends where no fix follows within `GAP_S`, or after `LONGEST_S`. The first group of each
vehicle is used always: without a position nobody navigates.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import LogError
from uwcoop.evaluation.nees import normalised_square
from uwcoop.evaluation.per_instant import names_of, values_of
from uwcoop.scenario.base import nearest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import Columns, MissionLog
    from uwcoop.missionlog.labelled import Arrays

__all__ = ["GAP_S", "LONGEST_S", "Request", "held_out_scores", "parse_request", "withhold"]

GAP_S = 10.0
LONGEST_S = 60.0
_FORM = re.compile(r"fix(?::(?P<share>[^@]*))?(?:@(?P<vehicles>.+))?$")


@dataclass(frozen=True)
class Request:
    """What to withhold."""

    share: float = 1.0
    """Of the groups of fixes after the first of each vehicle, evenly over time."""
    vehicles: tuple[str, ...] = ()
    """Whose; empty: of all."""


def parse_request(text: str) -> Request:
    """`fix`, `fix:SHARE`, each with `@VEHICLE,…`.

    Raises:
        LogError: another text, or a share outside 0 to 1.
    """
    found = _FORM.match(text.strip())
    if found is None:
        raise LogError(f"held out {text!r}: must be fix, fix:SHARE or fix:SHARE@VEHICLE,…")
    share = 1.0
    if found["share"] is not None:
        try:
            share = float(found["share"])
        except ValueError:
            share = np.nan
        if not 0 < share <= 1:
            raise LogError(f"held out {text!r}: the share {found['share']!r} must be above 0 and at most 1")
    names = tuple(name.strip() for name in (found["vehicles"] or "").split(",") if name.strip())
    return Request(share, names)


def withhold(log: MissionLog, request: Request) -> tuple[MissionLog, Columns]:
    """The log without the withheld fixes, with a note of how many, and the fixes that were withheld.

    Raises:
        LogError: an unknown vehicle, or nothing to withhold.
    """
    for name in request.vehicles:
        if name not in log.vehicles:
            raise LogError(f"held out fixes of {name!r}: {nearest(name, list(log.vehicles))}")
    table = log.events.get("fix")
    count = 0 if table is None else len(table["t_ns"])
    held = np.zeros(count, dtype=bool)
    told = []
    for vehicle, name in enumerate(log.vehicles):
        if table is None or (request.vehicles and name not in request.vehicles):
            continue
        rows = np.flatnonzero(table["vehicle"] == vehicle)
        group = _groups(table["t_ns"][rows])
        later = int(group[-1]) if rows.size else 0
        wanted = _evenly(later, request.share)
        chosen = np.isin(group, wanted)
        held[rows[chosen]] = True
        told.append(
            f"{name} {chosen.sum()} of {rows.size} in {len(wanted)} of {later + bool(rows.size)} groups"
        )
    if table is None or not held.any():
        raise LogError(
            f"mission {log.name!r} has no fixes to hold out: a vehicle's first group of fixes is always used "
            f"({'; '.join(told) or 'no fixes at all'})"
        )
    note = f"fixes held out and scored: {'; '.join(told)}"
    kept = {name: column[~held] for name, column in table.items()}
    taken = {name: column[held] for name, column in table.items()}
    return replace(log, events={**log.events, "fix": kept}, notes=(*log.notes, note)), taken


def held_out_scores(tracks: Arrays, fixes: Columns) -> dict[str, dict[str, dict[str, Any]]]:
    """By navigator and vehicle: `fixes` scored, `rms_m` of their distance from the estimate, `sigma_m` the root mean
    square sigma of the fixes alone, and `nees`, the mean normalised square under estimate and fix together (2 is
    ideal).

    `rms_m` holds the fixes' own noise: a navigator without any error has `sigma_m`.
    """
    at = np.searchsorted(values_of(tracks, "time"), fixes["t_ns"] / 1e9 - 5e-10)
    found: dict[str, dict[str, dict[str, Any]]] = {}
    position, covariance = values_of(tracks, "position_m"), values_of(tracks, "covariance_m2")
    measured = np.stack([fixes["e_m"], fixes["n_m"]], axis=-1)
    noise = np.stack(
        [fixes["cov_ee_m2"], fixes["cov_en_m2"], fixes["cov_en_m2"], fixes["cov_nn_m2"]], axis=-1
    )
    noise = noise.reshape(-1, 2, 2)
    for i, navigator in enumerate(names_of(tracks, "navigator")):
        found[navigator] = {}
        for j, vehicle in enumerate(names_of(tracks, "vehicle")):
            own = fixes["vehicle"] == j
            if not own.any():
                continue
            off = measured[own] - position[i, j, at[own]]
            square = normalised_square(off, covariance[i, j, at[own]] + noise[own])
            known = np.isfinite(off).all(-1)
            defined = square[np.isfinite(square)]
            found[navigator][vehicle] = {
                "fixes": int(known.sum()),
                "rms_m": float(np.sqrt((off[known] ** 2).sum(-1).mean())) if known.any() else None,
                "sigma_m": float(np.sqrt(np.trace(noise[own], axis1=-2, axis2=-1).mean())),
                "nees": float(defined.mean()) if defined.size else None,
            }
    return found


def _groups(t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) number of each fix's group, from 0."""
    group = np.zeros(len(t_ns), dtype=np.int64)
    began = t_ns[0] if len(t_ns) else 0
    for k in range(1, len(t_ns)):
        ends = (t_ns[k] - t_ns[k - 1]) / 1e9 > GAP_S or (t_ns[k] - began) / 1e9 >= LONGEST_S
        group[k] = group[k - 1] + ends
        began = t_ns[k] if ends else began
    return group


def _evenly(groups: int, share: float) -> NDArray[np.int64]:
    """So large a share of the groups 1 to `groups`, evenly spread: at least one where there is one."""
    if groups == 0:
        return np.zeros(0, dtype=np.int64)
    count = max(1, round(share * groups))
    return np.asarray(np.unique(np.round(np.linspace(1, groups, 2 * count + 1)[1::2])).astype(np.int64))
