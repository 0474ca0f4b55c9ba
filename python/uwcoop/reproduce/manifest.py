"""What a paper states, figure by figure, and what is flown to see whether it holds."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from uwcoop.errors import ScenarioError

__all__ = ["PAPERS", "Check", "Figure", "Flown", "Paper", "load_paper"]

PAPERS = ("tan2016", "matsuda2017", "walls2012")


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Flown(_Table):
    """Missions that figures share: one (`run`), many (`study`), or the time that one takes (`cost`)."""

    kind: Literal["run", "study", "cost"] = "study"
    scenario: str
    navigators: tuple[str, ...] = Field(strict=False, default=())
    options: tuple[str, ...] = Field(strict=False, default=())
    """Overrides of the scenario."""
    vary: dict[str, list[Any]] = {}
    runs: int = 1
    quick_runs: int = 1
    quick_options: tuple[str, ...] = Field(strict=False, default=())
    seed: int = 0
    """Of a run, or of a study's first."""
    clouds: bool = False
    keep_errors: bool = False
    particles: tuple[int, ...] = Field(strict=False, default=())
    quick_particles: tuple[int, ...] = Field(strict=False, default=())
    """Numbers of particles whose cost is measured."""


class Check(_Table):
    """A number of the missions beside what the paper says of it."""

    measure: str
    """Of `uwcoop.reproduce.measures.MEASURES`."""
    of: dict[str, Any] = {}
    """Its arguments."""
    flown: str = ""
    """Of `Paper.missions`; none: the figure's."""
    against: str = ""
    """Of `Paper.missions`: what is judged is the measure over that of these missions."""
    text: str
    """What is measured, with the unit."""
    paper: str
    """The paper's number or words, as a fact."""
    least: float | None = None
    most: float | None = None
    """It holds inside these."""
    why: str = ""
    """Where it does not hold, why."""


class Figure(_Table):
    """One figure or table of the paper."""

    id: str
    title: str
    flown: str
    """Of `Paper.missions`."""
    picture: str
    """Of `uwcoop.reproduce.pictures.PICTURES`."""
    shows: tuple[str, ...] = Field(strict=False, default=())
    """Navigators in the picture; none: all that flew."""
    states: str
    """What the paper states."""
    note: str = ""
    tables: tuple[str, ...] = Field(strict=False, default=())
    """Of `Paper.missions`: studies whose tables stand here too."""
    checks: tuple[Check, ...] = Field(strict=False, default=())

    @property
    def missions(self) -> tuple[str, ...]:
        """All missions that it needs, its own first."""
        judged = [name for check in self.checks for name in (check.flown, check.against) if name]
        return tuple(dict.fromkeys([self.flown, *self.tables, *judged]))


class Paper(_Table):
    """A paper: missions by name, and figures."""

    name: str
    short: str
    """Begins the names of the pictures."""
    cites: str
    note: str
    missions: dict[str, Flown]
    figures: tuple[Figure, ...] = Field(strict=False)


def load_paper(name: str) -> Paper:
    """The manifest of one of `PAPERS`.

    Raises:
        ScenarioError: an unknown paper.
    """
    if name not in PAPERS:
        raise ScenarioError(f"paper {name!r} is unknown: there are {', '.join(PAPERS)}")
    text = files("uwcoop.reproduce").joinpath("papers", f"{name}.toml").read_text(encoding="utf-8")
    try:
        return Paper.model_validate({"name": name, **tomllib.loads(text)})
    except ValidationError as invalid:
        raise ScenarioError(f"manifest of {name}: {invalid.errors()[0]}") from None
