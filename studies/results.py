"""Writes docs/results.md: every figure that the project states, from the commands that stand beside it.

python studies/results.py [--runs N]     the commands run one after the other; half an hour on two cores
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import aburatsubo

ROOT = Path(__file__).parents[1]
REFERENCE = Path(os.environ.get("UWCOOP_REFERENCE", ROOT / ".." / "shared")).resolve()
UWCOOP = Path(sys.executable).with_name("uwcoop")

ALL = "dead-reckoning,ranging-only,terrain-only,dmpf,mpf-terrain-only,mpf"

HEADER = """\
# Results

Every figure that this project states, with the command that gave it; `make study` writes this page anew.
Simulated missions unless it says otherwise. Run k of a study has seed k, for every navigator and variant: rows of one
table saw the same missions. Errors count after the first 50 s. ANEES is the mean over instants of the normalised
squared position error, ideal 2, above it overconfident; its median is over vehicles of their mean over time.
*Lost* is the share of vehicles more than 30 m off at the end. Measured on {machine}.
"""


@dataclass(frozen=True)
class Study:
    """One table of the page."""

    title: str
    scenario: str
    runs: int
    navigators: str = ALL
    options: tuple[str, ...] = ()
    note: str = ""


STUDIES = (
    Study(
        "Rich terrain, no current (`st-john`)",
        "st-john",
        100,
        note="The missions of Tan, Chitre & Hover's Figs. 6-7 over a synthetic stand-in for their chart, whose roughness "
        "was chosen so that, as there, ranges help the terrain filter and alone are worse than dead reckoning: that "
        "order is not independent evidence.",
    ),
    Study("A current that wanders (`st-john-drift`)", "st-john-drift", 100),
    Study(
        "Hardly any relief (`flat-bay`)",
        "flat-bay",
        50,
        note="Relief × 0.15 and 20 % loss: a broadcast belief contains what its receiver said before, and D-MPF talks "
        "itself into wrong positions.",
    ),
    Study(
        "Hardly any relief and poor sensors (`poor-bay`)",
        "poor-bay",
        50,
        note="0.5 m of relief, 0.3 m depth noise, unknown tide, current and biases, 20 % loss.",
    ),
    Study(
        "Number of particles",
        "st-john-drift",
        20,
        "mpf",
        ("--vary", "navigator.all.particles=300,600,1500"),
    ),
    Study(
        "How much a teammate's range counts",
        "flat-bay",
        20,
        "mpf",
        ("--vary", "navigator.mpf.range_temper=0.05,0.1,0.25,1.0"),
        note="A fused belief is not news: counted in full it makes the team overconfident.",
    ),
)


def run(arguments: list[str]) -> tuple[str, dict[str, Any]]:
    """The command as a reader would type it, and its JSON."""
    shown = "uwcoop " + " ".join(f'"{a}"' if " " in a else a for a in arguments)
    done = subprocess.run([str(UWCOOP), *arguments, "--json"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{shown}: {done.stderr.strip().splitlines()[-1]}")
    return shown, json.loads(done.stdout)


def table(summary: dict[str, Any]) -> str:
    """A study's summary as a Markdown table."""
    varied = list(summary["variants"][0]["set"])
    head = [*varied, "navigator", "final error, median (m)", "95 % (m)", "RMSE, median (m)", "ANEES, mean", "median",
            "lost", "packet (B)", "run time (s)"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for variant in summary["variants"]:
        for name, v in variant["navigators"].items():
            cells = [*(str(variant["set"][k]) for k in varied), f"`{name}`", number(v["median_final_error_m"]),
                     number(v["p95_final_error_m"]), number(v["median_rmse_m"]), number(v["anees"]),
                     number(v["anees_median"]), f"{100 * v['lost_share']:.0f} %",
                     str(v["packet_bytes_max"] or "-"), number(v["seconds"])]  # fmt: skip
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def number(value: float | None) -> str:
    """Two decimals below ten, one below a hundred, none above."""
    if value is None:
        return "-"
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.3g}"


def section(study: Study, runs: int | None) -> str:
    """One study's heading, note, command and table."""
    count = str(min(study.runs, runs) if runs else study.runs)
    shown, summary = run(
        ["study", study.scenario, "--runs", count, "--navigator", study.navigators, *study.options]
    )
    note = f"{study.note}\n\n" if study.note else ""
    return f"## {study.title}\n\n{note}<!-- no-run: takes minutes -->\n```console\n{shown}\n```\n\n{table(summary)}\n"


def real_soundings(runs: int | None) -> str:
    """Aburatsubo: leave-days-out teams for both classes of drift."""
    text = (
        "## Real soundings (Aburatsubo bay)\n\n"
        "Each team follows three survey days; their positions and soundings are real, the chart is gridded from the "
        "other days' soundings, odometry and acoustic ranges are simulated (20 % loss). The recording is not part of "
        "this project.\n"
    )
    if not (REFERENCE / aburatsubo.RECORDING).is_file():
        return text + "\nThe recording was absent when this page was written.\n"
    count = str(min(20, runs) if runs else 20)
    navigators = "dead-reckoning,dmpf,mpf-terrain-only,mpf"
    with tempfile.TemporaryDirectory() as folder:
        for drift in ("dvl", "no-dvl"):
            for team in aburatsubo.teams(REFERENCE):
                out = Path(folder) / f"{team[0][:8]}-{drift}"
                scenario = aburatsubo.write_team(REFERENCE, team, out, drift)
                shown, summary = run(["study", str(scenario), "--runs", count, "--navigator", navigators])
                shown = shown.replace(folder, "OUT")
                days = ", ".join(name[:8] for name in team)
                text += f"\n### Days {days}, drift `{drift}`\n\n<!-- no-run: takes minutes -->\n```console\n"
                text += f"python studies/aburatsubo.py REFERENCE OUT\n{shown}\n```\n\n{table(summary)}\n"
    return text


def speed() -> str:
    """The side-by-side comparison with NumPy, as it prints itself."""
    script = ROOT / "benches" / "python" / "side_by_side.py"
    done = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        check=False,  # a bar that is missed ends it with 1; the page shows which
        env={**os.environ, "COLUMNS": "130", "NO_COLOR": "1"},
    )
    return (
        "## Speed\n\nThread CPU time, least of many repeats, alternated in one process: the ratios count.\n\n"
        "<!-- no-run: takes minutes -->\n```console\npython benches/python/side_by_side.py\n```\n\n"
        f"```text\n{done.stdout.strip()}\n```\n"
    )


def main() -> None:
    """Runs everything and writes the page whole."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, help="at most so many runs for each study")
    runs = parser.parse_args().runs
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    page = [HEADER.format(machine=machine)]
    for study in STUDIES:
        print(study.title, file=sys.stderr)
        page.append(section(study, runs))
    page.append(real_soundings(runs))
    page.append(speed())
    (ROOT / "docs" / "results.md").write_text("\n".join(page))


if __name__ == "__main__":
    main()
