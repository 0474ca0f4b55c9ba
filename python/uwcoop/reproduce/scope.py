"""How much of a manifest is flown, and the commands that fly the same."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from shlex import join
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from uwcoop.reproduce.manifest import Flown, Paper

__all__ = ["Scope"]


@dataclass(frozen=True)
class Scope:
    """Few missions (`quick`), and at most so many runs of each study (`most_runs`; None: as the manifest says)."""

    quick: bool = False
    most_runs: int | None = None

    def runs_of(self, flown: Flown) -> int:
        """Runs of each variant."""
        runs = flown.quick_runs if self.quick else flown.runs
        return min(runs, self.most_runs or runs)

    def options_of(self, flown: Flown) -> list[str]:
        """Overrides of the scenario."""
        return [*flown.options, *(flown.quick_options if self.quick else ())]

    def particles_of(self, flown: Flown) -> tuple[int, ...]:
        """Numbers of particles whose cost is measured."""
        return (flown.quick_particles if self.quick else ()) or flown.particles

    def missions_of(self, flown: Flown) -> int:
        """How many missions are flown, all variants together."""
        if flown.kind == "cost":
            return len(self.particles_of(flown))
        if flown.kind == "run":
            return 1
        return self.runs_of(flown) * prod(len(values) for values in flown.vary.values())

    def flags(self) -> str:
        """What `uwcoop reproduce` was told, with a space before."""
        return (" --quick" if self.quick else "") + (f" --runs {self.most_runs}" if self.most_runs else "")

    def command_of(self, paper: Paper, name: str) -> str:
        """The command that flies these missions of the paper by themselves."""
        flown = paper.missions[name]
        if flown.kind == "cost":
            return f"uwcoop reproduce {paper.name}{self.flags()}"
        words = ["uwcoop", flown.kind, flown.scenario, "-n", ",".join(flown.navigators)]
        if flown.kind == "run":
            words += ["--seed", str(flown.seed)]
        else:
            words += ["--runs", str(self.runs_of(flown))]
            for key, values in flown.vary.items():
                words += ["--vary", f"{key}={','.join(str(value) for value in values)}"]
        for option in self.options_of(flown):
            words += ["--set", option]
        return join(words)
