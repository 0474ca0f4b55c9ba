"""The variants of a study: one scenario with each combination of varied keys, in each world."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop import scenario as scenarios
from uwcoop.experiment.navigator_choice import default_navigators
from uwcoop.experiment.study_store import text_of
from uwcoop.navigators import Custom, options_of
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    from uwcoop.experiment.named_worlds import World
    from uwcoop.scenario.models import Scenario

__all__ = ["WORLD", "Variant", "digest", "fit_everywhere", "label_of", "name_of", "variants_of"]

WORLD = "world"
"""The varied key of a study over worlds; its values are their names."""


@dataclass(frozen=True)
class Variant:
    """One scenario of a study, and what is varied in it."""

    settings: dict[str, Any]
    """What is varied, by dotted key; of a world its name."""
    scenario: Scenario
    changes: dict[str, Any]
    """The same as values of scenario keys, with those that the world changes."""

    @property
    def texts(self) -> tuple[str, ...]:
        return tuple(text_of(value) for value in self.settings.values())

    @property
    def label(self) -> str:
        return label_of(self.settings, self.texts)


def variants_of(
    scenario: Scenario | str | Path,
    overrides: Sequence[str],
    vary: Mapping[str, Sequence[Any]],
    worlds: Sequence[World] = (),
    samples: Sequence[Mapping[str, Any]] = (),
) -> Iterator[Variant]:
    """Every combination of varied values with every sample, each in every world; else in the scenario's own."""
    for values in itertools.product(*vary.values()):
        for sample in samples or [{}]:
            settings = {**dict(zip(vary, values, strict=True)), **sample}
            base = _with(scenario, overrides, settings)
            if not worlds:
                yield Variant(settings, base, settings)
            for world in worlds:
                changes = settings | world.settings(base)
                yield Variant(settings | {WORLD: world.name}, _with(scenario, overrides, changes), changes)


def _with(scenario: Scenario | str | Path, overrides: Sequence[str], settings: Mapping[str, Any]) -> Scenario:
    if isinstance(scenario, str | Path):
        return scenarios.load(scenario, overrides, settings)
    table = scenarios.apply_overrides(scenario.resolved(), overrides)
    return scenarios.parse(scenarios.apply_settings(table, settings), scenario.name)


def fit_everywhere(variants: Sequence[Variant]) -> list[str | Custom]:
    """The packaged navigators that take part in every variant."""
    fits = [default_navigators(MissionSetup.of(v.scenario), len(v.scenario.team)) for v in variants]
    return [name for name in fits[0] if all(name in f for f in fits)]


def name_of(navigator: str | Custom) -> str:
    """The name in tables and files."""
    return navigator if isinstance(navigator, str) else navigator.name


def digest(scenario: Scenario, navigators: Sequence[str | Custom]) -> str:
    """SHA-256 of what a variant's rows depend on: scenario, the navigators' options, files that are read."""
    setup = MissionSetup.of(scenario)
    options = {n: options_of(n, setup).model_dump() for n in navigators if isinstance(n, str)}
    chart = scenario.chart
    paths = [chart.source] if chart is not None and chart.synthetic is None else []
    paths += [vehicle.track.file for vehicle in scenario.team if vehicle.track is not None]
    # A file that is missing is refused, with a better message, by who reads it.
    files = [_digest_of_file(Path(p)) for p in paths if Path(p).is_file()]
    content = json.dumps([setup.tables(), options, files], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def _digest_of_file(path: Path) -> str:
    with path.open("rb") as file:  # a piece at a time: charts can be large
        return hashlib.file_digest(file, "sha256").hexdigest()


def label_of(keys: Iterable[str], texts: Iterable[str]) -> str:
    """The varied keys with their values, for people."""
    return ", ".join(f"{key} = {text}" for key, text in zip(keys, texts, strict=True))
