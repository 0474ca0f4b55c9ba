"""A seeded log with every kind of event, and the records of a log rewritten as another tool would."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from uwcoop.charts import Chart
from uwcoop.frames import Origin
from uwcoop.missionlog import (
    EVENT_COLUMNS,
    OPPORTUNITY_COLUMNS,
    RECEPTION_COLUMNS,
    SLOT_COLUMNS,
    Columns,
    Link,
    MissionLog,
    columns,
    event_columns,
)
from uwcoop.scenario import MissionSetup

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
        setup=MissionSetup.parse(
            {"name": "sample", "sensors": {"altimeter": {"sigma_m": 0.1}}, "list": [1, 2.5, None]}
        ),
        truth=_truth(rng, seconds, names),
    )


def _events(kind: str, rng: np.random.Generator, seconds: int, vehicles: int) -> Columns:
    t_ns = np.repeat(np.arange(seconds) * 1_000_000_000, vehicles) + (0 if kind == "motion" else 7)
    vehicle = np.tile(np.arange(vehicles), seconds)
    count = t_ns.size
    values: dict[str, Any] = {}
    for name, dtype in EVENT_COLUMNS[kind].items():
        values[name] = rng.random(count) < 0.5 if dtype == "bool" else rng.uniform(0.1, 3.0, count)
    if kind in ("beacon_range", "usbl"):
        values["measured_ns"] = np.maximum(t_ns - 300_000_001, 0)
    if kind in ("fix", "usbl"):
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


def rewrite(
    content: bytes,
    change: Callable[[list[McapRecord]], list[McapRecord]] = list,
    compression: CompressionType = CompressionType.NONE,
    use_chunking: bool = True,
) -> bytes:
    """The same records as another tool would write them, without CRCs, after a change."""
    out = io.BytesIO()
    writer = Writer(out, compression=compression, use_chunking=use_chunking, enable_crcs=False)
    writer.start("ros2", "another tool")
    ids: dict[tuple[str, int], int] = {}
    for record in change(list(StreamReader(io.BytesIO(content)).records)):
        if isinstance(record, Schema) and ("schema", record.id) not in ids:
            ids["schema", record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and ("channel", record.id) not in ids:
            schema = ids["schema", record.schema_id]
            ids["channel", record.id] = writer.register_channel(
                record.topic, record.message_encoding, schema, record.metadata
            )
        elif isinstance(record, Message):
            channel = ids["channel", record.channel_id]
            writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            writer.add_attachment(0, 0, record.name, record.media_type, record.data)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()
