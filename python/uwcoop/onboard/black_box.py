"""What a node's journal holds, as a mission log that `uwcoop run` replays to the same bits."""

from __future__ import annotations

import os
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop.errors import LogError
from uwcoop.missionlog.model import (
    EVENT_COLUMNS,
    RECEPTION_COLUMNS,
    SLOT_COLUMNS,
    MissionLog,
    columns,
    event_columns,
)
from uwcoop.onboard.journal import journal_files, read_lines
from uwcoop.onboard.messages import event_of

if TYPE_CHECKING:
    from uwcoop._native import Event
    from uwcoop.onboard.vehicle import VehicleNavigator

__all__ = ["read_black_box", "write_black_box"]


def read_black_box(folder: str | os.PathLike[str], vehicle: VehicleNavigator) -> MissionLog:
    """The mission as one vehicle saw it: its sensor events, what it received, the slots that it used.

    Replayed with the same navigator, this vehicle's estimates are those that the node said, bit for bit. The teammates
    have no events: their rows are empty.

    Args:
        folder: with the journal.
        vehicle: made as the node's was.

    Raises:
        LogError: no journal, one of another mission or vehicle, or damaged.
    """
    events: list[Event] = []
    slots: list[tuple[int, int]] = []
    path = Path(folder)
    if not journal_files(path):
        raise LogError(f"{path} holds no journal of a node")
    with journal_files(path)[0].open("rb") as file:
        if vehicle.digest.encode() not in file.readline():
            raise LogError(f"the journal in {path} is not of {vehicle.name}'s {vehicle.navigator}")
    for line in read_lines(path):
        if line["type"] == "event":
            events.append(event_of(line))
        elif line["type"] == "slot":
            slots.append((line["tol_ns"], line["capacity_bytes"]))
        elif line["type"] == "refused":
            events.pop()
    return _log(vehicle, events, slots)


def write_black_box(
    folder: str | os.PathLike[str], vehicle: VehicleNavigator, path: str | os.PathLike[str]
) -> MissionLog:
    """Write what `read_black_box` gives as MCAP, and give it.

    Raises:
        LogError: as `read_black_box`, or a file that cannot be written.
    """
    from uwcoop.missionlog.mcap import write_log

    log = read_black_box(folder, vehicle)
    write_log(log, path)
    return log


def _log(vehicle: VehicleNavigator, events: list[Event], slots: list[tuple[int, int]]) -> MissionLog:
    rows: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for event in events:
        table = rows[event.kind]
        table["t_ns"].append(event.t_ns)
        for name, value in event.fields.items():
            table[name].append(value)
    received = rows.pop("reception", {})
    tables = {
        kind: event_columns(kind, vehicle=[vehicle.index] * len(rows[kind]["t_ns"]), **rows[kind])
        for kind in EVENT_COLUMNS
        if kind in rows
    }
    payloads = received.pop("bytes", [])
    receptions = (
        columns(RECEPTION_COLUMNS, receiver=[vehicle.index] * len(payloads), **received) if payloads else {}
    )
    used = {
        "tol_ns": [tol_ns for tol_ns, _ in slots],
        "sender": [vehicle.index] * len(slots),
        "capacity_bytes": [capacity for _, capacity in slots],
    }
    return replace(
        vehicle.mission,
        events=tables,
        slots=columns(SLOT_COLUMNS, **used) if slots else {},
        receptions=receptions,
        payloads=payloads,
        notes=(f"black box of {vehicle.name}: navigator {vehicle.navigator}",),
    )
