"""What navigators that exchange pose graphs are compared with: options, and how they are made."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from uwcoop import _native
from uwcoop.navigators.options import Positive
from uwcoop.navigators.origin import OriginOptions, PacketForm

if TYPE_CHECKING:
    from uwcoop.navigators.protocol import Context

__all__ = [
    "BeliefOptions",
    "CekfOptions",
    "InterleavedOptions",
    "belief_exchange",
    "cekf",
    "interleaved",
]


class CekfOptions(OriginOptions):
    """Options of `cekf` and `cekf-received`."""

    fed: Literal["everything", "received"] = "everything"
    """received: each vehicle alone, with the raw data of exactly the packets that reached it."""
    assumed_packet_bytes: Annotated[int, Field(ge=0, le=4096)] = 0
    """Length of the packet that a range is assumed to ride on, for loss and air time; 0: a frame whatever its size."""


class BeliefOptions(OriginOptions):
    """Options of `nekf`, `covariance-intersection` and `local-only`."""

    correlation: Literal["ignored", "unknown"]
    """What is assumed of a teammate's belief and one's own."""
    process_noise_factor: Positive = 1.0
    """Factor on the process noises."""
    use_ranges: bool = True
    """False: it neither uses ranges nor broadcasts."""
    packet_form: PacketForm = "f64"
    """f64: 47 bytes; any other: 15, rounded so that a belief is never overstated. Follows `acoustics.packet`."""


class InterleavedOptions(OriginOptions):
    """Options of `interleaved`: its bank is broadcast in float64, 42 bytes for each filter."""


def _ranges(context: Context) -> bool:
    return context.ranging[context.vehicle] if context.ranging else True


def cekf(
    context: Context, options: Mapping[str, Any], _chart: _native.Chart | None
) -> _native.CentralEstimator:
    """One estimator for the team."""
    ranging = list(context.ranging) or [True] * context.vehicles
    return _native.cekf(dict(options), ranging, context.sound_speed_mps)


def belief_exchange(
    context: Context, options: Mapping[str, Any], _chart: _native.Chart | None
) -> _native.Navigator:
    """`nekf`, `covariance-intersection` or `local-only` of one vehicle."""
    return _native.belief_exchange(
        context.vehicle, context.vehicles, dict(options), _ranges(context), context.sound_speed_mps
    )


def interleaved(
    context: Context, options: Mapping[str, Any], _chart: _native.Chart | None
) -> _native.Navigator:
    """`interleaved` of one vehicle."""
    return _native.interleaved(
        context.vehicle, context.vehicles, dict(options), _ranges(context), context.sound_speed_mps
    )
