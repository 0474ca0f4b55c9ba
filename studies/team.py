"""What `team` is worth: paired studies on the packaged scenarios, one line for each navigator and variant.

    python studies/team.py NAME … [--runs N] [--processes N]

Every name is one question; `python studies/team.py --help` lists them. Run k has seed k for every variant.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import uwcoop
from uwcoop import scenario
from uwcoop.evaluation import metrics
from uwcoop.missionlog import MissionLog

ALL = ("team", "mpf", "mpf-terrain-only", "dmpf", "dead-reckoning")
PAIR = ("team", "mpf-terrain-only")
SAME_PARTICLES = "navigator.all.particles=1500"
KNOWN = ("sigma_current0_mps", "sigma_heading_bias0_rad", "sigma_thrust_bias0_mps")
"""What a scenario tells dead reckoning of its world, and `team` has to be told where it has no chart."""


@dataclass(frozen=True)
class Question:
    """One table."""

    asks: str
    world: str
    navigators: Sequence[str] = ("team",)
    overrides: Sequence[str] = ()
    vary: Mapping[str, Sequence[Any]] = field(default_factory=dict)


FULL = 'acoustics.modem="unlimited"'
QUESTIONS: dict[str, Question] = {
    "rich": Question("rich terrain", "st-john-drift", ALL),
    "flat": Question("flat bottom, 20 % loss", "flat-bay", ALL),
    "poor": Question("0.5 m of relief, poor sensors", "poor-bay", ALL),
    "surveyed": Question("a chart with errors of a survey", "surveyed-bay", ALL),
    "one-sigma": Question(
        "one sigma for all of such a chart", "surveyed-bay", ALL[:3],
        vary={"chart.survey.error_by_slope": [True, False]},
    ),
    "mixed": Question("vehicles that carry different things", "mixed-team", ("team", "mpf-terrain-only")),
    "vehicles": Question(
        "more teammates never hurt", "flat-bay", overrides=(SAME_PARTICLES,), vary={"vehicles.count": [1, 2, 3, 5]}
    ),
    "loss": Question(
        "less loss never hurts, and none is worse than alone", "flat-bay", PAIR, (SAME_PARTICLES,),
        {"acoustics.loss.probability": [0.0, 0.2, 0.5, 0.8, 1.0]},
    ),
    "surveyed-loss": Question(
        "the same on a surveyed chart", "surveyed-bay", PAIR,
        (SAME_PARTICLES, 'acoustics.loss.model="independent"'),
        {"acoustics.loss.probability": [0.0, 0.5, 0.8, 1.0]},
    ),
    "cycle": Question(
        "shorter cycles never hurt", "flat-bay", vary={"acoustics.slot_s": [3.0, 6.0, 12.0]}
    ),
    "packet": Question(
        "what 32 bytes with a tag cost", "flat-bay", overrides=(FULL,),
        vary={"navigator.team.packet": ["f64", "rounded"]},
    ),
    "groups": Question(
        "groups of teammates against one Gaussian over all", "flat-bay", overrides=("vehicles.count=6",),
        vary={"navigator.team.group_size": [5, 4, 2, 1]},
    ),
    "particles": Question(
        "fewer particles", "st-john-drift", vary={"navigator.team.particles": [300, 600, 1000, 1500, 3000]}
    ),
    "currents": Question(
        "what a shared current is worth", "flat-bay", vary={"navigator.team.current_difference": [0.1, 0.3, 1.0]}
    ),
}  # fmt: skip
NO_CHART = "no-chart"
ALONE = "alone"
OVER_TERRAIN = (
    "st-john", "st-john-drift", "st-john-current", "st-john-bias", "st-john-field", "st-john-field-3", "charles-river",
    "flat-bay", "poor-bay", "surveyed-bay", "mixed-team",
)  # fmt: skip
LOSSES = (0.0, 0.5, 0.9, 1.0)
SPEED = "speed"
TIMED: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("st-john-drift", ()), ("poor-bay", ()),
    ("st-john-drift", ("vehicles.count=16", "navigator.team.group_size=4")),
)  # fmt: skip


def line(shown: str, name: str, rows: Sequence[Mapping[str, Any]], base: Sequence[Mapping[str, Any]]) -> str:
    """One navigator's figures; the ratio is the median of its errors over those of `base`, run by run."""
    found = metrics.pool(rows)[name]
    over = found["rmse_over_bound"]
    ratios = [row["rmse_m"] / first["rmse_m"] for row, first in zip(rows, base, strict=False)]
    same = len(rows) == len(base)
    return (
        f"| {shown} | `{name}` | {found['median_final_error_m']:.2f} / {found['p95_final_error_m']:.1f} m "
        f"| {found['median_rmse_m']:.2f} m | {found['anees_median']:.2f} / {found['anees']:.2f} "
        f"| {100 * found['lost_share']:.1f} % | {'–' if over is None else f'{over:.2f}'} "
        f"| {f'{np.median(ratios):.2f}' if same else '–'} |"
    )


HEAD = (
    "| | navigator | final error, median / 95 % | RMSE, median | ANEES median / mean | lost | over bound | paired |\n"
    "|---|---|---|---|---|---|---|---|"
)


def ask(question: Question, runs: int, processes: int | None) -> None:
    """Flies one question and prints its table; ratios are paired with its first line."""
    result = uwcoop.study(
        question.world, runs, list(question.navigators), question.vary, overrides=question.overrides,
        processes=processes,
    )  # fmt: skip
    print(f"\n{question.asks}: {question.world}, {runs} runs {' '.join(question.overrides)}\n\n{HEAD}")
    base: list[Mapping[str, Any]] = []
    keys = list(question.vary)
    combinations = list(dict.fromkeys(tuple(row[key] for key in keys) for row in result.rows))
    for values in combinations:
        for name in question.navigators:
            own = [
                row
                for row in result.rows
                if row["navigator"] == name and tuple(row[key] for key in keys) == values
            ]
            own.sort(key=lambda row: (int(row["run"]), str(row["vehicle"])))
            base = base or own
            shown = ", ".join(f"{k.rsplit('.', 1)[-1]} {v}" for k, v in zip(keys, values, strict=True))
            print(line(shown, name, own, base), flush=True)


def ask_without_a_chart(runs: int) -> None:
    """Ranging only: the log's chart is taken away, as from a vehicle that has none."""
    told = [f"navigator.team.{name}=0.0" for name in KNOWN]
    world = scenario.load("st-john-drift", told)
    rows: list[Mapping[str, Any]] = []
    for seed in range(runs):
        log = replace(uwcoop.simulate(world, seed=seed), chart=None)
        flown = uwcoop.run(log, ["dead-reckoning", "team"], clouds=False)
        rows += metrics.rows(flown.tracks, seconds=flown.seconds, packets=flown.packets, run=seed)
    print(f"\nranging only: st-john-drift without its chart, {runs} runs\n\n{HEAD}")
    base = [row for row in rows if row["navigator"] == "dead-reckoning"]
    for name in ("dead-reckoning", "team"):
        print(line("", name, [row for row in rows if row["navigator"] == name], base), flush=True)


def ask_alone(runs: int, processes: int | None) -> None:
    """Every world over terrain, from no loss to nothing heard: the team against each of its vehicles alone."""
    print(f"\nRMSE of team over mpf-terrain-only's, medians, {runs} runs {SAME_PARTICLES}\n")
    print(
        "| loss | "
        + " | ".join(f"{100 * loss:.0f} %" for loss in LOSSES)
        + " |\n|---|"
        + "---|" * len(LOSSES)
    )
    for world in OVER_TERRAIN:
        ratios = []
        for loss in LOSSES:
            # In place of the losses that a scenario has.
            lost = f'acoustics.losses=[{{model="independent",probability={loss}}}]'
            result = uwcoop.study(
                world, runs, list(PAIR), overrides=(SAME_PARTICLES, lost), processes=processes
            )
            found = metrics.pool(result.rows)
            ratios.append(found[PAIR[0]]["median_rmse_m"] / found[PAIR[1]]["median_rmse_m"])
        print(f"| `{world}` | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |", flush=True)


def processor_s(log: MissionLog, navigator: str, times: int) -> float:
    """Least processor time of some runs on one thread."""
    taken = []
    for _ in range(times):
        began = time.process_time()
        uwcoop.run(log, [navigator], clouds=False)
        taken.append(time.process_time() - began)
    return min(taken)


def ask_speed(times: int) -> None:
    """Processor time of `team`, less that of dead reckoning over the same mission."""
    print("| | s | per particle, second and vehicle | times real time |\n|---|---|---|---|")
    for world, overrides in TIMED:
        log = uwcoop.simulate(scenario.load(world, overrides), seed=0)
        seconds = processor_s(log, "team", times) - processor_s(log, "dead-reckoning", times)
        lived_s = log.duration_ns * 1e-9
        each_us = 1e6 * seconds / lived_s / 1500 / len(log.vehicles)
        shown = f"`{world}` {' '.join(overrides)}".rstrip()
        print(f"| {shown} | {seconds:.2f} | {each_us:.2f} µs | {lived_s / seconds:.0f} |", flush=True)


def main() -> None:
    """Asks what was asked for."""
    about = "\n".join(f"  {name:14s} {question.asks}" for name, question in QUESTIONS.items())
    parser = argparse.ArgumentParser(
        description=f"{Path(__file__).name}: tables of docs/results/team.md\n\n{about}\n"
        f"  {NO_CHART:14s} ranging only\n  {ALONE:14s} every world and loss, against each vehicle alone\n"
        f"  {SPEED:14s} processor time, best of the runs",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="+", choices=[*QUESTIONS, NO_CHART, ALONE, SPEED], metavar="NAME")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--processes", type=int, default=None)
    asked = parser.parse_args()
    for name in asked.names:
        if name == NO_CHART:
            ask_without_a_chart(asked.runs)
        elif name == ALONE:
            ask_alone(asked.runs, asked.processes)
        elif name == SPEED:
            ask_speed(asked.runs)
        else:
            ask(QUESTIONS[name], asked.runs, asked.processes)


if __name__ == "__main__":
    main()
