"""Which sensor is noisier than the navigators are told, by what it shows; only navigators that estimate it answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.evaluation import pooling
from uwcoop.evaluation.metric_types import Column, Metric, Pooled

if TYPE_CHECKING:
    from uwcoop.evaluation.vehicle_run import VehicleRun

__all__ = ["SENSOR_MISFITS"]

_SHOWN_ABOVE = 1.5


def _at_end(name: str) -> Callable[[VehicleRun], float | None]:
    """The last value of a diagnostic that is known."""

    def measure(run: VehicleRun) -> float | None:
        if name not in run.tracks:
            return None
        values = run.values(name)
        known = values[np.isfinite(values)]
        return float(known[-1]) if known.size else None

    return measure


def _misfit(name: str, heading: str, sensor: str) -> Metric:
    column = Column(f"{heading}\nnoise\n/ told", only_if_above=_SHOWN_ABOVE)
    return Metric(
        "1",
        f"noise of the {sensor} over what is told, by what they show; in tables from {_SHOWN_ABOVE:g} on",
        _at_end(name),
        column=column,
        pooled=(Pooled(name, pooling.median, "median over runs and vehicles", column),),
    )


SENSOR_MISFITS = {
    "depth_noise_factor": _misfit("depth_noise_factor", "depth", "soundings"),
    "range_noise_factor": _misfit("range_noise_factor", "range", "ranges"),
}
"""Metrics by key; each reads the diagnostic of the same name."""
