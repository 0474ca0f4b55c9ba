"""The Micromodem's dialogue against a scripted modem, over TCP and over a serial line."""

from __future__ import annotations

import os
import pty
import select
import socket
import time

import pytest

from onboard_dive import SECOND_NS, scenario
from uwcoop.errors import ScenarioError
from uwcoop.onboard.lines import LINE_LIMIT_BYTES, SerialLine, TcpLine, open_line
from uwcoop.onboard.micromodem import Micromodem, fields_of, sentence
from uwcoop.onboard.vehicle import empty_mission

EPOCH_NS = 1_700_000_000 * SECOND_NS  # 22:13:20 UTC


class Water:
    """Two scripted modems: what one is asked to send, the other hears."""

    def __init__(self, frame_bytes: int) -> None:
        self.frame_bytes = frame_bytes
        self.now_ns = 8 * SECOND_NS
        self.to: list[list[str]] = [[], []]
        self.wrote: list[list[str]] = [[], []]

    def line(self, k: int):
        water = self

        class One:
            def write(self, line: str) -> None:
                water.wrote[k].append(line)
                water.said(k, fields_of(line))

            def read(self) -> list[str]:
                lines, water.to[k] = water.to[k], []
                return lines

            def close(self) -> None: ...

        return One()

    def said(self, k: int, fields) -> None:
        assert fields is not None, "a checksum is wrong"
        if fields[0] == "CCCYC":
            self.frames = int(fields[6])
            self.to[k].append(sentence("CACYC", *fields[1:]))
            self.to[1 - k].append(sentence("CACYC", *fields[1:]))
            self.to[1 - k].append(sentence("CATOA", "221329.2500", 0))  # 9.25 s
            self.to[k] += [
                sentence("CADRQ", "221329", fields[2], 15, 0, 32, f) for f in range(1, self.frames + 1)
            ]
            self.frame = 0
        elif fields[0] == "CCTXD":
            self.frame += 1
            assert len(fields[4]) == 2 * self.frame_bytes
            self.to[k].append(sentence("CATXF", 32))
            self.to[1 - k].append(sentence("CARXD", fields[1], 15, 0, self.frame, fields[4]))


@pytest.fixture(scope="module")
def mission():
    return empty_mission(scenario("acoustics.modem='micromodem-64'"))


@pytest.fixture(scope="module")
def slow_mission():
    return empty_mission(scenario("acoustics.modem='micromodem-32'", "acoustics.slot_s=9"))


def pair(mission):
    water = Water(mission.link.frame_bytes)
    modems = [Micromodem(water.line(k), mission, k, lambda: water.now_ns, EPOCH_NS) for k in (0, 1)]
    return water, modems


@pytest.mark.parametrize("length", [0, 1, 31, 63, 64, 150])
def test_a_packet_goes_from_modem_to_modem(mission, slow_mission, length) -> None:
    water, (sender, receiver) = pair(slow_mission if length == 31 else mission)
    tol_ns = 0 if length == 31 else 9 * SECOND_NS
    packet = bytes(range(1, length + 1))
    sender.send(packet, 9 * SECOND_NS)
    assert sender.received() == [], "its slot is a second ahead"
    assert water.wrote == [[], []]
    water.now_ns = 9 * SECOND_NS
    sender.received()
    sender.received()
    water.now_ns = 12 * SECOND_NS
    (event,) = receiver.received()
    assert event.kind == "reception"
    assert event.vehicle == 1
    expected = {"sender": 0, "tol_ns": tol_ns, "toa_ns": 9_250_000_000, "bytes": packet}
    assert event.fields == expected
    assert event.t_ns == 12 * SECOND_NS
    assert len(water.wrote[0]) == 1 + -(-(length + 1) // water.frame_bytes)
    assert not sender.counts
    assert not receiver.counts


def test_what_is_garbled_or_not_whole_is_counted_and_gives_nothing(mission) -> None:
    water, (_, receiver) = pair(mission)
    water.to[1] += [
        "$CACYC,0,1,15,0,0,2*00",
        "noise", "$", "$CARXD,1", sentence("CARXD", "x", 15, 0, 1, "00"), sentence("CATOA", "2x1329.25", 0),
        sentence("CARXD", 1, 15, 0, 1, "0A0B"),  # no cycle had begun
        sentence("CACYC", 0, 1, 15, 0, 0, 2), sentence("CARXD", 1, 15, 0, 1, "02" + "00" * 31),
        sentence("CACYC", 0, 9, 15, 0, 0, 1), sentence("CATOA", "221329.25", 0),
        sentence("CARXD", 9, 15, 0, 1, "00" * 32),  # not of the team
        sentence("CACYC", 0, 1, 15, 0, 0, 1), sentence("CARXD", 1, 15, 0, 1, "00" * 32),  # no arrival
        sentence("CAERR", "221329", "DATA_TIMEOUT", 1),
    ]  # fmt: skip
    assert receiver.received() == []
    assert receiver.counts == {
        "garbled": 5, "not whole": 2, "not a teammate's": 1, "without time of arrival": 1, "CAERR DATA_TIMEOUT": 1,
    }  # fmt: skip


def test_times_of_day_are_the_nearest_over_midnight(mission) -> None:
    water, (_, receiver) = pair(mission)
    midnight_ns = (1 * 3600 + 46 * 60 + 40) * SECOND_NS
    water.now_ns = midnight_ns + SECOND_NS
    assert receiver._mission_ns("235959.5") == midnight_ns - SECOND_NS // 2
    assert receiver._mission_ns("000002") == midnight_ns + 2 * SECOND_NS


def test_lines_over_tcp_and_serial() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = open_line(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        assert isinstance(line, TcpLine)
        device, _ = server.accept()
        check_line(line, device.fileno())
        device.close()
    master, slave = pty.openpty()
    line = open_line(f"serial:{os.ttyname(slave)}:19200")
    assert isinstance(line, SerialLine)
    check_line(line, master)
    os.close(master)
    os.close(slave)
    for wrong in (
        "tcp:host",
        "serial:/dev/none",
        "usb:1:2",
        "serial:/dev/none:9600",
        "serial:/dev/null:9600",
    ):
        with pytest.raises(ScenarioError):
            open_line(wrong)


def check_line(line, device: int) -> None:
    line.write("$CCCFG,SNV,1")
    assert select.select([device], [], [], 10)[0]
    assert os.read(device, 100) == b"$CCCFG,SNV,1\r\n"
    got: list[str] = []
    for part in (b"$CAR", b"EV,1*00\r\n\r\n$CATXF", b",32\r\n", b"x" * (LINE_LIMIT_BYTES + 10), b"\n$END\n"):
        os.write(device, part)
        time.sleep(0.05)
        got += line.read()
    until_s = time.monotonic() + 20
    while got[-1:] != ["$END"] and time.monotonic() < until_s:
        got += line.read()
        time.sleep(0.05)
    assert got == ["$CAREV,1*00", "$CATXF,32", "$END"]
    line.close()
