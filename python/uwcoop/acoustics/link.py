"""What both ends of an acoustic link agree on, as a log states it."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Link"]


@dataclass(frozen=True)
class Link:
    """What both ends of the acoustic link agree on.

    A packet of n bytes needs `ceil(n / frame_bytes)` frames (at least one), is refused above `max_frames`,
    and occupies the channel for `preamble_s + frames * frame_s`. All frames must survive.
    """

    modem: str
    frame_bytes: int
    max_frames: int
    frame_s: float
    preamble_s: float
    sound_speed_mps: float
