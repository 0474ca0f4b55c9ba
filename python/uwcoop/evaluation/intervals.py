"""How sure a study's figures are: bootstrap intervals over missions, and paired differences between navigators.

A mission is the sample, with all its vehicles and instants: they are correlated, missions with different seeds are not.
The missions are drawn with replacement; the interval holds the middle 95 % of the figures of such draws (the percentile
method of Efron and Tibshirani 1993, chapter 13). All navigators see the same draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation.pooling import LOST_BEYOND_M, Rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Draws = NDArray[np.int64]
    Intervals = dict[str, list[float | None] | None]

__all__ = ["CONFIDENCE", "LEAST_MISSIONS", "RESAMPLES", "draws_of", "intervals", "mission_rmse", "paired"]

CONFIDENCE = 0.95
RESAMPLES = 1000
LEAST_MISSIONS = 5
"""Of fewer missions no interval is given: it would look far too narrow."""


def draws_of(missions: int) -> Draws:
    """Indices of missions, (RESAMPLES, missions): the same for the same number of missions."""
    return np.random.default_rng(missions).integers(0, missions, (RESAMPLES, missions))


def intervals(rows: Rows) -> dict[str, Intervals]:
    """By navigator, the 95 % intervals of its pooled `median_rmse_m`, `rmse_m`, `anees`, `inside_share` and `lost_share`.

    Args:
        rows: of one variant, as `metrics.pool` takes them.

    Returns:
        [low, high] by figure, None in them for an infinite bound; None where no row has a value, and everywhere with
        fewer than `LEAST_MISSIONS` missions.
    """
    found: dict[str, Intervals] = {}
    for navigator, own in _by_navigator(rows).items():
        missions = _by_mission(own)
        draws = draws_of(len(missions)) if len(missions) >= LEAST_MISSIONS else None
        found[navigator] = {
            key: None if draws is None else _interval(figure(list(missions.values()), draws))
            for key, figure in _FIGURES.items()
        }
    return found


def paired(rows: Rows) -> dict[str, dict[str, Any]]:
    """By navigator, how its RMSE of a mission differs from that of the first navigator in the same mission.

    `reference`, `missions` (flown by both with a finite RMSE), `median_difference_m` (own minus reference) with
    `interval_m` as `intervals` gives it, and `better_share`, the share of missions in which it is smaller.
    """
    by_mission = {name: mission_rmse(own) for name, own in _by_navigator(rows).items()}
    reference, *others = by_mission or {"": {}}
    found = {}
    for name in others:
        known = by_mission[reference]
        both = [
            seed for seed, rmse in by_mission[name].items() if math.isfinite(rmse + known.get(seed, math.inf))
        ]
        difference = np.array([by_mission[name][seed] - known[seed] for seed in both])
        interval = None
        if len(both) >= LEAST_MISSIONS:
            interval = _interval(np.median(difference[draws_of(len(both))], axis=1))
        found[name] = {
            "reference": reference,
            "missions": len(both),
            "median_difference_m": float(np.median(difference)) if both else None,
            "interval_m": interval,
            "better_share": float((difference < 0).mean()) if both else None,
        }
    return found


def mission_rmse(rows: Rows) -> dict[int, float]:
    """By seed, the RMSE of a navigator over all vehicles and instants of the mission, m; NaN without truth."""
    return {seed: _ratio_root(own) for seed, own in _by_mission(rows).items()}


def _ratio_root(rows: Rows) -> float:
    known = [row for row in rows if row["rmse_m"] is not None and row["instants"] > 0]
    total = sum(row["instants"] for row in known)
    return (
        math.sqrt(sum(row["instants"] * row["rmse_m"] ** 2 for row in known) / total) if total else math.nan
    )


def _by_navigator(rows: Rows) -> dict[str, list[Mapping[str, Any]]]:
    found: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault(str(row["navigator"]), []).append(row)
    return found


def _by_mission(rows: Rows) -> dict[int, list[Mapping[str, Any]]]:
    found: dict[int, list[Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault(int(row["seed"]), []).append(row)
    return dict(sorted(found.items()))


def _interval(figures: Floats) -> list[float | None] | None:
    figures = np.sort(figures[~np.isnan(figures)])
    if not figures.size:
        return None
    tail = (1 - CONFIDENCE) / 2
    at = (math.floor(tail * (figures.size - 1)), math.ceil((1 - tail) * (figures.size - 1)))
    return [float(figures[k]) if math.isfinite(figures[k]) else None for k in at]


Missions = list[list[Mapping[str, Any]]]


def _table(missions: Missions, key: str) -> Floats:
    """A column, (missions, vehicles); NaN where there is no value."""
    table = np.full((len(missions), max(map(len, missions))), np.nan)
    for k, rows in enumerate(missions):
        table[k, : len(rows)] = [np.nan if row[key] is None else row[key] for row in rows]
    return table


def _median(key: str) -> Callable[[Missions, Draws], Floats]:
    def figure(missions: Missions, draws: Draws) -> Floats:
        table = _table(missions, key)
        if np.isnan(table).all():
            return np.array([])
        drawn = np.sort(table[draws].reshape(len(draws), -1), axis=1)  # NaN at the end
        count = (~np.isnan(drawn)).sum(1)
        each = np.arange(len(drawn))
        with np.errstate(invalid="ignore"):
            middle = (
                drawn[each, np.maximum(count - 1, 0) // 2] + drawn[each, count // 2 % drawn.shape[1]]
            ) / 2
        return np.where(count > 0, middle, np.nan)

    return figure


def _mean(key: str, weight: str, power: int = 1) -> Callable[[Missions, Draws], Floats]:
    def figure(missions: Missions, draws: Draws) -> Floats:
        value, weights = _table(missions, key), _table(missions, weight)
        known = ~np.isnan(value) & (weights > 0)
        with np.errstate(invalid="ignore"):
            sums = np.where(known, weights * value**power, 0.0).sum(1)
        total = np.where(known, weights, 0.0).sum(1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray((sums[draws].sum(1) / total[draws].sum(1)) ** (1 / power))

    return figure


def _lost(missions: Missions, draws: Draws) -> Floats:
    final = _table(missions, "final_error_m")
    known = ~np.isnan(final)
    with np.errstate(invalid="ignore"):
        lost = (known & (final > LOST_BEYOND_M)).sum(1)[draws].sum(1)
        return np.asarray(lost / known.sum(1)[draws].sum(1))


_FIGURES: dict[str, Callable[[Missions, Draws], Floats]] = {
    "median_rmse_m": _median("rmse_m"),
    "rmse_m": _mean("rmse_m", "instants", 2),
    "anees": _mean("anees", "nees_instants"),
    "inside_share": _mean("inside_share", "nees_instants"),
    "lost_share": _lost,
}
"""As `metrics.pool` pools them."""
