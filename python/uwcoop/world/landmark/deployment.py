"""The start of a mission with a landmark: the fix and the heading that each vehicle is given."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.frames import wrap_angle
from uwcoop.missionlog.model import Columns, event_columns
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from uwcoop.scenario.models import Scenario
    from uwcoop.world.landmark.hovering import HoverMotion

__all__ = ["priors"]

FRAME_SIGMA_M = 1e-3
FRAME_SIGMA_RAD = 1e-4
"""Of the first landmark's pose, which defines the frame: almost certain, but never singular."""


def priors(scenario: Scenario, seed: int, landmark: int, motion: list[HoverMotion]) -> dict[str, Columns]:
    """Fix and heading of every vehicle at the start: of the first landmark by definition, of the others drawn."""
    deployment, count = scenario.deployment, len(motion)
    sigma_m = np.full(count, deployment.position_sigma_m)
    sigma_rad = np.full(count, math.radians(deployment.heading_sigma_deg))
    draws = np.array([stream(seed, v, Purpose.DEPLOYMENT).standard_normal(3) for v in range(count)])
    sigma_m[landmark], sigma_rad[landmark], draws[landmark] = FRAME_SIGMA_M, FRAME_SIGMA_RAD, 0.0
    position = np.array([m.position_m[0] for m in motion]) + sigma_m[:, None] * draws[:, :2]
    yaw = np.array([m.yaw_rad[0] for m in motion]) + sigma_rad * draws[:, 2]
    start, who = np.zeros(count, dtype=np.int64), np.arange(count)
    return {
        "fix": event_columns(
            "fix", start, who, e_m=position[:, 0], n_m=position[:, 1],
            cov_ee_m2=sigma_m**2, cov_en_m2=np.zeros(count), cov_nn_m2=sigma_m**2,
        ),
        "heading": event_columns("heading", start, who, yaw_rad=wrap_angle(yaw), sigma_rad=sigma_rad),
    }  # fmt: skip
