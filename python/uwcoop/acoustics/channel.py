"""The channel: what each vehicle can hear of each slot, when its clock says so, and what is lost on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.losses import Signals, off_bow_rad, survival
from uwcoop.acoustics.modem import air_time_s, link_of, poll_air_s
from uwcoop.acoustics.schedule import RESIDENCE_BYTES, lead_s, pollers_of, slot_frames
from uwcoop.acoustics.sound import sound_speed_between_mps
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.missionlog.model import Columns
    from uwcoop.scenario.acoustics import Acoustics
    from uwcoop.world.vehicles import Motion

    Array = NDArray[np.float64]
    Indices = NDArray[np.int64]


def opportunities(
    acoustics: Acoustics, slots: Columns, motion: Sequence[Motion], seed: int, names: Sequence[str] = ()
) -> Columns:
    """What each vehicle can hear of each slot.

    One-way: a packet leaves when the sender's clock shows the slot's time and is stamped by the receiver's
    clock; the range is slant, from the sender at launch to the receiver at arrival. Two-way: in each slot one
    teammate, in turn, polls the sender and alone gets the packet with a range: `toa_ns` is `tol_ns` plus half
    the round trip on the poller's own clock, less the time for which the sender says that it held the poll. No
    clock's offset is in it; what clocks drift within an exchange of seconds (centimetres at 20 ppm) is left
    out. A receiver that is itself sending (half duplex), or that hears another signal at the same time, loses
    every frame; both are judged with slots filled to their capacity. Arrivals after the end of the mission are
    left out.

    Args:
        acoustics: modem, schedule, sound speed, clocks and losses.
        slots: as `schedule` gives them.
        motion: of every vehicle.
        seed: of the mission.
        names: of the vehicles, for losses that name some; without them V1, V2, ...

    Returns:
        Columns of `missionlog.OPPORTUNITY_COLUMNS` and `draws`, (M, max_frames), sorted by slot, then
        receiver.
    """
    world = _World(acoustics, motion, seed, tuple(names) or tuple(f"V{v + 1}" for v in range(len(motion))))
    packets = world.packets(slots)
    polls = world.polls(slots) if acoustics.ranging == "two-way" else None
    on_air = packets if polls is None else packets.beside(polls)
    arrival_s = world.arrivals(on_air)
    turnaround_s = acoustics.modem_profile.turnaround_s
    clear = _clear(on_air, arrival_s, turnaround_s)
    polled = None if polls is None else _polled(world, packets, polls, arrival_s, clear)
    parts = []
    for sender in range(len(motion)):
        mine = np.flatnonzero(slots["sender"] == sender)
        for receiver in range(len(motion)):
            if receiver == sender or mine.size == 0:
                continue
            part = _pair(world, slots, packets, mine, receiver, arrival_s[mine, receiver])
            part["survive_probability"][~clear[mine, receiver]] = 0.0
            parts.append(part if polled is None else polled.only(part, mine, receiver))
    return _sorted(world, parts)


def polls(
    acoustics: Acoustics, slots: Columns, motion: Sequence[Motion], seed: int, names: Sequence[str] = ()
) -> Columns:
    """Who polls for each slot's packet, and whether the slot's owner heard it; arguments as `opportunities`.

    Returns:
        Columns of `missionlog.POLL_COLUMNS`; no columns where ranging is one-way or nobody is there to poll.
    """
    if acoustics.ranging == "one-way" or len(motion) < 2:
        return {}
    world = _World(acoustics, motion, seed, tuple(names) or tuple(f"V{v + 1}" for v in range(len(motion))))
    packets, asked = world.packets(slots), world.polls(slots)
    on_air = packets.beside(asked)
    arrival_s = world.arrivals(on_air)
    clear = _clear(on_air, arrival_s, acoustics.modem_profile.turnaround_s)
    polled = _polled(world, packets, asked, arrival_s, clear)
    count = packets.sender.size
    return {
        "tol_ns": slots["tol_ns"].copy(),
        "t_ns": slots["tol_ns"] - round(lead_s(acoustics) * 1e9),
        "sender": slots["sender"].copy(),
        "poller": polled.poller,
        "poll_bytes": np.full(count, acoustics.two_way.poll_bytes, dtype=np.int64),
        "reply_bytes": np.full(count, RESIDENCE_BYTES, dtype=np.int64),
        "air_time_ns": np.full(count, round(poll_air_s(acoustics) * 1e9), dtype=np.int64),
        "answered": polled.heard,
    }


def travel_time_s(sender: Motion, receiver: Motion, launch_s: Array, speed_mps: float | Array) -> Array:
    """Time from the sender at launch to the receiver at arrival, seconds, (K,), by fixed-point iteration.

    Each turn shrinks the error by receiver speed / sound speed, about 1e-3: six reach rounding.
    """
    origin, depth = sender.position_at(launch_s), sender.depth_at(launch_s)
    travel = np.zeros_like(launch_s)
    for _ in range(6):
        there = launch_s + travel
        de, dn = (receiver.position_at(there) - origin).T
        travel = np.sqrt(de**2 + dn**2 + (receiver.depth_at(there) - depth) ** 2) / speed_mps
    return travel


@dataclass(frozen=True)
class _Launches:
    """Signals on the air: polls and packets, (K,)."""

    sender: Indices
    start_s: Array
    """True launch."""
    air_s: Array
    """How long each occupies the channel."""

    def beside(self, other: _Launches) -> _Launches:
        return _Launches(
            np.concatenate([self.sender, other.sender]),
            np.concatenate([self.start_s, other.start_s]),
            np.concatenate([self.air_s, other.air_s]),
        )


@dataclass(frozen=True)
class _Polled:
    """What a two-way schedule adds to its packets, one for each slot."""

    poller: Indices
    heard: NDArray[np.bool_]
    """The sender heard the poll alone, whole, and in time to answer."""
    measured_s: Array
    """Half the round trip."""

    def only(self, part: Columns, mine: Indices, receiver: int) -> Columns:
        """The opportunities of the slots in which the receiver polled, with the range that it measures."""
        asked = self.poller[mine] == receiver
        part = {name: column[asked] for name, column in part.items()}
        part["survive_probability"][~self.heard[mine[asked]]] = 0.0
        measured = self.measured_s[mine[asked]] + part["error_s"]
        part["toa_ns"] = part["tol_ns"] + np.round(measured * 1e9).astype(np.int64)
        return part


@dataclass(frozen=True)
class _Clock:
    offset_s: float
    drift: float  # seconds gained each second

    @classmethod
    def drawn(cls, acoustics: Acoustics, seed: int, vehicle: int) -> _Clock:
        offset, drift = stream(seed, vehicle, Purpose.CLOCK).standard_normal(2)
        clock = acoustics.clock
        return cls(float(offset) * clock.offset_sigma_s, float(drift) * clock.drift_sigma_ppm * 1e-6)

    def reading(self, true_s: Array) -> Array:
        return true_s + self.offset_s + self.drift * true_s

    def true_time(self, reading_s: Array) -> Array:
        return (reading_s - self.offset_s) / (1 + self.drift)


class _World:
    """What the channel of one mission depends on."""

    def __init__(
        self, acoustics: Acoustics, motion: Sequence[Motion], seed: int, names: tuple[str, ...]
    ) -> None:
        self.acoustics, self.motion, self.seed, self.names = acoustics, motion, seed, names
        self.clocks = [_Clock.drawn(acoustics, seed, vehicle) for vehicle in range(len(motion))]
        self.link = link_of(acoustics)
        self.packet_air_s = air_time_s(self.link, slot_frames(acoustics))

    def packets(self, slots: Columns) -> _Launches:
        """Every slot's packet."""
        start_s = self._by_clock(slots["sender"], slots["tol_ns"] / 1e9)
        return _Launches(slots["sender"], start_s, np.full(start_s.size, self.packet_air_s))

    def polls(self, slots: Columns) -> _Launches:
        """Every slot's poll, by the poller's clock; of nobody (-1) in a team of one."""
        poller = pollers_of(slots, len(self.motion))
        start_s = self._by_clock(poller, slots["tol_ns"] / 1e9 - lead_s(self.acoustics))
        return _Launches(poller, start_s, np.full(start_s.size, poll_air_s(self.acoustics)))

    def _by_clock(self, vehicle: Indices, reading_s: Array) -> Array:
        true_s = reading_s.copy()
        for index, clock in enumerate(self.clocks):
            mine = vehicle == index
            true_s[mine] = clock.true_time(reading_s[mine])
        return true_s

    def arrivals(self, on_air: _Launches) -> Array:
        """When each signal starts at each vehicle, (K, V): at its own sender, the launch."""
        start_s = np.repeat(on_air.start_s[:, None], len(self.motion), axis=1)
        for sender, moved in enumerate(self.motion):
            mine = np.flatnonzero(on_air.sender == sender)
            for receiver, other in enumerate(self.motion):
                if receiver != sender and mine.size:
                    launch_s = on_air.start_s[mine]
                    speed = sound_speed_between_mps(
                        self.acoustics, self.seed, moved.depth_at(launch_s), other.depth_at(launch_s)
                    )
                    start_s[mine, receiver] = launch_s + travel_time_s(moved, other, launch_s, speed)
        return start_s

    def survival(
        self, sender: int, receiver: int, scheduled_s: Array, launch_s: Array, arrival_s: Array
    ) -> Array:
        """Probability that a frame of each signal of one ordered pair survives, collisions aside, (K,)."""
        here, there = self.motion[sender], self.motion[receiver]
        at, to = here.position_at(launch_s), there.position_at(arrival_s)
        down = there.depth_at(arrival_s) - here.depth_at(launch_s)
        signals = Signals(
            sender=sender,
            receiver=receiver,
            scheduled_s=scheduled_s,
            launch_s=launch_s,
            range_m=np.sqrt(((to - at) ** 2).sum(axis=1) + down**2),
            off_bow_sender_rad=off_bow_rad(here.yaw_at(launch_s), at, to),
            off_bow_receiver_rad=off_bow_rad(there.yaw_at(arrival_s), to, at),
        )
        return survival(self.acoustics, signals, self.names, self.seed)

    def timing_error_s(self, sender: int, receiver: int, launch_s: Array) -> Array:
        """Noise of the measured travel times, and late arrivals by longer ways, seconds, (K,)."""
        count = launch_s.size
        speed = sound_speed_between_mps(self.acoustics, self.seed, np.zeros(1), np.zeros(1))[0]
        noise = stream(self.seed, sender, Purpose.RANGE, receiver).standard_normal(count)
        error = noise * self.acoustics.range_sigma_m / speed
        share = self.acoustics.range_outlier_share
        if share > 0:
            luck, size = self._longer_ways(sender, receiver, launch_s)
            error += np.where(luck < share, self.acoustics.range_outlier_m.quantile(size), 0.0) / speed
        return np.asarray(error)

    def _longer_ways(self, sender: int, receiver: int, launch_s: Array) -> tuple[Array, Array]:
        """Uniform draws for each signal: whether there is a longer way, and how long it is.

        A geometry that holds is that of the pair, whoever of both sends, and changes at times of its own."""
        hold_s = self.acoustics.range_outlier_hold_s
        if hold_s == 0:
            luck, size = (
                stream(self.seed, sender, Purpose.RANGE_OUTLIER, receiver).random((launch_s.size, 2)).T
            )
            return luck, size
        first, second = sorted((sender, receiver))
        draw = stream(self.seed, first, Purpose.RANGE_OUTLIER, second)
        place = np.floor(np.maximum(launch_s, 0.0) / hold_s + draw.random()).astype(np.int64)
        luck, size = draw.random((int(place.max(initial=0)) + 1, 2))[place].T
        return luck, size


def _pair(
    world: _World, slots: Columns, packets: _Launches, mine: Indices, receiver: int, arrival_s: Array
) -> Columns:
    """One-way opportunities of one ordered pair, and the error in their times."""
    sender = int(packets.sender[mine[0]])
    tol_ns = slots["tol_ns"][mine]
    error_s = world.timing_error_s(sender, receiver, packets.start_s[mine])
    measured_s = world.clocks[receiver].reading(arrival_s) + error_s
    draws = stream(world.seed, sender, Purpose.LOSS, receiver).random((world.link.max_frames, mine.size)).T
    return {
        "tol_ns": tol_ns,
        "sender": np.full(mine.size, sender, dtype=np.int64),
        "receiver": np.full(mine.size, receiver, dtype=np.int64),
        "toa_ns": np.round(measured_s * 1e9).astype(np.int64),
        "survive_probability": world.survival(
            sender, receiver, tol_ns / 1e9, packets.start_s[mine], arrival_s
        ),
        "draws": draws,
        "error_s": error_s,
    }


def _polled(
    world: _World, packets: _Launches, polls: _Launches, arrival_s: Array, clear: NDArray[np.bool_]
) -> _Polled:
    """Which polls are answered, and what the round trips measure."""
    count = packets.sender.size
    k = np.arange(count)
    heard_s = arrival_s[count + k, packets.sender]
    held_s = packets.start_s - heard_s
    back_s = arrival_s[k, polls.sender]
    heard = clear[count + k, packets.sender] & (polls.sender >= 0)
    heard &= held_s >= poll_air_s(world.acoustics) + world.acoustics.reply_turnaround_s - 1e-9
    for poller in range(len(world.motion)):
        for sender in range(len(world.motion)):
            mine = np.flatnonzero((polls.sender == poller) & (packets.sender == sender))
            if mine.size:
                launch_s = polls.start_s[mine]
                chance = world.survival(poller, sender, launch_s, launch_s, heard_s[mine])
                # A pair's draws are counted by its own polls: a third vehicle changes who polls, not these.
                luck = stream(world.seed, poller, Purpose.POLL, sender).random(mine.size)
                heard[mine] &= luck < chance
    return _Polled(polls.sender, heard, ((back_s - polls.start_s) - held_s) / 2)


def _clear(on_air: _Launches, arrival_s: Array, turnaround_s: float) -> NDArray[np.bool_]:
    """Which signals overlap no other at each vehicle, its own and their turn-around included, (K, V)."""
    clear = np.ones(arrival_s.shape, dtype=bool)
    for vehicle in range(arrival_s.shape[1]):
        own_s = np.where(on_air.sender == vehicle, turnaround_s, 0.0)
        begins = arrival_s[:, vehicle] - own_s
        order = np.argsort(begins, kind="stable")
        start = begins[order]
        end = start + (on_air.air_s + 2 * own_s)[order]
        still = np.maximum.accumulate(end)
        overlaps = np.zeros(start.size, dtype=bool)
        overlaps[1:] |= start[1:] < still[:-1]
        overlaps[:-1] |= start[1:] < end[:-1]
        clear[order, vehicle] = ~overlaps
    return clear


def _sorted(world: _World, parts: list[Columns]) -> Columns:
    """Put the pairs' arrivals together, drop those after the end, and sort."""
    if not parts:
        empty = np.empty(0, dtype=np.int64)
        return {
            "tol_ns": empty, "sender": empty.copy(), "receiver": empty.copy(), "toa_ns": empty.copy(),
            "survive_probability": np.empty(0), "draws": np.empty((0, world.link.max_frames)),
        }  # fmt: skip
    table = {name: np.concatenate([part[name] for part in parts]) for name in parts[0] if name != "error_s"}
    # A signal is never stamped before its slot, however the noise and the clocks fall.
    table["toa_ns"] = np.maximum(table["toa_ns"], table["tol_ns"])
    inside = np.flatnonzero(table["toa_ns"] / 1e9 + world.packet_air_s <= world.motion[0].end_s)
    order = inside[np.lexsort((table["receiver"][inside], table["sender"][inside], table["tol_ns"][inside]))]
    return {name: column[order] for name, column in table.items()}
