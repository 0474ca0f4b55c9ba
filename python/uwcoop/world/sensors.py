"""Sensors: truth -> events. Each draws from streams of its own, so that one more sensor changes no other's
noise.

Where no seabed is known (no chart, off it, over a hole) the simulated altimeter gives no event: the world has no
depth to measure there, and making one up would feed a navigator a number that no chart, true or wrong, stands
behind. A recorded sounding is what an echo sounder really read, and is delivered wherever it was taken.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.frames import turned, wrap_angle
from uwcoop.missionlog.model import EVENT_COLUMNS, Columns
from uwcoop.world.landmark.hovering import HoverMotion
from uwcoop.world.random_streams import TEAM, Purpose, stream
from uwcoop.world.sensor_faults import AXES, with_faults

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.scenario.models import Scenario
    from uwcoop.scenario.sensors import (
        DepthSensor,
        Gps,
        GroundVelocitySensor,
        HeadingSensor,
        OdometrySensor,
        Sensors,
        StartFix,
        TurnRateSensor,
        WaterDepthSensor,
    )
    from uwcoop.scenario.world import Tide
    from uwcoop.world.vehicles import Motion

    Array = NDArray[np.float64]
    Rows = dict[str, NDArray[np.float64]]


def events_of(
    scenario: Scenario,
    chart: Chart | None,
    motion: Sequence[Motion],
    seed: int,
    settled: Mapping[str, Columns] | None = None,
) -> dict[str, Columns]:
    """All events of a mission: a table of columns for each kind that occurs, sorted by time, then vehicle.

    `settled` are events that the mission's course has made already: roles, landings, mutual positioning.
    """
    tide = Tides(scenario.tide, seed)
    parts: dict[str, list[Columns]] = {kind: [] for kind in EVENT_COLUMNS}
    for kind, table in (settled or {}).items():
        parts[kind].append(table)
    for index, (vehicle, moved) in enumerate(zip(scenario.team, motion, strict=True)):
        sensors = vehicle.sensors or scenario.sensors
        for kind, rows in _vehicle_events(sensors, chart, tide, moved, seed, index):
            t_s = rows.pop("t_s")
            parts[kind].append(
                {
                    "t_ns": np.round(t_s * 1e9).astype(np.int64),
                    "vehicle": np.full(t_s.size, index, dtype=np.int64),
                    **rows,
                }
            )
    return {
        kind: _sorted(tables) for kind, tables in parts.items() if any(part["t_ns"].size for part in tables)
    }


def _vehicle_events(
    sensors: Sensors, chart: Chart | None, tide: Tides, moved: Motion, seed: int, index: int
) -> list[tuple[str, Rows]]:
    def rng(purpose: Purpose) -> np.random.Generator:
        return stream(seed, index, purpose)

    rows: list[tuple[str, Rows]] = []
    hovers = isinstance(moved, HoverMotion)  # it has no compass to command by, and a prior of its own
    if not hovers:
        rows.append(("motion", motion_events(moved)))
    if sensors.fix.at_start and not hovers:
        rows.append(("fix", start_fix(sensors.fix, moved, rng(Purpose.FIX))))
    rows.append(("depth", depth_events(sensors.depth, moved, rng(Purpose.DEPTH))))
    rows.append(
        ("water_depth", water_depth_events(sensors.water_depth, chart, tide, moved, rng(Purpose.WATER_DEPTH)))
    )
    if sensors.heading is not None:
        rows.append(("heading", heading_events(sensors.heading, moved, rng(Purpose.HEADING))))
    if sensors.turn_rate is not None:
        rows.append(("turn_rate", turn_rate_events(sensors.turn_rate, moved, rng(Purpose.TURN_RATE))))
    if sensors.ground_velocity is not None:
        dvl = sensors.ground_velocity
        rows.append(("ground_velocity", ground_velocity_events(dvl, moved, rng(Purpose.GROUND_VELOCITY))))
    if sensors.odometry is not None:
        rows.append(("odometry", odometry_events(sensors.odometry, moved, rng(Purpose.ODOMETRY))))
    if sensors.gps is not None:
        rows.append(("fix", gps_events(sensors.gps, moved, rng(Purpose.GPS))))
    for k, (kind, table) in enumerate(rows):
        if faults := sensors.faults(kind):
            luck = stream(seed, index, Purpose.SENSOR_FAULTS, list(AXES).index(kind))
            rows[k] = kind, with_faults(kind, table, faults, luck)
    return rows


class Tides:
    """How much deeper than the chart the water is in one mission."""

    def __init__(self, tide: Tide, seed: int) -> None:
        self._tide = tide
        drawn = float(stream(seed, TEAM, Purpose.TIDE).standard_normal())
        self._offset_m = tide.offset_m + tide.offset_sigma_m * drawn

    def at(self, t_s: Array) -> Array:
        """Metres to add to the chart, (K,); positive is deeper than the chart."""
        phase = 2 * math.pi * t_s / self._tide.period_s + math.radians(self._tide.phase_deg)
        return self._offset_m + self._tide.amplitude_m * np.sin(phase)


def sample_times(rate_hz: float, end_s: float) -> Array:
    """Instants 0, 1/rate, ... up to the end, seconds; none at a rate of 0."""
    if rate_hz == 0:
        return np.empty(0)
    return np.arange(math.floor(end_s * rate_hz + 1e-9) + 1) / rate_hz


def motion_events(moved: Motion) -> Rows:
    """Commanded velocity at every second, held until the next."""
    return {
        "t_s": np.arange(len(moved.yaw_rad), dtype=np.float64),
        "velocity_e_mps": moved.command_mps[:, 0],
        "velocity_n_mps": moved.command_mps[:, 1],
    }


def start_fix(sensor: StartFix, moved: Motion, rng: np.random.Generator) -> Rows:
    """One fix at the start, uniform in a disc around the truth; its covariance is radius²/4 on each axis."""
    radius, angle = sensor.radius_m * math.sqrt(rng.random()), 2 * math.pi * rng.random()
    variance = sensor.radius_m**2 / 4
    error = np.array([[radius * math.cos(angle), radius * math.sin(angle)]])
    return _fix(np.zeros(1), moved.position_m[:1] + error, variance)


def gps_events(sensor: Gps, moved: Motion, rng: np.random.Generator) -> Rows:
    """Periodic fixes with white noise, the first after one period."""
    t_s = sample_times(sensor.rate_hz, moved.end_s)[1:]
    noise = sensor.sigma_m * rng.standard_normal((t_s.size, 2))
    return _fix(t_s, moved.position_at(t_s) + noise, sensor.sigma_m**2)


def _fix(t_s: Array, position: Array, variance: float) -> Rows:
    constant = np.full(t_s.size, variance)
    return {
        "t_s": t_s, "e_m": position[:, 0], "n_m": position[:, 1],
        "cov_ee_m2": constant, "cov_en_m2": np.zeros(t_s.size), "cov_nn_m2": constant,
    }  # fmt: skip


def depth_events(sensor: DepthSensor, moved: Motion, rng: np.random.Generator) -> Rows:
    """Own depth below the surface with white noise, which at the surface may read below 0."""
    t_s = sample_times(sensor.rate_hz, moved.end_s)
    depth = moved.depth_at(t_s) + sensor.sigma_m * rng.standard_normal(t_s.size)
    return {"t_s": t_s, "depth_m": depth, "sigma_m": np.full(t_s.size, sensor.sigma_m)}


def water_depth_events(
    sensor: WaterDepthSensor, chart: Chart | None, tide: Tides, moved: Motion, rng: np.random.Generator
) -> Rows:
    """Water depth: recorded soundings as they are, or chart + tide + white noise where there is a chart."""
    if moved.soundings_m is not None and sensor.rate_hz > 0:
        t_s = np.flatnonzero(np.isfinite(moved.soundings_m)).astype(np.float64)
        water = moved.soundings_m[t_s.astype(np.int64)]
    elif chart is None:
        t_s = water = np.empty(0)
    else:
        t_s = sample_times(sensor.rate_hz, moved.end_s)
        noise = sensor.sigma_m * rng.standard_normal(t_s.size)
        water = chart.depth_at(moved.position_at(t_s)) + tide.at(t_s) + noise if t_s.size else t_s
        known = np.isfinite(water)
        t_s, water = t_s[known], water[known]
    return {"t_s": t_s, "water_depth_m": water, "sigma_m": np.full(t_s.size, sensor.sigma_m)}


def heading_events(sensor: HeadingSensor, moved: Motion, rng: np.random.Generator) -> Rows:
    """Yaw as the compass shows it (with its bias and noise) plus the sensor's own white noise."""
    t_s = sample_times(sensor.rate_hz, moved.end_s)
    sigma = math.radians(sensor.sigma_deg)
    yaw = moved.believed_yaw_on(t_s) + sigma * rng.standard_normal(t_s.size)
    return {"t_s": t_s, "yaw_rad": wrap_angle(yaw), "sigma_rad": np.full(t_s.size, sigma)}


def turn_rate_events(sensor: TurnRateSensor, moved: Motion, rng: np.random.Generator) -> Rows:
    """Mean yaw rate since the last event, from the second event on; of a hovering vehicle until the next one."""
    t_s = sample_times(sensor.rate_hz, moved.end_s)
    bias = math.radians(sensor.bias_sigma_degps) * rng.standard_normal()
    sigma = math.radians(sensor.sigma_degps)
    t_s, rate = moved.turn_rates(t_s, sensor.rate_hz)
    rate = rate + bias + sigma * rng.standard_normal(rate.size)
    return {"t_s": t_s, "yaw_rate_radps": rate, "sigma_radps": np.full(rate.size, sigma)}


def ground_velocity_events(sensor: GroundVelocitySensor, moved: Motion, rng: np.random.Generator) -> Rows:
    """Velocity over ground of the second in progress, in the body frame, with scale and mounting errors."""
    t_s = sample_times(sensor.rate_hz, moved.end_s)
    scale, mounting = rng.standard_normal(2) * (
        sensor.scale_sigma,
        math.radians(sensor.misalignment_sigma_deg),
    )
    t_s, body = moved.body_velocities(t_s, mounting)
    body = (1 + scale) * body
    body = body + sensor.sigma_at(np.hypot(*body.T))[:, None] * rng.standard_normal(body.shape)
    sigma = sensor.sigma_at(np.hypot(*body.T))  # what it states follows from what it reads
    return {"t_s": t_s, "forward_mps": body[:, 0], "left_mps": body[:, 1], "sigma_mps": sigma}


def odometry_events(sensor: OdometrySensor, moved: Motion, rng: np.random.Generator) -> Rows:
    """Displacement and change of yaw since the last event, in the body frame of that last event."""
    t_s = sample_times(sensor.rate_hz, moved.end_s)
    yaw = moved.yaw_on(t_s)
    count = max(0, t_s.size - 1)
    root = math.sqrt(1 / sensor.rate_hz) if count else 0.0
    sigma, sigma_yaw = sensor.sigma_m_per_sqrt_s * root, math.radians(sensor.sigma_yaw_deg_per_sqrt_s) * root
    noise = rng.standard_normal((count, 3))
    body = turned(np.diff(moved.position_at(t_s), axis=0), -yaw[:-1]) + sigma * noise[:, :2]
    turn_rad = wrap_angle(np.diff(yaw) + sigma_yaw * noise[:, 2])
    zero, along, turn = np.zeros(count), np.full(count, sigma**2), np.full(count, sigma_yaw**2)
    return {
        "t_s": t_s[1:], "forward_m": body[:, 0], "left_m": body[:, 1], "yaw_change_rad": turn_rad,
        "cov_ff": along, "cov_fl": zero, "cov_fy": zero, "cov_ll": along, "cov_ly": zero, "cov_yy": turn,
    }  # fmt: skip


def _sorted(tables: list[Columns]) -> Columns:
    table = {name: np.concatenate([part[name] for part in tables]) for name in tables[0]}
    order = np.lexsort((table["vehicle"], table["t_ns"]))
    return {name: column[order] for name, column in table.items()}
