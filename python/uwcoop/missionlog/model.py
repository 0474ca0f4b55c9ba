"""The mission log in memory: columns of events, acoustic opportunities, and truth kept apart.

Navigators are fed from `events`, `slots`, `polls`, `opportunities` and `receptions` only. `truth` is read by metrics,
figures and the viewer; nothing in the core has a type that could carry it.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.acoustics.link import Link
from uwcoop.errors import LogError
from uwcoop.frames import Origin
from uwcoop.missionlog.labelled import Arrays, DatasetWhenRead
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

    from uwcoop.charts import Chart

Columns = dict[str, "NDArray[Any]"]

EVENT_COLUMNS: dict[str, dict[str, str]] = {
    "motion": {"velocity_e_mps": "f8", "velocity_n_mps": "f8"},
    "odometry": {
        "forward_m": "f8", "left_m": "f8", "yaw_change_rad": "f8",
        "cov_ff": "f8", "cov_fl": "f8", "cov_fy": "f8", "cov_ll": "f8", "cov_ly": "f8", "cov_yy": "f8",
    },
    "water_depth": {"water_depth_m": "f8", "sigma_m": "f8"},
    "depth": {"depth_m": "f8", "sigma_m": "f8"},
    "heading": {"yaw_rad": "f8", "sigma_rad": "f8"},
    "turn_rate": {"yaw_rate_radps": "f8", "sigma_radps": "f8"},
    "ground_velocity": {"forward_mps": "f8", "left_mps": "f8", "sigma_mps": "f8"},
    "fix": {"e_m": "f8", "n_m": "f8", "cov_ee_m2": "f8", "cov_en_m2": "f8", "cov_nn_m2": "f8"},
    "acoustic_fix": {
        "peer": "i8", "transmit_ns": "i8", "range_m": "f8", "own_bearing_rad": "f8", "peer_bearing_rad": "f8",
        "peer_depth_m": "f8",
    },
    "water_velocity": {"forward_mps": "f8", "left_mps": "f8", "sigma_mps": "f8"},
    "beacon_range": {
        "measured_ns": "i8", "beacon_e_m": "f8", "beacon_n_m": "f8", "beacon_depth_m": "f8", "range_m": "f8",
        "sigma_m": "f8", "one_way": "bool",
    },
    "usbl": {
        "measured_ns": "i8", "e_m": "f8", "n_m": "f8", "cov_ee_m2": "f8", "cov_en_m2": "f8", "cov_nn_m2": "f8",
    },
    "landed": {},
    "lifted_off": {},
    "role_taken": {"landmark": "bool"},
}  # fmt: skip
"""Payload columns of each event kind; every table also has `t_ns` (i8) and `vehicle` (i8)."""

SLOT_COLUMNS: dict[str, str] = {"tol_ns": "i8", "sender": "i8", "capacity_bytes": "i8"}
OPPORTUNITY_COLUMNS: dict[str, str] = {
    "tol_ns": "i8", "sender": "i8", "receiver": "i8", "toa_ns": "i8", "survive_probability": "f8",
}  # fmt: skip
"""Plus `draws`, float64 (opportunities, frames): frame k arrives when draws[:, k] < survive_probability."""
RECEPTION_COLUMNS: dict[str, str] = {
    "t_ns": "i8", "receiver": "i8", "sender": "i8", "tol_ns": "i8", "toa_ns": "i8",
}  # fmt: skip
"""Packets that did arrive, as real logs hold them, stamped when decoding ends; their bytes are `payloads`."""

POLL_COLUMNS: dict[str, str] = {
    "tol_ns": "i8", "t_ns": "i8", "sender": "i8", "poller": "i8",
    "poll_bytes": "i8", "reply_bytes": "i8", "air_time_ns": "i8", "answered": "bool",
}  # fmt: skip
"""Two-way ranging: who polls `sender` for the packet of its slot at `tol_ns`. The poll is launched at `t_ns`, is
`poll_bytes` long and on the air for `air_time_ns`; its answer is `reply_bytes` longer than the packet; a slot whose
poll was not heard (`answered` is false) stays silent."""


def columns(spec: Mapping[str, str], **values: ArrayLike) -> Columns:
    """A table with exactly the columns of `spec` (name -> dtype), each a copy of `values[name]`, (N,).

    Raises:
        LogError: a column missing, unknown, not one-dimensional, of another length, or of values that the
            dtype cannot hold.
    """
    if missing := [name for name in spec if name not in values]:
        raise LogError(f"table has no column {missing[0]!r}: it needs {', '.join(spec)}")
    if unknown := [name for name in values if name not in spec]:
        raise LogError(f"table has an unknown column {unknown[0]!r}: it knows {', '.join(spec)}")
    try:
        table = {name: _converted(np.array(values[name]), dtype) for name, dtype in spec.items()}
    except (TypeError, ValueError) as error:
        raise LogError(f"table column cannot be converted: {error}") from error
    count = len(next(iter(table.values()))) if table else 0
    for name, column in table.items():
        if column.shape != (count,):
            raise LogError(f"table column {name!r} has shape {column.shape}, not ({count},)")
    return table


def _converted(column: NDArray[Any], dtype: str) -> NDArray[Any]:
    # An empty list has no kind of its own; everything else must not lose what it says.
    return column.astype(dtype, casting="same_kind" if column.size else "unsafe")


def event_columns(kind: str, t_ns: ArrayLike, vehicle: ArrayLike, **values: ArrayLike) -> Columns:
    """A table of events of one `kind`, sorted by (t_ns, vehicle); equal ones keep their order.

    Raises:
        LogError: an unknown kind, or columns as in `columns`.
    """
    if kind not in EVENT_COLUMNS:
        raise LogError(f"event kind {kind!r} is unknown: it must be one of {', '.join(EVENT_COLUMNS)}")
    spec = {"t_ns": "i8", "vehicle": "i8", **EVENT_COLUMNS[kind]}
    table = columns(spec, t_ns=t_ns, vehicle=vehicle, **values)
    order = np.lexsort((table["vehicle"], table["t_ns"]))
    return {name: column[order] for name, column in table.items()}


@dataclass
class MissionLog:
    """One mission: vehicles, their sensor events, transmission slots; separately, the truth."""

    name: str
    seed: int
    vehicles: tuple[str, ...]
    duration_ns: int
    link: Link
    events: dict[str, Columns] = field(default_factory=dict)
    slots: Columns = field(default_factory=dict)
    opportunities: Columns = field(default_factory=dict)
    receptions: Columns = field(default_factory=dict)
    payloads: list[bytes] = field(default_factory=list)
    """Bytes of each row of `receptions`."""
    polls: Columns = field(default_factory=dict)
    """Of two-way ranging; empty for one-way."""
    chart: Chart | None = None
    origin: Origin = field(default_factory=Origin)
    setup: MissionSetup = field(default_factory=MissionSetup)
    """What the log keeps of its scenario."""
    truth: DatasetWhenRead = DatasetWhenRead()  # noqa: RUF009 - a descriptor: xr.Dataset | None
    """dims (vehicle, time, axis): `position_m`, `depth_m`, `yaw_rad`, `current_mps`; `time` float64 s."""
    notes: tuple[str, ...] = ()
    """What was assumed, dropped or converted while the log was made, one sentence each."""
    epoch_ns: int | None = None
    """UTC of the mission's time 0, nanoseconds since 1970; None: not known, as of a simulation."""
    counterfactual: tuple[str, ...] = ()
    """In what this mission is not as it happened: "without V2", "acoustics.loss.probability=0.4"."""
    team_key: bytes | None = field(default=None, repr=False, compare=False)
    """Key of the packets' tags, in memory only: no file holds it."""

    @property
    def known_truth(self) -> Arrays | None:
        """The truth as it is held, for readers that need no Dataset."""
        held: Arrays | None = self.__dict__["truth"]
        return held

    def with_setup(self, setup: MissionSetup) -> MissionLog:
        """The same mission with another setup; what it holds is shared."""
        other = copy.copy(self)
        other.setup = setup
        return other

    def tables(self) -> Iterator[tuple[str, Columns]]:
        """Every table present, with its name: event kinds, then `slots`, `opportunities`, `receptions`, `polls`."""
        yield from self.events.items()
        for name in ("slots", "opportunities", "receptions", "polls"):
            if table := getattr(self, name):
                yield name, table

    def difference(self, other: MissionLog) -> str | None:
        """The first thing in which two logs differ, as one line; None when they are equal bit for bit.

        NaNs are equal when their bits are. Truth counts; what the chart is called does not.
        """
        for name in (
            "name",
            "seed",
            "vehicles",
            "duration_ns",
            "link",
            "origin",
            "setup",
            "notes",
            "epoch_ns",
            "counterfactual",
            "payloads",
        ):
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                return f"{name}: {mine!r} != {theirs!r}" if name != "payloads" else "payloads differ"
        mine_sha, their_sha = (log.chart.sha256 if log.chart is not None else None for log in (self, other))
        if mine_sha != their_sha:
            return f"chart: {mine_sha} != {their_sha}"
        ours, others = dict(self.tables()), dict(other.tables())
        if ours.keys() != others.keys():
            return f"tables: {sorted(ours)} != {sorted(others)}"
        for name, table in ours.items():
            if line := _difference(name, table, others[name]):
                return line
        return _difference("truth", _truth_arrays(self.truth), _truth_arrays(other.truth))


def _truth_arrays(truth: xr.Dataset | None) -> Columns:
    return {} if truth is None else {str(name): truth[name].to_numpy() for name in truth.variables}


def _difference(name: str, mine: Columns, theirs: Columns) -> str | None:
    """The first difference between two sets of arrays, bit for bit."""
    if mine.keys() != theirs.keys():
        return f"{name}: columns {sorted(mine)} != {sorted(theirs)}"
    for column, values in mine.items():
        others = theirs[column]
        if values.shape != others.shape or values.dtype.kind != others.dtype.kind:
            return f"{name}.{column}: {values.dtype} {values.shape} != {others.dtype} {others.shape}"
        bits = [
            np.ascontiguousarray(a).view(np.int64) if a.dtype == np.float64 else a for a in (values, others)
        ]
        unequal = np.argwhere(np.atleast_1d(bits[0] != bits[1]))
        if unequal.size:
            at = tuple(int(i) for i in unequal[0])
            return f"{name}.{column}{list(at)}: {values[at]!r} != {others[at]!r}"
    return None
