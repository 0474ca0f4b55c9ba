"""The watch's table: the last word of each node, and the alarms that stand."""

from __future__ import annotations

from rich.console import Console

from uwcoop.report.onboard_table import Watched

NAMES = ("V1", "V2", "V3")


def test_the_table_shows_position_sigma_last_heard_slots_and_alarms() -> None:
    watched = Watched(NAMES)
    estimate = {
        "type": "estimate", "vehicle": 0, "t_ns": 61_000_000_000, "mean_m": [120.04, -5.0], "status": "navigating",
        "covariance_m2": [9.0, 0.0, 0.0, 16.0], "heard_ns": {"1": 57_000_000_000}, "counts": {"sent": 7, "missed": 1},
    }  # fmt: skip
    watched.take("V1", estimate)
    watched.take(
        "V2", {**estimate, "mean_m": [None, None], "covariance_m2": [None] * 4, "status": "not started"}
    )
    watched.take("stranger", estimate)
    alarm = {"type": "diagnostic", "alarm": "depth silent", "raised": True, "text": "no depth since 40.000 s"}
    watched.take("V1", alarm)
    watched.take("V2", alarm)
    watched.take("V2", {**alarm, "raised": False})
    console = Console(width=140, record=True)
    console.print(watched.table())
    lines = {
        line.split()[1]: " ".join(line.split()) for line in console.export_text().splitlines() if "│" in line
    }
    assert lines["V1"].replace("│", "").split()[:11] == [
        "V1", "61", "120.0", "-5.0", "5.0", "navigating", "V2", "4", "s", "7", "1",
    ]  # fmt: skip
    assert "depth silent: no depth since 40.000 s" in lines["V1"]
    assert "not started" in lines["V2"]
    assert "silent" not in lines["V2"]
    assert "no word yet" in lines["V3"]
