"""What nodes say, live: lines of JSON, or a table on the terminal."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from uwcoop.onboard.messages import Message, MessageError, decode

if TYPE_CHECKING:
    from rich.table import Table

    from uwcoop.onboard.transports import Transport

__all__ = ["Watched", "watch_drawn", "watch_lines", "watch_table"]


class Watched:
    """The last word of each node."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self.estimates: dict[str, Message] = {}
        self.alarms: dict[str, dict[str, str]] = {name: {} for name in names}

    def take(self, source: str, message: Message) -> None:
        """Note a message of a vehicle."""
        if source not in self.alarms:
            return
        if message["type"] == "estimate":
            self.estimates[source] = message
        elif message["type"] == "diagnostic":
            name = str(message.get("alarm"))
            if message.get("raised"):
                self.alarms[source][name] = str(message.get("text"))
            else:
                self.alarms[source].pop(name, None)

    def table(self) -> Table:
        """Position, sigma, last heard, slots and alarms, a row for each vehicle."""
        from rich.table import Table

        table = Table(title="nodes")
        for column in (
            "vehicle",
            "time, s",
            "east, m",
            "north, m",
            "sigma, m",
            "status",
            "heard",
            "sent",
            "missed",
            "alarms",
        ):
            table.add_column(
                column, justify="left" if column in {"vehicle", "status", "heard", "alarms"} else "right"
            )
        for name in self.names:
            table.add_row(name, *self._cells(name))
        return table

    def _cells(self, name: str) -> list[str]:
        said = self.estimates.get(name)
        alarms = "; ".join(f"{alarm}: {text}" for alarm, text in self.alarms[name].items())
        if said is None:
            return ["-"] * 8 + [alarms or "no word yet"]
        east_m, north_m = said["mean_m"]
        variances = said["covariance_m2"][0], said["covariance_m2"][3]
        sigma_m = None if None in variances else math.sqrt(sum(variances))
        now_s = said["t_ns"] / 1e9
        heard = [
            f"{self.names[int(sender)]} {now_s - tol_ns / 1e9:.0f} s"
            for sender, tol_ns in said["heard_ns"].items()
        ]
        counts = said["counts"]
        return [
            f"{now_s:.0f}", _metres(east_m), _metres(north_m), _metres(sigma_m), said["status"],
            ", ".join(heard) or "-", str(counts.get("sent", 0)), str(counts.get("missed", 0)), alarms,
        ]  # fmt: skip


def watch_drawn(transport: Transport, take: Callable[[str, Message], None], until_s: float | None) -> None:
    """Every message goes to `take`, with the name of its sender."""
    for source, message in _messages(transport, until_s):
        with contextlib.suppress(KeyError, TypeError, ValueError):  # of another version, or damaged
            take(source, message)


def watch_lines(transport: Transport, names: Sequence[str], until_s: float | None) -> None:
    """Every message as a line of JSON on stdout."""
    for _, message in _messages(transport, until_s):
        sys.stdout.write(json.dumps(message) + "\n")
        sys.stdout.flush()


def watch_table(transport: Transport, names: Sequence[str], until_s: float | None) -> None:
    """A table that is drawn anew as the nodes speak."""
    from rich.live import Live

    watched = Watched(names)
    with Live(watched.table(), refresh_per_second=4) as live:
        for source, message in _messages(transport, until_s):
            watched.take(source, message)
            live.update(watched.table())


def _messages(transport: Transport, until_s: float | None) -> Any:
    began_s = time.monotonic()
    while until_s is None or time.monotonic() - began_s < until_s:
        for source, datagram in transport.receive(0.25):
            try:
                for message in decode(datagram):
                    yield source, message
            except MessageError:
                continue


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
