"""The registry of metrics: one entry is a column everywhere."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import uwcoop
from fake_mission import mission
from uwcoop.evaluation import metrics, pooling
from uwcoop.evaluation.metrics import METRICS, Column, Metric, Pooled
from uwcoop.report.result_tables import study_table, summary_table


@pytest.fixture
def worst_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """A metric that is in no source: the largest error, and the largest of all runs."""
    entry = Metric(
        "m",
        "largest distance from truth",
        lambda run: float(run.error_m.max()) if run.error_m.size else None,
        column=Column("worst\n(m)"),
        pooled=(
            Pooled("worst_error_m", pooling.largest, "largest of all runs", Column("worst\nof all\n(m)")),
        ),
    )
    monkeypatch.setitem(METRICS, "worst_error_m", entry)


def shown(table: Any) -> str:
    console = Console(width=120, file=io.StringIO(), record=True)
    console.print(table)
    return console.export_text()


@pytest.mark.usefixtures("worst_error")
def test_one_entry_is_in_rows_summary_table_and_documentation(hooks: Any) -> None:
    m = mission(duration_s=120)
    error_m = metrics.errors(m.tracks).sel(time=range(51, 121))
    rows = metrics.rows(m.tracks, seconds=m.seconds, packets=m.packets)
    assert list(rows[0]) == list(metrics.row_columns())
    summary = metrics.summarise(m.tracks, seconds=m.seconds, packets=m.packets)
    for row in rows:
        largest = float(error_m.sel(navigator=row["navigator"], vehicle=row["vehicle"]).max())
        assert row["worst_error_m"] == pytest.approx(largest)
        vehicles = summary["navigators"][row["navigator"]]["vehicles"]
        assert vehicles[row["vehicle"]]["worst_error_m"] == row["worst_error_m"]
    assert "worst" in shown(summary_table(summary, settle_s=50))
    assert "| `worst_error_m` | m | largest distance from truth |" in hooks.metrics_of_a_run()
    assert "| `worst_error_m` | `worst_error_m` | largest of all runs |" in hooks.metrics_of_a_study()


@pytest.mark.usefixtures("worst_error")
def test_one_entry_is_in_a_studys_csv_summary_and_table_and_is_resumed(tmp_path: Path) -> None:
    def flown(runs: int, *, resume: bool) -> Any:
        return uwcoop.study(
            "flat-bay", runs, ["dead-reckoning"], out=tmp_path / "study", processes=1, resume=resume,
            overrides=["duration_s=60", "metrics.settle_s=20"],
        )  # fmt: skip

    flown(1, resume=False)
    result = flown(2, resume=True)
    with (tmp_path / "study" / "runs.csv").open(newline="") as file:
        column = [float(line["worst_error_m"]) for line in csv.DictReader(file)]
    assert len(column) == 2 * 3
    pooled = result.summary["variants"][0]["navigators"]["dead-reckoning"]["worst_error_m"]
    assert pooled == max(column)
    assert json.loads((tmp_path / "study" / "summary.json").read_text()) == result.summary
    assert "worst" in shown(study_table(result.summary, settle_s=20))


def test_every_entry_says_what_it_is() -> None:
    assert len(METRICS) > 15
    for key, metric in METRICS.items():
        assert metric.text, key
        assert metric.unit, key
        assert metric.text[0].islower() or metric.text[:2].isupper() or metric.text[0].isdigit(), key
        ending = re.search(r"_(m|deg)$", key)
        if ending:
            assert metric.unit == {"m": "m", "deg": "°"}[ending[1]], key
    keys = [pooled.key for pooled in metrics.pooled_metrics()]
    assert len(set(keys)) == len(keys)
