"""Options of the navigators that exchange pose graphs, and of what they are compared with (Walls & Eustice 2012);
defaults and bounds are the core's."""

from __future__ import annotations

from typing import Literal

from uwcoop.navigators.base import FROM_CORE, NavigatorOptions

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
    """What all of them share: the model of a vehicle's own motion and sensors, and how ranges are weighed.

    A node is [x, y, ẋ, ẏ] with white acceleration; sigmas of fixes, headings and velocities come with the events.
    """

    process_noise_m2_per_s3: float = FROM_CORE
    """Spectral density of the acceleration per axis, of a vehicle that does not measure its velocity."""
    process_noise_dvl_m2_per_s3: float = FROM_CORE
    """The same of a vehicle with a DVL: it turns, and its velocity is measured whatever the process says."""
    sigma_velocity0_mps: float = FROM_CORE
    """Prior of the velocity per axis."""
    sigma_range_m: float = FROM_CORE
    """Of a slant range."""
    gate_sigmas: float = FROM_CORE
    """Fixes and ranges that contradict the belief by more are gated and counted; the third such fix in a row is
    believed."""


class MdeifOptions(OriginOptions, method="mdeif"):
    """Options of `mdeif`."""

    packet_form: PacketForm = FROM_CORE
    """Form of a broadcast: float64 for studies, or quantised for a frame of so many bytes. Follows `acoustics.packet`."""
    exact_lags: int = FROM_CORE
    """With how many of the last transmissions an f64 packet holds the exact joint. With so many, hardly a gap needs
    the filtered-error model, which costs a receiver 5-10 % of variance each time."""
    use_joint: bool = FROM_CORE
    """Reconstruct by the exact joint with the last node where the packet holds it."""
    use_equation_6: bool = FROM_CORE
    """Else by equation (6) where its health indicator allows; else by the filtered-error model."""
    health_loss_max: float = FROM_CORE
    """Equation (6) is trusted while rounding costs it no more than this share of the least direction of what it
    solves for."""


class DeifOptions(OriginOptions, method="deif"):
    """Options of `deif`: as published, packets of float64."""


class DeifRedundantOptions(OriginOptions, method="deif-redundant"):
    """Options of `deif-redundant`."""

    repeats: int = FROM_CORE
    """How many delta informations a packet holds: its own and the ones before it."""


class CekfOptions(OriginOptions, method="cekf"):
    """Options of `cekf` and `cekf-received`."""

    fed: Literal["everything", "received"] = FROM_CORE
    """received: each vehicle alone, with the raw data of exactly the packets that reached it."""
    assumed_packet_bytes: int = FROM_CORE
    """Length of the packet that a range is assumed to ride on, for loss and air time; 0: a frame whatever its size."""


class BeliefOptions(OriginOptions, method="belief-exchange"):
    """Options of `nekf`, `covariance-intersection` and `local-only`."""

    correlation: Literal["ignored", "unknown"] = FROM_CORE
    """What is assumed of a teammate's belief and one's own."""
    process_noise_factor: float = FROM_CORE
    """Factor on the process noises."""
    use_ranges: bool = FROM_CORE
    """False: it neither uses ranges nor broadcasts."""
    packet_form: PacketForm = FROM_CORE
    """f64: 47 bytes; any other: 15, rounded so that a belief is never overstated. Follows `acoustics.packet`."""


class InterleavedOptions(OriginOptions, method="interleaved"):
    """Options of `interleaved`: its bank is broadcast in float64, 42 bytes for each filter."""
