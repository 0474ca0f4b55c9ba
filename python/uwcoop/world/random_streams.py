"""Random streams: a seed and a name give a stream, so one consumer's draws never shift another's.

Every stream belongs to one vehicle (or the whole team) and one purpose. Adding a vehicle, a sensor or a modem
leaves the noise of all the others as it was; two scenarios that differ in one thing stay paired in everything
else.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

TEAM = 0xFFFF
"""Stands in a stream's name where a vehicle's index would, for what the whole team shares."""


class Purpose(IntEnum):
    """What a stream is for. The numbers are part of what a seed means: append, never renumber."""

    PATH = 0
    COMPASS = 1
    THRUSTER = 2
    VELOCITY_NOISE = 3
    VELOCITY_BIAS = 4
    CURRENT = 5
    TIDE = 6
    FIX = 7
    WATER_DEPTH = 8
    DEPTH = 9
    HEADING = 10
    TURN_RATE = 11
    GROUND_VELOCITY = 12
    ODOMETRY = 13
    GPS = 14
    SOUND_SPEED = 15
    CLOCK = 16
    RANGE = 17
    LOSS = 18
    ACOUSTIC_FIX = 19
    BURST = 20
    RANGE_OUTLIER = 21
    WAVES = 22
    POLL = 23
    SURVEY = 24
    SEABED = 25
    SENSOR_FAULTS = 26
    LANDING = 50
    DEPLOYMENT = 51
    MUTUAL_NOISE = 52
    MUTUAL_LUCK = 53
    EXCHANGE = 54
    EXCHANGE_TIME = 55


def stream(seed: int, vehicle: int, purpose: Purpose, *more: int) -> np.random.Generator:
    """The random generator of one vehicle (or `TEAM`) for one purpose.

    Args:
        seed: the mission's seed, 0 or above.
        vehicle: index of the vehicle, or `TEAM`.
        purpose: what the draws are for.
        more: further names, e.g. the receiver of an acoustic link.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(vehicle, int(purpose), *more)))
