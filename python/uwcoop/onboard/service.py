"""A node with its clock, transport and modem: what `uwcoop node` runs.

Mission time is the channel's, or this machine's clock less the mission's epoch. The system clock is read once and carried
on by the monotonic clock, which time services slew and never step: a step is said, and not followed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from uwcoop.errors import UwcoopError
from uwcoop.onboard.messages import Message, MessageError, decode, encode, event_of, integer
from uwcoop.onboard.modems import ChannelModem
from uwcoop.onboard.node import SECOND_NS, Node

if TYPE_CHECKING:
    from uwcoop._native import Event
    from uwcoop.onboard.journal import Journal
    from uwcoop.onboard.modems import Modem
    from uwcoop.onboard.transports import Transport
    from uwcoop.onboard.vehicle import VehicleNavigator

__all__ = ["NodeService", "ServiceOptions", "SystemClock"]

_HELLO_S = 0.25
_STEP_S = 0.1
"""A difference of system and monotonic clock that changes by so much is a step."""


@dataclass(frozen=True)
class ServiceOptions:
    """How a node runs. Bounds are checked by the command line."""

    checkpoint_s: float = 30.0
    """Between two checkpoints."""
    reorder_s: float = 0.2
    """System clock: events are handed over so long after their stamp, so that those of slower sensors come in order."""
    lead_s: float = 0.5
    """System clock: the packet is asked for so long before its launch."""
    channel_silent_s: float = 10.0
    """Channel's clock: without a word for so long, an alarm."""
    silent_after_s: float = 10.0
    """A sensor that is silent for so long raises an alarm; 0: none does."""


class SystemClock:
    """This machine's time since the mission's epoch."""

    def __init__(self, epoch_ns: int) -> None:
        self.epoch_ns = epoch_ns
        self._offset_ns = self._difference_ns()

    def now_ns(self) -> int:
        """Mission time."""
        return time.monotonic_ns() + self._offset_ns - self.epoch_ns

    def step_s(self) -> float:
        """By how much the system clock was stepped since the start."""
        return (self._difference_ns() - self._offset_ns) / SECOND_NS

    @staticmethod
    def _difference_ns() -> int:
        return time.time_ns() - time.monotonic_ns()


class NodeService:
    """One node on its transport."""

    def __init__(
        self,
        vehicle: VehicleNavigator,
        transport: Transport,
        journal: Journal | None = None,
        *,
        clock: SystemClock | None = None,
        modem: Modem | None = None,
        drivers: tuple[Callable[[], list[Event]], ...] = (),
        options: ServiceOptions | None = None,
    ) -> None:
        """Make a node, resumed from its journal.

        Args:
            vehicle: its navigator, fresh.
            transport: peers `channel`, `watch`, and drivers of sensors under any other name.
            journal: where it writes down what it does.
            clock: None: the channel's.
            modem: None: the channel's.
            drivers: each gives what its sensors have said since the last call, without waiting.
            options: see there.
        """
        self.options = options or ServiceOptions()
        self.transport, self.clock, self.journal, self.drivers = transport, clock, journal, drivers
        self.modem = modem or ChannelModem(transport, vehicle.index)
        self.node = Node(
            vehicle,
            self._out,
            journal,
            silent_after_s=self.options.silent_after_s,
            overhead_bytes=self.modem.overhead_bytes,
        )
        self.ended = False
        self._taken = 0
        self._baseline: int | None = None
        self._clock_ns = -1
        now_s = time.monotonic()
        self._heard_s = self._hello_s = self._checkpoint_s = now_s

    def run(self) -> None:
        """Until the mission is over; then a last checkpoint."""
        duration_ns = self.node.vehicle.mission.duration_ns
        while not self.ended:
            for source, datagram in self.transport.receive(self._wait_s()):
                self.datagram(source, datagram)
            for event in self.modem.received():
                self.node.take(event)
            for driver in self.drivers:
                for event in driver():
                    self._take_of_driver(event)
            if self.clock is None:
                self._watch_channel()
            else:
                self._pass_time(self.clock)
                late_ns = round((1.0 + self.options.reorder_s) * SECOND_NS)
                self.ended = self.node.now_ns >= duration_ns or self.clock.now_ns() > duration_ns + late_ns
            if time.monotonic() - self._checkpoint_s >= self.options.checkpoint_s:
                self._checkpoint_s = time.monotonic()
                self.node.checkpoint()
        self.node.checkpoint()

    def datagram(self, source: str, datagram: bytes) -> None:
        """What came from a peer; what is malformed is counted and said, and changes nothing."""
        try:
            messages = decode(datagram)
        except MessageError as error:
            self._malformed(source, error)
            return
        for message in messages:
            try:
                self._message(source, message)
            except MessageError as error:
                self._malformed(source, error)

    def _message(self, source: str, message: Message) -> None:
        kind = message["type"]
        if kind == "event":
            if source == "watch":
                raise MessageError("the watch sends no events")
            event = event_of(message)
            if source != "channel" and event.kind in {"reception", "delivered"}:
                raise MessageError(f"{source} sent a {event.kind}: that is the modem's")
            self._refuse_ahead(event)
            copies = self.node.counts["duplicate"]
            self.node.take(event)
            if source == "channel" and self.node.counts["duplicate"] == copies:
                self._taken += 1
        elif source != "channel":
            raise MessageError(f"{source} sent {kind[:20]!r}: that is the channel's")
        elif kind == "clock" and self.clock is None:
            self._tick(integer(message, "t_ns"), integer(message, "sent"))
        elif kind == "end" and self.clock is None:
            self.ended = True
        elif kind not in {"clock", "end"}:
            raise MessageError(f"type {kind[:20]!r} is unknown")

    def _take_of_driver(self, event: Event) -> None:
        try:
            self._refuse_ahead(event)
        except MessageError as error:
            self._malformed("a driver", error)
        else:
            self.node.take(event)

    def _refuse_ahead(self, event: Event) -> None:
        """What waits for a time that does not come would fill the queue."""
        if self.clock is not None and event.t_ns > self.clock.now_ns() + 60 * SECOND_NS:
            raise MessageError(f"{event.kind} is stamped more than 60 s ahead of the clock")

    def _tick(self, t_ns: int, sent: int) -> None:
        if self._baseline is None:
            self._baseline = sent - self._taken
        self._heard_s = time.monotonic()
        if t_ns < self._clock_ns:
            self.node.alarm("clock stepped", f"the channel's clock went back to {t_ns / SECOND_NS:.3f} s")
            return
        lost = sent - self._baseline - self._taken
        if lost > 0:
            self._baseline += lost
            self.node.counts["lost"] += lost
            self.node.alarm("messages lost", f"{lost} events did not come from the channel")
        if self._clock_ns < 0 and t_ns > self.node.now_ns + 2 * SECOND_NS:
            self.node.skip_to(t_ns)
        self._clock_ns = t_ns
        self.node.clear("channel silent", "the channel is back")
        self.node.advance(t_ns)
        ready = {"type": "ready", "vehicle": self.node.vehicle.index, "t_ns": t_ns}
        self.transport.send("channel", encode(ready))

    def _pass_time(self, clock: SystemClock) -> None:
        now_ns = clock.now_ns()
        if abs(step_s := clock.step_s()) > _STEP_S:
            text = f"the system clock was stepped by {step_s:+.3f} s; the node does not follow: restart it to do so"
            self.node.alarm("clock stepped", text)
        if self._clock_ns < 0:
            self._clock_ns = now_ns
            if now_ns > 2 * SECOND_NS:
                self.node.skip_to(now_ns)
        until_ns = now_ns - round(self.options.reorder_s * SECOND_NS)
        slot_ns = self.node.next_slot_ns
        if slot_ns is not None and now_ns >= slot_ns - round(self.options.lead_s * SECOND_NS):
            until_ns = max(until_ns, slot_ns)
        self.node.advance(until_ns, now_ns)

    def _watch_channel(self) -> None:
        now_s = time.monotonic()
        if now_s - self._heard_s > _HELLO_S and now_s - self._hello_s > _HELLO_S:
            self._hello_s = now_s
            self._hello()
        if now_s - self._heard_s > self.options.channel_silent_s:
            self.node.alarm("channel silent", f"no word for {self.options.channel_silent_s:g} s")

    def _hello(self) -> None:
        vehicle = self.node.vehicle
        self.transport.send("channel", encode({"type": "hello", "vehicle": vehicle.index}))

    def _wait_s(self) -> float:
        if self.clock is None:
            return _HELLO_S
        now_ns = self.clock.now_ns()
        due = [self.node.next_sample_ns + round(self.options.reorder_s * SECOND_NS)]
        if self.node.next_slot_ns is not None:
            due.append(self.node.next_slot_ns - round(self.options.lead_s * SECOND_NS))
        # Adapters are asked in turn: a modem often enough to launch in time, drivers ten times a second.
        asked_s = 0.01 if not isinstance(self.modem, ChannelModem) else 0.1 if self.drivers else 0.5
        return min(max(min(due) - now_ns, 0) / SECOND_NS + 0.001, asked_s)

    def _malformed(self, source: str, error: UwcoopError) -> None:
        self.node.counts["malformed"] += 1
        self.node.alarm("malformed message", f"from {source}: {error}")

    def _out(self, message: Message) -> None:
        if message["type"] == "launch":
            self.modem.send(bytes.fromhex(message["bytes"]), message["tol_ns"])
        else:
            self.transport.send("watch", encode(message))
