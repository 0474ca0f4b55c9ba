"""Checks of one table of a mission log: a failure names the row's vehicle and time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwcoop._native import event_bounds
from uwcoop.errors import LogError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog.model import Columns, MissionLog

__all__ = ["CheckedTable", "seconds_text"]

_BOUNDS = {(kind, field): (*bounds, above) for kind, field, *bounds, above in event_bounds()}
"""By event kind and column: least and greatest value, and whether the least itself is refused; the core's table."""
# A log may hold fixes of unknown covariance, all zeros: they get one before a navigator sees them.
for _variance in ("cov_ee_m2", "cov_nn_m2"):
    _BOUNDS["fix", _variance] = (0.0, *_BOUNDS["fix", _variance][1:])
_OPTIONAL = {"range_m", "own_bearing_rad", "peer_bearing_rad", "peer_depth_m"}  # NaN: not measured, not told
# Rounding may leave a singular covariance this much below zero, relative to its diagonal.
_CORRELATION_SLACK = 1e-9


class CheckedTable(NamedTuple):
    """A table, and the columns that name a row's vehicle and time in a message."""

    name: str
    columns: Columns
    log: MissionLog
    time: str
    who: str

    def refuse(self, wrong: NDArray[np.bool_], column: str, bound: str) -> None:
        """Raise for the first row where `wrong`, (N,), holds."""
        rows = np.flatnonzero(wrong)
        if rows.size == 0:
            return
        row = int(rows[0])
        index = int(self.columns[self.who][row])
        team = self.log.vehicles
        # The vehicle itself may be what is wrong.
        whose = f" of vehicle {team[index]!r}" if 0 <= index < len(team) and column != self.who else ""
        when = f" at t = {seconds_text(self.columns[self.time][row])} s" if column != self.time else ""
        value = self.columns[column][row]
        shown = f"{seconds_text(value)} s" if column.endswith("_ns") else f"{value}"
        raise LogError(f"{self.name}: {column} {shown}{whose}{when} must be {bound}")

    def check_shape(self, spec: dict[str, str]) -> None:
        """Columns present, one-dimensional, equally long and of the right kind of number."""
        if missing := [name for name in spec if name not in self.columns]:
            raise LogError(f"{self.name}: column {missing[0]!r} is missing")
        count = len(self.columns[self.time])
        for name, column in self.columns.items():
            if name == "draws":
                continue
            if name not in spec:
                raise LogError(f"{self.name}: column {name!r} is unknown")
            if column.shape != (count,):
                raise LogError(f"{self.name}: column {name!r} has shape {column.shape}, not ({count},)")
            if column.dtype != np.dtype(spec[name]):
                raise LogError(f"{self.name}: column {name!r} is {column.dtype}, not {np.dtype(spec[name])}")

    def check_times(self, tie: str | None) -> None:
        """Times within the mission and sorted, ties by column `tie`."""
        times = self.columns[self.time]
        duration = self.log.duration_ns
        outside = (times < 0) | (times > duration)
        self.refuse(outside, self.time, f"within the mission: 0 to {seconds_text(duration)} s")
        step = np.diff(times, prepend=times[:1])
        before = seconds_text(times[max(int(np.argmax(step < 0)) - 1, 0)]) if times.size else ""
        self.refuse(step < 0, self.time, f"in order: the row before is at {before} s")
        if tie is not None:
            rank = self.columns[tie]
            self.refuse((step == 0) & (np.diff(rank, prepend=rank[:1]) < 0), tie, "in order at equal times")

    def check_index(self, column: str) -> None:
        """A vehicle index points into the team."""
        values = self.columns[column]
        count = len(self.log.vehicles)
        self.refuse((values < 0) | (values >= count), column, f"an index into the team: 0 to {count - 1}")

    def check_finite(self) -> None:
        """Every float finite (NaN where a measurement is optional) and within the core's bounds of events."""
        for name, column in self.columns.items():
            if column.dtype.kind != "f" or name == "draws":
                continue
            bad = ~np.isfinite(column) & ~(np.isnan(column) & (name in _OPTIONAL))
            self.refuse(bad, name, "finite")
            if (self.name, name) in _BOUNDS:
                least, most, above = _BOUNDS[self.name, name]
                bound = f"above {least:g} m" if above else f"at least {least:g}"
                self.refuse(column <= least if above else column < least, name, bound)
                self.refuse(column > most, name, f"at most {most:g}")

    def check_covariance(self, names: Sequence[Sequence[str]]) -> None:
        """Variances not negative, and the matrices positive semidefinite."""
        size = len(names)
        for i in range(size):
            self.refuse(self.columns[names[i][i]] < 0, names[i][i], "at least 0")
        deviation = np.sqrt(np.stack([self.columns[names[i][i]] for i in range(size)], axis=-1))
        safe = np.where(deviation > 0, deviation, 1.0)
        for i in range(size):
            for j in range(i):
                known = (deviation[:, i] > 0) & (deviation[:, j] > 0)
                with np.errstate(over="ignore"):
                    share = np.abs(self.columns[names[j][i]] / safe[:, i] / safe[:, j])
                allowed = np.where(known, 1 + _CORRELATION_SLACK, 0.0)
                self.refuse(
                    share > allowed, names[j][i], "at most the product of its two standard deviations"
                )
        if size == 2 or not len(deviation):
            return
        correlation = np.stack(
            [np.stack([self.columns[c] / safe[:, i] / safe[:, j] for j, c in enumerate(row)], axis=-1)
             for i, row in enumerate(names)], axis=-2,
        )  # fmt: skip
        lowest = np.linalg.eigvalsh(correlation)[:, 0]
        self.refuse(lowest < -_CORRELATION_SLACK, names[0][0], "part of a positive semidefinite covariance")


def seconds_text(t_ns: Any) -> str:
    """Nanoseconds as seconds, exact and without needless zeros."""
    whole, rest = divmod(abs(int(t_ns)), 1_000_000_000)
    fraction = f".{rest:09d}".rstrip("0") if rest else ""
    return f"{'-' if int(t_ns) < 0 else ''}{whole}{fraction}"
