"""Writes docs/results/robustness.md: navigators in worlds that are not as they believe, by the packaged list of faults.

    nice python studies/robustness.py --seeds 50                 several hours on two cores
    nice python studies/robustness.py --seeds 8 --worlds believed,clock-10ms,all --scenarios flat-bay

All navigators of a world fly the same missions. What was flown stays in `--work` and is not flown again: a study that was
ended goes on where it was, and more seeds, worlds or scenarios are added. The page is written at the end, from what the
chosen scenarios have; `--write` writes it from what is there.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import uwcoop
from uwcoop.experiment.named_worlds import World, worlds_of

ROOT = Path(__file__).parents[1]
NAVIGATORS = ("team", "mpf", "mpf-terrain-only")
ALONE = "mpf-terrain-only"
PARTICLES = ("navigator.all.particles=1500",)
SCENARIOS = ("flat-bay", "st-john-drift", "poor-bay", "surveyed-bay")
ROUGH = "rough-water"
"""Has its own faults: flown as it is, with dead reckoning beside."""
LOST_BEYOND_M = 30.0
SURE_SIGMAS = 3.0

Row = Mapping[str, Any]


def fly(scenario: str, worlds: Sequence[World], seeds: int, work: Path, processes: int) -> None:
    """Adds what is missing to the scenario's study."""
    folder = work / scenario
    rough = scenario == ROUGH
    uwcoop.study(
        scenario,
        seeds,
        ("dead-reckoning", *NAVIGATORS) if rough else NAVIGATORS,
        out=folder,
        resume=(folder / "runs.csv").exists(),
        processes=processes,
        overrides=PARTICLES,
        worlds=() if rough else worlds,
        progress=lambda done, total: print(f"\r{scenario}: {done} of {total} missions", end="", flush=True),
    )
    print()


def rows_of(folder: Path) -> list[Row]:
    """All rows of a study's folder."""
    path = folder / "runs.csv"
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def column(rows: Sequence[Row], navigator: str, key: str) -> np.ndarray:
    """One navigator's values, one for each run and vehicle."""
    found = [row[key] for row in rows if row["navigator"] == navigator and row[key] != ""]
    return np.array(found, dtype=np.float64)


def cell(rows: Sequence[Row], navigator: str) -> str:
    """RMSE / NEES median, mean / lost, of which sure."""
    rmse, anees = column(rows, navigator, "rmse_m"), column(rows, navigator, "anees")
    lost = int(np.sum(column(rows, navigator, "final_error_m") > LOST_BEYOND_M))
    return f"{np.median(rmse):.2f} / {np.median(anees):.1f}, {np.mean(anees):.1f} / {lost}"


def line(title: str, rows: Sequence[Row]) -> str:
    """One row of the table; the last column is the median error of each over that of the lone vehicle."""
    alone = np.median(column(rows, ALONE, "rmse_m"))
    ratios = [np.median(column(rows, name, "rmse_m")) / alone for name in NAVIGATORS[:2]]
    missions = len({row["seed"] for row in rows})
    cells = [title, str(missions), *(cell(rows, name) for name in NAVIGATORS)]
    return "| " + " | ".join([*cells, " / ".join(f"{r:.2f}" for r in ratios)]) + " |"


HEAD = (
    "| world | missions | `team` | `mpf` | alone (`mpf-terrain-only`) | `team`, `mpf` / alone |\n"
    "|---|---|---|---|---|---|\n"
)


def table(scenario: str, worlds: Sequence[World], work: Path) -> str:
    """One scenario's section, or nothing where it was not flown."""
    rows = rows_of(work / scenario)
    if not rows:
        return ""
    if scenario == ROUGH:
        reckoned = cell(rows, "dead-reckoning")
        return f"## `{scenario}`\n\n{HEAD}{line('as it is', rows)}\n\nDead reckoning: {reckoned}."
    lines = []
    for world in worlds:
        own = [row for row in rows if row["world"] == world.name]
        if own:
            lines.append(line(world.title, own))
    return f"## `{scenario}`\n\n{HEAD}" + "\n".join(lines)


INTRO = """# Ranges as they are

Worlds whose clocks, sound speed, paths, losses and sensors are not as believed: the packaged list of faults, as
`uwcoop study SCENARIO --worlds faults` flies it ([how-to](../howto/studies.md)). Navigators are told the clock and range
faults of the world, as a user who knows the hardware would tell them (the option table `clock`, filled from the
scenario's `acoustics`), unless a row says otherwise. All filters have 1,500 particles; teams are of three vehicles.

A cell is RMSE (median over vehicles, m) / NEES (median, mean over vehicles; ideal 2) / vehicles lost (more than 30 m off
at the end). The last column is the median error over that of a vehicle that sails alone on the same missions. About 2 s
of one core for each mission and world; the command goes on where it was ended:

<!-- no-run: takes hours -->
```console
$ {command}
```

"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--worlds", help="names of the list, by comma; all unless told")
    parser.add_argument("--scenarios", default=",".join((*SCENARIOS, ROUGH)), help="names, by comma")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--work", type=Path, default=Path("robustness"), help="folder of what was flown")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "results" / "robustness.md")
    parser.add_argument("--notes", type=Path, help="Markdown that is put below the tables")
    parser.add_argument("--write", action="store_true", help="fly nothing, write the page")
    args = parser.parse_args()
    listed = worlds_of("faults")
    asked = [w.name for w in listed] if args.worlds is None else args.worlds.split(",")
    if unknown := sorted(set(asked) - {w.name for w in listed}):
        parser.error(f"no world is named {', '.join(unknown)}; there are {', '.join(w.name for w in listed)}")
    chosen = [world for world in listed if world.name in asked]
    for scenario in args.scenarios.split(","):
        if not args.write:
            fly(scenario, chosen, args.seeds, args.work, args.processes)
    parts = [table(scenario, listed, args.work) for scenario in (*SCENARIOS, ROUGH)]
    notes = [args.notes.read_text(encoding="utf-8").strip()] if args.notes else []
    command = f"nice .venv/bin/python studies/robustness.py --seeds {args.seeds}"
    page = INTRO.format(command=command) + "\n\n".join([*filter(None, parts), *notes]) + "\n"
    args.page.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
