"""What must hold in a mission log before it is written, replayed or trusted after reading.

Every failure is one `LogError` line: the quantity, its value, the bound, and where there is one the vehicle
and the time. Checks run from the whole to the parts: team and link, then each table, then truth.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwcoop._native import event_bounds
from uwcoop.errors import LogError
from uwcoop.missionlog.model import (
    EVENT_COLUMNS,
    OPPORTUNITY_COLUMNS,
    POLL_COLUMNS,
    RECEPTION_COLUMNS,
    SLOT_COLUMNS,
    Columns,
    Link,
    MissionLog,
)
from uwcoop.missionlog.truth import DIMENSIONS, truth_time_ns

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LONGEST_NS = (2**31 - 1) * 1_000_000_000  # seconds of a ROS 2 stamp are int32
_BOUNDS = {(kind, field): (*bounds, above) for kind, field, *bounds, above in event_bounds()}
"""By event kind and column: least and greatest value, and whether the least itself is refused; the core's table."""
_OPTIONAL = {"range_m", "own_bearing_rad", "peer_bearing_rad"}  # NaN: not measured
_COVARIANCES = {
    "fix": (("cov_ee_m2", "cov_en_m2"), ("cov_en_m2", "cov_nn_m2")),
    "odometry": (
        ("cov_ff", "cov_fl", "cov_fy"),
        ("cov_fl", "cov_ll", "cov_ly"),
        ("cov_fy", "cov_ly", "cov_yy"),
    ),
}
# Rounding may leave a singular covariance this much below zero, relative to its diagonal.
_CORRELATION_SLACK = 1e-9


def validate(log: MissionLog) -> None:
    """Refuse a log that a navigator must not be fed from.

    Raises:
        LogError: the first thing that is wrong.
    """
    _team(log)
    _link(log.link)
    for kind, table in log.events.items():
        if kind not in EVENT_COLUMNS:
            raise LogError(f"event kind {kind!r} is unknown: it must be one of {', '.join(EVENT_COLUMNS)}")
        _events(_Table(kind, table, log, "t_ns", "vehicle"))
    if log.slots:
        _slots(_Table("slots", log.slots, log, "tol_ns", "sender"))
    if log.polls:
        _polls(_Table("polls", log.polls, log, "t_ns", "poller"))
    if log.opportunities:
        _opportunities(_Table("opportunities", log.opportunities, log, "tol_ns", "receiver"))
    if log.receptions or log.payloads:
        _receptions(_Table("receptions", log.receptions, log, "t_ns", "receiver"))
    _truth(log)


class _Table(NamedTuple):
    """A table with what a message about one of its rows needs: whose the row is and when."""

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
        when = f" at t = {_seconds(self.columns[self.time][row])} s" if column != self.time else ""
        value = self.columns[column][row]
        shown = f"{_seconds(value)} s" if column.endswith("_ns") else f"{value}"
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
        self.refuse(outside, self.time, f"within the mission: 0 to {_seconds(duration)} s")
        step = np.diff(times, prepend=times[:1])
        before = _seconds(times[max(int(np.argmax(step < 0)) - 1, 0)]) if times.size else ""
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


def _team(log: MissionLog) -> None:
    for field, kind in (("name", str), ("seed", int), ("duration_ns", int)):
        if not isinstance(getattr(log, field), kind):
            raise LogError(f"{field} {getattr(log, field)!r} must be {kind.__name__}")
    if not log.vehicles:
        raise LogError("the team has 0 vehicles: it needs at least 1")
    for name in log.vehicles:
        if not isinstance(name, str) or not name.strip():
            raise LogError(f"vehicle name {name!r} must not be empty")
        if log.vehicles.count(name) > 1:
            raise LogError(
                f"vehicle name {name!r} is given {log.vehicles.count(name)} times: it must be unique"
            )
    if not 0 < log.duration_ns <= _LONGEST_NS:
        raise LogError(
            f"duration {_seconds(log.duration_ns)} s must be above 0 s and at most {_seconds(_LONGEST_NS)} s"
        )
    for name, bound in (("latitude_deg", 90.0), ("longitude_deg", 360.0)):
        value = getattr(log.origin, name)
        if value is not None and not (isinstance(value, int | float) and abs(value) <= bound):
            raise LogError(f"origin: {name} {value!r} must be within -{bound:g} to {bound:g}")


def _link(link: Link) -> None:
    for name, value, at_least in (
        ("frame_bytes", link.frame_bytes, 1), ("max_frames", link.max_frames, 1),
        ("frame_s", link.frame_s, 0), ("preamble_s", link.preamble_s, 0),
    ):  # fmt: skip
        if not (isinstance(value, int | float) and math.isfinite(value) and value >= at_least):
            raise LogError(f"link: {name} {value!r} must be finite and at least {at_least}")
    speed = link.sound_speed_mps
    if not (isinstance(speed, int | float) and math.isfinite(speed) and speed > 0):
        raise LogError(f"link: sound_speed_mps {speed!r} must be finite and above 0")


def _events(table: _Table) -> None:
    spec = EVENT_COLUMNS[table.name]
    table.check_shape({"t_ns": "i8", "vehicle": "i8", **spec})
    table.check_index("vehicle")
    table.check_times("vehicle")
    table.check_finite()
    if table.name in _COVARIANCES:
        _covariance(table, _COVARIANCES[table.name])
    if table.name == "acoustic_fix":
        table.check_index("peer")
        table.refuse(table.columns["peer"] == table.columns["vehicle"], "peer", "another vehicle")
        launch = table.columns["transmit_ns"]
        table.refuse(launch < 0, "transmit_ns", "at least 0 s")
        table.refuse(launch > table.columns["t_ns"], "transmit_ns", "at most the event's own time")


def _covariance(table: _Table, names: Sequence[Sequence[str]]) -> None:
    """Variances not negative, and the matrices positive semidefinite."""
    size = len(names)
    for i in range(size):
        table.refuse(table.columns[names[i][i]] < 0, names[i][i], "at least 0")
    deviation = np.sqrt(np.stack([table.columns[names[i][i]] for i in range(size)], axis=-1))
    safe = np.where(deviation > 0, deviation, 1.0)
    for i in range(size):
        for j in range(i):
            known = (deviation[:, i] > 0) & (deviation[:, j] > 0)
            with np.errstate(over="ignore"):
                share = np.abs(table.columns[names[j][i]] / safe[:, i] / safe[:, j])
            allowed = np.where(known, 1 + _CORRELATION_SLACK, 0.0)
            table.refuse(share > allowed, names[j][i], "at most the product of its two standard deviations")
    if size == 2 or not len(deviation):
        return
    correlation = np.stack(
        [np.stack([table.columns[c] / safe[:, i] / safe[:, j] for j, c in enumerate(row)], axis=-1)
         for i, row in enumerate(names)], axis=-2,
    )  # fmt: skip
    lowest = np.linalg.eigvalsh(correlation)[:, 0]
    table.refuse(lowest < -_CORRELATION_SLACK, names[0][0], "part of a positive semidefinite covariance")


def _slots(table: _Table) -> None:
    table.check_shape(SLOT_COLUMNS)
    table.check_index("sender")
    table.check_times("sender")
    table.refuse(table.columns["capacity_bytes"] < 0, "capacity_bytes", "at least 0")
    same = (np.diff(table.columns["tol_ns"]) == 0) & (np.diff(table.columns["sender"]) == 0)
    table.refuse(np.append(False, same), "tol_ns", "the only slot of its sender at that time")


def _polls(table: _Table) -> None:
    columns = table.columns
    table.check_shape(POLL_COLUMNS)
    for name in ("poller", "sender"):
        table.check_index(name)
    table.check_times("poller")
    table.refuse(columns["poller"] == columns["sender"], "sender", "another vehicle than the poller")
    table.refuse(columns["tol_ns"] < columns["t_ns"], "tol_ns", "at or after the launch of the poll")
    for name in ("poll_bytes", "reply_bytes", "air_time_ns"):
        table.refuse(columns[name] < 0, name, "at least 0")
    slots = table.log.slots
    known = set(zip(slots["tol_ns"].tolist(), slots["sender"].tolist(), strict=True)) if slots else set()
    pairs = list(zip(columns["tol_ns"].tolist(), columns["sender"].tolist(), strict=True))
    absent = np.fromiter((pair not in known for pair in pairs), dtype=np.bool_)
    table.refuse(absent, "sender", "one that has a slot then")
    counts = Counter(pairs)
    again = np.fromiter((counts[pair] > 1 for pair in pairs), dtype=np.bool_)
    table.refuse(again, "tol_ns", "of a slot that is polled once")


def _opportunities(table: _Table) -> None:
    columns = table.columns
    table.check_shape(OPPORTUNITY_COLUMNS)
    for name in ("sender", "receiver"):
        table.check_index(name)
    table.check_times(None)
    table.check_finite()
    table.refuse(columns["receiver"] == columns["sender"], "sender", "another vehicle than the receiver")
    table.refuse(columns["toa_ns"] < columns["tol_ns"], "toa_ns", "at or after the time of launch")
    chance = columns["survive_probability"]
    table.refuse((chance < 0) | (chance > 1), "survive_probability", "between 0 and 1")
    _draws(table)
    slots = table.log.slots
    known = set(zip(slots["tol_ns"].tolist(), slots["sender"].tolist(), strict=True)) if slots else set()
    pairs = list(zip(columns["tol_ns"].tolist(), columns["sender"].tolist(), strict=True))
    table.refuse(
        np.fromiter((pair not in known for pair in pairs), dtype=np.bool_),
        "sender",
        "one that has a slot then",
    )
    triples = list(zip(pairs, columns["receiver"].tolist(), strict=True))
    if len(set(triples)) < len(triples):
        counts = Counter(triples)
        again = np.fromiter((counts[triple] > 1 for triple in triples), dtype=np.bool_)
        table.refuse(again, "toa_ns", "the only arrival of its slot at that receiver")


def _draws(table: _Table) -> None:
    """One uniform draw for each frame that the modem can send."""
    expected = (len(table.columns["tol_ns"]), table.log.link.max_frames)
    draws = table.columns.get("draws")
    if draws is None:
        raise LogError("opportunities: column 'draws' is missing")
    if draws.shape != expected or draws.dtype != np.float64:
        raise LogError(
            f"opportunities: draws are {draws.dtype} {draws.shape}, they must be float64 {expected}: "
            "(opportunities, frames of the modem)"
        )
    outside = np.argwhere(~((draws >= 0) & (draws < 1)))
    if outside.size:
        row, frame = (int(i) for i in outside[0])
        when = _seconds(table.columns["tol_ns"][row])
        raise LogError(f"opportunities: draw {draws[row, frame]} at t = {when} s must be in [0, 1)")


def _receptions(table: _Table) -> None:
    columns = table.columns
    if not columns:
        raise LogError(f"receptions: {len(table.log.payloads)} payloads have no rows")
    table.check_shape(RECEPTION_COLUMNS)
    for name in ("receiver", "sender"):
        table.check_index(name)
    table.check_times("receiver")
    table.refuse(columns["receiver"] == columns["sender"], "sender", "another vehicle than the receiver")
    table.refuse(columns["tol_ns"] < 0, "tol_ns", "at least 0 s")
    table.refuse(columns["toa_ns"] < columns["tol_ns"], "toa_ns", "at or after the time of launch")
    table.refuse(columns["t_ns"] < columns["toa_ns"], "toa_ns", "at or before the end of decoding")
    if len(table.log.payloads) != len(columns["t_ns"]):
        raise LogError(f"receptions: {len(table.log.payloads)} payloads for {len(columns['t_ns'])} rows")
    for payload in table.log.payloads:
        if not isinstance(payload, bytes):
            raise LogError(f"receptions: a payload is {type(payload).__name__}, it must be bytes")


def _truth(log: MissionLog) -> None:
    """Shapes and times; a value may be NaN where the truth is not known, never infinite."""
    if log.truth is None:
        return
    names = {str(name) for name in log.truth.data_vars}
    if "position_m" not in names or not names <= DIMENSIONS.keys():
        raise LogError(f"truth: variables {sorted(names)} must be position_m and any of {sorted(DIMENSIONS)}")
    if (
        not {str(name) for name in log.truth.coords} <= {"vehicle", "time", "axis"}
        or "time" not in log.truth.coords
    ):
        raise LogError(
            f"truth: coordinates {sorted(map(str, log.truth.coords))} must be time, vehicle and axis"
        )
    sizes = {str(name): int(size) for name, size in log.truth.sizes.items()}
    if sizes.get("vehicle") != len(log.vehicles) or sizes.get("axis") != 2 or not sizes.get("time"):
        raise LogError(
            f"truth: sizes {sizes} must be vehicle {len(log.vehicles)}, axis 2 and time at least 1"
        )
    if "vehicle" in log.truth.coords and log.truth["vehicle"].to_numpy().tolist() != list(log.vehicles):
        raise LogError(
            f"truth: vehicles {log.truth['vehicle'].to_numpy().tolist()} must be {list(log.vehicles)}"
        )
    seconds = log.truth["time"].to_numpy()
    if seconds.dtype != np.float64 or not np.isfinite(seconds).all():
        raise LogError("truth: times must be finite float64 seconds")
    outside = seconds[(seconds < 0) | (seconds * 1e9 > _LONGEST_NS)]
    if outside.size:
        raise LogError(f"truth: time {outside[0]} s must be within 0 to {_seconds(_LONGEST_NS)} s")
    if np.any(np.diff(truth_time_ns(log.truth)) <= 0):
        raise LogError("truth: times must increase")
    for name in sorted(names):
        variable = log.truth[name]
        if set(variable.dims) != set(DIMENSIONS[name]) or variable.dtype != np.float64:
            raise LogError(
                f"truth: {name} is {variable.dtype} {variable.dims}, it must be float64 {DIMENSIONS[name]}"
            )
        if np.isinf(variable.to_numpy()).any():
            raise LogError(f"truth: {name} holds an infinite value: it must be finite, or NaN where unknown")


def _seconds(t_ns: Any) -> str:
    """Nanoseconds as seconds, exact and without needless zeros."""
    whole, rest = divmod(abs(int(t_ns)), 1_000_000_000)
    fraction = f".{rest:09d}".rstrip("0") if rest else ""
    return f"{'-' if int(t_ns) < 0 else ''}{whole}{fraction}"
