"""The slot schedule: who launches when, what fits, and the arithmetic that refuses what does not."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.modem import air_time_s, frames_of, link_of, poll_air_s
from uwcoop.errors import ScheduleError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.missionlog.model import Columns
    from uwcoop.scenario.acoustics import Acoustics

RESIDENCE_BYTES = 3
"""What a two-way reply spends to say how long it held the poll: 24 bits, 0 to 16.7 s in steps of a microsecond."""


def lead_s(acoustics: Acoustics) -> float:
    """From the start of a slot to the launch of its packet, seconds: 0, or poll, its travel and turn-around."""
    if acoustics.ranging == "one-way":
        return 0.0
    return poll_air_s(acoustics) + acoustics.travel_s + acoustics.reply_turnaround_s


def slot_needed_s(acoustics: Acoustics, frames: int) -> float:
    """The shortest slot for a packet of so many frames, seconds: the lead, its air time and the guard."""
    return lead_s(acoustics) + air_time_s(link_of(acoustics), frames) + acoustics.guard


def slot_frames(acoustics: Acoustics) -> int:
    """Whole frames that fit a slot before its guard, at most the modem's `max_frames`.

    Raises:
        ScheduleError: not one frame fits; the line shows the arithmetic.
    """
    link = link_of(acoustics)
    check_fits(acoustics, 1)
    if link.frame_s == 0:
        return link.max_frames
    room = acoustics.slot_s - slot_needed_s(acoustics, 0)
    return min(link.max_frames, math.floor(room / link.frame_s + 1e-9))


def slot_capacity_bytes(acoustics: Acoustics) -> int:
    """Bytes of a navigator's packet that fit a slot. A two-way reply spends `RESIDENCE_BYTES` of its frames.

    Raises:
        ScheduleError: not one frame fits.
    """
    return slot_frames(acoustics) * link_of(acoustics).frame_bytes - _overhead_bytes(acoustics)


def packet_frames(acoustics: Acoustics, packet_bytes: int) -> int:
    """Frames of a navigator's packet on the air, with what a two-way reply adds to it."""
    return frames_of(link_of(acoustics), packet_bytes + _overhead_bytes(acoustics))


def check_packet(acoustics: Acoustics, packet_bytes: int, what: str = "packet") -> None:
    """Refuse a schedule whose slots are too short for a packet.

    Args:
        acoustics: modem and schedule.
        packet_bytes: length of the packet; in two-way ranging without the reply's time.
        what: names it in the message, e.g. "packet of mpf".

    Raises:
        ScheduleError: more frames than the modem sends at once or than fit a slot; the line shows the
            arithmetic.
    """
    link = link_of(acoustics)
    overhead = _overhead_bytes(acoustics)
    size = f"{packet_bytes} bytes" + (f" + {overhead} for the poll's time" if overhead else "")
    frames = packet_frames(acoustics, packet_bytes)
    if frames > link.max_frames:
        raise ScheduleError(
            f"{what} of {size} needs {frames} frames of {link.frame_bytes} bytes: "
            f"{link.modem} sends at most {link.max_frames} ({link.max_frames * link.frame_bytes} bytes)"
        )
    check_fits(acoustics, frames, f"{what} of {size}: ")


def check_fits(acoustics: Acoustics, frames: int, what: str = "") -> None:
    """Refuse a slot that is shorter than so many frames, the preamble and the guard; two-way, also the poll.

    Raises:
        ScheduleError: one line with the arithmetic.
    """
    link = link_of(acoustics)
    needed = slot_needed_s(acoustics, frames)
    if needed <= acoustics.slot_s + 1e-9:
        return
    guard = f"guard {acoustics.guard:.2f} s"
    turn_s = acoustics.modem_profile.turnaround_s
    if acoustics.guard_s is None:
        turn = f" + turn-around {turn_s:g} s" if turn_s else ""
        guard += f" ({acoustics.max_range_m:g} m / {acoustics.sound_speed_mps:g} m/s{turn})"
    lead = ""
    if acoustics.ranging == "two-way":
        lead = (
            f"poll {poll_air_s(acoustics):.2f} s + guard {acoustics.travel_s:.2f} s "
            f"+ turn-around {acoustics.reply_turnaround_s:.2f} s + "
        )
    raise ScheduleError(
        f"{what}slot of {acoustics.slot_s:.2f} s is shorter than {lead}{frames} "
        f"frame{'s' if frames > 1 else ''} "
        f"x {link.frame_s:.2f} s ({link.modem}) + preamble {link.preamble_s:.2f} s + {guard} = {needed:.2f} s"
    )


def schedule(acoustics: Acoustics, names: Sequence[str], duration_s: float) -> Columns:
    """The transmit slots of a mission: round robin, or the scenario's own order. Only whole slots are used.

    `tol_ns` is when the slot's packet is launched: the start of the slot, or in two-way ranging `lead_s`
    later, after the poll.

    Returns:
        Columns of `missionlog.SLOT_COLUMNS`.

    Raises:
        ScheduleError: a slot that does not hold one frame, or not `packet_bytes`.
    """
    capacity = slot_capacity_bytes(acoustics)
    if acoustics.packet_bytes is not None:
        check_packet(acoustics, acoustics.packet_bytes)
    order = [names.index(name) for name in acoustics.order] or list(range(len(names)))
    count = max(0, math.floor((duration_s - acoustics.first_slot_s) / acoustics.slot_s + 1e-9))
    k = np.arange(count)
    launch_s = acoustics.first_slot_s + k * acoustics.slot_s + lead_s(acoustics)
    return {
        "tol_ns": np.round(launch_s * 1e9).astype(np.int64),
        "sender": np.array(order, dtype=np.int64)[k % len(order)],
        "capacity_bytes": np.full(count, capacity, dtype=np.int64),
    }


def pollers_of(slots: Columns, vehicles: int) -> NDArray[np.int64]:
    """Who polls in each slot of a two-way schedule, (K,): the sender's teammates in turn; -1 without any."""
    pollers = np.full(slots["sender"].size, -1, dtype=np.int64)
    if vehicles > 1:
        for sender in range(vehicles):
            mine = np.flatnonzero(slots["sender"] == sender)
            others = np.array([v for v in range(vehicles) if v != sender])
            pollers[mine] = others[np.arange(mine.size) % others.size]
    return pollers


def _overhead_bytes(acoustics: Acoustics) -> int:
    return RESIDENCE_BYTES if acoustics.ranging == "two-way" else 0
