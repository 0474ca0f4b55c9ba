"""What a channel is, as far as its type, or the names of a table's columns, tell."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.importers.column_roles import assign_roles
from uwcoop.importers.quantities import COLUMN_NAMES, NEEDS, RANGE_NAMES, TABLE_ROLES, Meaning, meanings_of

if TYPE_CHECKING:
    from uwcoop.importers.channels import Channel

__all__ = ["channel_meanings", "is_acoustic_range", "is_range_table", "range_columns"]

_ACOUSTIC = re.compile(r"modem|acoust|acomm|ranging|owtt|twtt|beacon|transponder|/range_to", re.IGNORECASE)


def channel_meanings(channel: Channel) -> list[Meaning]:
    """The sensors that a channel can be, by type or columns alone."""
    if channel.kind == "table":
        return [] if is_range_table(channel) else _of_table(channel)
    if is_acoustic_range(channel):
        return []
    return [m for m in meanings_of(channel.kind, frozenset(channel.columns)) if _is_told(m, channel)]


def is_acoustic_range(channel: Channel) -> bool:
    """Whether a topic of ranges is an acoustic modem's, not an altimeter's, by its name."""
    return channel.kind == "sensor_msgs/msg/Range" and bool(
        _ACOUSTIC.search(f"{channel.name} {channel.frame_id}")
    )


def is_range_table(channel: Channel) -> bool:
    """Whether a table holds acoustic ranges: from whom, to whom, how far."""
    found = range_columns(channel)
    return {"from", "to"} <= found.keys() and bool({"range", "travel"} & found.keys())


def range_columns(channel: Channel) -> dict[str, str]:
    """The columns of a table of ranges by what they hold."""
    if channel.kind != "table":
        return {}
    labels = list(channel.columns)
    return {role: labels[k] for role, k in assign_roles(labels, RANGE_NAMES).place.items()}


def _of_table(channel: Channel) -> list[Meaning]:
    labels = list(channel.columns)
    place = assign_roles(labels, COLUMN_NAMES).place
    known = {quantity: labels[k] for quantity, k in place.items() if not channel.is_text(labels[k])}
    found: list[Meaning] = []
    for role, quantity in TABLE_ROLES:
        if quantity not in known or any(m.role == role for m in found):
            continue
        if not any(set(need) <= known.keys() and quantity in need for need in NEEDS[role]):
            continue
        columns = {q: label for q, label in known.items() if q in _quantities(role)}
        frame = "flu" if role in ("ground_velocity", "water_velocity", "turn_rate") else "enu"
        found.append(Meaning(role, columns, frame=frame))
    return found


def _quantities(role: str) -> set[str]:
    beside = {"heading": {"roll", "pitch"}, "altimeter": {"roll", "pitch"}}
    return {q for need in NEEDS[role] for q in need} | beside.get(role, set())


def _is_told(meaning: Meaning, channel: Channel) -> bool:
    """Whether a message fills in what its type could hold: an Imu without orientation says so."""
    if meaning.role == "heading" and "qw" in meaning.columns:
        unknown = meaning.columns.get("unknown", "")
        if unknown in channel.columns and (channel.numbers(unknown) == -1).all():
            return False
        norm = sum(channel.numbers(meaning.columns[q]) ** 2 for q in ("qx", "qy", "qz", "qw"))
        return bool(np.median(norm) > 0.5)
    return True
