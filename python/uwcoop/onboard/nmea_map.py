"""Which sentences become which sensor events: a TOML file with one table for each kind of event."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from uwcoop.errors import ScenarioError
from uwcoop.importers.bounded import read_text
from uwcoop.scenario.base import NonNegative, Positive, Table
from uwcoop.scenario.validation_message import one_line

__all__ = ["DepthMap", "FixMap", "HeadingMap", "NmeaMap", "VelocityMap", "WaterDepthMap", "read_map"]

_MAP_LIMIT_BYTES = 2**20
Declination = Annotated[float, Field(ge=-180, le=180)]


class Mapped(Table):
    """What all tables have."""

    latency_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """From the measurement to the sentence's arrival: the event is stamped so much earlier."""


class FixMap(Mapped):
    """`fix` from GNSS."""

    sentence: Literal["GGA", "RMC"]
    sigma_m: Positive
    """Per axis, at an HDOP of 1: GGA's HDOP multiplies it, where it is above 1."""
    stamp: Literal["arrival", "utc"] = "arrival"
    """`utc`: the sentence's time of day, for clocks on GNSS time."""


class HeadingMap(Mapped):
    """`heading` from a compass or gyro."""

    sentence: Literal["HDT", "HDG"]
    sigma_deg: Positive
    declination_deg: Declination | Literal["sentence"] | None = None
    """Of HDG: added, positive to the east. `sentence`: the variation that HDG states."""
    mounting_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    """Added: from the sensor's forward to the vehicle's, clockwise."""

    @model_validator(mode="after")
    def _needs_a_north(self) -> HeadingMap:
        if (self.sentence == "HDG") == (self.declination_deg is None):
            raise ValueError(
                "declination_deg goes with HDG, which is magnetic: a number of degrees or 'sentence'; HDT is true"
            )
        return self


class VelocityMap(Mapped):
    """`motion` (east, north) or `ground_velocity` (forward, left)."""

    sentence: Literal["RMC", "VTG", "PNORBT4", ":BE", ":BS", "DVPDL", "DVPDX"]
    sigma_mps: Positive | None = None
    """Of `ground_velocity`."""
    declination_deg: Declination | None = None
    """Of :BE: its north is the DVL's heading sensor's; 0 where that is true north."""
    mounting_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    """Of what is in the sensor's frame: from the vehicle's forward to the sensor's, clockwise."""

    @model_validator(mode="after")
    def _needs_a_north(self) -> VelocityMap:
        if (self.sentence == ":BE") == (self.declination_deg is None):
            raise ValueError("declination_deg goes with :BE: 0 where the DVL's heading is true")
        if self.mounting_deg and self.sentence not in BODY:
            raise ValueError(f"mounting_deg goes with velocities of the body: {', '.join(BODY)}")
        return self


BODY = (":BS", "DVPDL", "DVPDX")


class DepthMap(Mapped):
    """`depth` from a DVL's pressure sensor."""

    sentence: Literal[":TS"]
    sigma_m: Positive


class WaterDepthMap(Mapped):
    """`water_depth`: the distance to the seabed and the transducer's own depth."""

    sentence: Literal["DBT", "DPT", "PNORBT4", ":BD"]
    sigma_m: Positive
    transducer: NonNegative | Literal["depth", "sentence"]
    """Its depth: metres (a craft at the surface), the last `depth` event of at most 2 s ago, or DPT's positive offset."""

    @model_validator(mode="after")
    def _offset_is_of_dpt(self) -> WaterDepthMap:
        if self.transducer == "sentence" and self.sentence != "DPT":
            raise ValueError(f"transducer 'sentence' goes with DPT: {self.sentence} states no offset")
        return self


class NmeaMap(Table):
    """The whole file."""

    fix: FixMap | None = None
    heading: HeadingMap | None = None
    motion: VelocityMap | None = None
    ground_velocity: VelocityMap | None = None
    depth: DepthMap | None = None
    water_depth: WaterDepthMap | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> NmeaMap:
        if not self.kinds():
            raise ValueError("no table: nothing would come of any sentence")
        if self.motion is not None and self.motion.sigma_mps is not None:
            raise ValueError("motion.sigma_mps: motion has none, its noise is the navigator's")
        if self.ground_velocity is not None:
            if self.ground_velocity.sentence not in BODY:
                raise ValueError(
                    f"ground_velocity.sentence is {self.ground_velocity.sentence}: must be of {', '.join(BODY)}"
                )
            if self.ground_velocity.sigma_mps is None:
                raise ValueError("ground_velocity.sigma_mps is missing")
        if self.motion is not None and self.motion.sentence in BODY and self.heading is None:
            raise ValueError(
                f"motion from {self.motion.sentence} is turned by the heading: a table heading is missing"
            )
        return self

    def kinds(self) -> dict[str, Mapped]:
        """The tables that are there, by kind of event; heading and depth first, which others are derived from."""
        order = ("heading", "depth", "fix", "motion", "ground_velocity", "water_depth")
        return {kind: table for kind in order if (table := getattr(self, kind)) is not None}


def read_map(path: Path) -> NmeaMap:
    """Read a mapping.

    Raises:
        ScenarioError: one line that names what is wrong.
    """
    try:
        table: dict[str, Any] = tomllib.loads(read_text(path, _MAP_LIMIT_BYTES))
    except OSError as error:
        raise ScenarioError(f"mapping {path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"mapping {path} is no TOML: {error}") from None
    try:
        return NmeaMap.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(one_line(error, table, str(path))) from None
