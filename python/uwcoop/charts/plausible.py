"""The one check of depths before anything is averaged: which numbers of a file mean "no data".

No depth on Earth lies below 12,000 m and no height above 9,000 m: what does is left out. Within those bounds, numbers
that programs commonly write for "no data" are left out where they stand apart from all other values, and so is any
one number that several nodes hold exactly and that stands far apart. What is left out is said, with its number and
share; a value that nothing here tells is given as `nodata`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import ChartError

if TYPE_CHECKING:
    from numpy.typing import NDArray

DEEPEST_M = 12_000.0
HIGHEST_M = 9_000.0
COMMON_FILLS = (999, 999.9, 9999, 9999.9, 9998, 99999, 999999, 32767, 32768, 65535, 65536)
"""Their negatives too."""
_APART = 2.0
"""A common fill stands apart when its size is more than so many times that of every other value."""
_FAR_APART_M = 100.0
_FAR_APART_RANGES = 10.0
_LEAST_REPEATS = 3
_SHOWN = 3


def without_fills(
    values: NDArray[Any], metres_per_unit: float, nodata: float | None, counted: str
) -> tuple[NDArray[Any], tuple[str, ...]]:
    """The values with NaN for those that mean "no data", and notes.

    Args:
        values: the file's numbers, any shape; NaN where it has none already.
        metres_per_unit: of those numbers; they may grow upwards or downwards.
        nodata: a value that means "no data", in the file's unit; None: find them.
        counted: what a value belongs to, for notes: "nodes" or "soundings".

    Raises:
        ChartError: nothing is left.
    """
    known = np.isfinite(values)
    total = int(np.count_nonzero(known))
    if not total:
        raise ChartError(f"chart of {values.size} values holds no depth: all are holes")
    fill = np.zeros(values.shape, dtype=bool)
    if nodata is not None:
        # A float32 grid holds the float32 nearest to the number asked for.
        fill |= values == np.asarray(nodata, dtype=values.dtype)
    with np.errstate(over="ignore", invalid="ignore"):
        fill |= known & (np.abs(values) * metres_per_unit > DEEPEST_M)
    rest = values[known & ~fill]
    for value in _standing_apart(rest, metres_per_unit):
        fill |= values == value
    count = int(np.count_nonzero(fill))
    if not count:
        return np.where(known, values, np.nan) if not np.isfinite(values).all() else values, ()
    if count == total:
        raise ChartError(
            f"chart values {values[known].min():g} to {values[known].max():g} are no depths: "
            f"none lies within {DEEPEST_M:,.0f} m of the surface"
        )
    note = f"{count:,} {counted} ({_percent(count, total)}) hold {_shown(values[fill])}: taken as no data"
    return np.where(known & ~fill, values, np.nan), (note,)


def without_impossible(depth: NDArray[Any], counted: str) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Depths in metres, positive down, without heights above the highest land, and notes."""
    with np.errstate(invalid="ignore"):
        wrong = depth < -HIGHEST_M
    if not wrong.any():
        return depth, ()
    count, total = int(np.count_nonzero(wrong)), int(np.count_nonzero(np.isfinite(depth)))
    note = (
        f"{count:,} {counted} ({_percent(count, total)}) hold heights of {_shown(-depth[wrong])} m, "
        f"above {HIGHEST_M:,.0f} m: taken as no data"
    )
    return np.where(wrong, np.nan, depth), (note,)


def _standing_apart(rest: NDArray[Any], metres_per_unit: float) -> list[float]:
    """Values that stand apart from all others: common fills, and any one extreme that is repeated exactly."""
    found: list[float] = []
    while rest.size:
        low, high = float(rest.min()), float(rest.max())
        extreme = low if abs(low) >= abs(high) else high
        others = rest[rest != extreme]
        if not others.size:
            break
        nearest = float(np.abs(others).max())
        common = any(abs(abs(extreme) - fill) < 1e-4 * fill for fill in COMMON_FILLS)
        spread = float(others.max() - others.min())
        gap = abs(extreme - float(others.max() if extreme == high else others.min()))
        repeated = rest.size - others.size >= _LEAST_REPEATS
        far = gap * metres_per_unit > _FAR_APART_M and gap > _FAR_APART_RANGES * spread > 0
        if not (common and abs(extreme) > _APART * nearest) and not (repeated and far):
            break
        found.append(extreme)
        rest = others
    return found


def _percent(count: int, total: int) -> str:
    share = 100 * count / total
    return f"{share:.1f} %" if share >= 0.1 else f"{share:.2g} %"


def _shown(values: NDArray[Any]) -> str:
    different = np.unique(values)
    if different.size <= _SHOWN:
        return " or ".join(f"{value:g}" for value in different)
    return f"{different[0]:g} to {different[-1]:g}"
