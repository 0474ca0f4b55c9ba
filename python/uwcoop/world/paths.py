"""Planned paths: lawn mowers, waypoints, and the pure pursuit that follows them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import ScenarioError
from uwcoop.frames import yaw_from_heading
from uwcoop.scenario.vehicle import Lawnmower, RandomLawnmower, Waypoints

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.scenario.vehicle import Vehicle

    Points = NDArray[np.float64]

SAMPLE_M = 4.0
"""Distance at which a random path is checked against the chart."""
ATTEMPTS = 3000
"""Random paths tried before a chart is refused as too small for one."""
SHARP_COSINE = -0.5
"""Turns beyond 120 degrees are driven to the corner itself, not cut."""

ARRIVED_M = 1.0
"""This close to a sharp corner it counts as reached."""


def waypoints_of(
    path: RandomLawnmower | Lawnmower | Waypoints,
    vehicle: Vehicle,
    chart: Chart | None,
    length_m: float,
    rng: np.random.Generator,
) -> Points:
    """Corners of a planned path, (N, 2) east and north in metres.

    Args:
        path: what was asked for.
        vehicle: for its depth and name.
        chart: which a random path must stay inside of; the others need none.
        length_m: how long a random path has to be, if the chart has room.
        rng: draws a random path.

    Raises:
        ScenarioError: a random path without a chart, or a chart that has no room for it.
    """
    if isinstance(path, Waypoints | Lawnmower):
        return fixed_corners(path)
    if chart is None:
        raise ScenarioError(
            f"vehicle {vehicle.name}: a random lawn mower is laid on a chart, and the scenario has none: "
            "give a [chart], or vehicles.path of another kind"
        )
    return _random_lawnmower(path, vehicle, chart, length_m, rng)


def fixed_corners(path: Lawnmower | Waypoints) -> Points:
    """Corners of a path in local metres, (N, 2) east and north; degrees are `places.placed` before."""
    if isinstance(path, Waypoints):
        assert path.waypoints_m is not None
        return np.array(path.waypoints_m)
    assert path.start_m is not None
    yaw = float(yaw_from_heading(path.heading_deg))
    return lawnmower(path.start_m, yaw, path.leg_m, path.spacing_m, path.legs)


def lawnmower(
    start: tuple[float, float], yaw_rad: float, leg_m: float, spacing_m: float, legs: int
) -> Points:
    """Corners of alternating legs, (2 legs, 2); each to the right of the last, seen along the first."""
    leg = np.arange(2 * legs) // 2
    along = leg_m * ((np.arange(2 * legs) + 1) // 2 % 2)
    across = -spacing_m * leg
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.column_stack(
        [start[0] + along * cosine - across * sine, start[1] + along * sine + across * cosine]
    )


def _random_lawnmower(
    path: RandomLawnmower, vehicle: Vehicle, chart: Chart, length_m: float, rng: np.random.Generator
) -> Points:
    """The first random lawn mower that fits; they shrink as tries fail, to give small charts a chance."""
    west, south, east, north = chart.extent
    margin = path.margin_m
    for attempt in range(ATTEMPTS):
        shrink = 0.9 ** (attempt // (ATTEMPTS // 20))
        leg = shrink * rng.uniform(*path.leg_m)
        spacing = shrink * rng.uniform(*path.spacing_m)
        corner = rng.uniform((west, south), (east, north))
        yaw = rng.uniform(-math.pi, math.pi)
        side = -1 if rng.random() < 0.5 else 1
        # As many legs as the mission needs; where the chart has no room for them, the path is retraced.
        room = 0.6 * min(east - west, north - south)
        legs = min(math.ceil(length_m / (leg + spacing)) + 1, max(2, int(room / spacing)))
        corners = lawnmower((corner[0], corner[1]), yaw, leg, side * spacing, legs)
        inside = (corners >= (west + margin, south + margin)) & (corners <= (east - margin, north - margin))
        if inside.all() and _over_water(corners, chart, vehicle.depth_m + path.clearance_m):
            return corners
    raise ScenarioError(
        f"vehicle {vehicle.name}: no random lawn mower fits the chart {chart.name!r} "
        f"({east - west:.0f} x {north - south:.0f} m, {100 * chart.hole_share:.0f} % holes) with a margin of "
        f"{margin:g} m and {vehicle.depth_m + path.clearance_m:g} m of water in {ATTEMPTS} tries: "
        "give smaller vehicles.path.leg_m and spacing_m, or waypoints"
    )


def _over_water(corners: Points, chart: Chart, depth_m: float) -> bool:
    depths = chart.depth_at(sampled(corners, SAMPLE_M))
    return bool(np.all(depths >= depth_m))  # NaN (a hole) compares false


def sampled(corners: Points, step_m: float) -> Points:
    """Points along a polyline, at most about `step_m` apart, (M, 2)."""
    lengths = np.hypot(*np.diff(corners, axis=0).T)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    s = np.linspace(0.0, at[-1], max(2, math.ceil(at[-1] / step_m)))
    return np.column_stack([np.interp(s, at, corners[:, 0]), np.interp(s, at, corners[:, 1])])


class Pursuit:
    """Pure pursuit on the true position: steers at the point `look_ahead_m` further along the path.

    At its end the path is retraced, back and forth.
    """

    def __init__(self, corners: Points, look_ahead_m: float) -> None:
        self._look_ahead = look_ahead_m
        self._corners: list[tuple[float, float]] = [(float(e), float(n)) for e, n in corners]
        self._at = 0  # index of the segment's first corner
        self._step = 1  # +1 outward, -1 on the way back
        self._directions: dict[tuple[int, int], tuple[float, float, float]] = {}

    def yaw(self, east: float, north: float) -> float:
        """Where to steer from a position in metres: yaw, radians, counter-clockwise from east."""
        for _ in self._corners:  # bounded: a path of legs shorter than a step would turn for ever
            along, length, aside = self._project(self._at, self._step, east, north)
            turned_at, turned_step = self._following()
            next_along, _, next_aside = self._project(turned_at, turned_step, east, north)
            sharp = self._sharp(turned_at, turned_step)
            passed = along >= length - (ARRIVED_M if sharp else 0.0)
            if not passed and (sharp or next_aside >= aside or next_along == 0):
                break
            self._at, self._step = turned_at, turned_step
        ahead = along + self._look_ahead
        if ahead <= length or sharp:
            target = self._point(self._at, self._step, min(ahead, length))
        else:
            target = self._point(turned_at, turned_step, ahead - length)
        return math.atan2(target[1] - north, target[0] - east)

    def _following(self) -> tuple[int, int]:
        at = self._at + self._step
        turns_back = not 0 <= at + self._step < len(self._corners)
        return at, -self._step if turns_back else self._step

    def _direction(self, at: int, step: int) -> tuple[float, float, float]:
        """Unit vector and length of a segment, worked out once."""
        known = self._directions.get((at, step))
        if known is None:
            (e0, n0), (e1, n1) = self._corners[at], self._corners[at + step]
            length = math.hypot(e1 - e0, n1 - n0)
            known = self._directions[at, step] = (e1 - e0) / length, (n1 - n0) / length, length
        return known

    def _project(self, at: int, step: int, east: float, north: float) -> tuple[float, float, float]:
        """Distance along a segment (from 0 on), the segment's length, and the distance from it."""
        de, dn, length = self._direction(at, step)
        e, n = east - self._corners[at][0], north - self._corners[at][1]
        along = max(e * de + n * dn, 0.0)
        clipped = min(along, length)
        return along, length, math.hypot(e - clipped * de, n - clipped * dn)

    def _point(self, at: int, step: int, along: float) -> tuple[float, float]:
        de, dn, length = self._direction(at, step)
        along = min(along, length)
        return self._corners[at][0] + along * de, self._corners[at][1] + along * dn

    def _sharp(self, next_at: int, next_step: int) -> bool:
        e0, n0, _ = self._direction(self._at, self._step)
        e1, n1, _ = self._direction(next_at, next_step)
        return e0 * e1 + n0 * n1 < SHARP_COSINE
