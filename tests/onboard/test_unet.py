"""A UnetStack modem through its own package, against a scripted gateway on loopback."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time

import pytest

from onboard_dive import SECOND_NS, scenario
from uwcoop.errors import ScenarioError
from uwcoop.onboard.vehicle import empty_mission

pytest.importorskip("unetpy")

from uwcoop.onboard.unet import UnetModem

BOOTED_NS = 3 * SECOND_NS
"""Mission time at which the modem's clock was 0."""


class Gateway(threading.Thread):
    """What a modem answers, as lines of JSON: the time of its physical layer; and what it was asked to send."""

    def __init__(self, *, says_time: bool = True) -> None:
        super().__init__(daemon=True)
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = self.server.getsockname()[1]
        self.says_time = says_time
        self.sent: list[dict] = []
        self.listeners: list[str] = []
        self.start()

    def run(self) -> None:
        self.connection, _ = self.server.accept()
        with self.connection.makefile("r") as lines:
            for line in lines:
                self.heard(json.loads(line))

    def heard(self, said: dict) -> None:
        action = said.get("action")
        if action == "wantsMessagesFor":
            self.listeners = said["agentIDs"]
        elif action == "send":
            data, kind = said["message"]["data"], said["message"]["clazz"].rpartition(".")[2]
            if kind == "ParameterReq" and self.says_time:
                value = {"param": "time", "value": (now_ns() - BOOTED_NS) // 1000}
                self.message(
                    "org.arl.fjage.param.ParameterRsp", data["sender"], inReplyTo=data["msgID"], **value
                )
            elif kind == "TxFrameReq":
                self.sent.append(data)

    def message(self, kind: str, recipient: str, **fields) -> None:
        data = {
            "msgID": str(time.monotonic_ns()),
            "perf": "INFORM",
            "sender": "phy",
            "recipient": recipient,
            **fields,
        }
        self.say({"action": "send", "relay": True, "message": {"clazz": kind, "data": data}})

    def frame(self, **fields) -> None:
        topic = next(name for name in self.listeners if name.startswith("#phy"))
        self.message("org.arl.unet.phy.RxFrameNtf", topic, **fields)

    def say(self, message: dict) -> None:
        self.connection.sendall(json.dumps(message).encode() + b"\n")

    def close(self) -> None:
        with contextlib.suppress(OSError):  # the other side has closed
            self.connection.shutdown(socket.SHUT_RDWR)
        self.connection.close()
        self.server.close()


BEGAN_NS = time.monotonic_ns()


def now_ns() -> int:
    return time.monotonic_ns() - BEGAN_NS + 20 * SECOND_NS


@pytest.fixture
def gateway():
    made = Gateway()
    yield made
    made.close()
    made.join(5)


def until(what) -> None:
    end_s = time.monotonic() + 10
    while not what() and time.monotonic() < end_s:
        time.sleep(0.01)


def test_packets_are_launched_and_received_by_the_modems_clock(gateway) -> None:
    mission = empty_mission(scenario())
    modem = UnetModem("127.0.0.1", gateway.port, mission, 0, now_ns)
    assert 0 <= modem.clock_error_ns < SECOND_NS // 4
    modem.send(b"\x01\xff\x80", 40 * SECOND_NS)
    until(lambda: gateway.sent)
    (request,) = gateway.sent
    assert (request["to"], request["type"], request["data"]) == (0, 2, [3, 1, 255, 128])
    assert request["txTime"] * 1000 + BOOTED_NS == pytest.approx(
        40 * SECOND_NS, abs=modem.clock_error_ns + 1000
    )
    tol_ns = int(mission.slots["tol_ns"][mission.slots["sender"] == 1][0])
    toa_ns = tol_ns + 250_000_000
    # Java's bytes are signed; what comes after the length is filled up.
    gateway.frame(
        **{"from": 2, "to": 0, "data": [3, 1, -1, -128, 0, 0], "rxTime": (toa_ns - BOOTED_NS) // 1000}
    )
    found = []
    until(lambda: found.extend(modem.received()) or found)
    (event,) = found
    assert (event.kind, event.vehicle) == ("reception", 0)
    assert (event.fields["sender"], event.fields["tol_ns"], event.fields["bytes"]) == (
        1,
        tol_ns,
        b"\x01\xff\x80",
    )
    assert event.fields["toa_ns"] == pytest.approx(toa_ns, abs=modem.clock_error_ns + 1000)
    modem.close()


def test_frames_that_are_none_are_counted(gateway) -> None:
    modem = UnetModem("127.0.0.1", gateway.port, empty_mission(scenario()), 0, now_ns)
    whole = {"from": 2, "to": 0, "data": [1, 7], "rxTime": 30_000_000}
    for change in (
        {"from": 9}, {"from": None}, {"from": "2"}, {"data": None}, {"data": []}, {"data": [5, 1]}, {"data": ["x"]},
        {"rxTime": None}, {"rxTime": -(10**15)}, {"rxTime": 10**30},
    ):  # fmt: skip
        gateway.frame(**{**whole, **change})
    topic = next(name for name in gateway.listeners if name.startswith("#phy"))
    gateway.message("org.arl.unet.phy.BadFrameNtf", topic)
    gateway.say({"action": "send", "message": 7})
    gateway.frame(**whole)
    found = []
    until(lambda: found.extend(modem.received()) or found)
    assert [event.fields["bytes"] for event in found] == [b"\x07"]
    assert modem.counts["BadFrameNtf"] == 1
    assert sum(modem.counts.values()) == 11
    modem.close()


def test_a_modem_without_a_clock_is_refused(monkeypatch) -> None:
    monkeypatch.setattr("uwcoop.onboard.unet._ANSWER_MS", 20)
    gateway = Gateway(says_time=False)
    with pytest.raises(ScenarioError, match="does not say the time"):
        UnetModem("127.0.0.1", gateway.port, empty_mission(scenario()), 0, now_ns)
    gateway.close()
    gateway.join(5)


def test_nobody_there_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with pytest.raises(ScenarioError, match="cannot be reached"):
        UnetModem("127.0.0.1", port, empty_mission(scenario()), 0, now_ns)
