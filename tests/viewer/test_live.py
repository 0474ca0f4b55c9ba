"""The live view: what nodes say becomes entities of a recording, read back."""

from __future__ import annotations

import numpy as np
import pytest

from onboard_dive import SECOND_NS, scenario
from uwcoop.onboard.vehicle import empty_mission
from uwcoop.viewer.live import LiveView

pytest.importorskip("rerun", reason="rerun-sdk is not installed")
pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read recordings back")

import rerun as rr
from rerun import chunk as chunks

NAMES = ("V1", "V 2")


def estimate(vehicle: int, t_s: int, east_m: float | None, variance_m2: float | None = 4.0):
    covariance = [None] * 4 if variance_m2 is None else [variance_m2, 0.0, 0.0, variance_m2]
    mean = [None, None] if east_m is None else [east_m, 10.0]
    return {
        "type": "estimate",
        "vehicle": vehicle,
        "t_ns": t_s * SECOND_NS,
        "mean_m": mean,
        "covariance_m2": covariance,
    }


def test_what_nodes_say_is_drawn(tmp_path) -> None:
    path = tmp_path / "live.rrd"
    strict = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        recording = rr.RecordingStream("uwcoop-watch")
        recording.save(path)
        view = LiveView(recording, NAMES, [2.0, 3.0], empty_mission(scenario()).chart)
        view.take("V1", estimate(0, 0, None, None))
        for t_s in range(5):
            view.take("V1", estimate(0, t_s, 3.0 * t_s))
            view.take("V 2", estimate(1, t_s, 100.0 - t_s))
        view.take("V1", estimate(0, 3, 999.0))  # of an earlier time
        view.take("stranger", estimate(0, 9, 1.0))
        alarm = {
            "type": "diagnostic",
            "alarm": "depth silent",
            "raised": True,
            "text": "no depth since 0.5 s",
        }
        view.take("V1", {**alarm, "t_ns": 4 * SECOND_NS})
        recording.flush()
        recording.disconnect()
    finally:
        rr.set_strict_mode(strict)
    columns: dict[str, list] = {}
    for chunk in chunks.RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            columns.setdefault(f"{chunk.entity_path}:{name}", []).extend(batch.column(name).to_pylist())
    moved = next(v for k, v in columns.items() if "nodes/V1/body:" in k and "translation" in k)
    np.testing.assert_allclose([row[0] for row in moved], [[3.0 * t, 10.0, -2.0] for t in range(5)])
    sigma = next(v for k, v in columns.items() if "sigma_m/V1" in k and "scalars" in k)
    np.testing.assert_allclose([row[0] for row in sigma], [np.sqrt(8.0)] * 5)
    text = next(v for k, v in columns.items() if "alarms" in k and "text" in k)
    assert text == [["V1: depth silent: no depth since 0.5 s"]]
    assert any("chart" in key for key in columns)
    assert len(next(v for k, v in columns.items() if "nodes/V1/trail" in k and "strips" in k)) == 4
