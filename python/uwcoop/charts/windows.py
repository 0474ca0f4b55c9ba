"""Sums over moving windows, by running totals: a cost that does not grow with the window."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def window_sums(values: NDArray[np.float64], half: int, axis: int) -> NDArray[np.float64]:
    """Sums over a node and `half` neighbours on each side along one axis; windows end at the grid's edge."""
    size = values.shape[axis]
    zero = np.zeros_like(np.take(values, [0], axis=axis))
    sums = np.concatenate([zero, np.cumsum(values, axis=axis)], axis=axis)
    nodes = np.arange(size)
    upper, lower = np.minimum(nodes + half + 1, size), np.maximum(nodes - half, 0)
    return np.asarray(np.take(sums, upper, axis=axis) - np.take(sums, lower, axis=axis))


def square_sums(values: NDArray[np.float64], half: int) -> NDArray[np.float64]:
    """Sums over the square of 2 half + 1 nodes around each node."""
    return window_sums(window_sums(values, half, 0), half, 1)
