"""Lines of text to and from a device: a serial port, TCP, or UDP that is listened to. Nothing here waits."""

from __future__ import annotations

import contextlib
import os
import socket
from typing import Protocol

from uwcoop.errors import ScenarioError
from uwcoop.onboard.transports import address_of

__all__ = ["Line", "SerialLine", "TcpLine", "UdpLine", "open_line"]

LINE_LIMIT_BYTES = 4096
"""Of one line; longer ones are dropped whole."""
_DATAGRAMS_AT_ONCE = 64
_BAUDS = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)


class Line(Protocol):
    """A device that speaks lines."""

    def write(self, line: str) -> None:
        """Send a line; its end is added."""

    def read(self) -> list[str]:
        """The whole lines that have come since the last call."""

    def close(self) -> None: ...


class _Splitter:
    """Bytes to lines, within a bound."""

    def __init__(self) -> None:
        self._rest = b""
        self._skip = False

    def lines(self, data: bytes) -> list[str]:
        *whole, self._rest = (self._rest + data).split(b"\n")
        if whole and self._skip:
            whole, self._skip = whole[1:], False
        if len(self._rest) > LINE_LIMIT_BYTES:
            self._rest, self._skip = b"", True
        kept = [line.strip() for line in whole if len(line) <= LINE_LIMIT_BYTES]
        return [line.decode("ascii", "replace") for line in kept if line]


class TcpLine:
    """A device behind a TCP port."""

    def __init__(self, host: str, port: int) -> None:
        """Connect.

        Raises:
            ScenarioError: nobody listens there.
        """
        try:
            self._socket = socket.create_connection((host, port), timeout=5)
        except OSError as error:
            raise ScenarioError(f"device at {host}:{port} cannot be reached: {error}") from None
        self._socket.setblocking(False)
        self._splitter = _Splitter()

    def write(self, line: str) -> None:
        self._socket.sendall(line.encode() + b"\r\n")

    def read(self) -> list[str]:
        data = b""
        with contextlib.suppress(BlockingIOError):
            data = self._socket.recv(65536)
        return self._splitter.lines(data)

    def close(self) -> None:
        self._socket.close()


class UdpLine:
    """Devices that send datagrams of lines to this machine. Whoever reaches the address is believed."""

    def __init__(self, host: str, port: int) -> None:
        """Listen.

        Raises:
            ScenarioError: the address cannot be had.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise ScenarioError(f"UDP {host}:{port} cannot be had: {error}") from None

    def write(self, line: str) -> None:
        raise ScenarioError("a UDP line is listened to: there is nobody to write to")

    def read(self) -> list[str]:
        found: list[str] = []
        for _ in range(_DATAGRAMS_AT_ONCE):
            try:
                datagram = self._socket.recv(65535)
            except BlockingIOError:
                break
            found += _Splitter().lines(datagram + b"\n")
        return found

    def close(self) -> None:
        self._socket.close()


class SerialLine:
    """A device on a serial port: 8 data bits, no parity, 1 stop bit."""

    def __init__(self, path: str, baud: int) -> None:
        """Open the port.

        Raises:
            ScenarioError: there is none, or it does not know the rate.
        """
        import termios
        import tty

        if baud not in _BAUDS:
            raise ScenarioError(f"baud rate is {baud}: must be one of {', '.join(map(str, _BAUDS))}")
        try:
            self._file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            tty.setraw(self._file)
            settings = termios.tcgetattr(self._file)
            settings[4] = settings[5] = getattr(termios, f"B{baud}")
            termios.tcsetattr(self._file, termios.TCSANOW, settings)
        except (OSError, termios.error) as error:
            raise ScenarioError(f"serial port {path} cannot be used: {error}") from None
        self._splitter = _Splitter()

    def write(self, line: str) -> None:
        os.write(self._file, line.encode() + b"\r\n")

    def read(self) -> list[str]:
        data = b""
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._file, 65536)
        return self._splitter.lines(data)

    def close(self) -> None:
        os.close(self._file)


def open_line(text: str) -> Line:
    """The device in `tcp:HOST:PORT`, `udp:HOST:PORT` (listened to) or `serial:PATH:BAUD`.

    Raises:
        ScenarioError: another form, or a device that is not there.
    """
    kind, _, place = text.partition(":")
    if kind == "tcp":
        return TcpLine(*address_of(place))
    if kind == "udp":
        return UdpLine(*address_of(place))
    path, _, baud = place.rpartition(":")
    if kind == "serial" and path and baud.isdigit():
        return SerialLine(path, int(baud))
    raise ScenarioError(
        f"device {text!r} is not of the form tcp:HOST:PORT, udp:HOST:PORT or serial:PATH:BAUD"
    )
