"""Modem profiles: how a packet's bytes become frames and air time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from uwcoop.acoustics.link import Link

if TYPE_CHECKING:
    from uwcoop.scenario.acoustics import Acoustics

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
        return self.bytes_s(self.frame_bytes)

    def bytes_s(self, count: int) -> float:
        """Air time of so many bytes, preamble aside, seconds."""
        return 8 * count / self.bits_per_s if self.bits_per_s else 0.0


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


def poll_air_s(acoustics: Acoustics) -> float:
    """How long a poll occupies the channel, seconds: a short signal of its own, not a whole frame."""
    modem = MODEMS[acoustics.modem]
    return modem.preamble_s + modem.bytes_s(acoustics.two_way.poll_bytes)


def frames_of(link: Link, packet_bytes: int) -> int:
    """Frames that a packet needs: at least one."""
    return max(1, math.ceil(packet_bytes / link.frame_bytes))
