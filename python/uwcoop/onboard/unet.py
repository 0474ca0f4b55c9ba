"""A modem that runs UnetStack, through its gateway: frames of the physical layer at a time of the modem's clock.

Each packet is one `TxFrameReq` with a `txTime`; each `RxFrameNtf` has an `rxTime`, both in microseconds of the modem's
own clock. Its offset from mission time is measured by asking for `phy.time` again and again: the answer that took the
shortest time counts, half of that time is what the offset may be off. The address of vehicle k of a team is k + 1, and
packets go to all (0). The launch of a received packet is that of its sender's last slot before the arrival. The first
byte is the packet's length.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from uwcoop import _native
from uwcoop.errors import MissingDependencyError, ScenarioError

if TYPE_CHECKING:
    from uwcoop._native import Event
    from uwcoop.missionlog.model import MissionLog

__all__ = ["UnetModem"]

_SECOND_NS = 1_000_000_000
_DATA = 2
"""The physical layer's data channel."""
_ALL = 0
_ASKED_AT_START, _KEPT = 8, 12
_ASK_EVERY_NS = 5 * _SECOND_NS
_BUSY_NS = 2 * _SECOND_NS
"""So near to a launch the modem is not asked for its time."""
_ANSWER_MS = 500


class UnetModem:
    """One vehicle's modem."""

    overhead_bytes = 1
    """The packet's length."""

    def __init__(
        self, host: str, port: int, mission: MissionLog, vehicle: int, now_ns: Callable[[], int]
    ) -> None:
        """Connect to the gateway of a modem.

        Args:
            host, port: of its gateway, usually port 1100.
            mission: for the slots.
            vehicle: index of its vehicle; the modem's address must be one more.
            now_ns: mission time.

        Raises:
            MissingDependencyError: unetpy is not installed.
            ScenarioError: nobody is there, or nothing with a physical layer that says its time.
        """
        try:
            import unetpy  # noqa: F401

            fjagepy: Any = import_module("fjagepy")
        except ImportError:
            raise MissingDependencyError("unetpy", "unet") from None
        self.counts: Counter[str] = Counter()
        """Frames that were damaged or of nobody, requests that were refused, questions for the time without an answer."""
        self._vehicle, self._vehicles, self._now_ns = vehicle, len(mission.vehicles), now_ns
        slots = mission.slots
        self._slots: dict[int, list[int]] = {
            k: slots["tol_ns"][slots["sender"] == k].tolist() for k in range(self._vehicles)
        }
        try:
            self._gateway: Any = fjagepy.Gateway(host, port)
        except (ConnectionError, OSError) as error:
            raise ScenarioError(f"modem at {host}:{port} cannot be reached: {error}") from None
        # By its name: fjagepy 2.2 loses an answer of the directory that comes before it waits for it.
        self._phy = self._gateway.agent("phy")
        self._gateway.subscribe(self._gateway.topic(self._phy))
        self._asked_ns, self._launch_ns = now_ns(), 0
        self._answers: deque[tuple[int, int]] = deque(maxlen=_KEPT)
        for _ in range(_ASKED_AT_START):
            self._ask_time()
        if not self._answers:
            self._gateway.close()
            raise ScenarioError(
                f"modem at {host}:{port} does not say the time of its physical layer (phy.time)"
            )

    @property
    def clock_error_ns(self) -> int:
        """What the offset of the modem's clock may be off, either way: at 1500 m/s 1 ms is 1.5 m of range."""
        return min(self._answers)[0] // 2

    def send(self, packet: bytes, tol_ns: int) -> None:
        unetpy: Any = import_module("unetpy")
        if len(packet) > 255:
            raise ScenarioError(f"a packet has {len(packet)} bytes: its length takes one byte, at most 255")
        self._launch_ns = tol_ns
        request = unetpy.TxFrameReq(recipient=self._phy)
        request.to, request.type = _ALL, _DATA
        request.data = [len(packet), *packet]
        request.txTime = (tol_ns - self._offset_ns()) // 1000
        self._gateway.send(request)

    def received(self) -> list[Event]:
        found: list[Event] = []
        while (message := self._gateway.receive()) is not None:
            kind = type(message).__name__
            if kind == "RxFrameNtf":
                event = self._frame(message)
                if event is not None:
                    found.append(event)
            elif kind in {"BadFrameNtf", "CollisionNtf", "FailureNtf", "RefuseRsp"}:
                self.counts[kind] += 1
            elif getattr(message.perf, "value", message.perf) in {"REFUSE", "FAILURE", "NOT_UNDERSTOOD"}:
                self.counts["refused"] += 1
        now_ns = self._now_ns()
        if now_ns - self._asked_ns >= _ASK_EVERY_NS and abs(now_ns - self._launch_ns) > _BUSY_NS:
            self._ask_time()
        return found

    def close(self) -> None:
        """End the connection."""
        self._gateway.close()

    def _offset_ns(self) -> int:
        return min(self._answers)[1]

    def _ask_time(self) -> None:
        fjagepy: Any = import_module("fjagepy")
        self._asked_ns = asked_ns = self._now_ns()
        request = fjagepy.ParameterReq(recipient=self._phy).get("time")
        answer = self._gateway.request(request, _ANSWER_MS)
        answered_ns = self._now_ns()
        modem_us = getattr(answer, "value", None)
        if isinstance(modem_us, bool) or not isinstance(modem_us, int):
            self.counts["no time"] += 1
            return
        taken_ns = answered_ns - asked_ns
        self._answers.append((taken_ns, asked_ns + taken_ns // 2 - modem_us * 1000))

    def _frame(self, message: Any) -> Event | None:
        sender, data, rx_us = (getattr(message, name, None) for name in ("from_", "data", "rxTime"))
        octets = _octets(data)
        if not isinstance(sender, int) or not isinstance(rx_us, int) or octets is None:
            self.counts["without sender, data or time"] += 1
            return None
        if not 1 <= sender <= self._vehicles or not octets or len(octets) <= octets[0]:
            self.counts["not a teammate's"] += 1
            return None
        toa_ns = rx_us * 1000 + self._offset_ns()
        slots = self._slots[sender - 1]
        turn = bisect_right(slots, toa_ns) - 1
        if turn < 0 or abs(toa_ns) >= 2**62:
            self.counts["not in a slot"] += 1
            return None
        fields = {
            "sender": sender - 1,
            "tol_ns": slots[turn],
            "toa_ns": toa_ns,
            "bytes": octets[1 : 1 + octets[0]],
        }
        return _native.Event(max(self._now_ns(), toa_ns), self._vehicle, "reception", **fields)


def _octets(data: Any) -> bytes | None:
    """Java's bytes are signed."""
    try:
        return bytes(int(value) & 0xFF for value in data)
    except (TypeError, ValueError):
        return None
