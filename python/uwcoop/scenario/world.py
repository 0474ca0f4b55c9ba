"""Tables of the world around the vehicles: water current, tide and waves."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from uwcoop.scenario.base import NonNegative, Point, Positive, Table


class NoCurrent(Table):
    """Still water."""

    model: Literal["none"] = "none"


class ConstantCurrent(Table):
    """The same current everywhere and always: a vector, or a speed in a given or random direction."""

    model: Literal["constant"]
    velocity_mps: Point | None = None
    """Eastward and northward."""
    speed_mps: NonNegative | None = None
    direction_deg: float | None = None
    """Where the water flows to, clockwise from north; without it a random direction for each mission."""

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> ConstantCurrent:
        if (self.velocity_mps is None) == (self.speed_mps is None):
            raise ValueError("needs exactly one of velocity_mps and speed_mps")
        if self.direction_deg is not None and self.speed_mps is None:
            raise ValueError("direction_deg goes with speed_mps, not with velocity_mps")
        return self


class RandomWalkCurrent(Table):
    """One current for the whole team, a random walk."""

    model: Literal["random-walk"]
    walk_mps_per_sqrt_s: NonNegative
    """Growth of its standard deviation on each axis."""
    initial_mps: Point = (0.0, 0.0)
    initial_sigma_mps: NonNegative = 0.0
    """On each axis, drawn for each mission."""


Current = Annotated[NoCurrent | ConstantCurrent | RandomWalkCurrent, Field(discriminator="model")]


class Tide(Table):
    """How much deeper than the chart the water is: an offset for each mission, and a sinusoid."""

    offset_m: float = 0.0
    offset_sigma_m: NonNegative = 0.0
    """Drawn for each mission."""
    amplitude_m: NonNegative = 0.0
    period_s: Positive = 44714.0
    """The principal lunar tide, 12.42 hours."""
    phase_deg: float = 0.0
    """At the start of the mission; 0 is mean water, rising."""


class Waves(Table):
    """Waves that move vehicles to and fro, each with its own phase; the commanded velocity does not contain them.

    Recorded tracks hold their own waves: these are for planned paths.
    """

    amplitude_m: NonNegative = 0.0
    """Of the sinusoid about the planned track."""
    period_s: Annotated[float, Field(ge=4)] = 12.0
    """At least four seconds: the world moves in steps of one."""
    direction_deg: float | None = None
    """The axis of the motion, clockwise from north; without it, across each vehicle's track."""
