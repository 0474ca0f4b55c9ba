"""Serialised ROS messages of one topic as columns: whole topics at a time, as structured arrays.

Messages whose strings and sequences have the same lengths lie byte for byte alike. Their fields are therefore columns of
one structured array, and only one message of each such group is taken apart by hand. Both encodings are read: CDR of
ROS 2 (aligned) and that of ROS 1 (packed).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from uwcoop.importers.channels import Columns

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rosbags.typesys.store import Typestore

__all__ = ["DecodeError", "Decoded", "decode"]

MOST_ITEMS = 64
"""Of a sequence that becomes columns; a longer one (an image, a scan) is passed over."""
MOST_GROUPS = 4096
"""Different combinations of lengths in one topic."""
_FORMATS = {
    "bool": "u1", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip


class DecodeError(ValueError):
    """A message that is not what its definition says."""


@dataclass(frozen=True)
class Decoded:
    """The messages that could be taken apart."""

    rows: NDArray[np.int64]
    """(N,) which messages these are, ascending."""
    columns: Columns
    stamps_ns: NDArray[np.int64] | None
    """(N,) of their headers; None: the type has none."""
    frame_id: str
    damaged: int
    """Messages that were left out."""


@dataclass(frozen=True)
class _Form:
    """Where the fields of a message lie, and the lengths that must be the same for another to lie alike."""

    fields: dict[str, tuple[int, str, int]]
    """Path to offset, NumPy format and number of items (0: a scalar)."""
    texts: dict[str, tuple[int, int]]
    """Path to offset and length in bytes."""
    lengths: dict[int, int]
    """Offset of each stated length, and its value."""
    order: str
    size: int


class _Walk:
    """Takes one message apart."""

    def __init__(self, store: Typestore, message: bytes, aligned: bool) -> None:
        self.store, self.message, self.aligned = store, message, aligned
        self.start = 4 if aligned else 0
        self.order = "<" if not aligned or message[1] & 1 else ">"
        self.at = self.start
        self.fields: dict[str, tuple[int, str, int]] = {}
        self.texts: dict[str, tuple[int, int]] = {}
        self.lengths: dict[int, int] = {}

    def form(self, msgtype: str) -> _Form:
        self.struct(msgtype, "")
        # Some middleware pads a message to a multiple of four bytes.
        if not self.at <= len(self.message) <= self.at + (3 if self.aligned else 0):
            raise DecodeError(f"{len(self.message)} bytes, its definition needs {self.at}")
        return _Form(self.fields, self.texts, self.lengths, self.order, len(self.message))

    def struct(self, msgtype: str, prefix: str) -> None:
        for name, (node, detail) in self.store.fielddefs[msgtype][1]:
            self.field(prefix + name, int(node), detail)

    def field(self, path: str, node: int, detail: Any) -> None:
        from rosbags.interfaces import Nodetype

        if node == Nodetype.NAME:
            self.struct(str(detail), path + ".")
        elif node == Nodetype.BASE:
            self.base(path, cast("tuple[str, int]", detail)[0])
        else:
            (inner, inner_detail), count = detail
            if node == Nodetype.SEQUENCE:
                count = self.length()
            self.items(path, int(inner), inner_detail, count)

    def items(self, path: str, node: int, detail: Any, count: int) -> None:
        from rosbags.interfaces import Nodetype

        if node == Nodetype.BASE and detail[0] != "string":
            if count:
                self.place(path, _FORMATS[detail[0]], count)
            return
        if count > MOST_ITEMS * 16:
            raise DecodeError(f"{path} has {count} items")
        for k in range(count):
            self.field(f"{path}[{k}]", node, detail)

    def base(self, path: str, kind: str) -> None:
        if kind != "string":
            self.place(path, _FORMATS[kind], 0)
            return
        length = self.length()
        self.texts[path] = (self.at, max(length - 1, 0) if self.aligned else length)
        self.advance(length)

    def length(self) -> int:
        self.align(4)
        at = self.at
        self.advance(4)
        (value,) = struct.unpack_from(f"{self.order}I", self.message, at)
        if value > len(self.message):
            raise DecodeError(f"a length of {value} in {len(self.message)} bytes")
        self.lengths[at] = value
        return int(value)

    def place(self, path: str, form: str, count: int) -> None:
        size = int(form[1:])
        self.align(size)
        if count <= MOST_ITEMS:
            self.fields[path] = (self.at, form, count)
        self.advance(size * max(count, 1))

    def align(self, size: int) -> None:
        if self.aligned:
            self.at += -(self.at - self.start) % size

    def advance(self, size: int) -> None:
        self.at += size
        if self.at > len(self.message):
            raise DecodeError(f"{len(self.message)} bytes, its definition needs more")


def decode(store: Typestore, msgtype: str, messages: Sequence[bytes], *, aligned: bool) -> Decoded:
    """The messages of one topic as columns.

    A field `a.b` of a nested message is the column "a.b", an item of an array "a.b[0]". A column that some messages lack,
    since a sequence of theirs is shorter, is NaN there.

    Args:
        store: knows `msgtype` and all it depends on.
        msgtype: "sensor_msgs/msg/Imu".
        messages: as recorded.
        aligned: CDR of ROS 2; else the packed form of ROS 1.
    """
    groups, damaged = _groups(store, msgtype, messages, aligned)
    rows = np.sort(np.concatenate([rows for _, rows, _ in groups])) if groups else np.zeros(0, np.int64)
    make: dict[str, Callable[[], NDArray[Any]]] = {}
    labels: dict[str, None] = {}
    places: dict[str, list[tuple[NDArray[np.int64], Callable[[], NDArray[Any]]]]] = {}
    for form, own, records in groups:
        where = np.searchsorted(rows, own)
        for label, column in _of_group(form, records).items():
            labels.setdefault(label)
            places.setdefault(label, []).append((where, column))
    for label, parts in places.items():
        make[label] = partial(_joined, len(rows), parts)
    columns = Columns(tuple(labels), len(rows), make)
    return Decoded(rows, columns, _stamps(columns), _frame_id(groups), damaged)


Group = tuple[_Form, "NDArray[np.int64]", "NDArray[Any]"]


def _groups(
    store: Typestore, msgtype: str, messages: Sequence[bytes], aligned: bool
) -> tuple[list[Group], int]:
    """Messages that lie alike, with their form."""
    by_size: dict[int, list[int]] = {}
    for k, size in enumerate(map(len, messages)):
        by_size.setdefault(size, []).append(k)
    groups: list[Group] = []
    damaged = 0
    for size, alike in by_size.items():
        left = np.array(alike, dtype=np.int64)
        table = np.frombuffer(b"".join([messages[k] for k in alike]), dtype=np.uint8).reshape(
            -1, max(size, 1)
        )
        while left.size:
            try:
                form = _Walk(store, messages[int(left[0])], aligned).form(msgtype)
            except (DecodeError, struct.error, IndexError):
                form = None
            if form is None or len(groups) >= MOST_GROUPS:
                damaged += 1 if form is None else left.size
                same = np.arange(left.size) < (1 if form is None else left.size)
            else:
                same = _lies_alike(form, table, aligned)
                groups.append(
                    (form, left[same], np.ascontiguousarray(table[same]) if not same.all() else table)
                )
            left, table = left[~same], table[~same]
    return groups, damaged


def _lies_alike(form: _Form, table: NDArray[np.uint8], aligned: bool) -> NDArray[np.bool_]:
    same = np.ones(len(table), dtype=bool)
    if aligned:
        same &= table[:, 1] == table[0, 1]
    for at, value in form.lengths.items():
        same &= np.ascontiguousarray(table[:, at : at + 4]).view(f"{form.order}u4").ravel() == value
    return same


def _of_group(form: _Form, records: NDArray[Any]) -> dict[str, Callable[[], NDArray[Any]]]:
    found: dict[str, Callable[[], NDArray[Any]]] = {}
    for path, (at, kind, count) in form.fields.items():
        step = int(kind[1:])
        if not count:
            found[path] = partial(_numbers, records, at, form.order + kind)
        for k in range(count):
            found[f"{path}[{k}]"] = partial(_numbers, records, at + k * step, form.order + kind)
    for path, (at, length) in form.texts.items():
        found[path] = partial(_texts, records, at, length)
    return found


def _numbers(records: NDArray[Any], at: int, form: str) -> NDArray[Any]:
    size = int(form[2:])
    return np.ascontiguousarray(records[:, at : at + size]).view(form).ravel().astype(form[1:])


def _texts(records: NDArray[Any], at: int, length: int) -> NDArray[Any]:
    out = np.full(len(records), "", dtype=object)
    if not length:
        return out
    cells, place = np.unique(
        np.ascontiguousarray(records[:, at : at + length]).view(f"S{length}"), return_inverse=True
    )
    names = np.array([*(bytes(c).decode("utf-8", "replace") for c in cells.ravel()), None], dtype=object)[:-1]
    return np.asarray(names[place.ravel()])


def _joined(
    count: int, parts: Sequence[tuple[NDArray[np.int64], Callable[[], NDArray[Any]]]]
) -> NDArray[Any]:
    made = [column() for _, column in parts]
    if len(parts) == 1 and len(made[0]) == count:
        return made[0]
    text = made[0].dtype.kind == "O"
    whole = sum(map(len, made)) == count
    kind: Any = object if text else made[0].dtype if whole else np.float64
    out = np.full(count, "" if text else 0 if whole else np.nan, dtype=kind)
    for (where, _), column in zip(parts, made, strict=True):
        out[where] = column
    return out


def _stamps(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.int64] | None:
    for prefix in ("header.stamp.", "stamp."):
        if prefix + "sec" in columns and prefix + "nanosec" in columns:
            seconds = columns[prefix + "sec"].astype(np.int64)
            return np.asarray(seconds * 1_000_000_000 + columns[prefix + "nanosec"].astype(np.int64))
    return None


def _frame_id(groups: Sequence[Group]) -> str:
    if not groups:
        return ""
    form, _, records = groups[0]
    for path in ("header.frame_id", "frame_id"):
        if path in form.texts:
            return str(_texts(records[:1], *form.texts[path])[0])
    return ""
