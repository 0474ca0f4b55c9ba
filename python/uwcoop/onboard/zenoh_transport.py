"""Messages over Zenoh, peer to peer over TCP, without a daemon and without multicast.

A program listens at its address and connects to those of its peers. A datagram of FROM for TO is a sample of the key
`uwcoop/TO/FROM`. Unlike a UDP address, FROM is what the sender says: where strangers can reach the network, Zenoh's
access control or TLS is needed.
"""

from __future__ import annotations

import queue
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote, unquote

from uwcoop.errors import MissingDependencyError, ScenarioError

__all__ = ["ZenohTransport"]

Address = tuple[str, int]

_WAITING = 4096
"""Datagrams that wait at most; what comes on top is dropped and counted."""
_AT_ONCE = 256


class ZenohTransport:
    """Lines in Zenoh samples."""

    def __init__(self, name: str, own: Address, peers: Mapping[str, Address]) -> None:
        """Open a session.

        Args:
            name: of this program.
            own: TCP address where to listen.
            peers: where the others listen; what comes from another name is dropped.

        Raises:
            MissingDependencyError: eclipse-zenoh is not installed.
            ScenarioError: the address cannot be had.
        """
        try:
            import zenoh
        except ImportError:
            raise MissingDependencyError("eclipse-zenoh", "live") from None
        self.dropped = 0
        self._name, self._peers = name, frozenset(peers)
        self._waiting: queue.Queue[tuple[str, bytes]] = queue.Queue(_WAITING)
        config = zenoh.Config()
        for key, value in (
            ("mode", '"peer"'),
            ("scouting/multicast/enabled", "false"),
            ("scouting/gossip/enabled", "false"),
            ("listen/endpoints", f'["tcp/{own[0]}:{own[1]}"]'),
            ("connect/endpoints", _endpoints(peers)),
            ("connect/exit_on_failure", "false"),
            ("connect/retry", "{ period_init_ms: 200, period_max_ms: 1000, period_increase_factor: 1.5 }"),
        ):
            config.insert_json5(key, value)
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise ScenarioError(f"Zenoh at tcp/{own[0]}:{own[1]} cannot be had: {error}") from None
        self._subscriber = self._session.declare_subscriber(f"uwcoop/{quote(name, safe='')}/*", self._take)

    def send(self, to: str, datagram: bytes) -> None:
        if to not in self._peers:
            raise ScenarioError(f"{to!r} is no peer of {self._name}")
        self._session.put(f"uwcoop/{quote(to, safe='')}/{quote(self._name, safe='')}", datagram)

    def receive(self, timeout_s: float) -> list[tuple[str, bytes]]:
        found: list[tuple[str, bytes]] = []
        try:
            found.append(self._waiting.get(timeout=max(timeout_s, 1e-6)))
            while len(found) < _AT_ONCE:
                found.append(self._waiting.get_nowait())
        except queue.Empty:
            pass
        return found

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def _take(self, sample: Any) -> None:
        # In a thread of Zenoh's.
        source = unquote(str(sample.key_expr).rpartition("/")[2])
        try:
            if source not in self._peers:
                raise queue.Full
            self._waiting.put_nowait((source, sample.payload.to_bytes()))
        except queue.Full:
            self.dropped += 1


def _endpoints(peers: Mapping[str, Address]) -> str:
    return "[" + ", ".join(f'"tcp/{host}:{port}"' for host, port in peers.values()) + "]"
