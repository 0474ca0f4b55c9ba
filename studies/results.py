"""Writes the tables of docs/results/: every figure that the project states, from the commands that stand beside it.

    python studies/results.py [PAGE ...] [--runs N] [--keep FOLDER]

Pages are those of `PAGES`; without any, all are written, which takes some hours on two cores. `--keep` holds the
studies' folders: what is there is not flown again, and `--figures` need no second run.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import aburatsubo
import navo
from pages import PAGES, Page, Study

ROOT = Path(__file__).parents[1]
REFERENCE = Path(os.environ.get("UWCOOP_REFERENCE", ROOT / ".." / "shared")).resolve()
UWCOOP = Path(sys.executable).with_name("uwcoop")
ABSENT = "\nThe recording was absent when this page was written.\n"


@dataclass(frozen=True)
class Keeper:
    """Where studies are kept, and how many runs they have at most."""

    folder: Path
    runs: int | None

    def count(self, runs: int) -> int:
        """Runs of a study that should have so many."""
        return min(runs, self.runs) if self.runs else runs

    def run(self, study: Study) -> tuple[str, dict[str, Any]]:
        """The command as a reader would type it, and its JSON."""
        arguments = ["study", study.scenario, "--runs", str(self.count(study.runs))]
        arguments += ["--navigator", study.navigators, *study.options]
        shown = "uwcoop " + " ".join(f'"{a}"' if " " in a else a for a in arguments)
        kept = ["-o", str(self.folder / study.slug), "--resume"]
        print(shown, file=sys.stderr, flush=True)
        done = subprocess.run(
            [str(UWCOOP), *arguments, *kept, "--json"], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(f"{shown}: {done.stderr.strip().splitlines()[-1]}")
        return shown, json.loads(done.stdout)


def table(summary: dict[str, Any]) -> str:
    """A study's summary as a Markdown table."""
    varied = list(summary["variants"][0]["set"])
    head = [*varied, "navigator", "final error, median (m)", "95 % (m)", "RMSE, median (m)", "ANEES, mean", "median",
            "lost", "packet (B)"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for variant in summary["variants"]:
        for name, v in variant["navigators"].items():
            cells = [*(str(variant["set"][k]) for k in varied), f"`{name}`", number(v["median_final_error_m"]),
                     number(v["p95_final_error_m"]), number(v["median_rmse_m"]), number(v["anees"]),
                     number(v["anees_median"]), f"{100 * v['lost_share']:.0f} %",
                     f"{v['packet_bytes_max']:,}" if v["packet_bytes_max"] else "-"]  # fmt: skip
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def number(value: float | None) -> str:
    """Two decimals below ten, one below a hundred, none above."""
    if value is None:
        return "-"
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.3g}"


def section(study: Study, keeper: Keeper, shown_as: tuple[str, str] = ("", ""), level: str = "##") -> str:
    """One study's heading, note, command and table; in the command a folder is shown by another name."""
    shown, summary = keeper.run(study)
    if shown_as[0]:
        shown = shown.replace(*shown_as)
    before = f"{study.before}\n" if study.before else ""
    note = f"{study.note}\n\n" if study.note else ""
    return (
        f"{level} {study.title}\n\n{note}<!-- no-run: takes minutes -->\n"
        f"```console\n{before}{shown}\n```\n\n{table(summary)}\n"
    )


def real_soundings(page: Page, keeper: Keeper) -> str:
    """The page of recordings: a chart of a bottom that cannot localise, and teams on a bay's soundings."""
    text = [f"# {page.title}\n\n{page.intro}\n"]
    with tempfile.TemporaryDirectory() as folder:
        text += [section(study, keeper) for study in page.studies]
        text.append(_navo(Path(folder), keeper))
        text.append(_aburatsubo(Path(folder), keeper))
    return "\n".join(text)


def _navo(folder: Path, keeper: Keeper) -> str:
    if not (REFERENCE / navo.CHART).is_file():
        return f"## A bottom that cannot localise\n{ABSENT}"
    study = Study(
        "A seabed without enough relief",
        str(navo.write_mission(REFERENCE, folder / "navo")),
        20,
        "dead-reckoning,dmpf,mpf-terrain-only,mpf",
        note=navo.NOTE,
        before="python studies/navo.py REFERENCE OUT",
        slug="navo",
    )
    return section(study, keeper, (str(folder / "navo"), "OUT"))


def _aburatsubo(folder: Path, keeper: Keeper) -> str:
    text = f"## Teams on real soundings (Aburatsubo bay)\n\n{aburatsubo.NOTE}\n"
    if not (REFERENCE / aburatsubo.RECORDING).is_file():
        return text + ABSENT
    for drift in ("dvl", "no-dvl"):
        for team in aburatsubo.teams(REFERENCE):
            name = f"{team[0][:8]}-{drift}"
            scenario = aburatsubo.write_team(REFERENCE, team, folder / name, drift)
            days = ", ".join(day[:8] for day in team)
            study = Study(
                f"Days {days}, drift `{drift}`",
                str(scenario),
                20,
                "dead-reckoning,dmpf,mpf-terrain-only,mpf",
                before="python studies/aburatsubo.py REFERENCE OUT",
                slug=f"aburatsubo-{name}",
            )
            text += "\n" + section(study, keeper, (str(folder), "OUT"), "###")
    return text


def main() -> None:
    """Runs what was asked for and writes each page whole."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=f"of {', '.join(PAGES)}; default: all")
    parser.add_argument("--runs", type=int, help="at most so many runs for each study")
    parser.add_argument(
        "--keep", type=Path, help="folder of the studies' runs, to go on from and to draw from"
    )
    asked = parser.parse_args()
    unknown = sorted(set(asked.pages) - set(PAGES))
    if unknown:
        parser.error(f"page {unknown[0]!r} is unknown: there are {', '.join(PAGES)}")
    with tempfile.TemporaryDirectory() as folder:
        keeper = Keeper(asked.keep or Path(folder), asked.runs)
        for name in asked.pages or PAGES:
            page = PAGES[name]
            if name == "real-soundings":
                text = real_soundings(page, keeper)
            else:
                sections = [section(study, keeper) for study in page.studies]
                text = "\n".join([f"# {page.title}\n\n{page.intro}\n", *sections])
            (ROOT / "docs" / "results" / f"{name}.md").write_text(text)


if __name__ == "__main__":
    main()
