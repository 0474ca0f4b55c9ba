"""Heading and velocity against course over ground: wrong frames, signs and units show themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.importers.mapping.series import interpolated

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from uwcoop.missionlog.model import Columns

    Floats = NDArray[np.float64]

__all__ = ["course_lines"]

_LEAST_WAY_M = 15.0
_FAR_DEG, _NEAR_DEG = 25.0, 12.0
_LONGEST_GAP_S = 15.0


def course_lines(name: str, events: Mapping[str, Columns]) -> list[str]:
    """What the fixes of one vehicle say of its heading and velocity; nothing where they agree or cannot tell.

    Dead reckoning from fix to fix is laid over the way between them, as it is and under the mistakes that people make:
    NED taken as ENU, left for right, angles turned the other way round.

    Args:
        name: the vehicle's.
        events: its tables `heading`, and `fix`, `usbl` or `odometry`, and `ground_velocity`, `water_velocity` or none.
    """
    places = events.get("fix")
    if places is None or len(places["t_ns"]) < 2:
        places = events.get("usbl")
    heading, body = events.get("heading"), events.get("ground_velocity") or events.get("water_velocity")
    if places is None or heading is None or len(places["t_ns"]) < 2 or len(heading["t_ns"]) < 2:
        return []
    t_ns, at = _apart(places["t_ns"], np.column_stack([places["e_m"], places["n_m"]]))
    if len(t_ns) < 2:
        return []
    ways = np.diff(at, axis=0)
    tried = {
        "": (1.0, 0.0, 1.0), 'frame = "ned"': (-1.0, np.pi / 2, 1.0), "the other sense of turning": (-1.0, 0.0, 1.0),
        "left for right": (1.0, 0.0, -1.0),
    }  # fmt: skip
    results = {}
    for label, (sign, turn, left) in tried.items():
        reckoned = _reckoned(t_ns, heading, body, sign, turn, left)
        known = np.isfinite(reckoned).all(axis=1)
        if not known.any():
            return []
        results[label] = _angle_deg(reckoned[known], ways[known])
    off, spread = results[""]
    if abs(off) < _FAR_DEG and spread < _FAR_DEG:
        return []
    better = [
        label
        for label, (angle, rest) in results.items()
        if label and abs(angle) < _NEAR_DEG and rest < _NEAR_DEG
    ]
    text = f"CHECK {name}: heading and course over ground differ by {off:+.0f} deg (scatter {spread:.0f} deg)"
    if better:
        return [
            f"{text}; they agree with {better[0]} in its place: [vehicles.heading] or the velocity's frame is wrong"
        ]
    return [f"{text}: frame, sign, unit, mounting_deg or columns of heading or velocity may be wrong"]


def _apart(t_ns: NDArray[np.int64], at: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Places that lie a way apart, each against the one before it."""
    kept = [0]
    for k in range(1, len(t_ns)):
        if np.hypot(*(at[k] - at[kept[-1]])) >= _LEAST_WAY_M:
            kept.append(k)
    return t_ns[kept], at[kept]


def _reckoned(
    t_ns: NDArray[np.int64], heading: Columns, body: Columns | None, sign: float, turn: float, left: float
) -> Floats:
    """(N - 1, 2) ways by heading and velocity between instants; NaN where neither was heard for long."""
    grid = np.unique(np.concatenate([t_ns, np.arange(t_ns[0], t_ns[-1], 10**9)]))
    yaw = sign * interpolated(grid, heading["t_ns"], np.unwrap(heading["yaw_rad"])) + turn
    x, y = np.ones(len(grid)), np.zeros(len(grid))
    if body is not None and len(body["t_ns"]) > 1:
        x = interpolated(grid, body["t_ns"], body["forward_mps"])
        y = left * interpolated(grid, body["t_ns"], body["left_mps"])
    seconds = np.diff(grid, append=grid[-1]) / 1e9
    steps = (
        np.column_stack([x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) + y * np.cos(yaw)])
        * seconds[:, None]
    )
    sums = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])[np.searchsorted(grid, t_ns)]
    ways = np.diff(sums, axis=0)
    gaps = np.diff(heading["t_ns"])
    for begin in np.flatnonzero(gaps > _LONGEST_GAP_S * 1e9):
        inside = (t_ns[:-1] < heading["t_ns"][begin + 1]) & (t_ns[1:] > heading["t_ns"][begin])
        ways[inside] = np.nan
    outside = (t_ns[:-1] < heading["t_ns"][0] - _LONGEST_GAP_S * 1e9) | (
        t_ns[1:] > heading["t_ns"][-1] + _LONGEST_GAP_S * 1e9
    )
    ways[outside] = np.nan
    return ways


def _angle_deg(reckoned: Floats, ways: Floats) -> tuple[float, float]:
    """Mean angle from the way by fixes to the one reckoned, and the scatter about it, degrees; longer ways count more."""
    ratio = (reckoned[:, 0] + 1j * reckoned[:, 1]) * np.conj(ways[:, 0] + 1j * ways[:, 1])
    weight = np.abs(ratio)
    mean = np.angle(ratio.sum())
    rest = np.angle(ratio * np.exp(-1j * mean))
    return float(np.rad2deg(mean)), float(
        np.rad2deg(np.sqrt((weight * rest**2).sum() / max(weight.sum(), 1e-12)))
    )
