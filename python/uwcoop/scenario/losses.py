"""Losses of the acoustic channel: `[acoustics.loss]`, or several that multiply as `[[acoustics.losses]]`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from uwcoop.acoustics.reception import fit_logistic, read_reception, table_of
from uwcoop.scenario.base import NonNegative, Point, Positive, Probability, Table

Names = Annotated[tuple[str, ...], Field(strict=False)]
"""Vehicles by name; empty: all."""


class NoLoss(Table):
    """Every frame arrives."""

    model: Literal["none"] = "none"


class IndependentLoss(Table):
    """Each frame is lost with the same probability, independently of the others."""

    model: Literal["independent"] = "independent"
    probability: Probability
    senders: Names = ()
    receivers: Names = ()

    def concerns(self, sender: str | None, receiver: str | None) -> bool:
        """Whether it matters between these vehicles; None stands for any that no loss names."""
        return (not self.senders or sender in self.senders) and (
            not self.receivers or receiver in self.receivers
        )


class RangeTestColumns(Table):
    """Names of a range test's columns: shares, or numbers of signals received and sent."""

    distance: str = "distance_m"
    """Metres."""
    share: str | None = None
    """Without any of the three: "share"."""
    received: str | None = None
    sent: str | None = None


class DistanceLoss(Table):
    """Loss that grows with slant range, as measured in a range test."""

    model: Literal["distance"]
    table: Annotated[tuple[Point, ...], Field(strict=False, min_length=1)]
    """Rows of [distance_m, share received], in any order."""
    weights: Annotated[tuple[Positive, ...], Field(strict=False)] = ()
    """Of the rows, e.g. signals sent; without them all rows have the same weight."""
    file: str | None = None
    """CSV of a range test, relative to the scenario file; read when there is no table, which it then gives."""
    columns: RangeTestColumns = RangeTestColumns()
    fit: Literal["monotone", "logistic"] = "monotone"
    """monotone: shares that never rise, straight between rows, constant beyond them. logistic: 1 / (1 +
    exp((range - half) / width))."""

    @model_validator(mode="before")
    @classmethod
    def _read_the_file(cls, data: Any) -> Any:
        # The numbers become part of the scenario, so that a log or a study does not depend on the file.
        if not isinstance(data, dict) or "table" in data or not isinstance(data.get("file"), str):
            return data
        try:
            columns = RangeTestColumns.model_validate(data.get("columns", {}))
        except ValidationError as error:
            found = error.errors(include_url=False)[0]
            key = ".".join(str(part) for part in ("columns", *found["loc"]))
            raise ValueError(f"{key}: {found['msg']}") from None
        read = read_reception(data["file"], **columns.model_dump())
        rows = [list(row) for row in zip(read.distance_m.tolist(), read.share.tolist(), strict=True)]
        return {**data, "table": rows, "weights": read.weight.tolist()}

    @model_validator(mode="after")
    def _can_be_fitted(self) -> DistanceLoss:
        table = table_of(self.table, self.weights)
        if self.fit == "logistic":
            fit_logistic(table)
        return self


class BurstLoss(Table):
    """Gilbert-Elliott: a channel that is good or bad, and changes as time goes by; each ordered pair its own."""

    model: Literal["burst"]
    p_good_to_bad: Probability
    """Probability of changing from one step to the next."""
    p_bad_to_good: Probability
    loss_good: Probability = 0.0
    """Probability that a frame is lost while the channel is good."""
    loss_bad: Probability = 1.0
    step_s: Positive = 1.0
    """Time between chances to change. The mean stay in bad is step_s / p_bad_to_good."""

    @model_validator(mode="after")
    def _changes_at_all(self) -> BurstLoss:
        if self.p_good_to_bad + self.p_bad_to_good == 0:
            raise ValueError("p_good_to_bad and p_bad_to_good are both 0: one must be above 0")
        return self

    @property
    def bad_share(self) -> float:
        """Share of time in which the channel is bad, in the long run."""
        return self.p_good_to_bad / (self.p_good_to_bad + self.p_bad_to_good)


class Sector(Table):
    """Relative bearings at which reception or transmission is poor, e.g. past the vehicle's own thruster."""

    bearing_deg: float = 180.0
    """Middle of the sector, clockwise from the bow; 180 is astern."""
    width_deg: Annotated[float, Field(gt=0, le=360)]
    loss: Probability
    """Probability that a frame through the sector is lost."""
    end: Literal["sender", "receiver", "both"] = "both"
    """Whether it matters for what the vehicle sends, for what it receives, or for both."""
    vehicles: Names = ()


class AspectLoss(Table):
    """Loss that depends on the relative bearing of the other vehicle: shadows of thrusters and hulls."""

    model: Literal["aspect"]
    sectors: Annotated[tuple[Sector, ...], Field(strict=False, min_length=1)]
    """Sectors that overlap, or lie at both ends, multiply what survives."""


class Blackout(Table):
    """A time window in which some directions fail."""

    from_s: NonNegative
    to_s: Positive
    """Slots that launch at from_s or later and before to_s."""
    senders: Names = ()
    receivers: Names = ()
    loss: Probability = 1.0

    @model_validator(mode="after")
    def _forward(self) -> Blackout:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s is {self.to_s:g}: must be above from_s, {self.from_s:g}")
        return self


class BlackoutLoss(Table):
    """Losses by time and direction."""

    model: Literal["blackout"]
    windows: Annotated[tuple[Blackout, ...], Field(strict=False, min_length=1)]


def _loss_model(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("model", "independent"))
    return str(getattr(value, "model", "independent"))


Loss = Annotated[
    Annotated[NoLoss, Tag("none")]
    | Annotated[IndependentLoss, Tag("independent")]
    | Annotated[DistanceLoss, Tag("distance")]
    | Annotated[BurstLoss, Tag("burst")]
    | Annotated[AspectLoss, Tag("aspect")]
    | Annotated[BlackoutLoss, Tag("blackout")],
    Discriminator(_loss_model),
]


def named_vehicles(losses: tuple[Loss, ...]) -> list[str]:
    """Vehicles that losses name."""
    names: list[str] = []
    for loss in losses:
        if isinstance(loss, AspectLoss):
            names += [name for sector in loss.sectors for name in sector.vehicles]
        elif isinstance(loss, BlackoutLoss):
            names += [name for window in loss.windows for name in (*window.senders, *window.receivers)]
        elif isinstance(loss, IndependentLoss):
            names += [*loss.senders, *loss.receivers]
    return names


__all__ = [
    "AspectLoss",
    "Blackout",
    "BlackoutLoss",
    "BurstLoss",
    "DistanceLoss",
    "IndependentLoss",
    "Loss",
    "NoLoss",
    "RangeTestColumns",
    "Sector",
    "named_vehicles",
]
