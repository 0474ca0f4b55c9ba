"""Flies what a paper's figures need, draws them, and judges each statement; what is done is not done again."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from uwcoop.errors import ScenarioError, TracksError, UwcoopError
from uwcoop.reproduce.manifest import Check, Figure, Flown, Paper, load_paper
from uwcoop.reproduce.measures import measure
from uwcoop.reproduce.pictures import draw
from uwcoop.reproduce.scope import Scope
from uwcoop.reproduce.tables import study_table

__all__ = ["Finding", "Outcome", "Reproduced", "Shown", "reproduce"]

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
class Shown:
    """Missions of a figure: the command that flies them by itself, and a study's table (head first; a run has none)."""

    command: str
    table: list[list[str]]


@dataclass(frozen=True)
class Outcome:
    """One figure: its picture (None: why not drawn) and its findings."""

    id: str
    title: str
    states: str
    flown: list[Shown]
    picture: str | None
    reason: str
    note: str
    findings: list[Finding]

    @property
    def holds(self) -> bool:
        """Whether every finding does."""
        return all(finding.holds for finding in self.findings)


@dataclass(frozen=True)
class Reproduced:
    """A paper with what came of it."""

    paper: Paper
    outcomes: list[Outcome]
    scope: Scope
    seconds: float
    """Wall time of the flights, of all calls that took part."""


def reproduce(
    name: str, out: Path, *, quick: bool = False, runs: int | None = None, progress: Progress | None = None
) -> Reproduced:
    """Every figure of a paper: pictures in `out`, with what was flown under `out/missions`.

    Figures that an earlier call finished with the same program, manifest and scope are taken from `out/done.json`;
    studies go on where they were cut off.

    Args:
        name: of `uwcoop.reproduce.PAPERS`.
        out: folder, made if need be.
        quick: few missions, for a first look.
        runs: at most so many runs of each study; None: as the manifest says.
        progress: called with what is being done, missions done, and missions in all.

    Raises:
        UwcoopError: one line; what was finished stays.
    """
    if runs is not None and runs < 1:
        raise ScenarioError(f"runs is {runs}: must be at least 1")
    paper, scope = load_paper(name), Scope(quick, runs)
    out.mkdir(parents=True, exist_ok=True)
    done = _Done(out / "done.json", paper, scope)
    pending = [figure for figure in paper.figures if done.get(figure) is None]
    flights = _Flights(paper, out / "missions", scope, pending, progress)
    for place, figure in enumerate(pending):
        flights.fly(figure)
        done.add(_outcome(paper, figure, flights.flown, out, scope))
        flights.keep(pending[place + 1 :])
    outcomes = [known for figure in paper.figures if (known := done.get(figure)) is not None]
    return Reproduced(paper, outcomes, scope, flights.seconds())


class _Flights:
    """What pending figures need, flown once and kept as long as one needs it."""

    def __init__(
        self, paper: Paper, folder: Path, scope: Scope, pending: Sequence[Figure], progress: Progress | None
    ) -> None:
        self._paper, self._folder, self._scope, self._progress = paper, folder, scope, progress
        needed = dict.fromkeys(name for figure in pending for name in figure.missions)
        self._total = sum(scope.missions_of(paper.missions[name]) for name in needed)
        self._done = 0
        self.flown: dict[str, Any] = {}

    def seconds(self) -> float:
        """Wall time of all missions of the paper, earlier calls included."""
        return sum(_spent(self._clock(name)) for name in self._paper.missions)

    def _clock(self, name: str) -> Path:
        """The file that holds how long these missions took, as they stand in the manifest."""
        content = [
            version("uwcoop"),
            self._paper.missions[name].model_dump(mode="json"),
            self._scope.quick,
        ]
        digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        return self._folder / f"{name}-{digest[:12]}.seconds"

    def fly(self, figure: Figure) -> None:
        for name in figure.missions:
            if name in self.flown:
                continue
            mission, text = self._paper.missions[name], f"{figure.id}: {figure.title}"
            self._tell(text, 0)
            clock = _Clock(self._clock(name), mission.kind == "study")
            told = partial(self._told, text, clock)
            try:
                self.flown[name] = _fly(mission, self._folder / name, self._scope, told)
            finally:
                clock.keep()
            self._done += self._scope.missions_of(mission)
            self._tell(text, 0)

    def keep(self, pending: Sequence[Figure]) -> None:
        needed = {name for figure in pending for name in figure.missions}
        self.flown = {name: result for name, result in self.flown.items() if name in needed}

    def _told(self, text: str, clock: _Clock, done: int, _: int) -> None:
        clock.keep()
        self._tell(text, done)

    def _tell(self, text: str, more: int) -> None:
        if self._progress:
            self._progress(text, self._done + more, self._total)


class _Clock:
    """How long missions took, in a file that outlives a kill; what resumes adds to what it took before."""

    def __init__(self, path: Path, resumes: bool) -> None:
        self._path, self._before, self._began = path, _spent(path) if resumes else 0.0, time.monotonic()

    def keep(self) -> None:
        from uwcoop.report.atomic_files import atomic_write
        from uwcoop.report.interruption import deferred

        self._path.parent.mkdir(parents=True, exist_ok=True)
        with deferred(), atomic_write(self._path) as partial_file:
            text = f"{self._before + time.monotonic() - self._began:.3f}\n"
            partial_file.write_text(text, encoding="utf-8")


def _spent(path: Path) -> float:
    try:
        return float(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return 0.0


class _Done:
    """Finished figures on disk, as long as program and manifest are the same."""

    def __init__(self, path: Path, paper: Paper, scope: Scope) -> None:
        content = json.dumps(
            [version("uwcoop"), paper.model_dump(mode="json"), astuple(scope)], sort_keys=True
        )
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
        findings, flown = (
            [of(**one) for one in kept[key]] for key, of in (("findings", Finding), ("flown", Shown))
        )
        return Outcome(**{**kept, "findings": findings, "flown": flown})

    def add(self, outcome: Outcome) -> None:
        from uwcoop.report.atomic_files import atomic_write

        self._figures[outcome.id] = asdict(outcome)
        with atomic_write(self._path) as partial_file:
            text = json.dumps({"digest": self._digest, "figures": self._figures}, indent=1)
            partial_file.write_text(text + "\n", encoding="utf-8")


def _fly(flown: Flown, folder: Path, scope: Scope, progress: Callable[[int, int], None]) -> Any:
    if flown.kind == "cost":
        from uwcoop.reproduce.cost import cost

        return cost(flown.scenario, scope.particles_of(flown), 1 if scope.quick else REPEATS)
    if flown.kind == "run":
        from uwcoop.experiment.run import run

        return run(
            flown.scenario,
            flown.navigators,
            seed=flown.seed,
            overrides=scope.options_of(flown),
            clouds=flown.clouds,
            threads=0,
        )
    from uwcoop.experiment.study import study

    return study(
        flown.scenario,
        scope.runs_of(flown),
        flown.navigators,
        flown.vary,
        out=folder,
        resume=True,
        overrides=scope.options_of(flown),
        first_seed=flown.seed,
        keep_errors=flown.keep_errors,
        progress=progress,
    )


def _outcome(paper: Paper, figure: Figure, flown: dict[str, Any], out: Path, scope: Scope) -> Outcome:
    picture, reason = f"{paper.short}-{figure.id}.png", ""
    try:
        drawn = draw(figure.picture, flown[figure.flown], figure.shows)
    except TracksError as refused:
        picture, reason = "", str(refused)
    else:
        from uwcoop.report.atomic_files import atomic_write

        with atomic_write(out / picture) as partial_file:
            drawn.savefig(partial_file)
    findings = [_finding(check, figure, flown) for check in figure.checks]
    shown = [
        Shown(
            scope.command_of(paper, name),
            study_table(flown[name].summary) if paper.missions[name].kind == "study" else [],
        )
        for name in figure.missions
    ]
    return Outcome(
        figure.id, figure.title, figure.states, shown, picture or None, reason, figure.note, findings
    )


def _finding(check: Check, figure: Figure, flown: dict[str, Any]) -> Finding:
    reason = check.why
    try:
        value = measure(check.measure, flown[check.flown or figure.flown], dict(check.of))
        if check.against:
            value /= measure(check.measure, flown[check.against], dict(check.of))
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
