"""What nodes, channel and drivers say to each other: JSON objects, one a line, with the names of the log's columns.

| type | from → to | fields |
|---|---|---|
| `event` | channel, drivers → node | `t_ns`, `vehicle` (index), `kind`, the columns of that kind |
| `clock` | channel → node | `t_ns`: all stamped up to then has been sent; `sent`: how many events in all |
| `end` | channel → node | the mission is over |
| `hello` | node → channel | `vehicle`: the node is there |
| `launch` | node → channel | `vehicle`, `tol_ns`, `bytes` |
| `ready` | node → channel | `vehicle`, `t_ns`: everything up to then is handled |
| `estimate` | node → watch | what `estimate` gives at `t_ns`, with `counts` and `heard_ns` by sender |
| `diagnostic` | node → watch | `vehicle`, `t_ns`, `alarm`, `raised`, `text` |

An event of kind `reception` has `sender`, `tol_ns`, `toa_ns` and `bytes`; bytes are hexadecimal digits.
"""

from __future__ import annotations

import json
import math
from typing import Any

from uwcoop import _native
from uwcoop.errors import UwcoopError
from uwcoop.missionlog.model import EVENT_COLUMNS

__all__ = ["Message", "MessageError", "decode", "encode", "event_message", "event_of"]

Message = dict[str, Any]

MESSAGE_LIMIT_BYTES = 60_000
"""Of a datagram: what UDP carries, less some room."""
_RECEPTION = {"sender": "i8", "tol_ns": "i8", "toa_ns": "i8", "bytes": "hex"}
_MAY_BE_NAN = {"range_m", "own_bearing_rad", "peer_bearing_rad", "peer_depth_m"}
_I8 = range(-(2**63), 2**63)


class MessageError(UwcoopError, ValueError):
    """A message that no honest sender makes: not JSON, an unknown type or kind, a field missing or of another type."""


def encode(*messages: Message) -> bytes:
    """Messages as lines."""
    return b"".join(
        json.dumps(message, separators=(",", ":"), allow_nan=False).encode() + b"\n" for message in messages
    )


def decode(datagram: bytes) -> list[Message]:
    """The messages of a datagram.

    Raises:
        MessageError: too long, not UTF-8, not JSON objects, or without a type.
    """
    if len(datagram) > MESSAGE_LIMIT_BYTES:
        raise MessageError(f"a datagram has {len(datagram)} bytes: must be at most {MESSAGE_LIMIT_BYTES}")
    found: list[Message] = []
    for line in datagram.splitlines():
        try:
            message = json.loads(line, parse_constant=_no_constant)
        except (ValueError, RecursionError):
            raise MessageError(f"a message is not JSON: {line[:40]!r}") from None
        if not isinstance(message, dict) or not isinstance(message.get("type"), str):
            raise MessageError(f"a message is no object with a type: {line[:40]!r}")
        found.append(message)
    return found


def event_message(event: _native.Event) -> Message:
    """An event as a message; what is not there (NaN) is null."""
    fields: Message = {"type": "event", "t_ns": event.t_ns, "vehicle": event.vehicle, "kind": event.kind}
    for name, value in event.fields.items():
        if isinstance(value, bytes):
            fields[name] = value.hex()
        else:
            fields[name] = None if isinstance(value, float) and math.isnan(value) else value
    return fields


def event_of(message: Message) -> _native.Event:
    """The event of a message.

    Raises:
        MessageError: an unknown kind, a field missing, unknown or of another type, or a value outside its bound.
    """
    kind = message.get("kind")
    spec = _RECEPTION if kind == "reception" else EVENT_COLUMNS.get(kind) if isinstance(kind, str) else None
    if spec is None:
        raise MessageError(
            f"event kind {str(kind)[:30]!r} is unknown: must be one of {', '.join(EVENT_COLUMNS)}"
        )
    given = message.keys() - {"type", "t_ns", "vehicle", "kind"}
    if given != spec.keys():
        odd = sorted(given ^ spec.keys())[0]
        raise MessageError(f"event {kind}: field {odd[:30]!r} is {'unknown' if odd in given else 'missing'}")
    fields = {name: _value(name, message[name], form) for name, form in spec.items()}
    t_ns, vehicle = integer(message, "t_ns"), integer(message, "vehicle")
    try:
        return _native.Event(t_ns, vehicle, str(kind), **fields)
    except (ValueError, OverflowError, TypeError) as error:
        raise MessageError(f"event {kind}: {error}") from None


def integer(message: Message, name: str) -> int:
    """An integer field.

    Raises:
        MessageError: it is missing, or no integer of 64 bits.
    """
    value = _value(name, message.get(name), "i8")
    assert isinstance(value, int)
    return value


def octets(message: Message, name: str) -> bytes:
    """A field of hexadecimal digits.

    Raises:
        MessageError: it is missing, or not that.
    """
    value = _value(name, message.get(name), "hex")
    assert isinstance(value, bytes)
    return value


def _value(name: str, value: Any, form: str) -> Any:
    if form == "bool" and isinstance(value, bool):
        return value
    if form == "i8" and isinstance(value, int) and not isinstance(value, bool) and value in _I8:
        return value
    if form == "f8" and isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass
    if form == "f8" and value is None and name in _MAY_BE_NAN:
        return math.nan
    if form == "hex" and isinstance(value, str):
        try:
            return bytes.fromhex(value)
        except ValueError:
            pass
    wanted = {"bool": "true or false", "i8": "an integer", "f8": "a number", "hex": "hexadecimal digits"}[
        form
    ]
    raise MessageError(f"field {name} is {str(value)[:30]!r}: must be {wanted}")


def _no_constant(text: str) -> float:
    raise ValueError(text)
