"""Error and NEES over time, one series for each vehicle and navigator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation import metrics
from uwcoop.evaluation.nees import CHI2_95_2D
from uwcoop.viewer.stage import Stage, entity, rgb, series

if TYPE_CHECKING:
    import xarray as xr

NEES_LIMIT = f"95 % limit {CHI2_95_2D:.2f}"


def send(recording: Any, stage: Stage, tracks: xr.Dataset) -> None:
    """Log the series; instants whose error or NEES is infinite or unknown are left out of the lines."""
    for quantity, values in (("error_m", metrics.errors(tracks)), ("nees", metrics.nees(tracks))):
        for j, vehicle in enumerate(stage.vehicles):
            for i, navigator in enumerate(stage.navigators):
                series(
                    recording, entity(quantity, vehicle, navigator), navigator, rgb(i),
                    stage.time_s, values.values[i, j, stage.at],
                )  # fmt: skip
    for vehicle in stage.vehicles:
        series(
            recording, entity("nees", vehicle, "limit"), NEES_LIMIT, (130, 130, 130),
            stage.time_s[[0, -1]], np.full(2, CHI2_95_2D),
        )  # fmt: skip
