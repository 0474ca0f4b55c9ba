"""What a reader finds in a file: channels of stamped columns, with units as the file states them.

A reader knows a file format and nothing of navigation; what a channel means is the mapping's business (`binding`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from uwcoop.errors import LogError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Integers = NDArray[np.int64]

__all__ = ["Channel", "Columns", "Omitted", "SourceFile"]


class Columns(Mapping[str, "NDArray[Any]"]):
    """Columns by label, each (N,): numbers, or texts (dtype object). Made when they are asked for."""

    def __init__(self, labels: tuple[str, ...], count: int, make: Mapping[str, Any]) -> None:
        self._labels, self._count, self._make = labels, count, make

    def __getitem__(self, label: str) -> NDArray[Any]:
        made: NDArray[Any] = self._make[label]()
        return made

    def __iter__(self) -> Iterator[str]:
        return iter(self._labels)

    def __len__(self) -> int:
        return len(self._labels)


@dataclass(frozen=True)
class Channel:
    """One stream of a file: a topic, a message type, a variable, or a whole table."""

    source: str
    """Name of its file."""
    name: str
    """Topic, message or variable as the file names it; of a table the file's name."""
    kind: str
    """Type as the format names it: "sensor_msgs/msg/Imu", "mavlink/ATTITUDE", "moos/double", "imc/GpsFix", "table"."""
    t_ns: Integers
    """(N,) stamps as they are, in the order of the file: nanoseconds since 1970 (`clock` "utc"), or since a zero of
    their own."""
    columns: Mapping[str, NDArray[Any]]
    """By label; (N,) each."""
    clock: Literal["utc", "own"] = "utc"
    units: Mapping[str, str] = field(default_factory=dict)
    """By label, where the file states one."""
    frame_id: str = ""
    """The coordinate frame that its first message names."""
    received_ns: Integers | None = None
    """(N,) when the recorder wrote each, nanoseconds since 1970."""

    @property
    def key(self) -> tuple[str, str]:
        """Its file and its name: several files may hold a channel of one name."""
        return self.source, self.name

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.t_ns)

    def numbers(self, label: str) -> NDArray[np.float64]:
        """A column as float64, (N,).

        Raises:
            LogError: a cell that is no number.
        """
        column = self.columns[label]
        try:
            return np.asarray(column, dtype=np.float64)
        except ValueError:
            row, cell = next(
                (k, str(c)) for k, c in enumerate(column.tolist()) if str(c).strip() and not _is_number(c)
            )
            raise LogError(
                f"{self.source}: column {label!r} of {self.name} holds {cell[:40]!r} in row {row + 1}: not a number"
            ) from None

    def is_text(self, label: str) -> bool:
        """Whether a column holds texts: most of its cells are none of numbers."""
        column = self.columns[label]
        if column.dtype.kind not in "OUS":
            return False
        filled = [cell for cell in column.tolist() if str(cell).strip()]
        return 2 * sum(map(_is_number, filled)) <= len(filled)


def _is_number(cell: object) -> bool:
    try:
        float(str(cell))
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Omitted:
    """A stream that is in the file and was not read."""

    name: str
    kind: str
    count: int
    reason: str


@dataclass(frozen=True)
class SourceFile:
    """A file or folder that was read."""

    name: str
    format: str
    """As a person calls it: "ROS 2 bag (MCAP)"."""
    channels: tuple[Channel, ...]
    omitted: tuple[Omitted, ...] = ()
    notes: tuple[str, ...] = ()
    """What was dropped, converted or assumed while it was read, one sentence each."""
