"""Options of the navigators that exchange pose graphs, and of their references (Walls & Eustice 2012);
defaults and bounds are the core's."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from uwcoop.navigators.base import FROM_CORE, NavigatorOptions
from uwcoop.navigators.clock import ClockOptions

__all__ = [
    "BeliefOptions",
    "CekfOptions",
    "DeifOptions",
    "DeifRedundantOptions",
    "InterleavedOptions",
    "MdeifOptions",
    "OriginOptions",
]

PacketForm = Literal["f64", "32", "64", "256"]


class OriginOptions(NavigatorOptions, method="deif"):
    """Options of all of them: the model of a vehicle's own motion and sensors, and the weight of ranges.

    A node is [x, y, ẋ, ẏ] with white acceleration; sigmas of fixes, headings and velocities come with the events.
    """

    process_noise_m2_per_s3: float = FROM_CORE
    """Spectral density of the acceleration per axis, of a vehicle that does not measure its velocity."""
    process_noise_dvl_m2_per_s3: float = FROM_CORE
    """The same of a vehicle with a DVL. It must allow for turns; the DVL bounds the velocity."""
    sigma_velocity0_mps: float = FROM_CORE
    """Prior of the velocity per axis."""
    sigma_odometry_scale: float = FROM_CORE
    """Prior of the scale error of odometry."""
    sigma_gyro_bias_radps: float = FROM_CORE
    """Prior of the constant error of the gyro behind the yaw changes of odometry. `mdeif` estimates it; in the others
    and in packets the variance of the heading grows by it."""
    sigma_range_m: float = FROM_CORE
    """Of a slant range."""
    gate_sigmas: float = FROM_CORE
    """Fixes and ranges with a larger normalised innovation are gated and counted; the third such fix in a row is
    used."""
    clock: ClockOptions = Field(default=FROM_CORE, validate_default=True)
    """Errors of one-way ranges: they widen the gate, and a range counts by the share of its error that is new."""


class MdeifOptions(OriginOptions, method="mdeif"):
    """Options of `mdeif`."""

    sigma_range_bias_m: float = FROM_CORE
    """Prior of the constant error of all ranges to one teammate or beacon, which is then estimated; 0: none."""
    sigma_range_drift_m: float = FROM_CORE
    """Standard deviation of a slowly changing error of these ranges (Gauss-Markov), which is then estimated; 0: none."""
    range_drift_s: float = FROM_CORE
    """Time in which the correlation of the changing error falls to 1/e."""
    noise_scale_max: float = FROM_CORE
    """Sigmas of ranges and of the own motion may grow to so many times the stated ones, as innovations show; 1: off."""
    noise_scale_rate: float = FROM_CORE
    """Share of one range in that scale."""
    packet_form: PacketForm = FROM_CORE
    """Form of a broadcast: float64 for studies, or quantised for a frame of so many bytes. Follows `acoustics.packet`."""
    exact_lags: int = FROM_CORE
    """Number of the last transmissions whose exact joint an f64 packet holds. With more, fewer gaps need the
    filtered-error model, which increases a receiver's variance by 5-10 % each time."""
    use_joint: bool = FROM_CORE
    """Reconstruct by the exact joint with the last node where the packet holds it."""
    use_equation_6: bool = FROM_CORE
    """Else by equation (6) where its health indicator allows; else by the filtered-error model."""
    health_loss_max: float = FROM_CORE
    """Equation (6) is used while its relative rounding error is at most this in every direction of its
    solution."""


class DeifOptions(OriginOptions, method="deif"):
    """Options of `deif`: as published, packets of float64."""


class DeifRedundantOptions(OriginOptions, method="deif-redundant"):
    """Options of `deif-redundant`."""

    repeats: int = FROM_CORE
    """Delta informations in a packet: its own and the previous ones."""


class CekfOptions(OriginOptions, method="cekf"):
    """Options of `cekf` and `cekf-received`."""

    fed: Literal["everything", "received"] = FROM_CORE
    """received: each vehicle alone, with the raw data of exactly the packets that reached it."""
    assumed_packet_bytes: int = FROM_CORE
    """Assumed length of the packet that carries a range, for loss and air time; 0: one frame of any size."""


class BeliefOptions(OriginOptions, method="belief-exchange"):
    """Options of `nekf`, `covariance-intersection` and `local-only`."""

    correlation: Literal["ignored", "unknown"] = FROM_CORE
    """Assumption on the correlation between a teammate's estimate and the own one."""
    process_noise_factor: float = FROM_CORE
    """Factor on the process noises."""
    use_ranges: bool = FROM_CORE
    """False: it neither uses ranges nor broadcasts."""
    packet_form: PacketForm = FROM_CORE
    """f64: 47 bytes; any other: 15, rounded so that the covariance is never understated. Follows `acoustics.packet`."""


class InterleavedOptions(OriginOptions, method="interleaved"):
    """Options of `interleaved`: its bank is broadcast in float64, 42 bytes for each filter."""
