"""`[acoustics.sound_speed]`: the water's true sound speed, of the sea, of lakes and rivers, or as a cast measured it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from uwcoop.acoustics.sea_water import SALINITY_PSU, TEMPERATURE_C
from uwcoop.acoustics.sound_profile import CastColumns, read_cast
from uwcoop.acoustics.teos10 import SALINITY_PSU as ANY_SALINITY_PSU
from uwcoop.acoustics.teos10 import TEMPERATURE_C as ANY_TEMPERATURE_C
from uwcoop.scenario.base import Point, Table


class Mackenzie(Table):
    """Sea water whose sound speed follows from temperature, salinity and depth (Mackenzie 1981)."""

    model: Literal["mackenzie"]
    temperature_c: Annotated[float, Field(ge=TEMPERATURE_C[0], le=TEMPERATURE_C[1])]
    salinity_psu: Annotated[float, Field(ge=SALINITY_PSU[0], le=SALINITY_PSU[1])]


class Teos10(Table):
    """Fresh, brackish or sea water of one temperature and salinity (TEOS-10, by the library gsw)."""

    model: Literal["teos-10"]
    temperature_c: Annotated[float, Field(ge=ANY_TEMPERATURE_C[0], le=ANY_TEMPERATURE_C[1])]
    """In situ."""
    salinity_psu: Annotated[float, Field(ge=ANY_SALINITY_PSU[0], le=ANY_SALINITY_PSU[1])] = 0.0
    """Practical salinity; 0 is fresh."""


class ProfileColumns(Table):
    """Names of a cast's columns: depth, and either sound speed or temperature (with salinity, if it has any)."""

    depth: str = "depth_m"
    """Metres, positive down."""
    speed: str | None = None
    """m/s. Without any of the three: "sound_speed_mps"."""
    temperature: str | None = None
    """°C, in situ."""
    salinity: str | None = None
    """Practical salinity; without it fresh water."""


class SoundSpeedProfile(Table):
    """Sound speed by depth, straight between its rows and constant beyond them. A signal's mean speed between two depths
    is the harmonic mean along the straight ray."""

    model: Literal["profile"]
    table: Annotated[tuple[Point, ...], Field(strict=False, min_length=2)]
    """Rows of [depth_m, sound speed in m/s], in any order."""
    file: str | None = None
    """Text table of a cast, relative to the scenario file; read when there is no table, which it then gives."""
    columns: ProfileColumns = ProfileColumns()

    @model_validator(mode="before")
    @classmethod
    def _read_the_file(cls, data: Any) -> Any:
        # The numbers become part of the scenario, so that a log or a study does not depend on the file.
        if not isinstance(data, dict) or "table" in data or not isinstance(data.get("file"), str):
            return data
        columns = ProfileColumns.model_validate(data.get("columns", {}))
        cast = read_cast(data["file"], CastColumns(**columns.model_dump()))
        return {**data, "table": [[depth, speed] for depth, speed in cast]}

    @model_validator(mode="after")
    def _is_a_profile(self) -> SoundSpeedProfile:
        depths = [depth for depth, _ in self.table]
        if len(set(depths)) < len(depths) or min(depths) < 0:
            raise ValueError("table needs depths at least 0, no two the same")
        wrong = next((speed for _, speed in self.table if not 1300 <= speed <= 1700), None)
        if wrong is not None:
            raise ValueError(f"table has a sound speed of {wrong:g} m/s: must be within 1300 to 1700")
        return self


SoundSpeed = Annotated[Mackenzie | Teos10 | SoundSpeedProfile, Field(discriminator="model")]
