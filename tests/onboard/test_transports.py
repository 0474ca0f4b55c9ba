"""Transports on loopback, and the names of peers."""

from __future__ import annotations

import time

import pytest

from onboard_dive import free_ports
from uwcoop.errors import ScenarioError
from uwcoop.onboard.transports import UdpTransport, address_of, default_addresses, open_transport

NAMES = ("Alpha 1", "b/*")


@pytest.mark.parametrize("kind", ["udp", "zenoh"])
def test_datagrams_arrive_whole_in_order_and_with_their_sender(kind) -> None:
    if kind == "zenoh":
        pytest.importorskip("zenoh", exc_type=ImportError)
    addresses = default_addresses(NAMES, free_ports(4))
    wires = {
        name: open_transport(kind, name, own, {other: a for other, a in addresses.items() if other != name})
        for name, own in addresses.items()
    }
    sent = {name: [f"{name} {k}".encode() * 200 for k in range(20)] for name in NAMES}
    got: list[tuple[str, bytes]] = []
    until_s = time.monotonic() + 20
    while not got and time.monotonic() < until_s:  # a session takes a moment to connect
        for name in NAMES:
            wires[name].send("channel", b"hello")
        got = wires["channel"].receive(0.2)
    time.sleep(1.5 if kind == "zenoh" else 0.0)
    while wires["channel"].receive(0.2):
        pass
    for name in NAMES:
        for datagram in sent[name]:
            wires[name].send("channel", datagram)
    got = []
    while len(got) < 40 and time.monotonic() < until_s + 20:
        got += wires["channel"].receive(0.2)
    for name in NAMES:
        assert [datagram for source, datagram in got if source == name] == sent[name]
        assert wires[name].receive(0.05) == []
        assert wires[name].dropped == 0
    for one in wires.values():
        one.close()


def test_addresses_are_checked() -> None:
    assert address_of("10.0.0.7:7401") == ("10.0.0.7", 7401)
    for wrong in ("7401", ":7401", "host:", "host:0", "host:65536", "host:x"):
        with pytest.raises(ScenarioError, match="HOST:PORT"):
            address_of(wrong)
    with pytest.raises(ScenarioError, match="base port"):
        default_addresses(NAMES, 80)
    with pytest.raises(ScenarioError, match="udp or zenoh"):
        open_transport("serial", "V1", ("127.0.0.1", 7401), {})


def test_everything_listens_on_loopback_and_a_port_is_had_once() -> None:
    addresses = default_addresses(NAMES, free_ports(4))
    assert {host for host, _ in addresses.values()} == {"127.0.0.1"}
    one = UdpTransport(addresses["channel"], {})
    with pytest.raises(ScenarioError, match="running already"):
        UdpTransport(addresses["channel"], {})
    one.close()
