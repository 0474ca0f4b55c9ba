"""Acoustics: modem profiles, the slot schedule, travel times, clocks and losses.

A slot's signal is launched when the sender's clock shows the slot's time, travels to where the receiver will
be, and is stamped by the receiver's clock. What a packet becomes is decided at replay: the log holds, for
every slot and other vehicle, the measured time of arrival, the probability that a frame survives and one draw
for each frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import ScheduleError
from uwcoop.missionlog.model import Columns, Link
from uwcoop.scenario.acoustics import IndependentLoss
from uwcoop.streams import TEAM, Purpose, stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.scenario.acoustics import Acoustics
    from uwcoop.vehicles import Motion

NO_LIMIT_BYTES = 2**31 - 1


@dataclass(frozen=True)
class Modem:
    """How a modem packs bytes: up to `max_frames` frames behind one preamble; 0 bits/s: no air time."""

    frame_bytes: int
    max_frames: int
    bits_per_s: float
    preamble_s: float

    @property
    def frame_s(self) -> float:
        """Air time of one frame, seconds."""
        return 8 * self.frame_bytes / self.bits_per_s if self.bits_per_s else 0.0


MODEMS: dict[str, Modem] = {
    "micromodem-32": Modem(32, 1, 80.0, 0.3),
    "micromodem-64": Modem(64, 3, 250.0, 0.3),
    "micromodem-256": Modem(256, 2, 1200.0, 0.3),
    "aloc": Modem(8, 16, 100.0, 0.0),
    "unlimited": Modem(NO_LIMIT_BYTES, 1, 0.0, 0.0),
}
"""Modem profiles.

WHOI Micromodem: frames for each packet as its drivers state them (rate 0: 1 x 32 bytes, rate 1: 3 x 64, rate
3: 2 x 256), at the nominal rates of its FH-FSK and of its PSK in a 4 kHz band (80, 250, 1200 bit/s), behind
0.3 s of probe and silence (WHOI's table of packet and signal lengths). Firmware with a wider band is about
twice as fast. ALOC: signals of 8 bytes at 100 bit/s, each with its own synchronisation in that rate; up to 16
in a row.
"""


def link_of(acoustics: Acoustics) -> Link:
    """The link that both ends agree on, from the scenario's modem."""
    modem = MODEMS[acoustics.modem]
    return Link(
        modem=acoustics.modem,
        frame_bytes=modem.frame_bytes,
        max_frames=modem.max_frames,
        frame_s=modem.frame_s,
        preamble_s=modem.preamble_s,
        sound_speed_mps=acoustics.sound_speed_mps,
    )


def air_time_s(link: Link, frames: int) -> float:
    """How long a packet of so many frames occupies the channel, seconds."""
    return link.preamble_s + frames * link.frame_s


def frames_of(link: Link, packet_bytes: int) -> int:
    """Frames that a packet needs: at least one."""
    return max(1, math.ceil(packet_bytes / link.frame_bytes))


def slot_frames(acoustics: Acoustics) -> int:
    """Whole frames that fit a slot before its guard, at most the modem's `max_frames`.

    Raises:
        ScheduleError: not one frame fits; the line shows the arithmetic.
    """
    link = link_of(acoustics)
    check_fits(acoustics, 1)
    if link.frame_s == 0:
        return link.max_frames
    room = acoustics.slot_s - acoustics.guard - link.preamble_s
    return min(link.max_frames, math.floor(room / link.frame_s + 1e-9))


def check_packet(acoustics: Acoustics, packet_bytes: int, what: str = "packet") -> None:
    """Refuse a schedule whose slots are too short for a packet.

    Args:
        acoustics: modem and schedule.
        packet_bytes: length of the packet.
        what: names it in the message, e.g. "packet of mpf".

    Raises:
        ScheduleError: more frames than the modem sends at once or than fit a slot; the line shows the
            arithmetic.
    """
    link = link_of(acoustics)
    frames = frames_of(link, packet_bytes)
    if frames > link.max_frames:
        raise ScheduleError(
            f"{what} of {packet_bytes} bytes needs {frames} frames of {link.frame_bytes} bytes: "
            f"{link.modem} sends at most {link.max_frames} ({link.max_frames * link.frame_bytes} bytes)"
        )
    check_fits(acoustics, frames, f"{what} of {packet_bytes} bytes: ")


def check_fits(acoustics: Acoustics, frames: int, what: str = "") -> None:
    """Refuse a slot that is shorter than so many frames, the preamble and the guard.

    Raises:
        ScheduleError: one line with the arithmetic.
    """
    link = link_of(acoustics)
    needed = air_time_s(link, frames) + acoustics.guard
    if needed <= acoustics.slot_s + 1e-9:
        return
    guard = f"guard {acoustics.guard:.2f} s"
    if acoustics.guard_s is None:
        guard += f" ({acoustics.max_range_m:g} m / {acoustics.sound_speed_mps:g} m/s)"
    raise ScheduleError(
        f"{what}slot of {acoustics.slot_s:.2f} s is shorter than {frames} frame{'s' if frames > 1 else ''} "
        f"x {link.frame_s:.2f} s ({link.modem}) + preamble {link.preamble_s:.2f} s + {guard} = {needed:.2f} s"
    )


def schedule(acoustics: Acoustics, names: Sequence[str], duration_s: float) -> Columns:
    """The transmit slots of a mission: round robin, or the scenario's own order. Only whole slots are used.

    Returns:
        Columns of `missionlog.SLOT_COLUMNS`.

    Raises:
        ScheduleError: a slot that does not hold one frame, or not `packet_bytes`.
    """
    frames = slot_frames(acoustics)
    if acoustics.packet_bytes is not None:
        check_packet(acoustics, acoustics.packet_bytes)
    order = [names.index(name) for name in acoustics.order] or list(range(len(names)))
    count = max(0, math.floor((duration_s - acoustics.first_slot_s) / acoustics.slot_s + 1e-9))
    k = np.arange(count)
    return {
        "tol_ns": np.round((acoustics.first_slot_s + k * acoustics.slot_s) * 1e9).astype(np.int64),
        "sender": np.array(order, dtype=np.int64)[k % len(order)],
        "capacity_bytes": np.full(count, frames * link_of(acoustics).frame_bytes, dtype=np.int64),
    }


def opportunities(acoustics: Acoustics, slots: Columns, motion: Sequence[Motion], seed: int) -> Columns:
    """What each vehicle can hear of each slot.

    The range is slant, from the sender at launch to the receiver at arrival. Clocks: a signal leaves when the
    sender's clock shows the slot's time and is stamped by the receiver's clock. A receiver that is itself
    sending (half duplex), or that hears another signal at the same time, loses every frame; both are judged
    with slots filled to their capacity. Arrivals after the end of the mission are left out.

    Returns:
        Columns of `missionlog.OPPORTUNITY_COLUMNS` and `draws`, (M, max_frames), sorted by slot, then
        receiver.
    """
    link = link_of(acoustics)
    speed = true_sound_speed_mps(acoustics, seed)
    clocks = [_Clock.drawn(acoustics, seed, vehicle) for vehicle in range(len(motion))]
    parts: list[Columns] = []
    for sender in range(len(motion)):
        tol_ns = slots["tol_ns"][slots["sender"] == sender]
        launch_s = clocks[sender].true_time(tol_ns / 1e9)
        for receiver in range(len(motion)):
            if receiver == sender or tol_ns.size == 0:
                continue
            arrival_s = launch_s + travel_time_s(motion[sender], motion[receiver], launch_s, speed)
            noise = stream(seed, sender, Purpose.RANGE, receiver).standard_normal(tol_ns.size)
            measured_s = clocks[receiver].reading(arrival_s) + noise * acoustics.range_sigma_m / speed
            draws = stream(seed, sender, Purpose.LOSS, receiver).random((link.max_frames, tol_ns.size)).T
            parts.append(
                {
                    "tol_ns": tol_ns,
                    "sender": np.full(tol_ns.size, sender, dtype=np.int64),
                    "receiver": np.full(tol_ns.size, receiver, dtype=np.int64),
                    # A signal is never stamped before its slot, however the noise and the clocks fall.
                    "toa_ns": np.maximum(np.round(measured_s * 1e9).astype(np.int64), tol_ns),
                    "arrival_s": arrival_s,
                    "draws": draws,
                }
            )
    return _on_the_air(acoustics, link, parts, slots, clocks, motion[0].end_s)


def travel_time_s(
    sender: Motion, receiver: Motion, launch_s: NDArray[np.float64], speed_mps: float
) -> NDArray[np.float64]:
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


def true_sound_speed_mps(acoustics: Acoustics, seed: int) -> float:
    """The mission's sound speed: what navigators believe plus its error, m/s."""
    drawn = stream(seed, TEAM, Purpose.SOUND_SPEED).standard_normal() * acoustics.sound_speed_error_sigma_mps
    return acoustics.sound_speed_mps + acoustics.sound_speed_error_mps + float(drawn)


@dataclass(frozen=True)
class _Clock:
    offset_s: float
    drift: float  # seconds gained each second

    @classmethod
    def drawn(cls, acoustics: Acoustics, seed: int, vehicle: int) -> _Clock:
        offset, drift = stream(seed, vehicle, Purpose.CLOCK).standard_normal(2)
        clock = acoustics.clock
        return cls(float(offset) * clock.offset_sigma_s, float(drift) * clock.drift_sigma_ppm * 1e-6)

    def reading(self, true_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return true_s + self.offset_s + self.drift * true_s

    def true_time(self, reading_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return (reading_s - self.offset_s) / (1 + self.drift)


def _on_the_air(
    acoustics: Acoustics, link: Link, parts: list[Columns], slots: Columns, clocks: list[_Clock], end_s: float
) -> Columns:
    """Put the pairs' arrivals together, silence what collides, and sort."""
    if not parts:
        empty = np.empty(0, dtype=np.int64)
        return {
            "tol_ns": empty, "sender": empty.copy(), "receiver": empty.copy(), "toa_ns": empty.copy(),
            "survive_probability": np.empty(0), "draws": np.empty((0, link.max_frames)),
        }  # fmt: skip
    table = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    air_s = air_time_s(link, slot_frames(acoustics))
    start = table.pop("arrival_s")
    survive = np.full(start.size, survive_probability(acoustics))
    for receiver, clock in enumerate(clocks):
        here = np.flatnonzero(table["receiver"] == receiver)
        own = clock.true_time(slots["tol_ns"][slots["sender"] == receiver] / 1e9)
        busy = _overlaps_any(start[here], own, air_s) | _overlaps_each_other(start[here], air_s)
        survive[here[busy]] = 0.0
    table["survive_probability"] = survive
    heard = np.flatnonzero(table["toa_ns"] / 1e9 + air_s <= end_s)
    order = heard[np.lexsort((table["receiver"][heard], table["sender"][heard], table["tol_ns"][heard]))]
    return {name: column[order] for name, column in table.items()}


def _overlaps_any(starts: NDArray[np.float64], own: NDArray[np.float64], air_s: float) -> NDArray[np.bool_]:
    """Which signals of length `air_s` overlap any of the sorted `own` signals of the same length."""
    if own.size == 0 or air_s == 0:
        return np.zeros(starts.size, dtype=bool)
    after = np.minimum(np.searchsorted(own, starts), own.size - 1)
    before = np.maximum(after - 1, 0)
    return np.asarray((np.abs(starts - own[before]) < air_s) | (np.abs(starts - own[after]) < air_s))


def _overlaps_each_other(starts: NDArray[np.float64], air_s: float) -> NDArray[np.bool_]:
    """Which of these signals of length `air_s` overlap another of them."""
    order = np.argsort(starts, kind="stable")
    close = np.diff(starts[order]) < air_s
    hit = np.zeros(starts.size, dtype=bool)
    hit[order[:-1]] |= close
    hit[order[1:]] |= close
    return hit


def survive_probability(acoustics: Acoustics) -> float:
    """Probability that a frame arrives, collisions aside."""
    loss = acoustics.loss
    return 1.0 - loss.probability if isinstance(loss, IndependentLoss) else 1.0
