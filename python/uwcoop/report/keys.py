"""All keys that a user can set: those of a scenario, and the options of navigators."""

from __future__ import annotations

from uwcoop.navigators import NAVIGATORS
from uwcoop.scenario.keys import Key, beginning_with, keys_of, scenario_keys


def all_keys(prefix: str = "") -> list[Key]:
    """Keys that begin with `prefix`: the scenario's, then `navigator.NAME.*` of every packaged navigator.

    Raises:
        ScenarioError: no key begins so.
    """
    options = [
        key
        for name, spec in NAVIGATORS.items()
        for key in keys_of(spec.options, f"navigator.{name}")
        if key.name.rpartition(".")[2] not in spec.fixed
    ]
    return beginning_with(prefix, [*scenario_keys(), *options])
