"""What the speed of sound truly is in a mission."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.sea_water import DEPTH_M, mackenzie_mps
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

    Speed is close to linear in depth over the depths that vehicles span, so that the ray's mean speed is the
    speed half way.
    """
    error = true_sound_speed_mps(acoustics, seed) - float(_of_the_water(acoustics, 0.0))
    if acoustics.sound_speed is None:
        return np.full(depth_a_m.shape, acoustics.sound_speed_mps + error)
    return _of_the_water(acoustics, (depth_a_m + depth_b_m) / 2) + error


def _of_the_water(acoustics: Acoustics, depth_m: ArrayLike) -> NDArray[np.float64]:
    water = acoustics.sound_speed
    if water is None:
        return np.full(np.shape(depth_m), acoustics.sound_speed_mps)
    return mackenzie_mps(water.temperature_c, water.salinity_psu, np.clip(depth_m, *DEPTH_M))
