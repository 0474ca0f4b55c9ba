"""How a metric of many rows (one for each run, navigator and vehicle) becomes one number of a study.

None and NaN mean "does not apply" and are left out; infinite values stay. None where no row has a value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

__all__ = [
    "LOST_BEYOND_M",
    "Pooling",
    "Rows",
    "largest",
    "lost_share",
    "mean_by_weight",
    "mean_over_runs",
    "median",
    "p95",
    "quantile",
    "rms_by_weight",
    "root_mean_square",
]

Rows = Sequence[Mapping[str, Any]]
Pooling = Callable[[Rows, str], "float | None"]
"""From the rows of one navigator and the key of a column."""

LOST_BEYOND_M = 30.0
"""A vehicle that is further off than this at the end counts as lost."""


def median(rows: Rows, key: str) -> float | None:
    """Over runs and vehicles."""
    return quantile(_column(rows, key), 0.5)


def p95(rows: Rows, key: str) -> float | None:
    """95 % quantile over runs and vehicles."""
    return quantile(_column(rows, key), 0.95)


def mean_by_weight(weight: str, *, power: int = 1) -> Pooling:
    """Mean of a power over instants, runs and vehicles: rows weighted by a column that counts their instants."""

    def pooled(rows: Rows, key: str) -> float | None:
        present = [r for r in rows if r[key] is not None and not math.isnan(r[key]) and r[weight] > 0]
        total = sum(row[weight] for row in present)
        return sum(row[weight] * row[key] ** power for row in present) / total if total else None

    return pooled


def rms_by_weight(weight: str) -> Pooling:
    """Root mean square over instants, runs and vehicles."""
    mean_square = mean_by_weight(weight, power=2)

    def pooled(rows: Rows, key: str) -> float | None:
        value = mean_square(rows, key)
        return None if value is None else math.sqrt(value)

    return pooled


def lost_share(rows: Rows, key: str) -> float | None:
    """Share of the rows with an error above `LOST_BEYOND_M`; an infinite error is lost."""
    final = _column(rows, key)
    return float((final > LOST_BEYOND_M).mean()) if final.size else None


def largest(rows: Rows, key: str) -> float | None:
    """Over runs and vehicles; a whole number stays one."""
    present: list[float] = [row[key] for row in rows if row[key] is not None and not math.isnan(row[key])]
    return max(present, default=None)


def mean_over_runs(rows: Rows, key: str) -> float | None:
    """Mean of a column whose value is the same for all vehicles of a run."""
    values = _column(list({row["run"]: row for row in rows}.values()), key)
    return float(values.mean()) if values.size else None


def quantile(values: Floats, share: float) -> float | None:
    """Linear interpolation between order statistics (NumPy's default), infinite errors at the top."""
    if not values.size:
        return None
    ordered = np.sort(values)
    at = share * (ordered.size - 1)
    below, above = ordered[math.floor(at)], ordered[math.ceil(at)]
    return float(below if above == below else below + (at - math.floor(at)) * (above - below))


def root_mean_square(values: Floats) -> float | None:
    """None where there are no values."""
    return math.sqrt(float(np.mean(values**2))) if values.size else None


def _column(rows: Rows, key: str) -> Floats:
    values = np.array([np.nan if row[key] is None else float(row[key]) for row in rows], dtype=np.float64)
    return values[~np.isnan(values)]
