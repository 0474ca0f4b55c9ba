"""Which varied number the error depends on: rank correlations over the missions of a study, with bootstrap intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation.intervals import CONFIDENCE, LEAST_MISSIONS, draws_of, mission_rmse
from uwcoop.evaluation.pooling import Rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

__all__ = ["sensitivity"]


def sensitivity(rows: Rows, keys: Sequence[str]) -> list[dict[str, Any]]:
    """For each varied key with numbers as values, and each navigator, how the RMSE of a mission follows it.

    Args:
        rows: of a study, with the varied keys' values as they were set.
        keys: the varied keys.

    Returns:
        One entry for each key and navigator: `key`, `navigator`, `rank_correlation` (Spearman's, of the value and the
        mission's RMSE, over all missions of all variants) with `interval` (bootstrap over seeds, ranks kept; None below
        `LEAST_MISSIONS` seeds), and what the RMSE does: `low` and `high`, the middle of the lowest and of the highest
        third of the values, with `rmse_low_m` and `rmse_high_m`, the median RMSE of missions in them. Other keys that
        are varied at the same time scatter the error, and so lower the correlation.
    """
    found = []
    navigators = list(dict.fromkeys(str(row["navigator"]) for row in rows))
    for key in keys:
        if len({row[key] for row in rows if _is_number(row[key])}) < 2 or not all(
            _is_number(row[key]) for row in rows
        ):
            continue
        for navigator in navigators:
            own = [row for row in rows if row["navigator"] == navigator]
            found.append({"key": key, "navigator": navigator, **_of_one(own, key, keys)})
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _of_one(rows: Rows, key: str, keys: Sequence[str]) -> dict[str, Any]:
    variants: dict[str, list[Any]] = {}
    for row in rows:
        variants.setdefault(str([row[k] for k in keys]), []).append(row)
    points = [
        (float(own[0][key]), rmse, seed)
        for own in variants.values()
        for seed, rmse in mission_rmse(own).items()
        if not math.isnan(rmse)
    ]
    values, rmse, seeds = (np.array(column, dtype=np.float64) for column in zip(*points, strict=True)) if points else (
        np.zeros(0),
    ) * 3  # fmt: skip
    if len(points) < 3:
        return dict.fromkeys(("rank_correlation", "interval", "low", "high", "rmse_low_m", "rmse_high_m"))
    correlation, interval = _correlation(_ranks(values), _ranks(rmse), seeds)
    distinct = np.unique(values)
    third = max(1, len(distinct) // 3)
    low, high = distinct[:third], distinct[-third:]
    return {
        "rank_correlation": correlation,
        "interval": interval,
        "low": float(np.median(low)),
        "high": float(np.median(high)),
        "rmse_low_m": _median(rmse[np.isin(values, low)]),
        "rmse_high_m": _median(rmse[np.isin(values, high)]),
    }


def _ranks(values: Floats) -> Floats:
    """From 1 on; equal values share their mean rank."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return np.asarray((last - (counts - 1) / 2)[inverse], dtype=np.float64)


def _correlation(x: Floats, y: Floats, seeds: Floats) -> tuple[float | None, list[float] | None]:
    """Pearson's correlation of ranks, and its interval over draws of seeds: each draw weights a seed's sums."""
    distinct, group = np.unique(seeds, return_inverse=True)
    x, y = x - x.mean(), y - y.mean()
    terms = np.stack([np.ones_like(x), x, y, x * x, y * y, x * y], axis=1)
    sums = np.zeros((len(distinct), terms.shape[1]))
    np.add.at(sums, group, terms)
    whole = float(_pearson(sums.sum(0)[None])[0])
    if math.isnan(whole):
        return None, None
    if len(distinct) < LEAST_MISSIONS:
        return whole, None
    drawn = _pearson(sums[draws_of(len(distinct))].sum(1))
    low, high = np.quantile(drawn[~np.isnan(drawn)], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return whole, [float(low), float(high)]


def _pearson(sums: Floats) -> Floats:
    n, x, y, xx, yy, xy = sums.T
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((n * xy - x * y) / np.sqrt((n * xx - x * x) * (n * yy - y * y)))


def _median(values: Floats) -> float | None:
    middle = float(np.median(values))
    return middle if math.isfinite(middle) else None
