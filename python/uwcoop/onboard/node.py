"""A node without clocks and sockets: events into the order of time, slots, journal, estimates, alarms.

Everything here is a function of the calls that come in, so a node of a simulated dive is that of a real one. Order is
that of a mission's replay: (time, class, kind, arrival), the class being sensors, receptions, transmit, roles. What comes
after something later was handed over is late: it is counted, and handed over at once to a navigator whose option `late`
takes it; else it is said and not used.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from uwcoop.errors import LogError, NavigatorError, UwcoopError
from uwcoop.missionlog.model import EVENT_COLUMNS
from uwcoop.onboard.messages import Message, encode, event_message, event_of, integer

if TYPE_CHECKING:
    from uwcoop._native import Event
    from uwcoop.onboard.journal import Journal
    from uwcoop.onboard.vehicle import Slot, VehicleNavigator

__all__ = ["KIND_ORDER", "Node"]

SECOND_NS = 1_000_000_000
_SENSOR, _RECEPTION, _TRANSMIT, _ROLE, _SAMPLE = range(5)
_ROLES = {"landed", "lifted_off", "role_taken"}
KIND_ORDER = {
    kind: index
    for index, kind in enumerate(
        [*(kind for kind in EVENT_COLUMNS if kind != "odometry"), "odometry", "reception", "delivered"]
    )
}
"""Odometry comes after all other sensors of its instant: a position and a heading hold at its end."""
RECENT_NS = 60 * SECOND_NS
"""For so long events are known again: a datagram that came twice is fused once."""
QUEUE_LIMIT = 20_000
"""Events that wait at most: a source that runs away must not fill the memory."""

Key = tuple[int, int, int]


class Node:
    """One vehicle's navigator with everything around it that has no clock."""

    def __init__(
        self,
        vehicle: VehicleNavigator,
        out: Callable[[Message], None],
        journal: Journal | None = None,
        *,
        silent_after_s: float = 10.0,
        overhead_bytes: int = 0,
    ) -> None:
        """Make a node, and resume what its journal holds.

        Args:
            vehicle: its navigator, fresh.
            out: takes `launch`, `estimate` and `diagnostic` messages.
            journal: None: nothing is kept, a node that is killed starts anew.
            overhead_bytes: what the modem adds to a packet.
            silent_after_s: a kind of sensor event that came and then does not for so long raises an alarm.

        Raises:
            LogError, NavigatorError: a journal that does not belong to this navigator, or is damaged.
        """
        self.vehicle, self.journal = vehicle, journal
        self._overhead_bytes = overhead_bytes
        self._out = out
        self._silent_ns = round(silent_after_s * SECOND_NS)
        self._queue: list[tuple[Key, int, Event]] = []
        self._arrivals = 0
        self._recent: dict[bytes, int] = {}
        self._known_from_ns = -1
        """From here on it is known what was handed over; a late event from before may be a copy."""
        self._slot = 0
        self._next_sample_ns = 0
        self.done: Key = (-1, 0, 0)
        """The last thing that was handed over."""
        self.counts: Counter[str] = Counter()
        self._pace: dict[
            str, tuple[int, int]
        ] = {}  # kind -> its last time, and the time between its last two
        self.heard_ns: dict[int, int] = {}
        self.alarms: set[str] = set()
        self.resumed = 0
        """Lines of the journal that were done again."""
        if journal is not None:
            self._resume(journal)

    @property
    def now_ns(self) -> int:
        """Time of the last thing that was handed over, -1 before the first."""
        return self.done[0]

    @property
    def next_sample_ns(self) -> int:
        """Time of the next estimate."""
        return self._next_sample_ns

    @property
    def next_slot_ns(self) -> int | None:
        """Launch of this vehicle's next slot; None after the last."""
        slot = self._due_slot()
        return None if slot is None else slot.tol_ns

    def take(self, event: Event) -> bool:
        """Queue an event of this vehicle until `advance` passes its time; False if it is not taken."""
        key = _key(event)
        if event.vehicle != self.vehicle.index:
            self.counts["misaddressed"] += 1
            return False
        if not 0 <= event.t_ns <= self.vehicle.mission.duration_ns:
            self.counts["before the start" if event.t_ns < 0 else "after the end"] += 1
            return False
        line = encode(event_message(event))
        if line in self._recent:  # it would count as new knowledge
            self.counts["duplicate"] += 1
            self.alarm(
                "duplicate event", f"{event.kind} at {event.t_ns / SECOND_NS:.3f} s came twice; used once"
            )
            return False
        if key < self.done:
            return self._late(event, line, key)
        if len(self._queue) >= QUEUE_LIMIT:
            self.alarm("queue full", f"{QUEUE_LIMIT} events wait: a source is ahead of the clock")
            self.counts["overflowed"] += 1
            return False
        self._remember(line, event.t_ns)
        self._arrivals += 1
        heapq.heappush(self._queue, (key, self._arrivals, event))
        return True

    def advance(self, until_ns: int, launch_from_ns: int | None = None) -> None:
        """Everything up to and including `until_ns` happens, in order.

        Args:
            until_ns: mission time that the clock has passed.
            launch_from_ns: slots before it have been missed; None takes `until_ns`.
        """
        launch_from_ns = until_ns if launch_from_ns is None else launch_from_ns
        while True:
            slot = self._due_slot()
            heads: list[Key] = [(self._next_sample_ns, _SAMPLE, 0)]
            if self._queue:
                heads.append(self._queue[0][0])
            if slot is not None:
                heads.append((slot.tol_ns, _TRANSMIT, 0))
            key = min(heads)
            if key[0] > until_ns:
                return
            if key[1] == _SAMPLE:
                self._sample(key[0])
            elif key[1] == _TRANSMIT and slot is not None:
                self._slot += 1
                self._transmit(slot, key, launch_from_ns)
            else:
                self._hand_over(heapq.heappop(self._queue)[2], key)

    def skip_to(self, t_ns: int) -> None:
        """The node was not running before `t_ns`: no estimates are said for that time, its slots are missed."""
        self._next_sample_ns = max(self._next_sample_ns, -(-t_ns // SECOND_NS) * SECOND_NS)

    def checkpoint(self) -> None:
        """Keep the state, if there is a journal."""
        if self.journal is not None:
            heard = {str(sender): tol_ns for sender, tol_ns in self.heard_ns.items()}
            about = {"done": list(self.done), "counts": dict(self.counts), "heard_ns": heard}
            self.journal.checkpoint(self.vehicle.save(), about)

    def alarm(self, name: str, text: str) -> None:
        """Say that something is wrong, once until it is over."""
        if name not in self.alarms:
            self.alarms.add(name)
            self._diagnostic(name, True, text)

    def clear(self, name: str, text: str) -> None:
        """Say that something is right again."""
        if name in self.alarms:
            self.alarms.discard(name)
            self._diagnostic(name, False, text)

    def _diagnostic(self, name: str, raised: bool, text: str) -> None:
        self._out(
            {
                "type": "diagnostic", "vehicle": self.vehicle.index, "t_ns": max(self.now_ns, 0),
                "alarm": name, "raised": raised, "text": text,
            }
        )  # fmt: skip

    def _remember(self, line: bytes, t_ns: int) -> None:
        self._recent[line] = t_ns
        kept_ns = max(RECENT_NS, self.vehicle.late_lag_ns + SECOND_NS)
        while self._recent:
            first = next(iter(self._recent))
            if len(self._recent) <= QUEUE_LIMIT and self._recent[first] >= self.now_ns - kept_ns:
                return
            self._known_from_ns = max(self._known_from_ns, self._recent.pop(first))

    def _late(self, event: Event, line: bytes, key: Key) -> bool:
        self.counts["late"] += 1
        behind_ns = self.now_ns - event.t_ns
        if behind_ns > self.vehicle.late_lag_ns or event.t_ns <= self._known_from_ns:
            said = f"{event.kind} came {behind_ns / SECOND_NS:.3f} s after its turn and is not used"
            self.alarm("late event", said)
            return False
        self._remember(line, event.t_ns)
        self._hand_over(event, key)
        return True

    def _due_slot(self) -> Slot | None:
        slots = self.vehicle.slots
        return slots[self._slot] if self._slot < len(slots) else None

    def _hand_over(self, event: Event, key: Key) -> None:
        if self.journal is not None:
            self.journal.append(event_message(event))
        self._handle(event, key)

    def _handle(self, event: Event, key: Key) -> None:
        self.done = max(self.done, key)
        try:
            outcome = self.vehicle.handle(event)
        except NavigatorError as error:
            if self.journal is not None:
                self.journal.append({"type": "refused"})
            self.counts["refused"] += 1
            self.alarm("event refused", str(error))
            return
        self.counts[outcome] += 1
        if event.kind in self._pace and event.t_ns > self._pace[event.kind][0]:
            self._pace[event.kind] = event.t_ns, event.t_ns - self._pace[event.kind][0]
        self._pace.setdefault(event.kind, (event.t_ns, 0))
        if event.kind == "reception" and outcome in {"fused", "noted"}:
            sender, tol_ns = event.fields["sender"], event.fields["tol_ns"]
            self.heard_ns[sender] = max(self.heard_ns.get(sender, tol_ns), tol_ns)
        self.clear(f"{event.kind} silent", f"{event.kind} is back")

    def _transmit(self, slot: Slot, key: Key, launch_from_ns: int) -> None:
        if slot.tol_ns < launch_from_ns:
            self.counts["missed"] += 1
            self.alarm("slot missed", f"the slot at {slot.tol_ns / SECOND_NS:.3f} s was missed")
            return
        self.clear("slot missed", f"the slot at {slot.tol_ns / SECOND_NS:.3f} s is used")
        room_bytes = max(slot.capacity_bytes - self._overhead_bytes, 0)
        if self.journal is not None:
            line = {"type": "slot", "tol_ns": slot.tol_ns, "capacity_bytes": room_bytes}
            self.journal.append(line, sync=True)
        packet = self._packet(slot.tol_ns, room_bytes, key)
        if packet is not None:
            self._out(
                {
                    "type": "launch", "vehicle": self.vehicle.index, "tol_ns": slot.tol_ns,
                    "bytes": packet.hex(),
                }
            )  # fmt: skip

    def _packet(self, tol_ns: int, capacity_bytes: int, key: Key) -> bytes | None:
        self.done = key
        try:
            packet = self.vehicle.transmit(tol_ns, capacity_bytes)
        except NavigatorError as error:
            self.counts["unsent"] += 1
            self.alarm("packet not made", str(error))
            return None
        self.counts["silent" if packet is None else "sent"] += 1
        return packet

    def _sample(self, t_ns: int) -> None:
        self._next_sample_ns += SECOND_NS
        self._look_for_silence(t_ns)
        found = self.vehicle.estimate(t_ns)
        mean, covariance = found.mean_m.tolist(), found.covariance_m2.ravel().tolist()
        self._out(
            {
                "type": "estimate", "vehicle": self.vehicle.index, "t_ns": t_ns,
                "mean_m": _finite(mean), "covariance_m2": _finite(covariance),
                "yaw_rad": _finite([found.yaw_rad])[0], "ess": _finite([found.ess])[0],
                "rejected": found.rejected, "status": found.status, "counts": dict(self.counts),
                "heard_ns": {str(sender): tol_ns for sender, tol_ns in self.heard_ns.items()},
            }
        )  # fmt: skip

    def _look_for_silence(self, t_ns: int) -> None:
        """A sensor that has spoken twice is expected to go on, at the pace of its own."""
        for kind, (last_ns, apart_ns) in self._pace.items():
            periodic = kind != "reception" and kind not in _ROLES and self._silent_ns > 0 and apart_ns > 0
            if periodic and t_ns - last_ns > max(self._silent_ns, 3 * apart_ns):
                self.alarm(f"{kind} silent", f"no {kind} since {last_ns / SECOND_NS:.3f} s")

    def _resume(self, journal: Journal) -> None:
        state, kept, lines = journal.resume()
        if state is not None:
            self.vehicle.restore(state)
            t_ns, order, kind = kept["done"]
            self.done = t_ns, order, kind
            self._known_from_ns = t_ns
            self.counts.update(kept["counts"])
            self.heard_ns.update({int(sender): tol_ns for sender, tol_ns in kept["heard_ns"].items()})
        self._again(lines)
        self._slot = sum((slot.tol_ns, _TRANSMIT, 0) <= self.done for slot in self.vehicle.slots)
        self.skip_to(self.now_ns + 1)
        if journal.notes:
            self.alarm("journal cut", "; ".join(journal.notes))

    def _again(self, lines: Iterable[Message]) -> None:
        """Do again what the journal holds after the checkpoint, without sending."""
        quiet, self.journal = self.journal, None
        said, self._out = self._out, lambda message: None
        try:
            for line in lines:
                self._repeat(line)
                self.resumed += 1
        except UwcoopError as error:
            raise LogError(f"the journal cannot be resumed: {error}") from None
        finally:
            self.journal, self._out = quiet, said
        self.alarms.clear()

    def _repeat(self, line: Message) -> None:
        if line["type"] == "event":
            event = event_of(line)
            self._remember(encode(line), event.t_ns)
            self._handle(event, _key(event))
        elif line["type"] == "slot":
            tol_ns = integer(line, "tol_ns")
            self._packet(tol_ns, integer(line, "capacity_bytes"), (tol_ns, _TRANSMIT, 0))
        # "refused": the event before it was refused again


def _key(event: Event) -> Key:
    kind = event.kind
    order = _RECEPTION if kind in {"reception", "delivered"} else _ROLE if kind in _ROLES else _SENSOR
    return event.t_ns, order, KIND_ORDER[kind]


def _finite(values: list[float]) -> list[float | None]:
    """JSON has no NaN and no infinity: null."""
    return [value if abs(value) < float("inf") else None for value in values]
