"""The `[acoustics]` table: modem, schedule, sound speed, clocks and losses."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from uwcoop.scenario.base import NonNegative, Positive, Probability, Table

Modem = Literal["micromodem-32", "micromodem-64", "micromodem-256", "aloc", "unlimited"]


class NoLoss(Table):
    """Every frame arrives."""

    model: Literal["none"] = "none"


class IndependentLoss(Table):
    """Each frame is lost with the same probability, whatever happened to the others."""

    model: Literal["independent"] = "independent"
    probability: Probability


def _loss_model(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("model", "independent"))
    return str(getattr(value, "model", "independent"))


Loss = Annotated[
    Annotated[NoLoss, Tag("none")] | Annotated[IndependentLoss, Tag("independent")],
    Discriminator(_loss_model),
]


class Clock(Table):
    """Errors of each vehicle's clock, drawn for each mission."""

    offset_sigma_s: NonNegative = 0.0
    """At the start of the mission."""
    drift_sigma_ppm: NonNegative = 0.0


class Acoustics(Table):
    """Who talks when over what. One slot after another; each starts on the scenario's clock."""

    modem: Modem
    slot_s: Positive
    max_range_m: Positive
    """The longest range for which the schedule keeps slots apart: the guard is what sound takes for it.
    Beyond it signals still arrive, and collide if they do."""
    guard_s: NonNegative | None = None
    """Instead of the guard that follows from max_range_m."""
    order: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Senders of one cycle; empty: every vehicle once, in their order (round robin)."""
    first_slot_s: NonNegative = 0.0
    packet_bytes: Annotated[int, Field(ge=1)] | None = None
    """The longest packet that must fit a slot; checked when the mission is simulated."""
    sound_speed_mps: Positive = 1500.0
    """What the navigators believe."""
    sound_speed_error_mps: float = 0.0
    """True minus believed."""
    sound_speed_error_sigma_mps: NonNegative = 0.0
    """Added to it, drawn for each mission."""
    range_sigma_m: NonNegative = 1.0
    """Of a one-way travel time, as a range."""
    loss: Loss = NoLoss()
    clock: Clock = Clock()

    @model_validator(mode="after")
    def _sound_has_a_speed(self) -> Acoustics:
        true = self.sound_speed_mps + self.sound_speed_error_mps
        if true <= 0:
            raise ValueError(f"sound_speed_mps + sound_speed_error_mps is {true:g} m/s: must be above 0")
        return self

    @property
    def guard(self) -> float:
        """Silence at the end of a slot, seconds."""
        return self.guard_s if self.guard_s is not None else self.max_range_m / self.sound_speed_mps
