"""What tracks hold beside positions where navigators estimate yaw: true yaw, and the covariance of the whole pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

    Array = NDArray[np.float64]

POSE = ("east", "north", "yaw")
"""Axes of a pose: metres, metres, radians."""


def pose_variables(
    log: MissionLog, records: Sequence[dict[str, Any]], t_ns: NDArray[np.int64]
) -> dict[str, Any]:
    """`truth_yaw_rad (vehicle, time)` and `pose_covariance (navigator, vehicle, time, pose, pose_b)`.

    Nothing where no navigator estimates yaw. NaN for a navigator that does not, and where the truth is unknown.
    """
    if not any(np.isfinite(record["yaw_rad"]).any() for record in records):
        return {}
    covariance = np.stack([_pose_covariance(r["covariance_m2"], r["yaw_covariance"]) for r in records])
    note = {"long_name": "covariance of (east, north, yaw)", "units": "m2, m rad, rad2"}
    variables: dict[str, Any] = {
        "pose_covariance": (("navigator", "vehicle", "time", "pose", "pose_b"), covariance, note)
    }
    known = log.known_truth
    if known is not None and "yaw_rad" in known:
        truth = true_yaw_rad(known["time"].to_numpy(), known["yaw_rad"].to_numpy(), t_ns / 1e9)
        variables["truth_yaw_rad"] = (("vehicle", "time"), truth, {"units": "rad"})
    return variables


def true_yaw_rad(known_s: Array, yaw_rad: Array, t_s: Array) -> Array:
    """Yaw (V, K) between known ones (V, N), along the shorter arc; NaN outside of them."""
    out = np.empty((len(yaw_rad), len(t_s)))
    for v, yaw in enumerate(yaw_rad):
        between = np.interp(t_s, known_s, np.unwrap(yaw), left=np.nan, right=np.nan)
        out[v] = (between + np.pi) % (2 * np.pi) - np.pi
    return out


def _pose_covariance(position: Array, yaw: Array) -> Array:
    """From [ee, en, nn] and [yaw-east, yaw-north, yaw-yaw], (..., 3) each, to (..., 3, 3)."""
    rows = np.concatenate([position, yaw], axis=-1)
    return np.asarray(rows[..., [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(*rows.shape[:-1], 3, 3))
