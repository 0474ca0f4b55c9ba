"""Hovering vehicles: surge, sway, heave and yaw in steps, turns on the spot, landing and lifting off.

Within a step of the world a vehicle has one velocity in the body frame of the step's start and one yaw rate, so
that x' = x + R(yaw) v dt and yaw' = yaw + w dt (Matsuda et al. 2017, (5) and (7)) are exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.frames import turned, wrap_angle, yaw_from_heading
from uwcoop.world.vehicles import Motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.scenario.landmark import Hover, Kidnap

    Array = NDArray[np.float64]

LEAST_WAY_M = 1e-6
"""Points nearer than this are where the vehicle is already."""
TOUCH_DOWN_S = 1.0
"""How long it shifts and turns a vehicle."""


@dataclass(frozen=True)
class HoverMotion(Motion):
    """What one hovering vehicle truly did at the steps 0..N of the world; it commands nothing by compass."""

    rate_hz: int = 1
    """Steps for each second."""
    turned_rad: Array | None = None
    """(N + 1,) yaw as a perfect gyro sums it up: what nothing measures is not in it."""
    travelled_m: Array | None = None
    """(N + 1, 2) what a perfect DVL sums up in the world frame."""

    @property
    def end_s(self) -> float:
        """Last instant."""
        return float((len(self.yaw_rad) - 1) / self.rate_hz)

    @property
    def times_s(self) -> Array:
        """Instants of the columns, seconds."""
        return np.arange(len(self.yaw_rad)) / self.rate_hz

    def yaw_at(self, t_s: Array) -> Array:
        """True yaw at any times within the mission, (K,)."""
        k, share = self._between(t_s)
        assert self.turned_rad is not None
        return np.asarray(self.yaw_rad[k] + share * (self.turned_rad[k + 1] - self.turned_rad[k]))

    def yaw_on(self, t_s: Array) -> Array:
        """True yaw that a sensor finds at these times, (K,)."""
        return self.yaw_at(t_s)

    def believed_yaw_on(self, t_s: Array) -> Array:
        """A compass, if there is one, has no bias: the true yaw."""
        return self.yaw_at(t_s)

    def turn_rates(self, t_s: Array, rate_hz: float) -> tuple[Array, Array]:
        """What an ideal gyro says at sampling times (K,): when, and mean yaw rate until the next one, rad/s."""
        assert self.turned_rad is not None
        return t_s[:-1], np.diff(self._summed(self.turned_rad, t_s)) * rate_hz

    def body_velocities(self, t_s: Array, mounting_rad: float) -> tuple[Array, Array]:
        """What a DVL without noise says at sampling times (K,): when, and mean velocity until the next one, (K, 2)."""
        assert self.travelled_m is not None
        moved = np.diff(self._summed(self.travelled_m, t_s), axis=0)
        velocity = moved / np.diff(t_s)[:, None]
        return t_s[:-1], turned(velocity, mounting_rad - self.yaw_at(t_s[:-1]))

    def _summed(self, sums: Array, t_s: Array) -> Array:
        k, share = self._between(t_s)
        share = share.reshape(-1, *(1,) * (sums.ndim - 1))
        return np.asarray(sums[k] + share * (sums[k + 1] - sums[k]))

    def _between(self, t_s: Array) -> tuple[NDArray[np.int64], Array]:
        # A step's own instant must fall into it, whatever rounding does to t · rate.
        at = np.clip(t_s, 0.0, self.end_s) * self.rate_hz
        at = np.where(np.abs(at - np.round(at)) < 1e-9, np.round(at), at)
        k = np.minimum(at.astype(np.int64), len(self.yaw_rad) - 2)
        return k, at - k


class Course:
    """The course of one vehicle while it is made: stretches of constant body velocity and yaw rate, one after another.

    A leg is planned from where the vehicle is and carried out blindly: what turns or shifts it on the way turns
    or shifts the rest of the leg.
    """

    def __init__(self, hover: Hover, position_m: tuple[float, float], yaw_rad: float, depth_m: float) -> None:
        self.hover = hover
        self._dt_s = 1.0 / hover.rate_hz
        self.steps = 0
        # After each step: east, north, depth, yaw, yaw by the gyro, east and north by the DVL.
        self._now = np.array([*position_m, depth_m, yaw_rad, yaw_rad, 0.0, 0.0])
        self._states = [self._now[None]]
        self._believed = self.pose()
        self._jump: tuple[int, float, tuple[float, float]] | None = None

    def pose(self) -> tuple[Array, float]:
        """Where the vehicle truly is and points at the end of the course so far."""
        return self._now[:2].copy(), float(self._now[3])

    def kidnap(self, kidnap: Kidnap) -> None:
        """Turn and shift the vehicle at the kidnap's time, which has not come yet."""
        step = round(kidnap.time_s * self.hover.rate_hz)
        self._jump = (step, math.radians(kidnap.yaw_step_deg), kidnap.shift_m)

    def spare(self) -> None:
        """Take the kidnapping back: it happens to another vehicle."""
        self._jump = None

    def rest(self, until_step: int) -> None:
        """Stay as it is until a step."""
        self._add(until_step - self.steps, (0.0, 0.0, 0.0, 0.0))

    def lift_off(self) -> None:
        """Rise to the altitude of the survey."""
        self._heave(-self.hover.altitude_m)
        self._believed = self.pose()

    def land(self, rng: np.random.Generator) -> None:
        """Sink to the seabed; touching down shifts and turns the vehicle a little."""
        self._heave(self.hover.altitude_m)
        steps = max(1, round(TOUCH_DOWN_S * self.hover.rate_hz))
        each = 1.0 / (steps * self._dt_s)
        shift = self.hover.landing_shift_sigma_m * each
        turn = math.radians(self.hover.landing_turn_sigma_deg) * each
        forward, left, about = rng.standard_normal(3).tolist()
        self._add(steps, (forward * shift, left * shift, 0.0, about * turn), bottom=False)

    def follow(
        self, points_m: Sequence[tuple[float, float]], speed_mps: float, until_step: int
    ) -> float | None:
        """Go straight from point to point, turning on the spot unless the heading is held.

        Args:
            points_m: where to, from the believed position on.
            speed_mps: over ground.
            until_step: stop there at the latest.

        Returns:
            None if the last point was reached, otherwise the distance covered, metres.
        """
        covered = 0.0
        for point in points_m:
            position, yaw = self._believed
            way = np.array(point) - position
            length = float(np.hypot(*way))
            if length < LEAST_WAY_M:
                continue
            along = math.atan2(way[1], way[0])
            held = self.hover.hold_heading_deg
            bow = along if held is None else float(yaw_from_heading(held))
            self._turn(float(wrap_angle(bow - yaw)), until_step)
            steps = math.ceil(length / speed_mps * self.hover.rate_hz - 1e-9)
            speed = length / (steps * self._dt_s)
            done = max(0, min(steps, until_step - self.steps))
            self._add(done, (speed * math.cos(along - bow), speed * math.sin(along - bow), 0.0, 0.0))
            moved = speed * done * self._dt_s
            covered += moved
            self._believed = (position + moved * np.array([math.cos(along), math.sin(along)]), bow)
            if done < steps:
                return covered
        return None

    def motion(self, steps: int) -> HoverMotion:
        """The course as it truly was, cut or drawn out by rest to so many steps of the world."""
        states = np.concatenate(self._states)
        if len(states) <= steps:
            states = np.concatenate([states, self._stretch(steps + 1 - len(states), (0.0, 0.0, 0.0, 0.0))])
        states = states[: steps + 1]
        yaw, zero = np.asarray(wrap_angle(states[:, 3])), np.zeros((steps + 1, 2))
        return HoverMotion(
            position_m=states[:, :2], depth_m=states[:, 2], yaw_rad=yaw, current_mps=zero, believed_yaw_rad=yaw,
            command_mps=zero, rate_hz=self.hover.rate_hz, turned_rad=states[:, 4], travelled_m=states[:, 5:7],
        )  # fmt: skip

    def _turn(self, angle_rad: float, until_step: int) -> None:
        steps = math.ceil(
            abs(angle_rad) / math.radians(self.hover.yaw_rate_degps) * self.hover.rate_hz - 1e-9
        )
        if steps > 0:
            rate = angle_rad / (steps * self._dt_s)
            self._add(min(steps, until_step - self.steps), (0.0, 0.0, 0.0, rate))

    def _heave(self, down_m: float) -> None:
        steps = max(1, math.ceil(abs(down_m) / self.hover.heave_mps * self.hover.rate_hz - 1e-9))
        self._add(steps, (0.0, 0.0, down_m / (steps * self._dt_s), 0.0))

    def _add(self, steps: int, moving: tuple[float, float, float, float], bottom: bool = True) -> None:
        """A stretch: steps and (forward, left, down m/s, yaw rate rad/s); whether the DVL sees the bottom."""
        if steps > 0:
            self._states.append(self._stretch(steps, moving, bottom))
            self._now = self._states[-1][-1]
            self.steps += steps

    def _stretch(self, steps: int, moving: tuple[float, float, float, float], bottom: bool = True) -> Array:
        """States after each of so many further steps, (steps, 7)."""
        forward, left, down, rate = (np.float64(value) * self._dt_s for value in moving)
        count = np.arange(1, steps + 1)
        jumped = np.zeros((steps + 1, 3))
        if self._jump is not None and self.steps < self._jump[0] <= self.steps + steps:
            step, turn, shift = self._jump
            jumped[step - self.steps :] = turn, *shift
        yaw = self._now[3] + rate * np.arange(steps + 1) + jumped[:, 0]
        moves = np.cumsum(turned(np.tile([forward, left], (steps, 1)), yaw[:-1]), axis=0)
        return np.column_stack(
            [
                self._now[:2] + moves + jumped[1:, 1:],
                self._now[2] + down * count,
                yaw[1:],
                self._now[4] + rate * count,
                self._now[5:7] + moves * bottom,
            ]
        )
