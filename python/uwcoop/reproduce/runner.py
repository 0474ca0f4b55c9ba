"""Flies what a paper's figures need, draws them, and judges each statement; what is done is not done again."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from uwcoop.errors import TracksError, UwcoopError
from uwcoop.reproduce.manifest import Check, Figure, Flown, Paper, load_paper
from uwcoop.reproduce.measures import measure
from uwcoop.reproduce.pictures import draw

__all__ = ["Finding", "Outcome", "reproduce"]

Progress = Callable[[str, int, int], None]
REPEATS = 3
"""A cost is the least of so many."""


@dataclass(frozen=True)
class Finding:
    """One check: the number, and whether it lies where the paper's statement wants it."""

    text: str
    paper: str
    ours: float | None
    bounds: str
    holds: bool
    why: str


@dataclass(frozen=True)
class Outcome:
    """One figure: its picture (None: why not drawn) and its findings."""

    id: str
    title: str
    states: str
    command: str
    picture: str | None
    reason: str
    note: str
    findings: list[Finding]

    @property
    def holds(self) -> bool:
        """Whether every finding does."""
        return all(finding.holds for finding in self.findings)


def reproduce(
    name: str, out: Path, *, quick: bool = False, progress: Progress | None = None
) -> tuple[Paper, list[Outcome]]:
    """Every figure of a paper: pictures in `out`, with what was flown under `out/missions`.

    Figures that an earlier call finished with the same program and manifest are taken from `out/done.json`; studies
    go on where they were cut off.

    Args:
        name: of `uwcoop.reproduce.PAPERS`.
        out: folder, made if need be.
        quick: few missions, for a first look.
        progress: called with what is being done, figures done, and figures in all.

    Raises:
        UwcoopError: one line; what was finished stays.
    """
    paper = load_paper(name)
    out.mkdir(parents=True, exist_ok=True)
    done = _Done(out / "done.json", paper, quick)
    flown: dict[str, Any] = {}
    outcomes = []
    for k, figure in enumerate(paper.figures):
        if progress:
            progress(f"{figure.id}: {figure.title}", k, len(paper.figures))
        known = done.get(figure)
        if known is None:
            if figure.flown not in flown:
                flown = {
                    figure.flown: _fly(paper.missions[figure.flown], out / "missions" / figure.flown, quick)
                }
            known = _outcome(paper, figure, flown[figure.flown], out, quick)
            done.add(known)
        outcomes.append(known)
    if progress:
        progress("done", len(paper.figures), len(paper.figures))
    return paper, outcomes


class _Done:
    """Finished figures on disk, as long as program and manifest are the same."""

    def __init__(self, path: Path, paper: Paper, quick: bool) -> None:
        content = json.dumps([version("uwcoop"), paper.model_dump(mode="json"), quick], sort_keys=True)
        self._path, self._digest = path, hashlib.sha256(content.encode()).hexdigest()
        self._figures: dict[str, dict[str, Any]] = {}
        if path.is_file():
            try:
                kept = json.loads(path.read_text(encoding="utf-8"))
            except ValueError:
                kept = {}
            if kept.get("digest") == self._digest:
                self._figures = kept["figures"]

    def get(self, figure: Figure) -> Outcome | None:
        kept = self._figures.get(figure.id)
        if kept is None or (kept["picture"] and not (self._path.parent / kept["picture"]).is_file()):
            return None
        return Outcome(**{**kept, "findings": [Finding(**one) for one in kept["findings"]]})

    def add(self, outcome: Outcome) -> None:
        from uwcoop.report.atomic_files import atomic_write

        self._figures[outcome.id] = asdict(outcome)
        with atomic_write(self._path) as partial:
            text = json.dumps({"digest": self._digest, "figures": self._figures}, indent=1)
            partial.write_text(text + "\n", encoding="utf-8")


def _fly(flown: Flown, folder: Path, quick: bool) -> Any:
    options = [*flown.options, *(flown.quick_options if quick else ())]
    if flown.kind == "cost":
        from uwcoop.reproduce.cost import cost

        return cost(
            flown.scenario,
            (flown.quick_particles if quick else ()) or flown.particles,
            1 if quick else REPEATS,
        )
    if flown.kind == "run":
        from uwcoop.experiment.run import run

        return run(
            flown.scenario,
            flown.navigators,
            seed=flown.seed,
            overrides=options,
            clouds=flown.clouds,
            threads=0,
        )
    from uwcoop.experiment.study import study

    return study(
        flown.scenario,
        flown.quick_runs if quick else flown.runs,
        flown.navigators,
        flown.vary,
        out=folder,
        resume=True,
        overrides=options,
        first_seed=flown.seed,
        keep_errors=flown.keep_errors,
    )


def _outcome(paper: Paper, figure: Figure, flown: Any, out: Path, quick: bool) -> Outcome:
    picture, reason = f"{paper.short}-{figure.id}.png", ""
    try:
        drawn = draw(figure.picture, flown, figure.shows)
    except TracksError as refused:
        picture, reason = "", str(refused)
    else:
        from uwcoop.report.atomic_files import atomic_write

        with atomic_write(out / picture) as partial:
            drawn.savefig(partial)
    findings = [_finding(check, flown) for check in figure.checks]
    command = command_of(paper.missions[figure.flown], quick)
    return Outcome(
        figure.id, figure.title, figure.states, command, picture or None, reason, figure.note, findings
    )


def _finding(check: Check, flown: Any) -> Finding:
    reason = check.why
    try:
        value = measure(check.measure, flown, dict(check.of))
    except (UwcoopError, KeyError, ValueError, StopIteration) as refused:
        value, reason = math.nan, f"not measured: {refused}"
    low = -math.inf if check.least is None else check.least
    high = math.inf if check.most is None else check.most
    holds = low <= value <= high
    return Finding(
        check.text,
        check.paper,
        value if math.isfinite(value) else None,
        _bounds(check),
        holds,
        "" if holds else reason,
    )


def _bounds(check: Check) -> str:
    if check.least is not None and check.most is not None:
        return f"{check.least:g} to {check.most:g}"
    if check.most is not None:
        return f"at most {check.most:g}"
    return f"at least {check.least:g}" if check.least is not None else "-"


def command_of(flown: Flown, quick: bool) -> str:
    """The command that flies the same missions by itself."""
    from shlex import join

    if flown.kind == "cost":
        return "uwcoop reproduce matsuda2017"
    options = [*flown.options, *(flown.quick_options if quick else ())]
    words = ["uwcoop", flown.kind, flown.scenario, "-n", ",".join(flown.navigators)]
    if flown.kind == "run":
        words += ["--seed", str(flown.seed)]
    else:
        words += ["--runs", str(flown.quick_runs if quick else flown.runs)]
        for key, values in flown.vary.items():
            words += ["--vary", f"{key}={','.join(str(value) for value in values)}"]
    for option in options:
        words += ["--set", option]
    return join(words)
