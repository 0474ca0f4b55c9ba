"""`uwcoop reproduce`: a paper's figures beside what the paper says of them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from uwcoop.cli.terminal import progress, say, say_written


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="tan2016, matsuda2017 or walls2012.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Few missions, minutes in place of hours: a first look.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder; else uwcoop-PAPER.")
    ] = None,
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="At most so many runs of each study.")
    ] = None,
    docs: Annotated[
        Path | None,
        typer.Option(
            "--docs", metavar="DIR", help="Also write results/PAPER.md and images/ of a documentation."
        ),
    ] = None,
) -> None:
    """Fly what a paper's figures show: pictures and a report of what holds. Continues where it was cut off."""
    from uwcoop.reproduce import reproduce as fly
    from uwcoop.reproduce.page import write_page
    from uwcoop.reproduce.report import write_report

    folder = output or Path(f"uwcoop-{paper}")
    began = time.monotonic()

    with progress(paper, None) as step:

        def told(text: str, done: int, of: int) -> None:
            left_s = (time.monotonic() - began) / done * (of - done) if done else None
            left = "" if left_s is None else f", about {max(1.0, left_s / 60):.0f} min left"
            step(f"{text}, mission {done} of {of}{left}", done, of)

        report = fly(paper, folder, quick=quick, runs=runs, progress=told)
    files = write_report(report, folder)
    for outcome in report.outcomes:
        for finding in outcome.findings:
            held = "holds" if finding.holds else "DOES NOT HOLD"
            ours = "-" if finding.ours is None else f"{finding.ours:.3g}"
            typer.echo(f"{outcome.id}: {finding.text}: {ours} (the paper: {finding.paper}): {held}")
        if outcome.picture is None:
            say(f"{outcome.id} is not drawn: {outcome.reason}")
    say_written([*files, *(outcome.picture for outcome in report.outcomes if outcome.picture)], folder)
    if docs is not None:
        say_written(write_page(report, folder, docs), docs)
