"""What must hold in a mission log before it is written, replayed or trusted after reading.

Every failure is one `LogError` line: the quantity, its value, the bound, and where there is one the vehicle
and the time. Checks run from the whole to the parts: team and link, then each table, then truth.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from uwcoop.acoustics.link import Link
from uwcoop.errors import LogError
from uwcoop.missionlog.model import (
    EVENT_COLUMNS,
    OPPORTUNITY_COLUMNS,
    POLL_COLUMNS,
    RECEPTION_COLUMNS,
    SLOT_COLUMNS,
    MissionLog,
)
from uwcoop.missionlog.table_checks import CheckedTable, seconds_text
from uwcoop.missionlog.truth import DIMENSIONS, truth_time_ns

_LONGEST_NS = (2**31 - 1) * 1_000_000_000  # seconds of a ROS 2 stamp are int32
_LAST_EPOCH_NS = 7_258_118_400 * 1_000_000_000
_OLDEST_NS = 1_000_000_000_000  # the core's bound of an age
_COVARIANCES = {
    "fix": (("cov_ee_m2", "cov_en_m2"), ("cov_en_m2", "cov_nn_m2")),
    "usbl": (("cov_ee_m2", "cov_en_m2"), ("cov_en_m2", "cov_nn_m2")),
    "odometry": (
        ("cov_ff", "cov_fl", "cov_fy"),
        ("cov_fl", "cov_ll", "cov_ly"),
        ("cov_fy", "cov_ly", "cov_yy"),
    ),
}


def validate(log: MissionLog) -> None:
    """Refuse a log that must not be replayed.

    Raises:
        LogError: the first thing that is wrong.
    """
    _team(log)
    _link(log.link)
    for kind, table in log.events.items():
        if kind not in EVENT_COLUMNS:
            raise LogError(f"event kind {kind!r} is unknown: it must be one of {', '.join(EVENT_COLUMNS)}")
        _events(CheckedTable(kind, table, log, "t_ns", "vehicle"))
    if log.slots:
        _slots(CheckedTable("slots", log.slots, log, "tol_ns", "sender"))
    if log.polls:
        _polls(CheckedTable("polls", log.polls, log, "t_ns", "poller"))
    if log.opportunities:
        _opportunities(CheckedTable("opportunities", log.opportunities, log, "tol_ns", "receiver"))
    if log.receptions or log.payloads:
        _receptions(CheckedTable("receptions", log.receptions, log, "t_ns", "receiver"))
    _truth(log)


def _team(log: MissionLog) -> None:
    for field, kind in (("name", str), ("seed", int), ("duration_ns", int)):
        if not isinstance(getattr(log, field), kind):
            raise LogError(f"{field} {getattr(log, field)!r} must be {kind.__name__}")
    if log.epoch_ns is not None and not (
        isinstance(log.epoch_ns, int) and 0 <= log.epoch_ns < _LAST_EPOCH_NS
    ):
        raise LogError(f"epoch_ns {log.epoch_ns!r} must be within 0 to {_LAST_EPOCH_NS} (the year 2200)")
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
            f"duration {seconds_text(log.duration_ns)} s must be above 0 s and at most {seconds_text(_LONGEST_NS)} s"
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


def _events(table: CheckedTable) -> None:
    spec = EVENT_COLUMNS[table.name]
    table.check_shape({"t_ns": "i8", "vehicle": "i8", **spec})
    table.check_index("vehicle")
    table.check_times("vehicle")
    table.check_finite()
    if table.name in _COVARIANCES:
        table.check_covariance(_COVARIANCES[table.name])
    if "measured_ns" in spec:
        measured = table.columns["measured_ns"]
        table.refuse(measured > table.columns["t_ns"], "measured_ns", "at most the event's own time")
        table.refuse(measured < table.columns["t_ns"] - _OLDEST_NS, "measured_ns", "at most 1000 s old")
    if table.name == "acoustic_fix":
        table.check_index("peer")
        table.refuse(table.columns["peer"] == table.columns["vehicle"], "peer", "another vehicle")
        launch = table.columns["transmit_ns"]
        table.refuse(launch < 0, "transmit_ns", "at least 0 s")
        table.refuse(launch > table.columns["t_ns"], "transmit_ns", "at most the event's own time")


def _slots(table: CheckedTable) -> None:
    table.check_shape(SLOT_COLUMNS)
    table.check_index("sender")
    table.check_times("sender")
    table.refuse(table.columns["capacity_bytes"] < 0, "capacity_bytes", "at least 0")
    same = (np.diff(table.columns["tol_ns"]) == 0) & (np.diff(table.columns["sender"]) == 0)
    table.refuse(np.append(False, same), "tol_ns", "the only slot of its sender at that time")


def _polls(table: CheckedTable) -> None:
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


def _opportunities(table: CheckedTable) -> None:
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


def _draws(table: CheckedTable) -> None:
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
        when = seconds_text(table.columns["tol_ns"][row])
        raise LogError(f"opportunities: draw {draws[row, frame]} at t = {when} s must be in [0, 1)")


def _receptions(table: CheckedTable) -> None:
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
    """Shapes and times; a value may be NaN where the truth is unknown, never infinite."""
    truth = log.known_truth
    if truth is None:
        return
    names = {str(name) for name in truth.data_vars}
    if "position_m" not in names or not names <= DIMENSIONS.keys():
        raise LogError(f"truth: variables {sorted(names)} must be position_m and any of {sorted(DIMENSIONS)}")
    if not {str(name) for name in truth.coords} <= {"vehicle", "time", "axis"} or "time" not in truth.coords:
        raise LogError(f"truth: coordinates {sorted(map(str, truth.coords))} must be time, vehicle and axis")
    sizes = {str(name): int(size) for name, size in truth.sizes.items()}
    if sizes.get("vehicle") != len(log.vehicles) or sizes.get("axis") != 2 or not sizes.get("time"):
        raise LogError(
            f"truth: sizes {sizes} must be vehicle {len(log.vehicles)}, axis 2 and time at least 1"
        )
    if "vehicle" in truth.coords and truth["vehicle"].to_numpy().tolist() != list(log.vehicles):
        raise LogError(f"truth: vehicles {truth['vehicle'].to_numpy().tolist()} must be {list(log.vehicles)}")
    seconds = truth["time"].to_numpy()
    if seconds.dtype != np.float64 or not np.isfinite(seconds).all():
        raise LogError("truth: times must be finite float64 seconds")
    outside = seconds[(seconds < 0) | (seconds * 1e9 > _LONGEST_NS)]
    if outside.size:
        raise LogError(f"truth: time {outside[0]} s must be within 0 to {seconds_text(_LONGEST_NS)} s")
    if np.any(np.diff(truth_time_ns(truth)) <= 0):
        raise LogError("truth: times must increase")
    for name in sorted(names):
        variable = truth[name]
        if set(variable.dims) != set(DIMENSIONS[name]) or variable.dtype != np.float64:
            raise LogError(
                f"truth: {name} is {variable.dtype} {variable.dims}, it must be float64 {DIMENSIONS[name]}"
            )
        if np.isinf(variable.to_numpy()).any():
            raise LogError(f"truth: {name} holds an infinite value: it must be finite, or NaN where unknown")
