"""ArduSub and other MAVLink recordings by pymavlink: telemetry (`.tlog`) and the autopilot's own log (`.bin`)."""

from __future__ import annotations

import struct
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from uwcoop.errors import LogError, MissingDependencyError
from uwcoop.importers.channels import Channel, Omitted, SourceFile

__all__ = ["is_dataflash", "is_telemetry", "read_mavlink"]

_DATAFLASH = b"\xa3\x95"
_TELEMETRY_MARKS = (0xFE, 0xFD)
_FIRST_S, _LAST_S = 315_532_800, 4_102_444_800
_NOT_COLUMNS = {"mavpackettype", "TimeUS", "time_boot_ms", "time_usec"}


def is_dataflash(path: Path) -> bool:
    """Whether a file is an ArduPilot log: the first record is one of formats."""
    with path.open("rb") as file:
        return file.read(3)[:2] == _DATAFLASH


def is_telemetry(path: Path) -> bool:
    """Whether a file is a `.tlog`: a big-endian time in microseconds before each packet."""
    with path.open("rb") as file:
        start = file.read(9)
    if len(start) < 9 or start[8] not in _TELEMETRY_MARKS:
        return False
    (micros,) = struct.unpack(">Q", start[:8])
    return bool(_FIRST_S <= micros / 1e6 <= _LAST_S)


def read_mavlink(path: Path) -> SourceFile:
    """Read a recording; each type of message is a channel, of several systems "SYSTEM/TYPE".

    Raises:
        MissingDependencyError: pymavlink is not installed.
        LogError: it holds no message.
    """
    try:
        from pymavlink import mavutil
    except ImportError as error:
        raise MissingDependencyError("pymavlink", "logs") from error
    dataflash = is_dataflash(path)
    # DataFlash logs name their units with each format; a tlog's are those of the MAVLink definitions.
    said = StringIO()
    with redirect_stdout(said), redirect_stderr(said):  # pymavlink prints what it finds damaged
        rows, bad = _messages(mavutil, path, dataflash)
    bad += len(said.getvalue().splitlines())
    return _source(path, rows, bad, dataflash)


Rows = dict[tuple[int, str], list[tuple[float, dict[str, Any]]]]


def _messages(mavutil: Any, path: Path, dataflash: bool) -> tuple[Rows, int]:
    """Times and fields by system and type, and how many pieces are no messages."""
    log: Any = mavutil.mavlink_connection(str(path), dialect="ardupilotmega", robust_parsing=True)
    rows: Rows = {}
    bad = 0
    try:
        while (message := log.recv_match()) is not None:
            kind = message.get_type()
            if kind == "BAD_DATA":
                bad += 1
                continue
            if kind in ("FMT", "FMTU", "UNIT", "MULT", "PARM"):
                continue
            system = 0 if dataflash else int(message.get_srcSystem())
            rows.setdefault((system, kind), []).append((float(message._timestamp), message.to_dict()))
    finally:
        log.close()
    return rows, bad


def _source(path: Path, rows: Rows, bad: int, dataflash: bool) -> SourceFile:
    if not rows:
        raise LogError(f"{path} holds no MAVLink message that can be read")
    systems = {system for (system, kind) in rows if kind not in ("HEARTBEAT", "TIMESYNC")} or {0}
    family = "dataflash" if dataflash else "mavlink"
    channels, omitted = [], []
    for (system, kind), own in sorted(rows.items()):
        name = kind if len(systems) < 2 else f"{system}/{kind}"
        channel = _channel(path.name, name, f"{family}/{kind}", own)
        if channel is None:
            omitted.append(Omitted(name, f"{family}/{kind}", len(own), "no numbers"))
        else:
            channels.append(channel)
    notes = [f"{path.name}: {bad:,} pieces are damaged or no messages: left out"] if bad else []
    if len(systems) > 1:
        notes.append(f"{path.name}: messages of the systems {', '.join(map(str, sorted(systems)))}")
    how = "ArduPilot log (DataFlash)" if dataflash else "MAVLink telemetry (tlog)"
    return SourceFile(path.name, how, tuple(channels), tuple(omitted), tuple(notes))


def _channel(source: str, name: str, kind: str, rows: list[tuple[float, dict[str, Any]]]) -> Channel | None:
    labels = [
        label for label, value in rows[0][1].items()
        if label not in _NOT_COLUMNS and isinstance(value, int | float | str) and not isinstance(value, bool)
    ]  # fmt: skip
    columns: dict[str, Any] = {}
    for label in labels:
        cells = [row.get(label) for _, row in rows]
        if all(isinstance(cell, int | float) for cell in cells):
            columns[label] = np.array(cells, dtype=np.float64)
        elif isinstance(cells[0], str):
            columns[label] = np.array([*map(str, cells), None], dtype=object)[:-1]
    if not columns:
        return None
    seconds = np.array([stamp for stamp, _ in rows])
    clock: Any = "utc" if np.median(seconds) > _FIRST_S else "own"
    return Channel(source, name, kind, np.round(seconds * 1e9).astype(np.int64), columns, clock=clock)
