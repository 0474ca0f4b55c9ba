"""All terrain navigators over the same missions, with the team's bound: the comparison on README's first screen.

    python studies/compare.py [--runs N] [--work DIR]      an hour and a half on two cores for 50 runs

Writes docs/results/comparison.md, docs/images/comparison.png and the table between the marks in README.md. What was
flown stays in DIR and is not flown again. `--write` takes of the real soundings only the teams that DIR holds.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import aburatsubo

import uwcoop
from uwcoop.evaluation import metrics
from uwcoop.navigators import NAVIGATORS

ROOT = Path(__file__).parents[1]
REFERENCE = Path(os.environ.get("UWCOOP_REFERENCE", ROOT / ".." / "shared")).resolve()
BEGIN, END = "<!-- comparison: written by studies/compare.py -->", "<!-- end of comparison -->"

NAMES = [n for n in ("dead-reckoning", "dmpf", "mpf-terrain-only", "mpf", "team") if n in NAVIGATORS]
COLOURS = {
    "dead-reckoning": "#999999",
    "dmpf": "#D55E00",
    "mpf-terrain-only": "#56B4E9",
    "mpf": "#009E73",
    "team": "#000000",
}

Row = Mapping[str, Any]


@dataclass(frozen=True)
class World:
    """One group of missions."""

    key: str
    title: str
    note: str
    rows: list[Row] = field(default_factory=list)


SIMULATED = {
    "st-john-drift": (
        "rich terrain,\ndrifting current",
        "rich terrain, a current that is a random walk, no loss",
    ),
    "flat-bay": ("flat bottom,\n20 % loss", "the same with relief × 0.15 and 20 % loss"),
    "poor-bay": (
        "0.5 m of relief,\npoor sensors",
        "0.3 m depth noise, unknown tide, current and biases, 20 % loss",
    ),
    "surveyed-bay": (
        "chart from a\nsimulated survey",
        "the first through a chart with holes and errors of metres",
    ),
}
REAL = {
    "dvl": ("real soundings,\nDVL", "with the residual errors of a DVL"),
    "no-dvl": ("real soundings,\nno DVL", "with thruster speed and a compass"),
}


def simulated(name: str, runs: int, work: Path) -> list[Row]:
    """Rows of a packaged scenario, seeds 0 to runs - 1."""
    folder = work / name
    result = uwcoop.study(name, runs, NAMES, out=folder, resume=folder.exists(), overrides=PARTICLES)
    return result.rows


def real(drift: str, runs: int, work: Path, *, write_only: bool = False) -> list[Row]:
    """Rows of every team of survey days of Aburatsubo bay, each over its own chart of the other days."""
    rows: list[Row] = []
    for team in aburatsubo.teams(REFERENCE):
        folder = work / f"aburatsubo-{team[0][:8]}-{drift}"
        if write_only and not (folder / "study" / "summary.json").exists():
            continue
        scenario = folder / "scenario.toml"
        if not scenario.exists():
            aburatsubo.write_team(REFERENCE, team, folder, drift)
        out = folder / "study"
        found = uwcoop.study(scenario, runs, NAMES, out=out, resume=out.exists(), overrides=PARTICLES)
        rows += found.rows
    return rows


PARTICLES = ("navigator.all.particles=1500",)


def column(rows: Sequence[Row], navigator: str, key: str) -> np.ndarray:
    """A column of one navigator's rows: one value for each run and vehicle."""
    values = [row[key] for row in rows if row["navigator"] == navigator and row[key] is not None]
    return np.array(values, dtype=np.float64)


def bound_rms(rows: Sequence[Row]) -> np.ndarray:
    """The bound's root mean square for each run and vehicle, from any navigator's ratio to it."""
    own = [row for row in rows if row["navigator"] == NAMES[0] and row["rmse_over_bound"]]
    return np.array([row["rmse_m"] / row["rmse_over_bound"] for row in own])


def figure(worlds: Sequence[World], path: Path) -> None:
    """Root mean square errors of every run and vehicle: median and 5 to 95 %, with the bound."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    drawn, axes = plt.subplots(figsize=(10.5, 4.6), layout="constrained")
    width = 0.8 / len(NAMES)
    for k, world in enumerate(worlds):
        for j, name in enumerate(NAMES):
            rmse = column(world.rows, name, "rmse_m")
            low, middle, high = np.quantile(rmse[np.isfinite(rmse)], [0.05, 0.5, 0.95])
            x = k - 0.4 + (j + 0.5) * width
            axes.plot([x, x], [low, high], color=COLOURS[name], lw=3.5, alpha=0.55, solid_capstyle="round")
            axes.plot([x], [middle], "o", color=COLOURS[name], ms=7, label=name if k == 0 else None)
            axes.annotate(
                f"{middle:.1f}", (x, high), (0, 4), textcoords="offset points", ha="center", fontsize=7.5,
                color=COLOURS[name],
            )  # fmt: skip
        line = float(np.median(bound_rms(world.rows)))
        axes.plot(
            [k - 0.45, k + 0.45], [line, line], color="#CC79A7", lw=2, ls="--",
            label="Cramér–Rao bound of the team, median" if k == 0 else None,
        )  # fmt: skip
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xticks(range(len(worlds)), [world.title for world in worlds])
    axes.set_xlim(-0.55, len(worlds) - 0.45)
    axes.set_ylabel("RMS position error of a mission (m)\nmedian, 5 to 95 % of vehicles")
    axes.grid(axis="y", which="major", alpha=0.35)
    axes.tick_params(axis="x", length=0)
    for k in range(1, len(worlds)):
        axes.axvline(k - 0.5, color="#cccccc", lw=0.8)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, 1.14), ncols=len(NAMES) + 1, frameon=False, fontsize=8.5
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn.savefig(path, dpi=130)


def number(value: float | None) -> str:
    """Three digits."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.0f}" if value >= 99.95 else f"{value:.1f}" if value >= 9.995 else f"{value:.2f}"


def short_table(worlds: Sequence[World]) -> str:
    """README's table: median RMSE, NEES and lost share of each navigator in each world."""
    lines = [
        "| | " + " | ".join(w.title.replace("\n", " ") for w in worlds) + " |",
        "|---" * (len(worlds) + 1) + "|",
    ]
    for name in NAMES:
        cells = []
        for world in worlds:
            pooled = metrics.pool(world.rows)[name]
            lost = pooled["lost_share"] or 0.0
            text = f"{number(pooled['median_rmse_m'])} m · {number(pooled['anees_median'])}"
            cells.append(text + (f" · {lost:.0%} lost" if lost >= 0.005 else ""))
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    bounds = " | ".join(f"{number(float(np.median(bound_rms(w.rows))))} m" for w in worlds)
    lines.append(f"| *Cramér–Rao bound* | {bounds} |")
    return "\n".join(lines)


def long_table(world: World) -> str:
    """One world's table of the results page."""
    heads = (
        "navigator", "RMSE median (m)", "final median (m)", "final 95 % (m)", "NEES median", "NEES mean", "lost",
        "RMSE / bound", "/ linearised", "bytes",
    )  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name, pooled in metrics.pool(world.rows).items():
        cells = [
            number(pooled["median_rmse_m"]),
            number(pooled["median_final_error_m"]),
            number(pooled["p95_final_error_m"]),
            number(pooled["anees_median"]),
            number(pooled["anees"]),
            f"{pooled['lost_share']:.1%}",
            number(pooled["rmse_over_bound"]),
            number(pooled["rmse_over_linearised_bound"]),
            str(pooled["packet_bytes_max"] or "–"),
        ]
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def page(worlds: Sequence[World], command: str) -> str:
    """docs/results/comparison.md."""
    parts = [
        "# Comparison",
        "All terrain navigators over the same missions of three vehicles and 900 s, N = 1500 particles each, with [the "
        "team's Cramér–Rao bound](../methods/bound.md). Run k of a table has seed k for every navigator; errors count "
        "after 50 s. NEES: 2 is ideal, its median is over runs and vehicles of the mean over time. *Lost*: more than "
        f"30 m off at the end. Measured on {platform.machine()}, {os.cpu_count()} cores, by",
        f"<!-- no-run: takes an hour -->\n```console\n$ {command}\n```",
        "![RMS error of each navigator in each world, and the bound](../images/comparison.png)",
    ]
    for world in worlds:
        flown = len({(row["seed"], row.get("team")) for row in world.rows})
        vehicles = len(world.rows) // len(NAMES)
        parts += [
            f"## {world.title.replace(chr(10), ' ')} (`{world.key}`)",
            f"{world.note[0].upper()}{world.note[1:]}; {flown} seeds, {vehicles} vehicle-missions.",
            long_table(world),
        ]
    parts.append(
        "The real soundings are Takamitsu Iida's single-beam survey of Aburatsubo bay: tracks, soundings and "
        "charts are "
        "recorded, a day never in its own chart; three days are flown at once as one team. Odometry and ranges are "
        "simulated. The bound of these and of `surveyed-bay` takes the slope from the chart that the vehicles carry, "
        "with its errors: it is a reference there rather than a bound."
    )
    return "\n\n".join(parts) + "\n"


def readme(worlds: Sequence[World]) -> None:
    """Puts picture and table between the marks."""
    path = ROOT / "README.md"
    text = path.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    runs = len({row["seed"] for row in worlds[0].rows})
    recorded = [len(world.rows) // len(NAMES) for world in worlds if world.key not in SIMULATED]
    real_ones = f" ({recorded[0]} vehicle-missions each)" if recorded else ""
    block = (
        "\n![RMS error of each navigator in each world, and the bound](docs/images/comparison.png)\n\n"
        f"{short_table(worlds)}\n\n"
        "Median RMS error of a mission · median NEES (ideal 2) · share of vehicles more than 30 m off at the "
        "end; three "
        f"vehicles, 900 s, {runs} seeds each, simulated. In the last columns tracks, soundings and charts are recorded "
        f"(other days' chart), ranges and odometry simulated{real_ones}. More, with commands: "
        "[docs/results/comparison.md](docs/results/comparison.md).\n"
    )
    path.write_text(before + BEGIN + block + END + after, encoding="utf-8")


def main() -> None:
    """Flies what is not flown, and writes page, picture and README's block."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--real-runs", type=int, default=None, help="seeds for each team of survey days")
    parser.add_argument("--work", type=Path, default=ROOT / "comparison-work")
    parser.add_argument(
        "--only", default=None, help="names of worlds, separated by commas; nothing is written then"
    )
    parser.add_argument(
        "--write", action="store_true", help="fly nothing on real soundings; write what there is"
    )
    asked = parser.parse_args()
    real_runs = asked.real_runs or max(1, asked.runs // 4)
    only = None if asked.only is None else asked.only.split(",")
    worlds = []
    for name, (title, note) in SIMULATED.items():
        if only is None or name in only:
            worlds.append(World(name, title, note, simulated(name, asked.runs, asked.work)))
            print(f"{name}\n{long_table(worlds[-1])}\n", flush=True)
    for drift, (title, note) in REAL.items():
        if (only is None or drift in only) and (REFERENCE / aburatsubo.RECORDING).exists():
            rows = real(drift, real_runs, asked.work, write_only=asked.write)
            if not rows:
                continue
            worlds.append(World(f"aburatsubo, {drift}", title, note, rows))
            print(f"{drift}\n{long_table(worlds[-1])}\n", flush=True)
    if only is None:
        command = f"python studies/compare.py --runs {asked.runs} --real-runs {real_runs}"
        command += " --write" if asked.write else ""
        figure(worlds, ROOT / "docs" / "images" / "comparison.png")
        (ROOT / "docs" / "results").mkdir(exist_ok=True)
        (ROOT / "docs" / "results" / "comparison.md").write_text(page(worlds, command), encoding="utf-8")
        readme(worlds)


if __name__ == "__main__":
    main()
