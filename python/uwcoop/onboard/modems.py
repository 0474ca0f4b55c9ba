"""What a node asks of a modem, and the simulated one.

A modem adapter sends a packet at a launch time and gives what was received as `reception` events: packet, sender, launch,
arrival of the signal's start, stamped when decoding ended. All times are ns since the mission's epoch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from uwcoop.onboard.messages import encode

if TYPE_CHECKING:
    from uwcoop._native import Event
    from uwcoop.onboard.transports import Transport

__all__ = ["ChannelModem", "Modem"]


class Modem(Protocol):
    """One vehicle's acoustic modem."""

    overhead_bytes: int
    """What it adds to a packet: the slot holds so much less."""

    def send(self, packet: bytes, tol_ns: int) -> None:
        """Launch the packet at `tol_ns`, which lies ahead by the node's lead."""

    def received(self) -> list[Event]:
        """What has been decoded since the last call, as `reception` events of this vehicle; does not wait."""


class ChannelModem:
    """The simulated water's: launches go to `uwcoop channel`, whose receptions come as messages to the node."""

    overhead_bytes = 0

    def __init__(self, transport: Transport, vehicle: int) -> None:
        self._transport, self._vehicle = transport, vehicle

    def send(self, packet: bytes, tol_ns: int) -> None:
        launch = {"type": "launch", "vehicle": self._vehicle, "tol_ns": tol_ns, "bytes": packet.hex()}
        self._transport.send("channel", encode(launch))

    def received(self) -> list[Event]:
        return []
