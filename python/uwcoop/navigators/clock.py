"""What may be wrong with ranges, as navigators are told it: clocks, sound speed, late arrivals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from uwcoop.scenario.acoustics import Acoustics

__all__ = ["ClockOptions", "clock_of"]


class ClockOptions(BaseModel):
    """Errors of one-way ranges. Values that are not stated follow the scenario's `acoustics`; 0: no such error."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    offset_sigma_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Sigma of each vehicle's clock error at the start of the mission."""
    drift_sigma_ppm: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Sigma of each clock's drift."""
    sound_speed_sigma_mps: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Sigma of the sound speed's error."""
    late_share: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    """Share of ranges by a longer path (multipath)."""
    lateness_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 20.0
    """Their mean excess length."""


def clock_of(acoustics: Acoustics) -> dict[str, float]:
    """The errors of ranges that the scenario states as sigmas and shares, as `ClockOptions`.

    Two-way ranging does not depend on differences between clocks. Errors of a given amount are not in it: a navigator
    cannot know them.
    """
    one_way, clock = acoustics.ranging == "one-way", acoustics.clock
    return {
        "offset_sigma_s": clock.offset_sigma_s if one_way else 0.0,
        "drift_sigma_ppm": clock.drift_sigma_ppm if one_way else 0.0,
        "sound_speed_sigma_mps": acoustics.sound_speed_error_sigma_mps,
        "late_share": min(acoustics.range_outlier_share, 0.9),
        "lateness_m": acoustics.range_outlier_m.mean_m,
    }
