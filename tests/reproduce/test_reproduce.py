"""`uwcoop reproduce`: manifests that can be flown, reports that say what holds, work that is not done twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from uwcoop import scenario
from uwcoop.errors import ScenarioError
from uwcoop.navigators import options_of
from uwcoop.reproduce import PAPERS, load_paper, reproduce, runner
from uwcoop.reproduce.manifest import Check, Figure, Flown, Paper
from uwcoop.reproduce.measures import MEASURES
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
    paper, outcomes = reproduce("small", tmp_path)
    assert [finding.holds for finding in outcomes[0].findings] == [True, False]
    assert (tmp_path / "small-fig-01.png").stat().st_size > 10_000
    write_report(paper, outcomes, tmp_path, quick=False)
    text = (tmp_path / "report.md").read_text()
    assert "1 of 2 statements hold" in text
    assert "Why not: RMS: it errs" in text
    assert "![a map]" in text
    assert "A &amp; B &lt;2000&gt;" in (tmp_path / "report.html").read_text()

    def refuse(*_: object) -> None:
        raise AssertionError("flown twice")

    monkeypatch.setattr(runner, "_fly", refuse)
    assert reproduce("small", tmp_path)[1] == outcomes
    (tmp_path / "small-fig-01.png").unlink()
    with pytest.raises(AssertionError, match="flown twice"):
        reproduce("small", tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("name", PAPERS)
def test_quick(name: str, tmp_path: Path) -> None:
    _, outcomes = reproduce(name, tmp_path, quick=True)
    assert all(outcome.picture for outcome in outcomes), [o.reason for o in outcomes if not o.picture]
    assert all(f.ours is not None for outcome in outcomes for f in outcome.findings)
