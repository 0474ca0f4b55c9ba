"""A study's report and Parquet table: whole, alone, true to the rows; and what flies a bad mission again."""

from __future__ import annotations

import html
import json
import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop.evaluation.metrics import row_columns
from uwcoop.experiment.study import StudyResult
from uwcoop.report.study_report import nees_shares, running_mean, worst_missions
from uwcoop.report.svg import number

SHORT = ("duration_s=90", "navigator.all.particles=100")
LOSS = "acoustics.loss.probability"
VOID = {"meta", "line", "path", "rect", "circle", "polygon", "polyline", "br"}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[StudyResult, Path]:
    out = tmp_path_factory.mktemp("study") / "out"
    navigators = ["dead-reckoning", "mpf"]
    return uwcoop.study(
        "flat-bay", 6, navigators, {LOSS: [0.0, 0.5]}, overrides=SHORT, out=out, processes=1
    ), out


class Page(HTMLParser):
    """Checks that what is opened is closed, and collects texts and addresses."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [
            value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")
        ]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def page_of(out: Path) -> tuple[Page, str]:
    page, text = Page(), (out / "report.html").read_text(encoding="utf-8")
    page.feed(text)
    assert page.open == []
    return page, text


def test_the_report_stands_alone_and_shows_every_part(done: tuple[StudyResult, Path]) -> None:
    result, out = done
    assert result.files == ("summary.json", "runs.csv", "study.json", "runs.parquet", "report.html")
    page, text = page_of(out)
    assert page.addresses == []
    assert not re.search(r"https?://|url\(|<script|@import", text)
    for heading in ("The world", "Accuracy and consistency", "Errors over the missions", "NEES at the end",
                    "Convergence", "What the error depends on", "Worst missions", "Provenance"):  # fmt: skip
        assert any(heading in part for part in page.texts), heading
    assert text.count("<svg") == 2 + 1 + 2 + 1, "boxes twice, one key, NEES of two navigators, convergence"
    assert f"uwcoop {uwcoop.__version__}" in text
    assert "nan" not in re.sub(r"<pre>.*?</pre>", "", text, flags=re.DOTALL).lower().replace("provenance", "")


def test_the_reports_figures_are_the_summarys(done: tuple[StudyResult, Path]) -> None:
    result, out = done
    _, text = page_of(out)
    for variant in result.summary["variants"]:
        assert f"{LOSS} = {variant['set'][LOSS]}" in text
        for name, pooled in variant["navigators"].items():
            low, high = variant["intervals"][name]["rmse_m"]
            assert low <= pooled["rmse_m"] <= high
            shown = f"<td>{number(pooled['rmse_m'])}<small>{number(low)} to {number(high)}</small></td>"
            assert shown in text
        assert variant["paired"]["mpf"]["reference"] == "dead-reckoning"


def test_the_command_of_the_worst_mission_flies_it_again(
    done: tuple[StudyResult, Path], tmp_path: Path
) -> None:
    result, out = done
    page, _ = page_of(out)
    shown = "".join(page.texts)
    worst = worst_missions([r for r in result.rows if r["navigator"] == "mpf"], [LOSS], 3)
    assert worst[0]["rmse_m"] == max(r["rmse_m"] for r in result.rows if r["navigator"] == "mpf")
    command = (
        f"uwcoop run flat-bay -n mpf --seed {worst[0]['seed']} --set duration_s=90 --set navigator.all.particles=100 "
        f"--set {LOSS}={worst[0][LOSS]}"
    )
    assert command in " ".join(shown.split())
    ended = subprocess.run(
        [sys.executable, "-m", *shlex.split(command), "--json"], capture_output=True, text=True, check=True
    )
    vehicles = json.loads(ended.stdout)["navigators"]["mpf"]["vehicles"]
    assert vehicles[worst[0]["vehicle"]]["rmse_m"] == worst[0]["rmse_m"]


def test_a_mission_in_any_world_is_flown_again_by_its_command(tmp_path: Path) -> None:
    """Worlds set tables, scale numbers and tell navigators what is not so: all of it stands in the command."""
    result = uwcoop.study(
        "flat-bay", 1, ["mpf"], overrides=SHORT, worlds="faults", out=tmp_path / "out", processes=1
    )
    assert len(result.summary["variants"]) > 8
    _, text = page_of(tmp_path / "out")
    shown = html.unescape(re.sub(r"</?span>", "", text))
    commands = [shlex.split(line) for line in re.findall(r"<code>(uwcoop run .*?)</code>", shown)]
    worst = worst_missions(result.rows, ["world"], 3)
    assert len(commands) == len(worst)
    for command, row in zip(commands, worst, strict=True):
        overrides = [command[k + 1] for k, part in enumerate(command) if part == "--set"]
        again = uwcoop.run(command[2], ["mpf"], seed=row["seed"], overrides=overrides, clouds=False)
        assert again.summary["navigators"]["mpf"]["vehicles"][row["vehicle"]]["rmse_m"] == row["rmse_m"]


def test_the_parquet_table_holds_the_rows_of_the_csv(done: tuple[StudyResult, Path]) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    result, out = done
    table = parquet.read_table(out / "runs.parquet")
    assert table.column_names == [LOSS, *row_columns()]
    rows = table.to_pylist()
    assert [{**row, LOSS: float(row[LOSS])} for row in rows] == result.rows
    assert str(table.schema.field("seed").type) == "int64"
    assert str(table.schema.field("rmse_m").type) == "double"


def test_what_is_named_wickedly_is_shown_as_text(tmp_path: Path) -> None:
    from uwcoop.scenario import load

    scenario = load("flat-bay", ('description="<script>alert(1)</script>"', *SHORT))
    result = uwcoop.study(scenario, 1, ["dead-reckoning"], out=tmp_path / "out", processes=1)
    page, text = page_of(tmp_path / "out")
    assert "<script" not in text
    assert any("<script>alert(1)</script>" in part for part in page.texts)
    seed = result.rows[0]["seed"]
    assert f"uwcoop.run(scenario, ['dead-reckoning'], seed={seed})" in "".join(page.texts)


def test_reports_of_half_a_study_go_away_when_it_goes_on(
    done: tuple[StudyResult, Path], tmp_path: Path
) -> None:
    again = tmp_path / "again"
    again.mkdir()
    for file in done[1].iterdir():
        (again / file.name).write_bytes(file.read_bytes())

    seen: list[bool] = []

    def look(now: int, _of: int) -> None:
        if now > 12:
            seen.extend((again / name).exists() for name in ("report.html", "runs.parquet", "summary.json"))

    uwcoop.study(
        "flat-bay", 7, ["dead-reckoning", "mpf"], {LOSS: [0.0, 0.5]}, overrides=SHORT, out=again,
        resume=True, processes=1, progress=look,
    )  # fmt: skip
    assert seen
    assert not any(seen)
    assert (again / "report.html").exists()


def test_nees_of_a_consistent_navigator_fills_its_bins_equally() -> None:
    values = np.random.default_rng(0).chisquare(2, 5000)
    shares, (low, high) = nees_shares(values)
    assert sum(shares) == pytest.approx(1)
    assert sum(low <= share <= high for share in shares) >= 9
    over, _ = nees_shares(4 * values)
    assert over[-1] > 0.4
    infinite, _ = nees_shares(np.array([np.inf, 0.0]))
    assert (infinite[0], infinite[-1]) == (0.5, 0.5)


def test_the_running_mean_and_its_band() -> None:
    values = np.random.default_rng(1).exponential(3.0, 400)
    mean, low, high = running_mean(values)
    assert mean[99] == pytest.approx(values[:100].mean())
    assert high[99] - mean[99] == pytest.approx(1.96 * values[:100].std(ddof=1) / 10)
    assert np.isnan(low[0])
    assert low[-1] < 3.0 < high[-1]


def test_without_pyarrow_the_table_is_left_out_with_a_note(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    missing: dict[str, Any] = {"pyarrow": None}
    monkeypatch.setitem(sys.modules, "pyarrow", missing["pyarrow"])
    result = uwcoop.study(
        "flat-bay", 1, ["dead-reckoning"], overrides=SHORT, out=tmp_path / "out", processes=1
    )
    assert result.notes == (
        'runs.parquet is left out: pyarrow is not installed: pip install "uwcoop[parquet]"',
    )
    assert "runs.parquet" not in result.files
    assert (tmp_path / "out" / "report.html").exists()
