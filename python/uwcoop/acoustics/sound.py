"""What the speed of sound truly is in a mission."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.sea_water import DEPTH_M, mackenzie_mps
from uwcoop.acoustics.sound_profile import Profile
from uwcoop.acoustics.teos10 import teos10_mps
from uwcoop.scenario.water import SoundSpeedProfile, Teos10
from uwcoop.world.random_streams import TEAM, Purpose, stream

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from uwcoop.scenario.acoustics import Acoustics


def true_sound_speed_mps(acoustics: Acoustics, seed: int, depth_m: float = 0.0) -> float:
    """The mission's sound speed, m/s: the water's (or what navigators believe) plus its error.

    Args:
        acoustics: what is believed, and the water's model if it has one.
        seed: of the mission, which draws the error.
        depth_m: for a model that knows depth; outside of its range the nearest depth counts.
    """
    drawn = stream(seed, TEAM, Purpose.SOUND_SPEED).standard_normal() * acoustics.sound_speed_error_sigma_mps
    return float(_of_the_water(acoustics, depth_m)) + acoustics.sound_speed_error_mps + float(drawn)


def sound_speed_between_mps(
    acoustics: Acoustics, seed: int, depth_a_m: NDArray[np.float64], depth_b_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """True sound speed along straight rays between two depths, m/s, (K,).

    Of a profile it is the harmonic mean between the depths. The equations of uniform water are close to linear in
    depth over the depths that vehicles span, so that the mean is the speed half way.
    """
    error = true_sound_speed_mps(acoustics, seed) - float(_of_the_water(acoustics, 0.0))
    water = acoustics.sound_speed
    if water is None:
        return np.full(depth_a_m.shape, acoustics.sound_speed_mps + error)
    if isinstance(water, SoundSpeedProfile):
        return _profile(water.table).between(depth_a_m, depth_b_m) + error
    return _of_the_water(acoustics, (depth_a_m + depth_b_m) / 2) + error


def profile_note(acoustics: Acoustics, depth_m: NDArray[np.float64]) -> str | None:
    """What is assumed where vehicles are outside of the profile's depths; None where they are not, or there is none."""
    water = acoustics.sound_speed
    if not isinstance(water, SoundSpeedProfile):
        return None
    top_m, bottom_m = _profile(water.table).span_m
    low, high = float(np.min(depth_m)), float(np.max(depth_m))
    if low >= top_m and high <= bottom_m:
        return None
    return (
        f"sound speed: the profile covers {top_m:g} to {bottom_m:g} m, vehicles are at {low:g} to {high:g} m: its last "
        "value holds beyond it"
    )


@lru_cache(maxsize=8)
def _profile(table: tuple[tuple[float, float], ...]) -> Profile:
    return Profile(table)


def _of_the_water(acoustics: Acoustics, depth_m: ArrayLike) -> NDArray[np.float64]:
    water = acoustics.sound_speed
    if water is None:
        return np.full(np.shape(depth_m), acoustics.sound_speed_mps)
    if isinstance(water, SoundSpeedProfile):
        return _profile(water.table).at(np.asarray(depth_m))
    if isinstance(water, Teos10):
        return teos10_mps(water.temperature_c, water.salinity_psu, np.clip(depth_m, *DEPTH_M))
    return mackenzie_mps(water.temperature_c, water.salinity_psu, np.clip(depth_m, *DEPTH_M))
