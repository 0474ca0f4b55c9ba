"""How messages travel: datagrams of lines over UDP. A transport knows nothing of what they say.

A name stands for each program: `channel`, `watch`, and the vehicles' own. Sockets bind to loopback unless told
otherwise, and what comes from an address that is nobody's is dropped and counted.
"""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Mapping, Sequence
from typing import Protocol

from uwcoop.errors import ScenarioError

__all__ = [
    "BASE_PORT",
    "Address",
    "Transport",
    "UdpTransport",
    "address_of",
    "default_addresses",
    "open_transport",
]

Address = tuple[str, int]
BASE_PORT = 7400
"""The watch listens here, the channel one above, then the vehicles in the team's order."""
_BUFFER_BYTES = 2**20
_AT_ONCE = 256


class Transport(Protocol):
    """Datagrams to and from programs by name."""

    dropped: int
    """Datagrams from unknown addresses."""

    def send(self, to: str, datagram: bytes) -> None:
        """Send, or lose: a peer that is not there is no error."""

    def receive(self, timeout_s: float) -> list[tuple[str, bytes]]:
        """What has come, with who sent it; waits for at most `timeout_s`."""

    def close(self) -> None: ...


def default_addresses(vehicles: Sequence[str], base_port: int = BASE_PORT) -> dict[str, Address]:
    """Where each program listens on this machine.

    Raises:
        ScenarioError: ports outside 1024 to 65535.
    """
    names = ["watch", "channel", *vehicles]
    if not 1024 <= base_port <= 65535 - len(names):
        raise ScenarioError(f"base port is {base_port}: must be 1024 to {65535 - len(names)}")
    return {name: ("127.0.0.1", base_port + k) for k, name in enumerate(names)}


def address_of(text: str) -> Address:
    """The address in HOST:PORT.

    Raises:
        ScenarioError: it is none.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ScenarioError(f"address {text!r} is not of the form HOST:PORT")
    return host, int(port)


def open_transport(kind: str, name: str, own: Address, peers: Mapping[str, Address]) -> Transport:
    """The transport of this kind for the program of this name.

    Raises:
        ScenarioError: an unknown kind, or an address that cannot be had.
        MissingDependencyError: Zenoh is not installed.
    """
    if kind == "udp":
        return UdpTransport(own, peers)
    if kind == "zenoh":
        from uwcoop.onboard.zenoh_transport import ZenohTransport

        return ZenohTransport(name, own, peers)
    raise ScenarioError(f"transport is {kind!r}: must be udp or zenoh")


class UdpTransport:
    """Lines in UDP datagrams."""

    def __init__(self, own: Address, peers: Mapping[str, Address]) -> None:
        """Bind a socket.

        Args:
            own: where to listen.
            peers: where the others are; what comes from anywhere else is dropped.

        Raises:
            ScenarioError: the address cannot be had.
        """
        self.dropped = 0
        self._to = {name: _resolved(address) for name, address in peers.items()}
        self._names = {address: name for name, address in self._to.items()}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        self._socket.setblocking(False)
        try:
            self._socket.bind(_resolved(own))
        except OSError as error:
            self._socket.close()
            raise ScenarioError(
                f"UDP {own[0]}:{own[1]} cannot be had: {error.strerror}: is the program running already?"
            ) from None

    def send(self, to: str, datagram: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody listens there yet, or the buffer is full
            self._socket.sendto(datagram, self._to[to])

    def receive(self, timeout_s: float) -> list[tuple[str, bytes]]:
        found: list[tuple[str, bytes]] = []
        if not select.select([self._socket], [], [], max(timeout_s, 0.0))[0]:
            return found
        for _ in range(_AT_ONCE):
            try:
                datagram, source = self._socket.recvfrom(65535)
            except BlockingIOError:
                break
            except OSError:  # word from the system that a peer was not there
                continue
            name = self._names.get(source)
            if name is None:
                self.dropped += 1
            else:
                found.append((name, datagram))
        return found

    def close(self) -> None:
        self._socket.close()


def _resolved(address: Address) -> Address:
    try:
        return socket.gethostbyname(address[0]), address[1]
    except OSError as error:
        raise ScenarioError(f"host {address[0]!r} is unknown: {error}") from None
