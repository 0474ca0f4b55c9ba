"""Mutual positioning: two-way slant range and both directions between a vehicle and the landmark, with what goes wrong.

The vehicle asks at `transmit_ns`. The landmark measures where the question comes from, and answers after its
turn-around with one signal that tells this direction and its depth, and a chirp. The vehicle ranges on the chirp and
measures its direction at `t_ns`. In the mission nothing of it depends on a navigator.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.modem import link_of
from uwcoop.acoustics.sound import sound_speed_between_mps
from uwcoop.frames import wrap_angle
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog.model import Columns
    from uwcoop.scenario.models import Scenario
    from uwcoop.world.landmark.hovering import HoverMotion

    Array = NDArray[np.float64]
    Indices = NDArray[np.int64]

CHANNELS = 3
"""Range, own bearing, peer's bearing."""
DEPTH_STEP_M = 0.1
"""The reply tells the landmark's depth in steps of so much."""


@dataclass(frozen=True)
class Luck:
    """One vehicle's draws for each of its instants of positioning, whether or not it asks then."""

    noise: Array
    """(K, 3) standard normal: range, own bearing, peer's bearing."""
    replied: NDArray[np.bool_]
    """(K,) the question gets a reply."""
    measured: NDArray[np.bool_]
    """(K, 3) the reply yields this measurement."""
    outlier: NDArray[np.bool_]
    """(K, 3) the measurement has nothing to do with the truth."""
    elsewhere: Array
    """(K, 3) uniform: where an outlier lies."""

    @classmethod
    def drawn(cls, scenario: Scenario, seed: int, vehicle: int) -> Luck:
        """For the whole mission."""
        mutual = scenario.mutual
        count = math.floor(scenario.duration_s / mutual.interval_s) + 1
        noise = stream(seed, vehicle, Purpose.MUTUAL_NOISE).standard_normal((count, CHANNELS))
        luck = stream(seed, vehicle, Purpose.MUTUAL_LUCK).random((count, 1 + 3 * CHANNELS))
        return cls(
            noise=noise,
            replied=luck[:, 0] >= mutual.dropout_share,
            measured=luck[:, 1:4] >= mutual.channel_dropout_share,
            outlier=luck[:, 4:7] < mutual.outlier_share,
            elsewhere=luck[:, 7:10],
        )


def delay_s(scenario: Scenario) -> float:
    """From a question's arrival at the landmark to the chirp of its reply, seconds."""
    link = link_of(scenario.acoustics)
    return scenario.mutual.turnaround_s + link.preamble_s + link.frame_s


def acoustic_fixes(
    scenario: Scenario,
    seed: int,
    pair: tuple[int, int],
    motion: tuple[HoverMotion, HoverMotion],
    asked: tuple[Indices, Array],
    luck: Luck,
) -> Columns:
    """What one vehicle measures of one landmark.

    Args:
        scenario: with the table `mutual`, and the sound speed.
        seed: of the mission.
        pair: index of the vehicle that asks, and of the landmark.
        motion: of these two.
        asked: which of its instants of positioning (K,), and when it asks, seconds (K,).
        luck: the vehicle's draws.

    Returns:
        Columns of `acoustic_fix` events; a measurement that is missing is NaN, a reply without any is left out.
    """
    mutual = scenario.mutual
    index, t_s = asked
    mover, landmark = motion
    speed = sound_speed_between_mps(scenario.acoustics, seed, mover.depth_at(t_s), landmark.depth_at(t_s))
    way_out = _distance(mover, t_s, landmark, t_s) / speed
    heard_s = t_s + way_out
    replied_s = heard_s + delay_s(scenario)
    received_s = replied_s + _distance(mover, replied_s, landmark, replied_s) / speed
    out, back = (landmark.position_at(t) - mover.position_at(t) for t in (t_s, received_s))
    known = scenario.acoustics.sound_speed_mps / speed
    values = np.column_stack(
        [
            known
            * (_distance(mover, t_s, landmark, t_s) + _distance(mover, received_s, landmark, received_s))
            / 2,
            np.arctan2(back[:, 1], back[:, 0]) - mover.yaw_at(received_s),
            np.arctan2(-out[:, 1], -out[:, 0]) - landmark.yaw_at(heard_s),
        ]
    )
    sigma = [mutual.range_sigma_m, *np.radians([mutual.own_bearing_sigma_deg, mutual.peer_bearing_sigma_deg])]
    values = values + np.array(sigma) * luck.noise[index]
    low, high = mutual.outlier_range_m
    elsewhere = luck.elsewhere[index] * [high - low, 2 * math.pi, 2 * math.pi] + [low, -math.pi, -math.pi]
    values = np.where(luck.outlier[index], elsewhere, values)
    values[:, 1:] = wrap_angle(values[:, 1:])
    valid = luck.measured[index].copy()
    valid[:, 0] &= values[:, 0] > 0  # noise can make a short range negative: the unit drops it
    values[~valid] = np.nan
    told_m = np.round(landmark.depth_at(replied_s) / DEPTH_STEP_M) * DEPTH_STEP_M
    near = _distance(mover, t_s, landmark, t_s) <= mutual.max_range_m
    kept = luck.replied[index] & near & (received_s <= mover.end_s) & np.isfinite(values).any(axis=1)
    return {
        "t_ns": np.round(received_s[kept] * 1e9).astype(np.int64),
        "vehicle": np.full(int(kept.sum()), pair[0], dtype=np.int64),
        "peer": np.full(int(kept.sum()), pair[1], dtype=np.int64),
        "transmit_ns": np.round(t_s[kept] * 1e9).astype(np.int64),
        "range_m": values[kept, 0],
        "own_bearing_rad": values[kept, 1],
        "peer_bearing_rad": values[kept, 2],
        "peer_depth_m": told_m[kept],
    }


def _distance(a: HoverMotion, at_s: Array, b: HoverMotion, bt_s: Array) -> Array:
    """Slant distance, metres, (K,)."""
    flat = b.position_at(bt_s) - a.position_at(at_s)
    return np.asarray(np.sqrt((flat**2).sum(axis=1) + (b.depth_at(bt_s) - a.depth_at(at_s)) ** 2))
