"""Packaged modems: one entry each, with the source of its figures and what no source confirms."""

from __future__ import annotations

from dataclasses import dataclass

NO_LIMIT_BYTES = 2**31 - 1


@dataclass(frozen=True)
class ModemFigures:
    """How a modem packs bytes: up to `max_frames` frames behind one preamble; 0 bits/s: no air time."""

    frame_bytes: int
    max_frames: int
    bits_per_s: float
    preamble_s: float
    turnaround_s: float = 0.0
    """From the end of a signal, sent or received, to the earliest start of the other kind (half duplex)."""
    source: str = ""
    """Where the figures are from, and what is not confirmed."""

    @property
    def frame_s(self) -> float:
        """Air time of one frame, seconds."""
        return self.bytes_s(self.frame_bytes)

    def bytes_s(self, count: int) -> float:
        """Air time of so many bytes, preamble aside, seconds."""
        return 8 * count / self.bits_per_s if self.bits_per_s else 0.0


_WHOI = (
    "WHOI Micromodem: frames of each packet as its drivers state them, nominal bit rate of the modulation, and 0.3 s "
    "of probe and silence (WHOI's table of packet and signal lengths). Turn-around: not confirmed."
)

MODEMS: dict[str, ModemFigures] = {
    "micromodem-32": ModemFigures(32, 1, 80.0, 0.3, source=f"Rate 0, FH-FSK, 1 × 32 bytes at 80 bit/s. {_WHOI}"),
    "micromodem-64": ModemFigures(
        64, 3, 250.0, 0.3,
        source=f"Rate 1, PSK in a 4 kHz band, 3 × 64 bytes at 250 bit/s; twice as fast in a wider band. {_WHOI}",
    ),
    "micromodem-256": ModemFigures(
        256, 2, 1200.0, 0.3,
        source=f"Rate 3, PSK in a 4 kHz band, 2 × 256 bytes at 1200 bit/s; twice as fast in a wider band. {_WHOI}",
    ),
    "evologics-im": ModemFigures(
        64, 1, 976.0, 0.0,
        source="EvoLogics S2C, instant messages (AT*SENDIM) of up to 64 bytes, S2C modem guide. Not confirmed: 976 "
        "bit/s (quoted in the literature for instant messages), preamble, turn-around. Measure them.",
    ),
    "seatrac": ModemFigures(
        31, 1, 100.0, 0.0,
        source="Blueprint Subsea SeaTrac X100 series, DAT messages of up to 31 bytes, 80 ms a byte (Serial Command "
        "Interface Reference UM-140-D00221, CID_DAT_SEND). Not confirmed: preamble and turn-around.",
    ),
    "nanomodem-v3": ModemFigures(
        64, 1, 640.0, 0.306,
        source="Newcastle University Nanomodem v3, messages of up to 64 bytes at 640 bit/s raw, 463 bit/s throughput "
        "(USMART project, specification of October 2018); the preamble is what makes up the difference at 64 bytes. "
        "Not confirmed: turn-around.",
    ),
    "waterlinked-m64": ModemFigures(
        8, 1, 64.0, 0.0,
        source="Water Linked Modem M64, packets of 8 bytes, 64 bit/s (serial protocol and product page). It links two "
        "modems of one channel in fixed time slots: a team of more, and free launch times, are not confirmed.",
    ),
    "aloc": ModemFigures(
        8, 16, 100.0, 0.0,
        source="ALOC (Matsuda et al. 2017): signals of 8 bytes at 100 bit/s, each with its own synchronisation in that "
        "rate; up to 16 in a row.",
    ),
    "unlimited": ModemFigures(NO_LIMIT_BYTES, 1, 0.0, 0.0, source="No modem: any packet at once."),
}  # fmt: skip
"""Packaged modems by name."""
