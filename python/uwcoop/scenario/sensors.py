"""The `[sensors.*]` tables: which sensors, how often, how well. A sensor without a table does not exist."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from uwcoop.scenario.base import NonNegative, Point, Positive, Probability, Table

if TYPE_CHECKING:
    from numpy.typing import NDArray

Rate = Annotated[float, Field(ge=0, le=1000)]
"""Events per second from the start on; 0 switches the sensor off."""


class Fault(Table):
    """Wrong readings of one sensor in an interval of time; the sigma that the sensor states does not change."""

    kind: Literal["dropout", "stuck", "value"]
    """dropout: no readings. stuck: the last reading before it again and again. value: `value` in their place, as a
    saturated echo sounder or a DVL without bottom track (-32.768) writes."""
    from_s: NonNegative
    to_s: Positive
    """Readings at from_s or later and before to_s."""
    value: float | None = None
    """In the sensor's unit (m, °, m/s), on each axis."""
    share: Probability = 1.0
    """Share of the readings in this interval that are wrong, drawn for each reading."""

    @model_validator(mode="after")
    def _is_whole(self) -> Fault:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s is {self.to_s:g}: must be above from_s, {self.from_s:g}")
        if (self.kind == "value") != (self.value is not None):
            raise ValueError(f"kind is {self.kind!r}: value belongs to kind 'value', and to no other")
        return self


Faults = Annotated[tuple[Fault, ...], Field(strict=False)]


class WaterDepthSensor(Table):
    """Altimeter plus depth sensor: water depth."""

    rate_hz: Rate = 1.0
    sigma_m: NonNegative = 0.05
    """Of the sum. For recorded soundings nothing is added; this is what the event states."""
    faults: Faults = ()


class DepthSensor(Table):
    """Pressure sensor: the vehicle's own depth."""

    rate_hz: Rate = 1.0
    sigma_m: NonNegative = 0.02
    faults: Faults = ()


class HeadingSensor(Table):
    """Compass or attitude reference: shares the vehicle's compass bias and adds noise of its own."""

    rate_hz: Rate = 1.0
    sigma_deg: NonNegative = 0.5
    faults: Faults = ()


class TurnRateSensor(Table):
    """One-axis gyro."""

    rate_hz: Rate = 1.0
    sigma_degps: NonNegative = 0.01
    bias_sigma_degps: NonNegative = 0.0
    """Drawn for each vehicle and mission."""


class GroundVelocitySensor(Table):
    """DVL with bottom track: velocity over ground in the body frame."""

    rate_hz: Rate = 1.0
    sigma_mps: NonNegative = 0.05
    """On each axis, at rest."""
    sigma_per_root_mps: NonNegative = 0.0
    """Further noise: this times the root of the speed, (m/s)^0.5."""
    sigma_speed_mps: Point = (0.05, 0.5)
    """Speeds below and above which the noise is constant."""
    scale_sigma: NonNegative = 0.0
    """Relative error of the speed, drawn for each vehicle and mission."""
    misalignment_sigma_deg: NonNegative = 0.0
    """Clockwise error of the mounting, drawn for each vehicle and mission."""
    faults: Faults = ()

    def sigma_at(self, speed_mps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard deviation on each axis at speeds (K,), m/s."""
        slow, fast = self.sigma_speed_mps
        return np.asarray(self.sigma_mps + self.sigma_per_root_mps * np.sqrt(np.clip(speed_mps, slow, fast)))


class OdometrySensor(Table):
    """Displacement and change of yaw since the last event, in the body frame of that last event."""

    rate_hz: Annotated[float, Field(ge=0, le=100)] = 1.0
    sigma_m_per_sqrt_s: NonNegative = 0.05
    """On each axis."""
    sigma_yaw_deg_per_sqrt_s: NonNegative = 0.05


class StartFix(Table):
    """A GPS fix before submerging: uniform in a disc around the true start (Tan et al. 2016, section 5)."""

    at_start: bool = True
    """False: the vehicle starts without one; see `start_anywhere` of `mpf` and `team`."""
    radius_m: Positive = 10.0
    """Of the disc; beyond twice `acquisition_sigma_m` (40 m), `mpf` and `team` search for the position."""


class Gps(Table):
    """Periodic GPS fixes, for a vehicle at the surface."""

    rate_hz: Rate = 1.0
    sigma_m: Positive = 3.0
    """On each axis."""


class Sensors(Table):
    """All sensors of a vehicle. Those with a default are there unless switched off (`rate_hz = 0`)."""

    fix: StartFix = StartFix()
    water_depth: WaterDepthSensor = WaterDepthSensor()
    depth: DepthSensor = DepthSensor()
    heading: HeadingSensor | None = None
    turn_rate: TurnRateSensor | None = None
    ground_velocity: GroundVelocitySensor | None = None
    odometry: OdometrySensor | None = None
    gps: Gps | None = None

    @model_validator(mode="after")
    def _odometry_has_a_covariance(self) -> Sensors:
        odometry = self.odometry
        if odometry is not None and odometry.rate_hz > 0:
            for name in ("sigma_m_per_sqrt_s", "sigma_yaw_deg_per_sqrt_s"):
                if getattr(odometry, name) == 0:
                    raise ValueError(
                        f"odometry.{name} is 0: must be above 0, its covariance is part of the event"
                    )
        return self

    def faults(self, kind: str) -> tuple[Fault, ...]:
        """Faults of the sensor that gives this kind of event."""
        found: tuple[Fault, ...] = getattr(getattr(self, kind, None), "faults", ())
        return found

    def replaced_by(self, other: Sensors | None) -> Sensors:
        """These sensors with those that `other`'s author gave in their place."""
        if other is None:
            return self
        return self.model_copy(update={name: getattr(other, name) for name in other.model_fields_set})
