"""A hovering vehicle's path leg by leg: where the next one leads, by the rule that says where the vehicle lands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.frames import yaw_from_heading
from uwcoop.scenario.landmark import AfterDistance, OnSchedule
from uwcoop.scenario.vehicle import Lawnmower, Waypoints
from uwcoop.world.paths import fixed_corners

if TYPE_CHECKING:
    from uwcoop.scenario.landmark import AtWaypoints
    from uwcoop.scenario.vehicle import Vehicle

    Point = tuple[float, float]

ENDED_M = 1e-6
"""A rest of a path that is shorter is none."""


class Legs:
    """The path of one vehicle, and how much of it lies behind."""

    def __init__(self, vehicle: Vehicle, land: AtWaypoints | AfterDistance | OnSchedule) -> None:
        assert isinstance(vehicle.path, Lawnmower | Waypoints)
        corners = fixed_corners(vehicle.path)
        self._corners = corners
        self._at_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        self._land = land
        self._done_m = 0.0
        self._end_m = 0.0

    @property
    def start_m(self) -> Point:
        """First point of the path."""
        return float(self._corners[0, 0]), float(self._corners[0, 1])

    def first_yaw_rad(self, hold_heading_deg: float | None) -> float:
        """Yaw at the start: the heading that is held, or along the first segment."""
        if hold_heading_deg is not None:
            return float(yaw_from_heading(hold_heading_deg))
        de, dn = self._corners[1] - self._corners[0]
        return math.atan2(dn, de)

    def all_points(self) -> list[Point]:
        """Every corner after the first."""
        return [(float(e), float(n)) for e, n in self._corners[1:]]

    @property
    def ended(self) -> bool:
        """Nothing of the path is left."""
        return bool(self._done_m >= self._at_m[-1] - ENDED_M)

    def next_leg(self, now_s: float, *, first: bool) -> tuple[list[Point], float | None]:
        """Points of the next leg, and until when it may last, seconds (None: as long as it takes).

        Args:
            now_s: when it begins.
            first: whether it is the mission's first leg.
        """
        until_s = None
        self._end_m = float(self._at_m[-1])
        if isinstance(self._land, AfterDistance):
            distance = self._land.distance_m
            if first and self._land.first_distance_m is not None:
                distance = self._land.first_distance_m
            self._end_m = min(self._end_m, self._done_m + distance)
        elif isinstance(self._land, OnSchedule):
            until_s = next((t for t in self._land.times_s if t > now_s), None)
        else:
            self._end_m = float(self._at_m[np.searchsorted(self._at_m, self._done_m + ENDED_M)])
        between = (self._at_m > self._done_m + ENDED_M) & (self._at_m < self._end_m - ENDED_M)
        last = tuple(float(np.interp(self._end_m, self._at_m, axis)) for axis in self._corners.T)
        return [(float(e), float(n)) for e, n in self._corners[between]] + [(last[0], last[1])], until_s

    def covered(self, distance_m: float | None) -> None:
        """The leg was cut off after some distance; None: it was completed."""
        whole = self._end_m - self._done_m
        self._done_m += whole if distance_m is None else min(distance_m, whole)
