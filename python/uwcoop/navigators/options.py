"""Options of the navigators: the only place for their defaults, with units in the names.

Sources: Tan, Chitre & Hover (2016), Table 1 and section 3–4, for `dmpf`; the package's methods page for `mpf`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

DRIFT_PRESETS: dict[str, dict[str, float]] = {
    # Tan, Chitre & Hover (2016), Table 1; the paper does not give the priors of the current and the biases.
    "table-1": {
        "sigma_position_m_per_sqrt_s": 0.05,
        "sigma_current_mps_per_sqrt_s": 0.01,
        "sigma_current0_mps": 0.3,
        "sigma_heading_bias0_rad": 0.0175,
        "sigma_thrust_bias0_mps": 0.1,
    },
    # Speed through the water from the thrusters, heading from a compass.
    "no-dvl": {
        "sigma_position_m_per_sqrt_s": 0.07,
        "sigma_current_mps_per_sqrt_s": 0.012,
        "sigma_current0_mps": 0.15,
        "sigma_heading_bias0_rad": math.radians(1.5),
        "sigma_thrust_bias0_mps": 0.075,
    },
    # Speed over ground from a DVL; what is left is slow and small.
    "dvl": {
        "sigma_position_m_per_sqrt_s": 0.04,
        "sigma_current_mps_per_sqrt_s": 0.003,
        "sigma_current0_mps": 0.06,
        "sigma_heading_bias0_rad": math.radians(0.5),
        "sigma_thrust_bias0_mps": 0.01,
    },
}
"""Drift by class of vehicle: what a preset states, an option of the same name overrides."""

DRIFT_KEYS = (
    "sigma_position_m_per_sqrt_s",
    "sigma_current_mps_per_sqrt_s",
    "sigma_current0_mps",
    "sigma_heading_bias0_rad",
    "sigma_heading_bias_rad_per_sqrt_s",
    "sigma_thrust_bias0_mps",
    "sigma_thrust_bias_mps_per_sqrt_s",
)
"""Options that say how dead reckoning drifts."""

NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, le=1)]


class DriftOptions(BaseModel):
    """How dead reckoning drifts. None takes the preset's value; walks are per root second."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    drift: Literal["table-1", "no-dvl", "dvl"] = "no-dvl"
    sigma_position_m_per_sqrt_s: NonNegative | None = None
    sigma_current_mps_per_sqrt_s: NonNegative | None = None
    sigma_current0_mps: NonNegative | None = None
    sigma_heading_bias0_rad: NonNegative | None = None
    sigma_thrust_bias0_mps: NonNegative | None = None
    sigma_heading_bias_rad_per_sqrt_s: NonNegative = 1e-5
    sigma_thrust_bias_mps_per_sqrt_s: NonNegative = 1e-4

    def native(self, correlation_length_m: float) -> dict[str, Any]:
        """All options with presets and what depends on the chart filled in."""
        values = self.model_dump()
        for name, value in DRIFT_PRESETS[self.drift].items():
            if values[name] is None:
                values[name] = value
        return values


class DeadReckoningOptions(DriftOptions):
    """Options of `dead-reckoning`."""


class FilterOptions(DriftOptions):
    """What both particle filters have."""

    particles: Annotated[int, Field(ge=10, le=10_000_000)] = 600
    resample_share: Share = 2 / 3
    """Resample when the effective sample size falls to this share of the particles (14)."""
    use_ranges: bool = True
    sigma_range_m: Positive = 1.0
    range_gate_sigmas: Positive | None = None
    """Ranges that contradict the cloud by more than this many sigmas are gated and counted; None: never."""
    entropy_sigma_m: Positive | None = None
    """Kernel width of the entropies (20)-(21) that say what a range told; set by `diagnostics.entropy`."""


class DmpfOptions(FilterOptions):
    """Options of `dmpf`, `terrain-only` and `ranging-only`: the paper's values."""

    drift: Literal["table-1", "no-dvl", "dvl"] = "table-1"
    packet: Literal["rounded", "f64", "modes", "particles"] = "rounded"
    """Broadcast belief: 15 bytes, or 47 as float64; `modes`: a Gaussian mixture (section 7); or all particles (section
    5.1), 24 bytes each."""
    modes: Annotated[int, Field(ge=1, le=4)] = 2
    """Modes of a `modes` packet; two take 26 bytes."""
    window: Annotated[int, Field(ge=1, le=120)] = 14
    """ℓ, the number of depth differences along the vehicle's track."""
    sigma_like_m: Positive = 0.2
    """Sigma of a difference in (15). The paper states none; 0.05 m times √ℓ, since each sounding is used ℓ times."""
    roughening_m2: NonNegative = 2.0
    use_terrain: bool = True
    range_method: Literal["eq17", "gaussian"] = "eq17"
    range_samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """Samples of the broadcast belief in (17); None: as many as particles."""
    range_temper: Share = 1.0
    """Exponent of the Gaussian range likelihood."""


class MpfOptions(FilterOptions):
    """Options of `mpf` and `mpf-terrain-only`."""

    packet: Literal["rounded", "f64"] = "rounded"
    """Broadcast belief: 15 bytes, or 47 for studies without a limit on bandwidth."""
    sigma_depth_m: Positive | None = None
    """Sigma of a sounding; None: what the sensor states."""
    sigma_offset0_m: Positive = 1.0
    """Prior of the datum offset (tide), positive = deeper than the chart."""
    sigma_offset_m_per_sounding: NonNegative | None = None
    """Walk of the datum offset; None: 0.005, or 0.002 on a chart whose error is not correlated."""
    student_dof: Positive | None = None
    """Degrees of freedom of the sounding's Student t; None: 4, or a Gaussian on a chart whose error is not correlated."""
    correlation_length_m: NonNegative | None = None
    """Distance over which the chart's error stays itself; None: as the chart states."""
    sigma_map_m: NonNegative | None = None
    """Sigma of the chart's error; None: as the chart states."""
    sounding_spacing_m: NonNegative = 0.0
    """Least distance between the soundings that are used."""
    least_ess_share: Annotated[float, Field(ge=0, le=0.5)] = 0.02
    """A sounding that would leave a smaller effective share of the particles has its sigma doubled, six times at most."""
    acquisition_sigma_m: Positive = 20.0
    """A start known to less than this (sigma along the longer axis) is searched for with many particles, and so is a
    position whose sigma grew to more than twice as much, and beyond what its particles can hold."""
    acquisition_particles: Annotated[int, Field(ge=10, le=10_000_000)] = 20_000
    """Particles while the position is searched for, at most."""
    start_anywhere: bool = False
    """Where no fix comes before the first sounding, begin anywhere on the chart."""
    bias_states: bool = False
    """Compass and thrust bias as further Kalman states."""
    range_method: Literal["gaussian"] = "gaussian"
    range_novelty: bool = True
    """A teammate's position is wrong by an error that lasts: of its range counts what the error's renewal since it was
    last heard makes new. Off: every range counts alike."""
    range_temper: Share | None = None
    """Further exponent of the range likelihood. None: 1 over the number of teammates, who may all pass on the same
    news; 0.05 without `range_novelty`."""
    range_gate_sigmas: Positive | None = 6.0
    monitor: bool = True
    """Spread the cloud when its soundings have contradicted it for long."""
    monitor_forgetting: Share = 0.05
    monitor_clip: Positive = 25.0
    monitor_alarm: Positive = 6.0
    monitor_spread_m: NonNegative = 10.0
    monitor_repeat_spread_m: NonNegative = 25.0
    monitor_spread_current_mps: NonNegative = 0.1
    monitor_quiet_s: NonNegative = 20.0
    monitor_repeat_s: NonNegative = 100.0

    def native(self, correlation_length_m: float) -> dict[str, Any]:
        """As the base, with tails and walk chosen for the chart's kind of error."""
        values = super().native(correlation_length_m)
        length = correlation_length_m if self.correlation_length_m is None else self.correlation_length_m
        white = length == 0
        if self.range_temper is None and not self.range_novelty:
            values["range_temper"] = 0.05
        if self.student_dof is None:
            values["student_dof"] = math.inf if white else 4.0
        if self.sigma_offset_m_per_sounding is None:
            values["sigma_offset_m_per_sounding"] = 0.002 if white else 0.005
        return values
