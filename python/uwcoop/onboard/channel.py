"""The simulated water between nodes: launches in, receptions out, and recorded sensors where a mission is played.

What can be heard, when, and with what luck is in the mission's log, as for `uwcoop run`. When a mission is played, the
channel has the clock: it sends what is stamped up to an instant, then the instant, and waits until the nodes have handled
it. So the order of events is that of the log whatever the load of the machine, and estimates are those of `uwcoop run`.
"""

from __future__ import annotations

import heapq
import math
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.acoustics.modem import frames_of
from uwcoop.errors import LogError
from uwcoop.missionlog.model import EVENT_COLUMNS, Columns, MissionLog
from uwcoop.onboard.messages import Message, MessageError, decode, encode, integer, octets
from uwcoop.onboard.node import KIND_ORDER, SECOND_NS

if TYPE_CHECKING:
    from uwcoop.onboard.transports import Transport

__all__ = ["Channel", "Water", "sensor_messages"]

_DATAGRAM_BYTES = 8000
_RESEND_S = 1.0


class Water:
    """What becomes of a launch."""

    def __init__(self, log: MissionLog) -> None:
        """Take the opportunities of a mission.

        Raises:
            LogError: a mission without slots, or with two-way ranging.
        """
        if not log.slots or not log.opportunities:
            raise LogError(f"mission {log.name!r} has no slots or nobody to hear: there is no channel in it")
        if log.polls:
            raise LogError(f"mission {log.name!r} has two-way ranging: nodes range one-way")
        self.log = log
        slots = log.slots
        self._capacity = {
            (tol_ns, sender): capacity
            for tol_ns, sender, capacity in zip(
                slots["tol_ns"].tolist(),
                slots["sender"].tolist(),
                slots["capacity_bytes"].tolist(),
                strict=True,
            )
        }
        order = np.lexsort((log.opportunities["receiver"], log.opportunities["tol_ns"]))
        self._table = {name: column[order] for name, column in log.opportunities.items()}
        self._tol_ns: list[int] = self._table["tol_ns"].tolist()
        self.launched: set[tuple[int, int]] = set()

    def launch(self, sender: int, tol_ns: int, packet: bytes) -> list[Message]:
        """The receptions of a packet, in the receivers' order.

        Raises:
            MessageError: no slot of the sender, a packet longer than the slot, or a second one in it.
        """
        capacity = self._capacity.get((tol_ns, sender))
        if capacity is None:
            raise MessageError(f"vehicle {sender} has no slot at {tol_ns / SECOND_NS:.9f} s")
        if len(packet) > capacity:
            raise MessageError(
                f"a packet of vehicle {sender} has {len(packet)} bytes: its slot holds {capacity}"
            )
        if (tol_ns, sender) in self.launched:
            raise MessageError(f"vehicle {sender} launched twice at {tol_ns / SECOND_NS:.9f} s")
        self.launched.add((tol_ns, sender))
        link, table = self.log.link, self._table
        frames = frames_of(link, len(packet))
        air_ns = math.floor((link.preamble_s + frames * link.frame_s) * 1e9 + 0.5)
        found: list[Message] = []
        row = bisect_left(self._tol_ns, tol_ns)
        while row < len(self._tol_ns) and self._tol_ns[row] == tol_ns:
            draws = table["draws"][row, :frames]
            survives = len(draws) == frames and bool((draws < table["survive_probability"][row]).all())
            if survives and int(table["sender"][row]) == sender:
                toa_ns = int(table["toa_ns"][row])
                found.append(
                    {
                        "type": "event", "t_ns": toa_ns + air_ns, "vehicle": int(table["receiver"][row]),
                        "kind": "reception", "sender": sender, "tol_ns": tol_ns, "toa_ns": toa_ns,
                        "bytes": packet.hex(),
                    }
                )  # fmt: skip
            row += 1
        return found


def sensor_messages(log: MissionLog, vehicle: int) -> Iterator[Message]:
    """What a log recorded of one vehicle's sensors, and received, in the order in which a node hands it over."""
    streams = [
        _rows(kind, KIND_ORDER[kind], log.events[kind], vehicle)
        for kind in EVENT_COLUMNS
        if kind in log.events
    ]
    if log.receptions:
        streams.append(_received(log, vehicle))
    for _, message in heapq.merge(*streams, key=lambda pair: pair[0]):
        yield message


def _rows(kind: str, order: int, table: Columns, vehicle: int) -> Iterator[tuple[tuple[int, int], Message]]:
    names = [name for name in table if name not in {"t_ns", "vehicle"}]
    for row in np.flatnonzero(table["vehicle"] == vehicle).tolist():
        t_ns = int(table["t_ns"][row])
        values = {name: _plain(table[name][row]) for name in names}
        yield (t_ns, order), {"type": "event", "t_ns": t_ns, "vehicle": vehicle, "kind": kind, **values}


def _received(log: MissionLog, vehicle: int) -> Iterator[tuple[tuple[int, int], Message]]:
    table = log.receptions
    for row in np.flatnonzero(table["receiver"] == vehicle).tolist():
        times = {name: int(table[name][row]) for name in ("t_ns", "sender", "tol_ns", "toa_ns")}
        message = {"type": "event", "vehicle": vehicle, "kind": "reception", **times}
        yield (times["t_ns"], KIND_ORDER["reception"]), {**message, "bytes": log.payloads[row].hex()}


def _plain(value: Any) -> Any:
    value = value.item()
    return None if isinstance(value, float) and math.isnan(value) else value


class Channel:
    """The water between nodes on a transport."""

    def __init__(self, log: MissionLog, transport: Transport, say: Callable[[str], None]) -> None:
        """Make the channel of a mission.

        Args:
            log: simulated, or recorded with opportunities.
            transport: peers are the vehicles, by name.
            say: takes what a user should know, one line each.
        """
        self.log, self.transport, self.say = log, transport, say
        self.water = Water(log)
        self.away = set(range(len(log.vehicles)))
        """Nodes that are not waited for."""
        self.ready_ns = [-1] * len(log.vehicles)
        self.sent = [0] * len(log.vehicles)
        self.refused = 0
        self._arriving: list[tuple[int, int, int, Message]] = []
        self._order = 0
        self._said_order()

    def play(self, speed: float = 1.0, *, wait_s: float = 30.0, patience_s: float = 5.0) -> None:
        """Feed the nodes their sensors and each other's packets from the mission's start to its end.

        Args:
            speed: mission seconds in a second; 0: as fast as the nodes are.
            wait_s: for the nodes to be there, before the start.
            patience_s: for a node to handle what it got, before the mission goes on without it.
        """
        self._gather(wait_s)
        streams = [sensor_messages(self.log, k) for k in range(len(self.log.vehicles))]
        heads = [next(stream, None) for stream in streams]
        began_s = time.monotonic()
        for t_ns in self._instants():
            if speed > 0:
                self._receive_until(began_s + t_ns / SECOND_NS / speed)
            due: list[list[Message]] = [[] for _ in self.log.vehicles]
            for k, stream in enumerate(streams):
                while (head := heads[k]) is not None and head["t_ns"] <= t_ns:
                    due[k].append(head)
                    heads[k] = next(stream, None)
            for message in self._arrived(t_ns):
                due[message["vehicle"]].append(message)
            self._step(t_ns, due, patience_s)
        for name in self.log.vehicles:
            self.transport.send(name, encode({"type": "end"}))

    def relay(self, now_ns: Callable[[], int]) -> None:
        """Deliver packets between nodes that have clocks of their own, until the mission ends."""
        while (now := now_ns()) <= self.log.duration_ns:
            for message in self._arrived(now):
                self._send(message["vehicle"], [message])
            next_ns = self._arriving[0][0] if self._arriving else now + SECOND_NS
            self._receive(min(max(next_ns - now, 0) / SECOND_NS, 0.5))

    def _said_order(self) -> None:
        known = [kind for kind in EVENT_COLUMNS if kind in self.log.events]
        if list(self.log.events) != known:
            self.say(
                f"note: the log orders simultaneous events as {', '.join(self.log.events)}, nodes as "
                f"{', '.join(known)}: estimates may differ from those of `uwcoop run` in the last bits"
            )

    def _instants(self) -> list[int]:
        seconds = range(0, self.log.duration_ns + 1, SECOND_NS)
        return sorted(
            {*seconds, *(t for t in self.log.slots["tol_ns"].tolist() if t <= self.log.duration_ns)}
        )

    def _gather(self, wait_s: float) -> None:
        until_s = time.monotonic() + wait_s
        while self.away and time.monotonic() < until_s:
            self._receive(0.1)
        for vehicle in sorted(self.away):
            self.say(f"{self.log.vehicles[vehicle]} is not there: the mission starts without it")

    def _step(self, t_ns: int, due: list[list[Message]], patience_s: float) -> None:
        for vehicle, messages in enumerate(due):
            self._send(vehicle, messages)
        began_s = time.monotonic()
        told_s = -math.inf
        while waiting := [k for k in range(len(due)) if k not in self.away and self.ready_ns[k] < t_ns]:
            now_s = time.monotonic()
            if now_s - told_s > _RESEND_S:
                told_s = now_s
                for k in waiting:
                    self._tell(k, t_ns)
            if now_s - began_s > patience_s:
                for k in waiting:
                    self.away.add(k)
                    self.say(
                        f"{self.log.vehicles[k]} does not answer at {t_ns / SECOND_NS:.3f} s: on without it"
                    )
                return
            self._receive(0.05)

    def _tell(self, vehicle: int, t_ns: int) -> None:
        clock = {"type": "clock", "t_ns": t_ns, "sent": self.sent[vehicle]}
        self.transport.send(self.log.vehicles[vehicle], encode(clock))

    def _send(self, vehicle: int, messages: list[Message]) -> None:
        lines: list[bytes] = []
        size = 0
        for message in messages:
            line = encode(message)
            if lines and size + len(line) > _DATAGRAM_BYTES:
                self.transport.send(self.log.vehicles[vehicle], b"".join(lines))
                lines, size = [], 0
            lines.append(line)
            size += len(line)
        if lines:
            self.transport.send(self.log.vehicles[vehicle], b"".join(lines))
        self.sent[vehicle] += len(messages)

    def _arrived(self, t_ns: int) -> Iterator[Message]:
        while self._arriving and self._arriving[0][0] <= t_ns:
            yield heapq.heappop(self._arriving)[3]

    def _receive_until(self, at_s: float) -> None:
        while (left_s := at_s - time.monotonic()) > 0:
            self._receive(left_s)

    def _receive(self, timeout_s: float) -> None:
        for source, datagram in self.transport.receive(timeout_s):
            try:
                for message in decode(datagram):
                    self._message(source, message)
            except MessageError as error:
                self.refused += 1
                self.say(f"refused, from {source}: {error}")

    def _message(self, source: str, message: Message) -> None:
        vehicle = integer(message, "vehicle")
        if source not in self.log.vehicles or self.log.vehicles.index(source) != vehicle:
            raise MessageError(f"it speaks for vehicle {vehicle}")
        if message["type"] == "hello":
            if vehicle in self.away:
                self.away.discard(vehicle)
                self.say(f"{source} is there")
        elif message["type"] == "ready":
            self.ready_ns[vehicle] = max(self.ready_ns[vehicle], integer(message, "t_ns"))
        elif message["type"] == "launch":
            tol_ns = integer(message, "tol_ns")
            for arrival in self.water.launch(vehicle, tol_ns, octets(message, "bytes")):
                self._order += 1
                heapq.heappush(self._arriving, (arrival["t_ns"], arrival["vehicle"], self._order, arrival))
        else:
            raise MessageError(f"type {message['type'][:20]!r} is unknown")
