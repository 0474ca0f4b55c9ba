"""Slots, opportunities and receptions to and from the topics below `/acoustics`, one for the whole team."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from uwcoop.errors import LogError
from uwcoop.missionlog.messages import Layout, Records, layout, set_stamps, split, stamps
from uwcoop.missionlog.model import (
    OPPORTUNITY_COLUMNS,
    POLL_COLUMNS,
    RECEPTION_COLUMNS,
    SLOT_COLUMNS,
    Columns,
    MissionLog,
    columns,
)
from uwcoop.missionlog.topics import Recorded, Stream, read_topic, refuse_missing

SLOT_TOPIC = "/acoustics/slot"
OPPORTUNITY_TOPIC = "/acoustics/opportunity"
RECEPTION_TOPIC = "/acoustics/reception"
POLL_TOPIC = "/acoustics/poll"

_SLOT = "uwcoop_msgs/msg/AcousticSlot"
_OPPORTUNITY = "uwcoop_msgs/msg/AcousticOpportunity"
_RECEPTION = "uwcoop_msgs/msg/AcousticReception"
_POLL = "uwcoop_msgs/msg/AcousticPoll"

TYPES = {SLOT_TOPIC: _SLOT, OPPORTUNITY_TOPIC: _OPPORTUNITY, RECEPTION_TOPIC: _RECEPTION, POLL_TOPIC: _POLL}
"""Message type of each topic."""


def encode_acoustics(log: MissionLog) -> Iterator[Stream]:
    """The acoustic tables that the log has, as streams of messages."""
    if log.slots:
        records = layout(_SLOT).blank(len(log.slots["tol_ns"]))
        yield _fill(SLOT_TOPIC, records, log.slots, "tol_ns")
    if log.opportunities:
        count, frames = log.opportunities["draws"].shape
        records = _opportunity_layout(frames).blank(count)
        yield _fill(OPPORTUNITY_TOPIC, records, log.opportunities, "tol_ns")
    if log.polls:
        yield _fill(POLL_TOPIC, layout(_POLL).blank(len(log.polls["tol_ns"])), log.polls, "t_ns")
    if log.receptions:
        records = layout(_RECEPTION).blank(len(log.payloads))
        records["payload.count"] = [len(payload) for payload in log.payloads]
        stream = _fill(RECEPTION_TOPIC, records, log.receptions, "t_ns")
        messages = [head + payload for head, payload in zip(stream.messages, log.payloads, strict=True)]
        yield Stream(stream.topic, stream.msgtype, stream.t_ns, messages)


def decode_slots(recorded: Recorded, count: int) -> Columns:
    """The slots; raises `LogError` unless there are `count` of them, whole and in order."""
    records = read_topic(recorded, SLOT_TOPIC, layout(_SLOT), count)
    return _table(records, SLOT_COLUMNS, "tol_ns")


def decode_polls(recorded: Recorded, count: int) -> Columns:
    """The polls of two-way ranging; raises `LogError` as `decode_slots` does."""
    return _table(read_topic(recorded, POLL_TOPIC, layout(_POLL), count), POLL_COLUMNS, "t_ns")


def decode_opportunities(recorded: Recorded, count: int, frames: int) -> Columns:
    """The opportunities with `draws`, (count, frames); raises `LogError` as `decode_slots` does."""
    records = read_topic(recorded, OPPORTUNITY_TOPIC, _opportunity_layout(frames), count)
    draws = np.ascontiguousarray(records["draws"], dtype=np.float64)
    return {**_table(records, OPPORTUNITY_COLUMNS, "tol_ns"), "draws": draws}


def decode_receptions(recorded: Recorded, count: int) -> tuple[Columns, list[bytes]]:
    """Receptions and their payloads; raises `LogError` as `decode_slots` does."""
    head = layout(_RECEPTION)
    size = head.dtype.itemsize
    messages = recorded.get(RECEPTION_TOPIC, ())
    refuse_missing(RECEPTION_TOPIC, len(messages), count)
    payloads = [message[size:] for message in messages]
    # The payload comes last: cut it off, and what remains has one layout but for the payload's length.
    fixed = {name: value for name, value in head.fixed.items() if name != "payload.count"}
    heads = {RECEPTION_TOPIC: [message[:size] for message in messages]}
    records = read_topic(heads, RECEPTION_TOPIC, Layout(head.dtype, fixed), count)
    lengths = np.array([len(payload) for payload in payloads], dtype=np.uint32)
    wrong = np.flatnonzero(records["payload.count"] != lengths)
    if wrong.size:
        raise LogError(f"{RECEPTION_TOPIC}: payload of message {wrong[0]} is cut off")
    return _table(records, RECEPTION_COLUMNS, "t_ns"), payloads


def _opportunity_layout(frames: int) -> Layout:
    return layout(_OPPORTUNITY, counts={"draws": frames})


def _fill(topic: str, records: Records, table: Columns, time: str) -> Stream:
    """A stream whose stamps are column `time` and whose other fields are named as their columns."""
    set_stamps(records, table[time])
    for name, column in table.items():
        if name != time:
            records[name] = column
    return Stream(topic, TYPES[topic], table[time], split(records))


def _table(records: Records, spec: dict[str, str], time: str) -> Columns:
    # A message's booleans are bytes.
    values: dict[str, Any] = {
        name: records[name] != 0 if kind == "bool" else records[name]
        for name, kind in spec.items()
        if name != time
    }
    return columns(spec, **{time: stamps(records)}, **values)
