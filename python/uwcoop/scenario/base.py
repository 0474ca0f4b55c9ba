"""What all scenario models share: frozen, strict, unknown keys refused with the nearest known one."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

NAME = r"^[A-Za-z0-9_-]+$"
"""What names of scenarios and vehicles are made of: no dots, which separate keys in overrides."""
NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
Point = Annotated[tuple[float, float], Field(strict=False)]
"""East and north, metres (or metres per second for a velocity)."""
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=360)]
PlaceDeg = Annotated[tuple[Latitude, Longitude], Field(strict=False)]
"""Latitude and longitude, degrees, WGS 84."""


class Table(BaseModel):
    """One table of a scenario file."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, validate_default=True
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        # Before pydantic does, because only here the model's own keys are at hand for a suggestion.
        if isinstance(data, dict):
            for key in data:
                if key not in cls.model_fields:
                    raise PydanticCustomError(
                        "unknown_key",
                        "{hint}",
                        {"key": str(key), "hint": nearest(str(key), cls.model_fields)},
                    )
        return data


def nearest(key: str, known: Any) -> str:
    """A hint for an unknown key: the nearest known one, or all of them."""
    close = get_close_matches(key, list(known), n=1)
    return f"did you mean {close[0]!r}?" if close else f"known: {', '.join(sorted(known))}"
