"""Options of the particle filters and of dead reckoning, with units in the names; defaults and bounds are the core's.

Sources: Tan, Chitre & Hover (2016), Table 1 and section 3-4, for `dmpf`; the package's methods page for `mpf`.
"""

from __future__ import annotations

import json
from typing import Literal

from pydantic import Field

from uwcoop import _native
from uwcoop.navigators.base import FROM_CORE, NavigatorOptions
from uwcoop.navigators.clock import ClockOptions

__all__ = [
    "DRIFT_PRESETS",
    "DeadReckoningOptions",
    "DmpfOptions",
    "DriftName",
    "DriftOptions",
    "FilterOptions",
    "MpfOptions",
    "TerrainOptions",
]

DRIFT_PRESETS: dict[str, dict[str, float]] = json.loads(_native.drift_presets())
"""Drift by class of vehicle: what a preset states, an option of the same name overrides."""

DriftName = Literal["table-1", "no-dvl", "dvl"]


class DriftOptions(NavigatorOptions, method="dead-reckoning"):
    """Drift model of dead reckoning. None takes the preset's value; random walks are per root second."""

    drift: DriftName = FROM_CORE
    """Class of vehicle."""
    sigma_position_m_per_sqrt_s: float | None = FROM_CORE
    """White velocity noise, as a random walk of the position."""
    sigma_current_mps_per_sqrt_s: float | None = FROM_CORE
    """Random walk of the current, per axis."""
    sigma_current0_mps: float | None = FROM_CORE
    """Prior of the current, per axis."""
    sigma_heading_bias0_rad: float | None = FROM_CORE
    """Prior of the compass bias; read where biases are states, and of velocities over ground."""
    sigma_thrust_bias0_mps: float | None = FROM_CORE
    """Prior of the thrust bias; read where biases are states."""
    sigma_heading_bias_rad_per_sqrt_s: float = FROM_CORE
    """Random walk of the compass bias; read where biases are states."""
    sigma_thrust_bias_mps_per_sqrt_s: float = FROM_CORE
    """Random walk of the thrust bias; read where biases are states."""
    sigma_dvl_scale: float = FROM_CORE
    """Sigma of the scale of a DVL's velocities."""
    sigma_dvl_misalignment_rad: float = FROM_CORE
    """Sigma of the angle between DVL and compass."""
    dvl_hold_s: float = FROM_CORE
    """A velocity of a DVL, a water lock or odometry holds for so long after its reading."""


class DeadReckoningOptions(DriftOptions, method="dead-reckoning"):
    """Options of `dead-reckoning`."""


class FilterOptions(DriftOptions, method="dmpf"):
    """Options of all particle filters."""

    particles: int = FROM_CORE
    """Number of particles."""
    resample_share: float = FROM_CORE
    """Resample when the effective sample size falls to this share of the particles (14)."""
    use_ranges: bool = FROM_CORE
    """Broadcast, and use ranges to teammates."""
    sigma_range_m: float = FROM_CORE
    """Sigma of a range."""
    range_gate_sigmas: float | None = FROM_CORE
    """Ranges whose innovation exceeds this many sigmas are gated and counted; None: never."""
    clock: ClockOptions = Field(default=FROM_CORE, validate_default=True)
    """Errors of one-way ranges."""


class DmpfOptions(FilterOptions, method="dmpf"):
    """Options of `dmpf`, `terrain-only` and `ranging-only`: the paper's values."""

    entropy_sigma_m: float | None = FROM_CORE
    """Kernel width of the entropies (20)-(21), for the information gained from a range; set by `diagnostics.entropy`."""
    update_entropy_sigma_m: float | None = FROM_CORE
    """Kernel width of the same entropies over whole measurement updates (18); set by `diagnostics.entropy`."""
    packet: Literal["rounded", "f64", "modes", "particles"] = FROM_CORE
    """Broadcast belief: 15 bytes, or 47 as float64; `modes`: a Gaussian mixture (section 7); or all particles (section
    5.1), 24 bytes each."""
    modes: int = FROM_CORE
    """Modes of a `modes` packet; two take 26 bytes."""
    window: int = FROM_CORE
    """ℓ, the number of depth differences along the vehicle's track."""
    sigma_like_m: float = FROM_CORE
    """Sigma of a difference in (15). The paper states none; 0.05 m times √ℓ, since each sounding is used ℓ times."""
    roughening_m2: float | None = FROM_CORE
    """Variance of the roughening after resampling, per axis; None: twice the resolution of the chart."""
    use_terrain: bool = FROM_CORE
    """Use soundings."""
    range_method: Literal["eq17", "gaussian"] = FROM_CORE
    """Likelihood of a range: (17), or its Gaussian second-order form."""
    range_samples: int | None = FROM_CORE
    """Samples of the broadcast belief in (17); None: as many as particles."""
    range_temper: float = FROM_CORE
    """Exponent of the Gaussian range likelihood."""


class TerrainOptions(FilterOptions, method="mpf"):
    """Options that `mpf` and `team` share: the terrain core."""

    update_entropy_sigma_m: float | None = FROM_CORE
    """Kernel width of the entropies over measurement updates; set by `diagnostics.entropy = "at_updates"`."""
    sigma_depth_m: float | None = FROM_CORE
    """Sigma of a sounding; None: what the sensor states."""
    sigma_offset0_m: float = FROM_CORE
    """Prior of the datum offset (tide), positive = deeper than the chart."""
    sigma_offset_m_per_sounding: float | None = FROM_CORE
    """Walk of the datum offset; None: 0.005, or 0.002 on a chart whose error is not correlated."""
    student_dof: float | None = FROM_CORE
    """Degrees of freedom of the sounding's Student t; None: 4, or a Gaussian on a chart whose error is not correlated."""
    correlation_length_m: float | None = FROM_CORE
    """Correlation length of the chart's error; None: as the chart states."""
    sigma_map_m: float | None = FROM_CORE
    """Sigma of the chart's error; None: as the chart states."""
    sounding_spacing_m: float = FROM_CORE
    """Least distance between the soundings that are used."""
    least_ess_share: float = FROM_CORE
    """A sounding that would leave a smaller effective share of the particles has its sigma doubled, six times at most."""
    depth_noise_factor_max: float | None = FROM_CORE
    """Soundings are taken for noisier than stated where they show it, by this factor at most; None: as stated."""
    acquisition_sigma_m: float = FROM_CORE
    """A start known to less than this (sigma along the longer axis) is searched for with many particles, and so is a
    position whose sigma grew to more than twice as much, and beyond what its particles can hold."""
    acquisition_particles: int = FROM_CORE
    """Particles while the position is searched for, at most."""
    start_anywhere: bool = FROM_CORE
    """Where no fix comes before the first sounding, begin anywhere on the chart."""
    bias_states: bool = FROM_CORE
    """Compass and thrust bias as further Kalman states."""
    monitor: bool = FROM_CORE
    """Spread the cloud when the innovations of its soundings stay too large."""
    monitor_forgetting: float = FROM_CORE
    """Weight of a new sounding in the mean normalised squared innovation."""
    monitor_clip: float = FROM_CORE
    """Largest value of the statistic for one sounding."""
    monitor_alarm: float = FROM_CORE
    """Alarm when the mean exceeds this."""
    monitor_spread_m: float = FROM_CORE
    """Spread of the position on an alarm."""
    monitor_repeat_spread_m: float = FROM_CORE
    """Spread of the position on an alarm within `monitor_repeat_s` of the previous one."""
    monitor_spread_current_mps: float = FROM_CORE
    """Spread of the current on an alarm."""
    monitor_quiet_s: float = FROM_CORE
    """Shortest time between two alarms."""
    monitor_repeat_s: float = FROM_CORE
    """See `monitor_repeat_spread_m`."""


class MpfOptions(TerrainOptions, method="mpf"):
    """Options of `mpf` and `mpf-terrain-only`."""

    entropy_sigma_m: float | None = FROM_CORE
    """Kernel width of the entropies, for the information gained from a range; set by `diagnostics.entropy`."""
    packet: Literal["rounded", "f64"] = FROM_CORE
    """Broadcast belief: 15 bytes, or 47 for studies without a limit on bandwidth."""
    range_novelty: bool = FROM_CORE
    """Weight a range by the part of the teammate's position error that is independent of the error in its previous
    packet. Off: every range has the same weight."""
    range_temper: float | None = FROM_CORE
    """Further exponent of the range likelihood. None: 1 over the number of teammates, whose estimates may
    contain the same information; 0.05 without `range_novelty`."""
