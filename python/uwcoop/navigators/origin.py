"""Options of the navigators that exchange pose graphs, and of what they are compared with (Walls & Eustice 2012)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from uwcoop import _native
from uwcoop.navigators.options import NonNegative, Positive

if TYPE_CHECKING:
    from uwcoop.navigators.protocol import Context

__all__ = [
    "DeifOptions",
    "DeifRedundantOptions",
    "MdeifOptions",
    "OriginOptions",
    "deif",
    "deif_redundant",
    "mdeif",
]

PacketForm = Literal["f64", "32", "64", "256"]


class OriginOptions(BaseModel):
    """What all of them share: the model of a vehicle's own motion and sensors, and how ranges are weighed.

    A node is [x, y, ẋ, ẏ] with white acceleration; sigmas of fixes, headings and velocities come with the events.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    process_noise_m2_per_s3: Positive = 1e-4
    """Spectral density of the acceleration per axis, of a vehicle that does not measure its velocity."""
    process_noise_dvl_m2_per_s3: Positive = 1e-2
    """The same of a vehicle with a DVL: it turns, and its velocity is measured whatever the process says."""
    sigma_velocity0_mps: Positive = 1.0
    """Prior of the velocity per axis."""
    sigma_range_m: Positive = 1.0
    """Of a slant range."""
    gate_sigmas: Positive = 6.0
    """Fixes and ranges that contradict the belief by more are gated and counted; the third such fix in a row is
    believed."""

    def native(self, correlation_length_m: float) -> dict[str, Any]:
        """All options; nothing here depends on the chart."""
        return self.model_dump()


class MdeifOptions(OriginOptions):
    """Options of `mdeif`."""

    packet_form: PacketForm = "f64"
    """Form of a broadcast: float64 for studies, or quantised for a frame of so many bytes. Follows `acoustics.packet`."""
    exact_lags: Annotated[int, Field(ge=0, le=8)] = 6
    """With how many of the last transmissions an f64 packet holds the exact joint. With so many, hardly a gap needs
    the filtered-error model, which costs a receiver 5-10 % of variance each time."""
    use_joint: bool = True
    """Reconstruct by the exact joint with the last node where the packet holds it."""
    use_equation_6: bool = True
    """Else by equation (6) where its health indicator allows; else by the filtered-error model."""
    health_loss_max: NonNegative = 1e-4
    """Equation (6) is trusted while rounding costs it no more than this share of the least direction of what it
    solves for."""


class DeifOptions(OriginOptions):
    """Options of `deif`: as published, packets of float64."""


class DeifRedundantOptions(OriginOptions):
    """Options of `deif-redundant`."""

    repeats: Annotated[int, Field(ge=1, le=16)] = 6
    """How many delta informations a packet holds: its own and the ones before it."""


def _ranging(context: Context) -> list[bool]:
    """By vehicle, whether it uses ranges; where nobody said, all do."""
    return list(context.ranging) or [True] * context.vehicles


def mdeif(context: Context, options: Mapping[str, Any], _chart: _native.Chart | None) -> _native.Navigator:
    """Walls & Eustice (2012), section 4."""
    return _native.mdeif(context.vehicle, _ranging(context), dict(options), context.sound_speed_mps)


def deif(context: Context, options: Mapping[str, Any], _chart: _native.Chart | None) -> _native.Navigator:
    """Walls & Eustice (2012), section 3."""
    return _native.deif(context.vehicle, _ranging(context), dict(options), None, context.sound_speed_mps)


def deif_redundant(
    context: Context, options: Mapping[str, Any], _chart: _native.Chart | None
) -> _native.Navigator:
    """Section 3.1's workaround."""
    repeats = int(options["repeats"])
    return _native.deif(context.vehicle, _ranging(context), dict(options), repeats, context.sound_speed_mps)
