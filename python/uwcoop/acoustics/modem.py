"""How a packet's bytes become frames and air time on a scenario's modem."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from uwcoop.acoustics.link import Link
from uwcoop.acoustics.modem_profiles import MODEMS, NO_LIMIT_BYTES, ModemFigures

if TYPE_CHECKING:
    from uwcoop.scenario.acoustics import Acoustics

__all__ = ["MODEMS", "NO_LIMIT_BYTES", "ModemFigures", "air_time_s", "frames_of", "link_of", "poll_air_s"]


def link_of(acoustics: Acoustics) -> Link:
    """The link that both ends agree on, from the scenario's modem."""
    modem = acoustics.modem_profile
    return Link(
        modem=acoustics.modem_name,
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
    modem = acoustics.modem_profile
    return modem.preamble_s + modem.bytes_s(acoustics.two_way.poll_bytes)


def frames_of(link: Link, packet_bytes: int) -> int:
    """Frames that a packet needs: at least one."""
    return max(1, math.ceil(packet_bytes / link.frame_bytes))
