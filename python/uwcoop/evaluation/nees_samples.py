"""NEES as a sample of each mission, for histograms over missions, and how often the ellipse holds the truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.evaluation import pooling
from uwcoop.evaluation.metric_types import Metric, Pooled
from uwcoop.evaluation.nees import CHI2_95_2D

if TYPE_CHECKING:
    from uwcoop.evaluation.vehicle_run import VehicleRun

__all__ = ["NEES_SAMPLES"]


def _final_nees(run: VehicleRun) -> float | None:
    """At the last settled instant with truth; instants of one mission are correlated, missions are not."""
    return float(run.nees[-1]) if run.nees.size and not np.isnan(run.nees[-1]) else None


def _inside_share(run: VehicleRun) -> float | None:
    """Share of the instants with a NEES up to the 95 % quantile of χ² with two degrees of freedom."""
    defined = run.nees[~np.isnan(run.nees)]
    return float((defined <= CHI2_95_2D).mean()) if defined.size else None


NEES_SAMPLES = {
    "final_nees": Metric(
        "1", "NEES of the position at the end; χ² with two degrees of freedom is ideal", _final_nees,
        in_summary=False,
    ),
    "inside_share": Metric(
        "1", "share of instants with truth inside the 95 % ellipse; 0.95 is ideal", _inside_share,
        in_summary=False,
        pooled=(
            Pooled(
                "inside_share",
                pooling.mean_by_weight("nees_instants"),
                "mean over all instants, runs and vehicles; 0.95 is ideal",
            ),
        ),
    ),
}  # fmt: skip
"""Metrics by key."""
