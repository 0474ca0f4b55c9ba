"""Vehicles: kinematics, current, waves, compass and thruster errors -> what truly happened, what was commanded.

The world moves in steps of one second. Between whole seconds a vehicle moves in a straight line at constant
speed and holds its yaw, so that its position at any instant is exact. Conventions: yaw counter-clockwise from
east; a compass errs clockwise, true heading = believed heading + bias, hence yaw_true = yaw_believed - bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.frames import turned, wrap_angle, yaw_from_heading
from uwcoop.scenario.vehicle import Adrift, AreaShare
from uwcoop.scenario.world import ConstantCurrent, NoCurrent
from uwcoop.world.paths import Pursuit, waypoints_of
from uwcoop.world.random_streams import TEAM, Purpose, stream
from uwcoop.world.tracks import Record, read_tracks

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.scenario.models import Scenario
    from uwcoop.scenario.vehicle import Drift, Vehicle
    from uwcoop.scenario.world import Current, Waves

    Array = NDArray[np.float64]

STILL_MPS = 1e-3
"""Below this speed through the water a recorded track does not tell the yaw: the last one is kept."""


@dataclass(frozen=True)
class Motion:
    """What one vehicle truly did at the seconds 0..T, and what it commanded."""

    position_m: Array
    """(T + 1, 2) east and north."""
    depth_m: Array
    """(T + 1,) own depth below the surface."""
    yaw_rad: Array
    """(T + 1,) held from each second to the next, counter-clockwise from east."""
    current_mps: Array
    """(T + 1, 2) drift from each second to the next: velocity that the command does not know of. The water's
    current (unless the command is over ground) and the vehicle's own velocity bias; waves and white noise are
    not in it."""
    believed_yaw_rad: Array
    """(T + 1,) what the compass showed."""
    command_mps: Array
    """(T + 1, 2) commanded velocity in the world, by the compass's yaw."""
    soundings_m: Array | None = None
    """(T + 1,) recorded water depths, NaN where there is none; None without a record."""

    @property
    def end_s(self) -> float:
        """Last second."""
        return float(len(self.yaw_rad) - 1)

    def position_at(self, t_s: Array) -> Array:
        """True east and north at any times within the mission, (K, 2)."""
        k, share = self._between(t_s)
        return self.position_m[k] + share[:, None] * (self.position_m[k + 1] - self.position_m[k])

    def depth_at(self, t_s: Array) -> Array:
        """True own depth at any times within the mission, (K,)."""
        k, share = self._between(t_s)
        return self.depth_m[k] + share * (self.depth_m[k + 1] - self.depth_m[k])

    def yaw_at(self, t_s: Array) -> Array:
        """True yaw at any times within the mission, (K,)."""
        return self.yaw_rad[self._between(t_s)[0]]

    @property
    def times_s(self) -> Array:
        """Instants of the columns, seconds."""
        return np.arange(len(self.yaw_rad), dtype=np.float64)

    def yaw_on(self, t_s: Array) -> Array:
        """True yaw that a sensor finds at these times, (K,)."""
        return self.yaw_rad[t_s.astype(np.int64)]

    def believed_yaw_on(self, t_s: Array) -> Array:
        """Yaw that the compass shows at these times, (K,)."""
        return self.believed_yaw_rad[t_s.astype(np.int64)]

    def turn_rates(self, t_s: Array, rate_hz: float) -> tuple[Array, Array]:
        """What an ideal gyro says at sampling times (K,): when, and mean yaw rate since the last one, rad/s."""
        return t_s[1:], wrap_angle(np.diff(self.yaw_on(t_s))) * rate_hz

    def body_velocities(self, t_s: Array, mounting_rad: float) -> tuple[Array, Array]:
        """What a DVL without noise says at sampling times (K,): when, and velocity of the second in progress, (K, 2).

        A mounting turned clockwise by `mounting_rad` sees the velocity turned counter-clockwise.
        """
        velocity = np.diff(self.position_m, axis=0)
        second = np.minimum(t_s.astype(np.int64), len(velocity) - 1)
        return t_s, turned(velocity[second], mounting_rad - self.yaw_on(t_s))

    def _between(self, t_s: Array) -> tuple[NDArray[np.int64], Array]:
        inside = np.clip(t_s, 0.0, self.end_s)
        k = np.minimum(inside.astype(np.int64), len(self.yaw_rad) - 2)
        return k, inside - k


def team_motion(
    scenario: Scenario, chart: Chart | None, seed: int, records: Mapping[str, Record] | None = None
) -> list[Motion]:
    """The motion of every vehicle of a scenario.

    Args:
        scenario: its places in local metres.
        chart: what vehicles sound.
        seed: of the mission.
        records: of the vehicles with a recorded track, by name; None: read them.

    Raises:
        ScenarioError: a random path finds no room, a recorded track cannot be used.
    """
    steps = round(scenario.duration_s)
    current = current_of(scenario.current, steps, seed)
    if records is None:
        records = read_tracks(scenario.team, chart, None, steps)
    moved = []
    for index, vehicle in enumerate(scenario.team):
        errors = _Errors.drawn(vehicle.drift or scenario.drift, steps, seed, index)
        if vehicle.track is not None:
            moved.append(_follow_record(records[vehicle.name], errors, current))
        elif isinstance(vehicle.path, Adrift):
            rng = stream(seed, index, Purpose.PATH)
            moved.append(_float_about(vehicle.path, vehicle.depth_m, errors, steps, rng))
        else:
            planned = _follow_path(vehicle, chart, errors, current, stream(seed, index, Purpose.PATH))
            moved.append(_washed(planned, scenario.waves, stream(seed, index, Purpose.WAVES)))
    return moved


def current_of(current: Current, steps: int, seed: int) -> Array:
    """Velocity of the water from each second to the next, (steps + 1, 2), common to the team, m/s."""
    rng = stream(seed, TEAM, Purpose.CURRENT)
    if isinstance(current, NoCurrent):
        return np.zeros((steps + 1, 2))
    if isinstance(current, ConstantCurrent):
        if current.velocity_mps is not None:
            return np.tile(np.array(current.velocity_mps), (steps + 1, 1))
        random_yaw = rng.uniform(-math.pi, math.pi)
        yaw = random_yaw if current.direction_deg is None else float(yaw_from_heading(current.direction_deg))
        speed = current.speed_mps or 0.0
        return np.tile([speed * math.cos(yaw), speed * math.sin(yaw)], (steps + 1, 1))
    start = np.array(current.initial_mps) + current.initial_sigma_mps * rng.standard_normal(2)
    walk = current.walk_mps_per_sqrt_s * rng.standard_normal((steps, 2))
    return np.vstack([start, start + np.cumsum(walk, axis=0)])


@dataclass(frozen=True)
class _Errors:
    """One vehicle's errors in one mission, from each second to the next."""

    heading: Array  # clockwise, radians: compass bias and noise
    thrust: Array  # m/s: thrust bias and noise
    velocity: Array  # (T + 1, 2) m/s: white noise on each axis
    bias: Array  # (T + 1, 2) m/s: the vehicle's own slow drift
    ground_referenced: bool

    @classmethod
    def drawn(cls, drift: Drift, steps: int, seed: int, vehicle: int) -> _Errors:
        compass = stream(seed, vehicle, Purpose.COMPASS).standard_normal(steps + 2)
        thrust = stream(seed, vehicle, Purpose.THRUSTER).standard_normal(steps + 2)
        white = stream(seed, vehicle, Purpose.VELOCITY_NOISE).standard_normal((steps + 1, 2))
        walk = stream(seed, vehicle, Purpose.VELOCITY_BIAS).standard_normal((steps + 1, 2))
        walk[0] *= drift.velocity_bias_sigma_mps
        walk[1:] *= drift.velocity_bias_walk_mps_per_sqrt_s
        heading_deg = drift.compass_bias_deg + drift.compass_bias_sigma_deg * compass[0]
        return cls(
            heading=np.deg2rad(heading_deg + drift.compass_noise_deg * compass[1:]),
            thrust=drift.thrust_bias_mps
            + drift.thrust_bias_sigma_mps * thrust[0]
            + drift.thrust_noise_mps * thrust[1:],
            # In steps of one second a white velocity of x m/sqrt(s) is x m/s for each step.
            velocity=drift.velocity_noise_m_per_sqrt_s * white,
            bias=np.cumsum(walk, axis=0),
            ground_referenced=drift.ground_referenced,
        )


def _follow_path(
    vehicle: Vehicle, chart: Chart | None, errors: _Errors, current: Array, rng: np.random.Generator
) -> Motion:
    """Steer along the planned path by the true position: the path is driven, whatever the compass says."""
    steps = len(current) - 1
    assert vehicle.path is not None
    assert not isinstance(vehicle.path, Adrift | AreaShare)
    corners = waypoints_of(vehicle.path, vehicle, chart, vehicle.speed_mps * steps, rng)
    pursuit = Pursuit(corners, vehicle.look_ahead_m)
    push = current + errors.velocity + errors.bias
    speed = vehicle.speed_mps + errors.thrust
    position = np.empty((steps + 1, 2))
    yaw = np.empty(steps + 1)
    east, north = float(corners[0, 0]), float(corners[0, 1])
    for k, (speed_k, push_e, push_n) in enumerate(zip(speed.tolist(), *push.T.tolist(), strict=True)):
        heading = pursuit.yaw(east, north)
        position[k] = east, north
        yaw[k] = heading
        east += speed_k * math.cos(heading) + push_e
        north += speed_k * math.sin(heading) + push_n
    depth = np.full(steps + 1, vehicle.depth_m)
    if errors.ground_referenced:
        through_water = speed[:, None] * _direction(yaw)
        return _commanded_over(through_water + push, position, depth, errors, current, yaw)
    believed = yaw + errors.heading
    return Motion(
        position, depth, yaw, current + errors.bias, believed, vehicle.speed_mps * _direction(believed)
    )


def _float_about(
    path: Adrift, depth_m: float, errors: _Errors, steps: int, rng: np.random.Generator
) -> Motion:
    """Brownian motion bound to its start: v' = a - v / T - k (x - start), a white; nothing is commanded."""
    damping = 1.0 / path.velocity_time_s
    sigma = math.sqrt(path.push_m2ps3 / (2 * damping))
    stiffness = (sigma / path.spread_m) ** 2
    assert path.start_m is not None
    start = np.array(path.start_m)
    velocity = np.empty((steps + 1, 2))
    position = np.empty((steps + 1, 2))
    v, x = sigma * rng.standard_normal(2), start.copy()
    pushes = math.sqrt(path.push_m2ps3) * rng.standard_normal((steps + 1, 2))
    for k in range(steps + 1):
        position[k], velocity[k] = x, v
        x = x + v
        v = v - damping * v - stiffness * (x - start) + pushes[k]
    yaw = _held(np.arctan2(velocity[:, 1], velocity[:, 0]), np.hypot(*velocity.T) > STILL_MPS)
    depth = np.full(steps + 1, depth_m)
    return Motion(position, depth, yaw, velocity, yaw + errors.heading, np.zeros((steps + 1, 2)))


def _washed(planned: Motion, waves: Waves, rng: np.random.Generator) -> Motion:
    """The same motion to and fro about its track; yaw and command stay those of the plan."""
    phase = rng.uniform(0.0, 2 * math.pi)
    if waves.amplitude_m == 0:
        return planned
    t_s = np.arange(len(planned.yaw_rad), dtype=np.float64)
    swing = waves.amplitude_m * np.sin(2 * math.pi * t_s / waves.period_s + phase)
    if waves.direction_deg is None:
        axis = _direction(planned.yaw_rad + math.pi / 2)
    else:
        axis = _direction(np.full(t_s.size, float(yaw_from_heading(waves.direction_deg))))
    return replace(planned, position_m=planned.position_m + swing[:, None] * axis)


def _follow_record(record: Record, errors: _Errors, current: Array) -> Motion:
    """Take the record as truth and find the command that, with these errors, would have led there."""
    velocity = np.diff(record.position_m, axis=0)
    velocity = np.vstack([velocity, velocity[-1]])
    return _commanded_over(
        velocity, record.position_m, record.depth_m, errors, current, None, record.soundings_m
    )


def _commanded_over(
    velocity: Array, position: Array, depth: Array, errors: _Errors, current: Array,
    yaw: Array | None, soundings: Array | None = None,
) -> Motion:  # fmt: skip
    """The command whose errors give this velocity over ground: the inverse of what `_follow_path` integrates.

    Without a yaw the vehicle points where it moves through the water (over ground, for a ground-referenced
    command).
    """
    drift = errors.bias if errors.ground_referenced else current + errors.bias
    own = velocity - drift - errors.velocity
    true_speed = np.hypot(*own.T)
    course = _held(np.arctan2(own[:, 1], own[:, 0]), true_speed > STILL_MPS)
    believed_course = course + errors.heading
    command = (true_speed - errors.thrust)[:, None] * _direction(believed_course)
    yaw = course if yaw is None else yaw
    return Motion(position, depth, yaw, drift, yaw + errors.heading, command, soundings)


def _direction(yaw: Array) -> Array:
    return np.column_stack([np.cos(yaw), np.sin(yaw)])


def _held(values: Array, valid: NDArray[np.bool_]) -> Array:
    """Each value, or the last valid one before it (the first valid one at the start; 0 if there is none)."""
    if not valid.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(valid, np.arange(len(values)), -1))
    return values[np.where(last < 0, np.argmax(valid), last)]
