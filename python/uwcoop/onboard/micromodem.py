"""A WHOI Micromodem on a line, by its NMEA dialogue (Micro-Modem Software Interface Guide).

```
send     host  $CCCYC,0,SRC,DEST,RATE,0,FRAMES     at the launch less the modem's latency
         modem $CACYC …                            it has begun
         modem $CADRQ,HHMMSS,SRC,DEST,0,N,F        a frame is wanted
         host  $CCTXD,SRC,DEST,0,HEX
         modem $CATXF,N                            the frame is in the water
receive  modem $CACYC,…,SRC,DEST,RATE,ACK,FRAMES   a packet of SRC begins
         modem $CATOA,HHMMSS.ssss,MODE             arrival of its start, by the modem's clock on a pulse per second
         modem $CARXD,SRC,DEST,ACK,F,HEX           a frame; after the last, the packet is whole
```

The address of vehicle k of a team is k + 1, and packets go to all (15). The launch of a received packet is that of its
sender's last slot before the arrival. Frames are filled up with zeros, so the first byte is the packet's length.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING

from uwcoop import _native
from uwcoop.errors import ScenarioError
from uwcoop.onboard.times_of_day import mission_ns_of_day

if TYPE_CHECKING:
    from uwcoop._native import Event
    from uwcoop.missionlog.model import MissionLog
    from uwcoop.onboard.lines import Line

__all__ = ["Micromodem", "fields_of", "sentence"]

_ALL = 15
_SECOND_NS = 1_000_000_000
_RATES = {32: 0, 64: 1, 256: 5}
"""Packet type by bytes in a frame: FSK 80 bit/s, PSK 250 and 5300 bit/s."""


def sentence(*fields: object) -> str:
    """An NMEA 0183 sentence with its checksum."""
    body = ",".join(str(field) for field in fields)
    return f"${body}*{reduce(xor, body.encode(), 0):02X}"


def fields_of(line: str) -> list[str] | None:
    """The fields of a sentence; None for what is none, or whose checksum is wrong. One without a checksum is taken."""
    if not line.startswith("$"):
        return None
    body, star, checksum = line[1:].partition("*")
    if star and f"{reduce(xor, body.encode('ascii', 'replace'), 0):02X}" != checksum.strip().upper():
        return None
    return body.split(",")


class Micromodem:
    """One vehicle's modem."""

    overhead_bytes = 1
    """The packet's length."""

    def __init__(
        self,
        line: Line,
        mission: MissionLog,
        vehicle: int,
        now_ns: Callable[[], int],
        epoch_ns: int,
        *,
        latency_s: float = 0.0,
    ) -> None:
        """Take a modem that is on, its clock on the pulse per second (`$CCCFG,SNV,1`).

        Args:
            line: where it is.
            mission: for the slots and the link.
            vehicle: index of its vehicle.
            now_ns: mission time.
            epoch_ns: UNIX time of mission time 0: the modem says times of day.
            latency_s: from `$CCCYC` to the signal's start.

        Raises:
            ScenarioError: frames that this dialogue does not know, or more vehicles than there are addresses.
        """
        if mission.link.frame_bytes not in _RATES:
            raise ScenarioError(
                f"frames of {mission.link.frame_bytes} bytes: the Micromodem's packets have {sorted(_RATES)}"
            )
        if len(mission.vehicles) >= _ALL:
            raise ScenarioError(f"{len(mission.vehicles)} vehicles: the Micromodem has {_ALL - 1} addresses")
        self.counts: Counter[str] = Counter()
        """Sentences that were not understood (`garbled`), modem errors, packets that were not whole."""
        self._line, self._vehicle, self._now_ns, self._epoch_ns = line, vehicle, now_ns, epoch_ns
        self._frame_bytes, self._vehicles = mission.link.frame_bytes, len(mission.vehicles)
        self._latency_ns = round(latency_s * _SECOND_NS)
        slots = mission.slots
        self._slots: dict[int, list[int]] = {
            k: slots["tol_ns"][slots["sender"] == k].tolist() for k in range(self._vehicles)
        }
        self._waiting: tuple[int, list[bytes]] | None = None
        self._sending: list[bytes] = []
        self._from: int | None = None
        self._wanted = 0
        self._frames: dict[int, bytes] = {}
        self._toa_ns: int | None = None

    def send(self, packet: bytes, tol_ns: int) -> None:
        if len(packet) > 255:
            raise ScenarioError(f"a packet has {len(packet)} bytes: its length takes one byte, at most 255")
        framed = bytes([len(packet)]) + packet
        size = self._frame_bytes
        frames = [framed[k : k + size].ljust(size, b"\0") for k in range(0, len(framed), size)]
        self._waiting = tol_ns, frames

    def received(self) -> list[Event]:
        self._launch_if_due()
        found = [self._sentence(line) for line in self._line.read()]
        return [event for event in found if event is not None]

    def _launch_if_due(self) -> None:
        if self._waiting is None or self._now_ns() < self._waiting[0] - self._latency_ns:
            return
        _, self._sending = self._waiting
        self._waiting = None
        rate = _RATES[self._frame_bytes]
        self._line.write(sentence("CCCYC", 0, self._vehicle + 1, _ALL, rate, 0, len(self._sending)))

    def _sentence(self, line: str) -> Event | None:
        fields = fields_of(line)
        if fields is None:
            self.counts["garbled"] += 1
            return None
        try:
            if fields[0] == "CADRQ":
                self._answer(int(fields[2]), int(fields[6]))
            elif fields[0] == "CACYC":
                self._begins(int(fields[2]), int(fields[6]))
            elif fields[0] == "CATOA":
                self._toa_ns = self._mission_ns(fields[1])
            elif fields[0] == "CARXD":
                return self._frame(int(fields[1]), int(fields[4]), bytes.fromhex(fields[5]))
            elif fields[0] in {"CAERR", "CAMSG"}:
                self.counts[f"{fields[0]} {fields[2] if fields[0] == 'CAERR' else fields[1]}"] += 1
        except (ValueError, IndexError):
            self.counts["garbled"] += 1
        return None

    def _answer(self, source: int, frame: int) -> None:
        if source == self._vehicle + 1 and 1 <= frame <= len(self._sending):
            data = self._sending[frame - 1].hex().upper()
            self._line.write(sentence("CCTXD", self._vehicle + 1, _ALL, 0, data))

    def _begins(self, source: int, frames: int) -> None:
        if source == self._vehicle + 1:
            return  # the echo of an own one
        if self._from is not None:
            self.counts["not whole"] += 1
        self._from, self._wanted, self._frames, self._toa_ns = source, frames, {}, None

    def _frame(self, source: int, frame: int, data: bytes) -> Event | None:
        if source != self._from or not 1 <= frame <= self._wanted:
            self.counts["not whole"] += 1
            return None
        self._frames[frame] = data
        if len(self._frames) < self._wanted:
            return None
        framed = b"".join(self._frames[k] for k in sorted(self._frames))
        self._from = None
        sender = source - 1
        if not 0 <= sender < self._vehicles or not framed or len(framed) <= framed[0]:
            self.counts["not a teammate's"] += 1
            return None
        slots = self._slots[sender]
        turn = bisect_right(slots, self._toa_ns) - 1 if self._toa_ns is not None else -1
        if self._toa_ns is None or turn < 0:
            self.counts["without time of arrival"] += 1
            return None
        fields = {
            "sender": sender,
            "tol_ns": slots[turn],
            "toa_ns": self._toa_ns,
            "bytes": framed[1 : 1 + framed[0]],
        }
        return _native.Event(max(self._now_ns(), self._toa_ns), self._vehicle, "reception", **fields)

    def _mission_ns(self, text: str) -> int:
        return mission_ns_of_day(text, self._now_ns(), self._epoch_ns)
