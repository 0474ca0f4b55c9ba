"""The command that flies one mission of a study again."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["replay_command"]


def replay_command(
    scenario: str | None, overrides: Sequence[str], changes: Mapping[str, Any], navigator: str, seed: int
) -> str:
    """One line for a shell, or for Python where the scenario has no name.

    Args:
        scenario: name or path as it was given; None: an object of a program.
        overrides: of all variants, "dotted.key=value".
        changes: of the variant, by dotted key.
        navigator: who flies.
        seed: of the mission.
    """
    settings = [*overrides, *(f"{key}={_toml(value)}" for key, value in changes.items())]
    if scenario is None:
        said = f", overrides={settings!r}" if settings else ""
        return f"uwcoop.run(scenario, [{navigator!r}], seed={seed}{said})"
    sets = [part for setting in settings for part in ("--set", setting)]
    return shlex.join(["uwcoop", "run", scenario, "-n", navigator, "--seed", str(seed), *sets])


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False, default=str)
