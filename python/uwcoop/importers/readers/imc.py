"""Neptus/DUNE logs of IMC messages (`.lsf`, gzipped or not) by imcpy."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from uwcoop.errors import LogError, MissingDependencyError
from uwcoop.importers.bounded import open_binary, read_bytes
from uwcoop.importers.channels import Channel, Omitted, SourceFile

__all__ = ["is_imc", "read_lsf"]

_SYNCS = (b"\x54\xfe", b"\xfe\x54")
"""First two bytes of a packet: little and big endian."""
_HEADER = struct.Struct("<HHHdHBHB")
_FOOTER_BYTES = 2
_LIMIT_BYTES = 2**32


def is_imc(path: Path) -> bool:
    """Whether a file begins with an IMC packet."""
    with open_binary(path, _LIMIT_BYTES) as file:
        return file.read(2) in _SYNCS


def read_lsf(path: Path) -> SourceFile:
    """Read a log; each type of message is a channel, "SYSTEM/TYPE" or, of several entities, "SYSTEM/TYPE/ENTITY".

    Raises:
        MissingDependencyError: imcpy is not installed.
        LogError: it holds no message that is known.
    """
    try:
        import imcpy
    except ImportError as error:
        raise MissingDependencyError("imcpy", "logs") from error
    content = read_bytes(path, _LIMIT_BYTES)
    rows: dict[tuple[int, str, int], list[tuple[float, Any]]] = {}
    unknown = damaged = at = 0
    while at + _HEADER.size + _FOOTER_BYTES <= len(content):
        order = {_SYNCS[0]: "<", _SYNCS[1]: ">"}.get(content[at : at + 2])
        if order is None:
            at += 1
            damaged += 1
            continue
        size = struct.unpack_from(f"{order}H", content, at + 4)[0] + _HEADER.size + _FOOTER_BYTES
        packet = content[at : at + size]
        try:
            message = imcpy.Packet.deserialize(packet)
        except Exception:  # what the binding throws on a damaged packet or an unknown type is not listed
            unknown += 1
            at += size
            continue
        at += size
        kind = type(message).__name__
        rows.setdefault((int(message.src), kind, int(message.src_ent)), []).append(
            (float(message.timestamp), message)
        )
    if not rows:
        raise LogError(f"{path} holds no IMC message that imcpy knows")
    notes = []
    if unknown:
        notes.append(
            f"{path.name}: {unknown:,} messages are damaged or of types that imcpy does not know: left out"
        )
    if damaged or at < len(content):
        notes.append(
            f"{path.name}: {damaged + len(content) - at:,} bytes are no IMC packets, or it is cut off: left out"
        )
    return _source(path, rows, notes)


def _source(
    path: Path, rows: dict[tuple[int, str, int], list[tuple[float, Any]]], notes: list[str]
) -> SourceFile:
    channels, omitted = [], []
    entities: dict[tuple[int, str], int] = {}
    for system, kind, _ in rows:
        entities[system, kind] = entities.get((system, kind), 0) + 1
    names = _entity_names(rows)
    for (system, kind, entity), own in sorted(rows.items(), key=lambda item: item[0]):
        name = f"{_system_name(rows, system)}/{kind}"
        if entities[system, kind] > 1:
            name += f"/{names.get((system, entity), entity)}"
        channel = _channel(path.name, name, f"imc/{kind}", own)
        if channel is None:
            omitted.append(Omitted(name, f"imc/{kind}", len(own), "no numbers"))
        else:
            channels.append(channel)
    return SourceFile(path.name, "IMC log (LSF)", tuple(channels), tuple(omitted), tuple(notes))


def _system_name(rows: dict[tuple[int, str, int], list[tuple[float, Any]]], system: int) -> str:
    """As the system announces itself, else its number."""
    for (own, kind, _), messages in rows.items():
        if own == system and kind == "Announce":
            return str(messages[0][1].sys_name)
    return str(system)


def _entity_names(rows: dict[tuple[int, str, int], list[tuple[float, Any]]]) -> dict[tuple[int, int], str]:
    names: dict[tuple[int, int], str] = {}
    for (system, kind, _), messages in rows.items():
        if kind == "EntityInfo":
            names |= {(system, int(m.id)): str(m.label) for _, m in messages if hasattr(m, "label")}
    return names


def _channel(source: str, name: str, kind: str, rows: list[tuple[float, Any]]) -> Channel | None:
    columns: dict[str, Any] = {}
    for label, value in _fields(rows[0][1]).items():
        if isinstance(value, str):
            columns[label] = np.array([*(str(getattr(m, label, "")) for _, m in rows), None], dtype=object)[
                :-1
            ]
        elif label.startswith("validity_") or label.startswith("valid_"):
            _, _, flag = label.partition("_")
            columns[label] = np.array(
                [_has_flag(getattr(m, "validity", 0), flag) for _, m in rows], dtype=np.float64
            )
        else:
            columns[label] = np.array([_number(getattr(m, label)) for _, m in rows])
    if not columns:
        return None
    seconds = np.array([stamp for stamp, _ in rows])
    return Channel(source, name, kind, np.round(seconds * 1e9).astype(np.int64), columns)


_FLAGS = {"GpsFix": ("pos",), "GroundVelocity": ("xy",), "WaterVelocity": ("xy",)}
"""Of the bit field `validity`, which become columns."""
_BITS = {"pos": 0x04, "xy": 0x03}
"""GFV_VALID_POS (0x01 is the date's, 0x02 the time's); VAL_VEL_X and VAL_VEL_Y."""


def _fields(message: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for label in dir(message):
        if label.startswith("_") or label in (
            "src",
            "src_ent",
            "dst",
            "dst_ent",
            "timestamp",
            "msg_id",
            "msg_name",
        ):
            continue
        value = getattr(message, label)
        if isinstance(value, str) or _is_number(value):
            found[label] = value
    for flag in _FLAGS.get(type(message).__name__, ()):
        prefix = "validity" if flag == "pos" else "valid"
        found[f"{prefix}_{flag}"] = 1.0
    return found


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or callable(value):
        return False
    try:
        int(value)
    except (TypeError, ValueError):
        return False
    return True


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else float(int(value))


def _has_flag(value: Any, flag: str) -> bool:
    wanted = _BITS[flag]
    return int(value) & wanted == wanted
