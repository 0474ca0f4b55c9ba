"""Losses: the probability that a frame survives, for every signal between two vehicles.

Each model gives a probability for each signal; several multiply. What is drawn against it is drawn elsewhere
and by the pair alone, so that missions stay paired across loss models. A burst channel has a state that evolves
in time for each ordered pair, from a stream of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.reception import (
    ReceptionTable,
    fit_logistic,
    logistic_share,
    monotone_share,
    table_of,
)
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.scenario.acoustics import Acoustics
    from uwcoop.scenario.losses import AspectLoss, BlackoutLoss, BurstLoss, DistanceLoss, Loss

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Signals:
    """Signals of one ordered pair of vehicles, all arrays (K,)."""

    sender: int
    receiver: int
    scheduled_s: Array
    """Launch by the schedule."""
    launch_s: Array
    """True launch, ascending."""
    range_m: Array
    """True slant range, from the sender at launch to the receiver at arrival."""
    off_bow_sender_rad: Array
    """Where the sender saw the receiver: clockwise from its bow."""
    off_bow_receiver_rad: Array
    """Where the receiver saw the sender: clockwise from its bow."""


def survival(acoustics: Acoustics, signals: Signals, names: Sequence[str], seed: int) -> Array:
    """Probability that one frame of each signal survives the losses, collisions aside, (K,).

    Args:
        acoustics: with the losses.
        signals: of one ordered pair.
        names: of the vehicles, for losses that name them.
        seed: of the mission; moves the state of burst channels.
    """
    probability = np.ones(signals.launch_s.size)
    for index, loss in enumerate(acoustics.all_losses):
        probability *= 1.0 - _loss(loss, signals, names, seed, index)
    return probability


def packet_survival(acoustics: Acoustics, frames: int) -> float:
    """Nominal probability that a packet of so many frames arrives, collisions aside.

    For losses that depend on where vehicles are: at the longest range of the schedule, outside of shadows and
    blackouts; for losses between some vehicles only, of the worst pair. Frames of one packet share the state of
    a burst channel.
    """
    total = _worst_independent(acoustics) ** frames
    for loss in acoustics.all_losses:
        if loss.model == "burst":
            bad = loss.bad_share
            total *= (1 - bad) * (1 - loss.loss_good) ** frames + bad * (1 - loss.loss_bad) ** frames
        elif loss.model == "distance":
            total *= float(_share_received(loss, np.array([acoustics.max_range_m]))[0]) ** frames
    return total


def _worst_independent(acoustics: Acoustics) -> float:
    """Probability that a frame survives the independent losses between the pair that loses most."""
    losses = [loss for loss in acoustics.all_losses if loss.model == "independent"]
    senders = {None, *(name for loss in losses for name in loss.senders)}
    receivers = {None, *(name for loss in losses for name in loss.receivers)}
    return min(
        math.prod(1 - loss.probability for loss in losses if loss.concerns(sender, receiver))
        for sender in senders
        for receiver in receivers
        if sender is None or sender != receiver
    )


def survive_probability(acoustics: Acoustics) -> float:
    """Nominal probability that a frame arrives, collisions aside; see `packet_survival`."""
    return packet_survival(acoustics, 1)


def _loss(loss: Loss, signals: Signals, names: Sequence[str], seed: int, index: int) -> Array | float:
    """Probability that one frame is lost to one model."""
    if loss.model == "none":
        return 0.0
    if loss.model == "independent":
        concerned = loss.concerns(names[signals.sender], names[signals.receiver])
        return loss.probability if concerned else 0.0
    if loss.model == "distance":
        return 1.0 - _share_received(loss, signals.range_m)
    if loss.model == "aspect":
        return _in_shadow(loss, signals, names)
    if loss.model == "blackout":
        return _in_blackout(loss, signals, names)
    return _in_burst(loss, signals, seed, index)


def _share_received(loss: DistanceLoss, range_m: Array) -> Array:
    table, curve = _curve(loss)
    if curve is None:
        return monotone_share(table, range_m)
    return logistic_share(*curve, range_m)


@lru_cache(maxsize=8)
def _curve(loss: DistanceLoss) -> tuple[ReceptionTable, tuple[float, float] | None]:
    # A team asks once for each ordered pair.
    table = table_of(loss.table, loss.weights)
    return table, fit_logistic(table) if loss.fit == "logistic" else None


def _in_shadow(loss: AspectLoss, signals: Signals, names: Sequence[str]) -> Array:
    survives = np.ones(signals.launch_s.size)
    for sector in loss.sectors:
        for end, vehicle, bearing in (
            ("sender", signals.sender, signals.off_bow_sender_rad),
            ("receiver", signals.receiver, signals.off_bow_receiver_rad),
        ):
            if sector.end in (end, "both") and (not sector.vehicles or names[vehicle] in sector.vehicles):
                off = np.rad2deg(bearing) - sector.bearing_deg
                inside = np.abs((off + 180.0) % 360.0 - 180.0) <= sector.width_deg / 2
                survives[inside] *= 1.0 - sector.loss
    return 1.0 - survives


def _in_blackout(loss: BlackoutLoss, signals: Signals, names: Sequence[str]) -> Array:
    survives = np.ones(signals.launch_s.size)
    for window in loss.windows:
        if (not window.senders or names[signals.sender] in window.senders) and (
            not window.receivers or names[signals.receiver] in window.receivers
        ):
            inside = (signals.scheduled_s >= window.from_s) & (signals.scheduled_s < window.to_s)
            survives[inside] *= 1.0 - window.loss
    return 1.0 - survives


def _in_burst(loss: BurstLoss, signals: Signals, seed: int, index: int) -> Array:
    step = np.floor(np.maximum(signals.launch_s, 0.0) / loss.step_s).astype(np.int64)
    rng = stream(seed, signals.sender, Purpose.BURST, signals.receiver, index)
    # The chain runs from the mission's start whether or not there are signals: slots do not shift it.
    bad = burst_states(loss, int(step.max(initial=-1)) + 1, rng)[step]
    return np.where(bad, loss.loss_bad, loss.loss_good)


def burst_states(loss: BurstLoss, count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Gilbert-Elliott channel: whether it is bad in each of so many steps; starts in its long-run mixture.

    One uniform number drives each step. It sends both states to bad, both to good, or (in between) keeps the
    state, or swaps it where p_good_to_bad + p_bad_to_good is above 1: so the state is that of the last step
    which sent both to the same.
    """
    if count == 0:
        return np.zeros(0, dtype=bool)
    u = rng.random(count)
    to_bad, stay_bad = loss.p_good_to_bad, 1.0 - loss.p_bad_to_good
    low, high = min(to_bad, stay_bad), max(to_bad, stay_bad)
    settled = (u < low) | (u >= high)
    bad = u < low
    settled[0], bad[0] = True, u[0] < loss.bad_share
    k = np.arange(count)
    last = np.maximum.accumulate(np.where(settled, k, 0))
    swaps = (k - last) % 2 == 1 if to_bad > stay_bad else np.zeros(count, dtype=bool)
    return np.asarray(bad[last] ^ swaps)


def off_bow_rad(yaw_rad: Array, own_m: Array, other_m: Array) -> Array:
    """Relative bearing of another vehicle, clockwise from the own bow, (K,), within ±π."""
    de, dn = (other_m - own_m).T
    off = yaw_rad - np.arctan2(dn, de)
    return np.asarray((off + math.pi) % (2 * math.pi) - math.pi)
