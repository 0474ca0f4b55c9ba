"""Sensors that fail for a while: readings that are missing, stuck, or of a value that nothing measured."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.scenario.sensors import Fault

    Rows = dict[str, NDArray[np.float64]]

AXES = {
    "water_depth": ("water_depth_m",),
    "depth": ("depth_m",),
    "heading": ("yaw_rad",),
    "ground_velocity": ("forward_mps", "left_mps"),
}
"""What a sensor reads, by its event; `sigma_…` is what it states of its error."""


def with_faults(kind: str, rows: Rows, faults: Sequence[Fault], rng: np.random.Generator) -> Rows:
    """A sensor's events with its faults, one after another. Without faults nothing is drawn."""
    for fault in faults:
        struck = (rows["t_s"] >= fault.from_s) & (rows["t_s"] < fault.to_s)
        struck &= rng.random(struck.size) < fault.share
        rows = _struck(kind, rows, fault, struck)
    return rows


def _struck(kind: str, rows: Rows, fault: Fault, struck: NDArray[np.bool_]) -> Rows:
    if fault.kind == "dropout":
        return {name: column[~struck] for name, column in rows.items()}
    if not struck.any():
        return rows
    before = max(0, int(np.argmax(struck)) - 1)
    changed = dict(rows)
    for axis in AXES[kind]:
        value = rows[axis][before] if fault.value is None else fault.value
        if fault.value is not None and axis == "yaw_rad":
            value = math.pi / 2 - math.radians(fault.value)
        changed[axis] = np.where(struck, value, rows[axis])
    return changed
