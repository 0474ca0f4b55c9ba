"""Lists of worlds by name: what is changed in a scenario to see how navigators bear it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from uwcoop.errors import ScenarioError
from uwcoop.importers.bounded import read_text, refused
from uwcoop.scenario.base import NAME, Table, nearest
from uwcoop.scenario.models import Scenario
from uwcoop.scenario.validation_message import one_line

__all__ = ["World", "packaged_worlds", "worlds_of"]

_PACKAGE = files("uwcoop.experiment") / "packaged_worlds"
_LIMIT_BYTES = 2**20


class World(Table):
    """One world: what differs from the scenario, and what the navigators are told."""

    name: str = Field(pattern=NAME)
    title: str
    """In tables."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Values of scenario keys, by dotted key."""
    scale: dict[str, float] = Field(default_factory=dict)
    """Factors by dotted key of a number: the scenario's value is multiplied."""
    told: dict[str, Any] = Field(default_factory=dict)
    """Values of navigators' options, as in `[navigator.all]`: for every navigator that reads the option."""
    told_as_before: dict[str, str] = Field(default_factory=dict)
    """Navigators' options by the key whose value in the unchanged scenario they get."""

    def settings(self, scenario: Scenario) -> dict[str, Any]:
        """The world's changes of a scenario, by dotted key.

        Args:
            scenario: without the world's changes.

        Raises:
            ScenarioError: a key to be scaled that is no number in this scenario.
        """
        table = scenario.resolved()
        changes = dict(self.set)
        for key, factor in self.scale.items():
            changes[key] = factor * _number(table, key, self.name)
        said = self.told | {
            option: _number(table, key, self.name) for option, key in self.told_as_before.items()
        }
        return changes | {f"navigator.all.{option}": value for option, value in said.items()}


class _Worlds(Table):
    worlds: list[World] = Field(min_length=1)


def packaged_worlds() -> list[str]:
    """Names of the packaged lists."""
    return sorted(
        file.name.removesuffix(".toml") for file in _PACKAGE.iterdir() if file.name.endswith(".toml")
    )


def worlds_of(name_or_path: str | Path) -> list[World]:
    """The worlds of a packaged list, or of a TOML file with one table `[[worlds]]` for each.

    Raises:
        ScenarioError: one line that names what is wrong.
    """
    text = str(name_or_path)
    if text not in packaged_worlds() and not Path(text).is_file():
        raise ScenarioError(
            f"worlds {text!r} are neither a file nor packaged: {nearest(text, packaged_worlds())}"
        )
    with refused(ScenarioError, f"worlds {text}"):
        packaged = text in packaged_worlds()
        content = (
            (_PACKAGE / f"{text}.toml").read_text(encoding="utf-8")
            if packaged
            else read_text(text, _LIMIT_BYTES)
        )
        table = tomllib.loads(content)
    try:
        worlds = _Worlds.model_validate(table).worlds
    except ValidationError as error:
        raise ScenarioError(one_line(error, table, text)) from None
    names = [world.name for world in worlds]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ScenarioError(f"{text}: two worlds are named {twice[0]!r}")
    return worlds


def _number(table: Mapping[str, Any], key: str, world: str) -> float:
    value: Any = table
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(f"world {world!r} needs a number at {key}, the scenario has {value!r}")
    return float(value)
