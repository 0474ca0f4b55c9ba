"""Fixes whose covariance nobody stated: zeros, which ROS defines as "unknown" and no receiver means as exact."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError

if TYPE_CHECKING:
    from uwcoop.missionlog.model import MissionLog

FIX_SIGMA_M = 5.0
"""Per axis, of a fix without a covariance: a single-frequency GPS receiver's."""


def with_stated_fixes(log: MissionLog, sigma_m: float = FIX_SIGMA_M) -> MissionLog:
    """The log with a standard deviation for fixes of covariance 0, and a note with their count; else the log itself.

    Raises:
        LogError: a sigma that is not above 0.
    """
    if isinstance(sigma_m, bool) or not isinstance(sigma_m, int | float) or not 0 < sigma_m < np.inf:
        raise LogError(f"log.fix_sigma_m is {sigma_m!r}: must be a number above 0")
    table = log.events.get("fix")
    if table is None:
        return log
    unknown = (table["cov_ee_m2"] == 0) & (table["cov_nn_m2"] == 0)
    if not unknown.any():
        return log
    variance = {name: np.where(unknown, sigma_m**2, table[name]) for name in ("cov_ee_m2", "cov_nn_m2")}
    note = (
        f"{unknown.sum():,} of {unknown.size:,} fixes have covariance 0, which means unknown: taken as sigma "
        f"{sigma_m:g} m per axis (log.fix_sigma_m)"
    )
    events = {**log.events, "fix": {**table, **variance}}
    return replace(log, events=events, notes=(*log.notes, note))
