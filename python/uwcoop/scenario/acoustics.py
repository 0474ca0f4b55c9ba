"""The `[acoustics]` table: modem, schedule, ranging, sound speed, clocks, late arrivals and losses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from uwcoop.acoustics.modem_profiles import MODEMS
from uwcoop.scenario.authentication import Authentication
from uwcoop.scenario.base import NonNegative, Positive, Table
from uwcoop.scenario.losses import IndependentLoss, Loss, NoLoss, named_vehicles
from uwcoop.scenario.modem import Modem, ModemTable
from uwcoop.scenario.water import SoundSpeed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.acoustics.modem_profiles import ModemFigures

__all__ = ["Acoustics", "Clock", "IndependentLoss", "Loss", "Modem", "NoLoss", "TwoWay"]


def _as_text(value: object) -> object:
    # `acoustics.packet=32` reads as a number.
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


class Clock(Table):
    """Errors of each vehicle's clock, drawn for each mission."""

    offset_sigma_s: NonNegative = 0.0
    """At the start of the mission."""
    drift_sigma_ppm: NonNegative = 0.0


class TwoWay(Table):
    """Size and delay of a poll. Used when ranging is "two-way"."""

    poll_bytes: Annotated[int, Field(ge=1, le=64)] = 2
    """A short signal of its own: the poller and the vehicle polled."""
    turnaround_s: NonNegative = 0.1
    """From the end of a poll to the earliest launch of the reply; the modem's own, if that is longer."""


class ExponentialOutlier(Table):
    """Excess length of a range by a longer path: small excesses are the most frequent."""

    distribution: Literal["exponential"] = "exponential"
    mean: Positive = 20.0

    def quantile(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Metres, below which this share of the outliers lies."""
        return np.asarray(-self.mean * np.log1p(-share))

    @property
    def mean_m(self) -> float:
        """Mean, metres."""
        return self.mean


class UniformOutlier(Table):
    """Excess length of a range by a longer path: uniform between two lengths."""

    distribution: Literal["uniform"]
    low: NonNegative
    high: Positive

    @model_validator(mode="after")
    def _ascends(self) -> UniformOutlier:
        if self.high <= self.low:
            raise ValueError(f"high is {self.high:g}: must be above low, {self.low:g}")
        return self

    def quantile(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Metres, below which this share of the outliers lies."""
        return np.asarray(self.low + (self.high - self.low) * share)

    @property
    def mean_m(self) -> float:
        """Mean, metres."""
        return (self.low + self.high) / 2


class Acoustics(Table):
    """Modem, schedule and channel. One slot follows another; each starts on the scenario's clock."""

    modem: Modem
    """A packaged modem by name, or a table."""
    slot_s: Positive
    max_range_m: Positive
    """The longest range for which the schedule keeps slots apart: the guard is the travel time over it.
    Beyond it signals still arrive, and collide if they do."""
    guard_s: NonNegative | None = None
    """Instead of the time that follows from max_range_m; the modem's turn-around comes on top."""
    order: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Senders of one cycle; empty: every vehicle once, in their order (round robin)."""
    first_slot_s: NonNegative = 0.0
    packet: Annotated[Literal["f64", "32", "64", "256"], BeforeValidator(_as_text)] = "f64"
    """Form in which navigators that share pose-graphs pack their numbers: float64, or frames of so many bytes."""
    packet_bytes: Annotated[int, Field(ge=1)] | None = None
    """The longest packet that must fit a slot; checked when the mission is simulated."""
    ranging: Literal["one-way", "two-way"] = "one-way"
    """one-way: every receiver of a packet measures its travel time, with synchronised clocks. two-way: a slot holds a
    poll by one teammate and the packet as its reply; the poller alone has the range, whatever the clocks."""
    two_way: TwoWay = TwoWay()
    sound_speed_mps: Positive = 1500.0
    """Sound speed that the navigators assume."""
    sound_speed: SoundSpeed | None = None
    """The water's true sound speed; without it, the one that the navigators assume."""
    sound_speed_error_mps: float = 0.0
    """Added to the true one."""
    sound_speed_error_sigma_mps: NonNegative = 0.0
    """Added to it, drawn for each mission."""
    range_sigma_m: NonNegative = 1.0
    """Of a travel time (two-way: half a round trip), as a range."""
    range_outlier_share: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of ranges by a longer path (multipath): late, never early."""
    range_outlier_m: Annotated[ExponentialOutlier | UniformOutlier, Field(discriminator="distribution")] = (
        ExponentialOutlier()
    )
    """By how much they are too long, metres."""
    range_outlier_hold_s: NonNegative = 0.0
    """How long two vehicles stay in a geometry that has a longer way, or has none; 0: each range by its own chance."""
    loss: Loss = NoLoss()
    losses: Annotated[tuple[Loss, ...], Field(strict=False)] = ()
    """Further losses: a frame must survive them all."""
    clock: Clock = Clock()
    authentication: Authentication = Authentication()

    @model_validator(mode="after")
    def _sound_has_a_speed(self) -> Acoustics:
        true = self.sound_speed_mps + self.sound_speed_error_mps
        if self.sound_speed is None and true <= 0:
            raise ValueError(f"sound_speed_mps + sound_speed_error_mps is {true:g} m/s: must be above 0")
        return self

    @property
    def modem_profile(self) -> ModemFigures:
        """Frames, rate, preamble and turn-around of the modem."""
        return self.modem.figures if isinstance(self.modem, ModemTable) else MODEMS[self.modem]

    @property
    def modem_name(self) -> str:
        """Name of the modem, for tables and logs."""
        return self.modem.name if isinstance(self.modem, ModemTable) else self.modem

    @property
    def travel_s(self) -> float:
        """Time in a slot for the sound to reach every vehicle, seconds."""
        return self.guard_s if self.guard_s is not None else self.max_range_m / self.sound_speed_mps

    @property
    def guard(self) -> float:
        """Silence at the end of a slot, seconds: the sound's travel, then the modem's turn-around."""
        return self.travel_s + self.modem_profile.turnaround_s

    @property
    def reply_turnaround_s(self) -> float:
        """From the end of a poll to the earliest launch of its reply, seconds."""
        return max(self.two_way.turnaround_s, self.modem_profile.turnaround_s)

    @property
    def all_losses(self) -> tuple[Loss, ...]:
        """`loss` and `losses`."""
        return (self.loss, *self.losses)

    @property
    def named_vehicles(self) -> dict[str, list[str]]:
        """By key, the vehicles that this table names."""
        return {"order": list(self.order), "losses": named_vehicles(self.all_losses)}
