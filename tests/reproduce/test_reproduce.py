"""`uwcoop reproduce`: manifests that can be flown, reports that say what holds, work that is not done twice."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.errors import ScenarioError
from uwcoop.navigators import options_of
from uwcoop.reproduce import PAPERS, load_paper, reproduce, runner
from uwcoop.reproduce.manifest import Check, Figure, Flown, Paper
from uwcoop.reproduce.measures import MEASURES, measure
from uwcoop.reproduce.page import write_page
from uwcoop.reproduce.pictures import PICTURES
from uwcoop.reproduce.report import write_report
from uwcoop.scenario.setup import MissionSetup

FIGURES = {
    "tan2016": {f"fig-{k:02d}" for k in range(5, 20)},
    "matsuda2017": {f"fig-{k:02d}" for k in range(7, 18)} | {"table-4"},
    "walls2012": {"fig-03", "fig-04", "fig-05", "table-1"},
}


@pytest.mark.parametrize("name", PAPERS)
def test_manifest_names_what_there_is(name: str) -> None:
    paper = load_paper(name)
    assert {figure.id for figure in paper.figures} >= FIGURES[name]
    for flown in paper.missions.values():
        setup = MissionSetup.of(scenario.load(flown.scenario, flown.options))
        for navigator in flown.navigators:
            options_of(navigator, setup)
    for figure in paper.figures:
        assert set(figure.missions) <= set(paper.missions)
        flown = paper.missions[figure.flown]
        assert figure.picture in PICTURES
        assert set(figure.shows) <= set(flown.navigators)
        for check in figure.checks:
            assert check.measure in MEASURES
            assert check.least is not None or check.most is not None, check.text


def test_unknown_paper_is_one_line() -> None:
    with pytest.raises(
        ScenarioError, match="paper 'tan' is unknown: there are tan2016, matsuda2017, walls2012"
    ):
        load_paper("tan")


def small() -> Paper:
    checks = (
        Check(measure="rms_error", of={"navigator": "dmpf"}, text="RMS (m)", paper="small", most=1e6),
        Check(
            measure="rms_error", of={"navigator": "dmpf"}, text="RMS", paper="none", most=0.0, why="it errs"
        ),
    )
    figure = Figure(id="fig-01", title="a map", flown="one", picture="map", states="a fact", checks=checks)
    flown = Flown(
        kind="run", scenario="st-john", navigators=("dmpf", "dmpf@many"),
        options=("duration_s=60", "navigator.dmpf@many.particles=900"),
    )  # fmt: skip
    return Paper(
        name="small",
        short="small",
        cites="A & B <2000>",
        note="n",
        missions={"one": flown},
        figures=(figure,),
    )


def test_report_and_resume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "load_paper", lambda _: small())
    report = reproduce("small", tmp_path)
    assert [finding.holds for finding in report.outcomes[0].findings] == [True, False]
    assert (tmp_path / "small-fig-01.png").stat().st_size > 10_000
    assert report.seconds > 0
    write_report(report, tmp_path)
    text = (tmp_path / "report.md").read_text()
    assert "1 of 2 statements hold" in text
    assert "Why not: RMS: it errs." in text
    assert "![a map](small-fig-01.png)" in text
    assert "A &amp; B &lt;2000&gt;" in (tmp_path / "report.html").read_text()

    def refuse(*_: object) -> None:
        raise AssertionError("flown twice")

    monkeypatch.setattr(runner, "_fly", refuse)
    again = reproduce("small", tmp_path)
    assert (again.outcomes, again.seconds) == (report.outcomes, report.seconds)
    (tmp_path / "small-fig-01.png").unlink()
    with pytest.raises(AssertionError, match="flown twice"):
        reproduce("small", tmp_path)


def compared() -> Paper:
    """A figure of one study, one of its numbers taken against another study."""
    flown = Flown(
        scenario="st-john-current", navigators=("dead-reckoning",), options=("duration_s=60",), runs=3, quick_runs=2,
        vary={"current.speed_mps": [0.0, 0.5]},
    )  # fmt: skip
    still = flown.model_copy(update={"vary": {}, "options": (*flown.options, "current.speed_mps=0")})
    check = Check(
        measure="vehicles_rmse", of={"navigator": "dead-reckoning", "vehicles": ["V1"]}, text="RMS",
        paper="more", flown="many", against="still", least=1.5,
    )  # fmt: skip
    figure = Figure(
        id="section-7", title="a comparison", flown="still", picture="boxes", states="a fact", checks=(check,)
    )
    missions = {"many": flown, "still": still}
    return Paper(name="small", short="small", cites="A", note="n", missions=missions, figures=(figure,))


def test_studies_compared_tables_and_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "load_paper", lambda _: compared())
    told: list[tuple[int, int]] = []
    report = reproduce(
        "small", tmp_path / "out", runs=2, progress=lambda _, done, of: told.append((done, of))
    )
    (finding,) = report.outcomes[0].findings
    assert finding.ours is not None
    assert finding.ours > 1.5
    assert finding.holds
    assert told == sorted(told)
    assert told[-1] == (6, 6)
    pages = write_page(report, tmp_path / "out", tmp_path / "docs")
    assert pages == ["results/small.md", "images/small-section-7.png"]
    text = (tmp_path / "docs" / "results" / "small.md").read_text()
    assert "## Section 7: a comparison" in text
    assert "(../images/small-section-7.png)" in text
    assert "At most 2 runs of each study." in text
    assert "uwcoop study st-john-current -n dead-reckoning --runs 2 --vary current.speed_mps=0.0,0.5" in text
    assert "| current.speed_mps | navigator | final error, median (m) |" in text
    small, whole = tmp_path / "docs" / pages[1], tmp_path / "out" / "small-section-7.png"
    assert whole.stat().st_size > small.stat().st_size > 5_000


def test_interval_of_a_ratio_needs_more_than_luck() -> None:
    rng = np.random.default_rng(1)

    def study(factor: float, runs: int) -> SimpleNamespace:
        rows = [
            {"navigator": name, "seed": seed, "vehicle": vehicle, "rmse_m": scale * rng.lognormal(0.0, 0.5)}
            for name, scale in (("one", 1.0), ("two", factor))
            for seed in range(runs)
            for vehicle in ("V1", "V2")
        ]
        return SimpleNamespace(rows=rows)

    asked = {"navigator": "two", "to": "one", "column": "rmse_m"}
    assert measure("ratio_high", study(0.5, 40), asked) < 1
    assert measure("ratio_high", study(0.95, 5), asked) > 1
    assert measure("ratio_high", study(1.2, 40), asked) > 1.2


def test_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="runs is 0: must be at least 1"):
        reproduce("walls2012", tmp_path, runs=0)


def test_quick_walls(tmp_path: Path) -> None:
    drawn_and_measured("walls2012", tmp_path)


def drawn_and_measured(name: str, folder: Path) -> None:
    outcomes = reproduce(name, folder, quick=True).outcomes
    assert all(outcome.picture for outcome in outcomes), [o.reason for o in outcomes if not o.picture]
    assert all(f.ours is not None for outcome in outcomes for f in outcome.findings)


@pytest.mark.long
@pytest.mark.parametrize("name", ["tan2016", "matsuda2017"])
def test_quick(name: str, tmp_path: Path) -> None:
    drawn_and_measured(name, tmp_path)
