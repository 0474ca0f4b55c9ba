"""The mission log in memory; `sample_log` is the seeded log that the other missionlog tests use."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from uwcoop.charts import Chart
from uwcoop.errors import LogError
from uwcoop.missionlog import (
    EVENT_COLUMNS,
    OPPORTUNITY_COLUMNS,
    RECEPTION_COLUMNS,
    SLOT_COLUMNS,
    Columns,
    Link,
    MissionLog,
    Origin,
    columns,
    event_columns,
)

FRAMES = 3


def sample_chart(seed: int = 0) -> Chart:
    rng = np.random.default_rng(seed)
    return Chart(
        depth_m=rng.uniform(5, 30, (12, 17)).astype(np.float32),
        east0_m=-3.5,
        north0_m=2.0,
        cell_m=10.0,
        name="box",
    )


def sample_log(seconds: int = 40, vehicles: int = 3, seed: int = 1, chart: Chart | None = None) -> MissionLog:
    """A log with every kind of event, slots, opportunities, receptions, truth and a chart."""
    rng = np.random.default_rng(seed)
    names = tuple(f"V{i + 1}" for i in range(vehicles))
    slots, opportunities = _acoustics(rng, seconds, vehicles)
    receptions = columns(
        RECEPTION_COLUMNS,
        t_ns=opportunities["toa_ns"] + 123_456_789,
        **{name: opportunities[name] for name in ("receiver", "sender", "tol_ns", "toa_ns")},
    )
    order = np.lexsort((receptions["receiver"], receptions["t_ns"]))
    return MissionLog(
        name="sample",
        seed=2**80 + seed,
        vehicles=names,
        duration_ns=(seconds + 5) * 1_000_000_000,
        link=Link("box", 32, FRAMES, 0.1, 1 / 3, 1500.1),
        events={kind: _events(kind, rng, seconds, vehicles) for kind in EVENT_COLUMNS},
        slots=slots,
        opportunities=opportunities,
        receptions={name: column[order] for name, column in receptions.items()},
        payloads=[rng.bytes(int(rng.integers(0, 20))) for _ in order],
        chart=sample_chart() if chart is None else chart,
        origin=Origin(1.2203, 103.8507, "EPSG:32648"),
        scenario={"name": "sample", "sensors": {"altimeter": {"sigma_m": 0.1}}, "list": [1, 2.5, None]},
        truth=_truth(rng, seconds, names),
    )


def _events(kind: str, rng: np.random.Generator, seconds: int, vehicles: int) -> Columns:
    t_ns = np.repeat(np.arange(seconds) * 1_000_000_000, vehicles) + (0 if kind == "motion" else 7)
    vehicle = np.tile(np.arange(vehicles), seconds)
    count = t_ns.size
    values: dict[str, Any] = {}
    for name, dtype in EVENT_COLUMNS[kind].items():
        values[name] = rng.random(count) < 0.5 if dtype == "bool" else rng.uniform(0.1, 3.0, count)
    if kind == "fix":
        values |= {
            "cov_ee_m2": np.full(count, 25.0),
            "cov_en_m2": np.full(count, -3.1),
            "cov_nn_m2": np.full(count, 24.0),
        }
    if kind == "odometry":
        root = rng.normal(size=(count, 3, 3))
        covariance = root @ root.transpose(0, 2, 1)
        for name, (i, j) in zip(
            ("ff", "fl", "fy", "ll", "ly", "yy"), zip(*np.triu_indices(3), strict=True), strict=True
        ):
            values[f"cov_{name}"] = covariance[:, i, j]
    if kind == "acoustic_fix":
        values["peer"] = (vehicle + 1) % vehicles
        values["transmit_ns"] = np.maximum(t_ns - 400_000_001, 0)
        values["range_m"][::3] = np.nan
        values["own_bearing_rad"] -= 2.0
    return event_columns(kind, t_ns=t_ns, vehicle=vehicle, **values)


def _acoustics(rng: np.random.Generator, seconds: int, vehicles: int) -> tuple[Columns, Columns]:
    tol = np.arange(1, seconds, 4) * 1_000_000_000 + 17
    sender = np.arange(tol.size) % vehicles
    slots = columns(SLOT_COLUMNS, tol_ns=tol, sender=sender, capacity_bytes=np.full(tol.size, 64))
    rows = [(t, s, r) for t, s in zip(tol, sender, strict=True) for r in range(vehicles) if r != s]
    t, s, r = (np.array(column, dtype=np.int64) for column in zip(*rows, strict=True))
    table = columns(
        OPPORTUNITY_COLUMNS,
        tol_ns=t,
        sender=s,
        receiver=r,
        toa_ns=t + rng.integers(10**7, 3 * 10**8, t.size),
        survive_probability=rng.random(t.size),
    )
    return slots, {**table, "draws": rng.random((t.size, FRAMES))}


def _truth(rng: np.random.Generator, seconds: int, names: tuple[str, ...]) -> xr.Dataset:
    shape = (len(names), seconds)
    return xr.Dataset(
        {
            "position_m": (("vehicle", "time", "axis"), rng.normal(size=(*shape, 2)), {"units": "m"}),
            "depth_m": (("vehicle", "time"), rng.uniform(0, 5, shape)),
            "yaw_rad": (("vehicle", "time"), rng.uniform(-3, 3, shape)),
            "current_mps": (("vehicle", "time", "axis"), rng.normal(size=(*shape, 2))),
        },
        coords={
            "vehicle": list(names),
            "time": np.arange(seconds, dtype=np.float64),
            "axis": ["east", "north"],
        },
        attrs={"title": "sample"},
    )


def test_a_log_differs_from_another_by_a_single_bit() -> None:
    log = sample_log(seconds=5)
    assert log.difference(sample_log(seconds=5)) is None
    other = sample_log(seconds=5)
    depth = other.events["depth"]["depth_m"]
    depth[3] = np.nextafter(depth[3], 9.0)
    assert (log.difference(other) or "").startswith("depth.depth_m[3]: ")
    assert log.difference(sample_log(seconds=5, chart=sample_chart(seed=9))) is not None
    del other.events["fix"]
    assert "tables" in (log.difference(other) or "")


def test_zero_and_minus_zero_differ_and_a_nan_equals_itself() -> None:
    log, other = sample_log(seconds=5), sample_log(seconds=5)
    for one in (log, other):
        one.events["acoustic_fix"]["range_m"][0] = np.nan
    log.events["depth"]["depth_m"][0], other.events["depth"]["depth_m"][0] = 0.0, -0.0
    assert log.difference(other) == "depth.depth_m[0]: np.float64(0.0) != np.float64(-0.0)"


def test_events_are_sorted_and_equal_ones_keep_their_order() -> None:
    table = event_columns(
        "depth", t_ns=[5, 3, 5, 5], vehicle=[1, 0, 0, 1], depth_m=[1.0, 2.0, 3.0, 4.0], sigma_m=np.zeros(4)
    )
    assert table["depth_m"].tolist() == [2.0, 3.0, 1.0, 4.0]
    assert {name: column.dtype.str[1:] for name, column in table.items()} == {
        "t_ns": "i8", "vehicle": "i8", "depth_m": "f8", "sigma_m": "f8",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"t_ns": [1], "vehicle": [0], "depth_m": [1.0]}, "no column 'sigma_m'"),
        ({"t_ns": [1], "vehicle": [0], "depth_m": [1.0], "sigma_m": [0.0], "x": [1]}, "unknown column 'x'"),
        ({"t_ns": [1], "vehicle": [0], "depth_m": [1.0, 2.0], "sigma_m": [0.0]}, "has shape (2,), not (1,)"),
        ({"t_ns": [1.5], "vehicle": [0], "depth_m": [1.0], "sigma_m": [0.0]}, "cannot be converted"),
    ],
)
def test_a_table_that_does_not_fit_its_kind_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(LogError, match="column") as refusal:
        event_columns("depth", **values)
    assert message in str(refusal.value)
    with pytest.raises(LogError, match="event kind 'sonar' is unknown"):
        event_columns("sonar", t_ns=[], vehicle=[])
