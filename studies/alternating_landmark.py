"""Writes docs/results/alternating-landmark.md: two vehicles that take turns as the landmark, and what bytes cost.

python studies/alternating_landmark.py [--runs N] [--only NAME,...] [--figures DIR]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from uwcoop.evaluation import metrics
from uwcoop.experiment.mission import open_mission
from uwcoop.experiment.run import run

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "results" / "alternating-landmark.md"
KEPT = ROOT / "docs" / "results" / "alternating-landmark.json"
REFERENCE = Path(os.environ.get("UWCOOP_REFERENCE", ROOT / ".." / "shared")).resolve()
COMMAND = "python studies/alternating_landmark.py"
WITHIN = (0.3, 1.0)
"""Metres and degrees: the accuracy that Matsuda et al. (2017) report."""
FAILED = (1.0, 5.0)

Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """Lines of a table: navigators with options, on missions."""

    mission: str
    navigators: tuple[str, ...]
    overrides: tuple[str, ...] = ()
    note: str = ""
    """Put after the navigator's name."""
    runs: int = 50
    """At most so many."""

    def label(self, navigator: str) -> str:
        return f"`{navigator}`" + (f", {self.note}" if self.note else "")


def fly(job: tuple[Case, int]) -> dict[str, Row]:
    """One mission: by line, what the run's vehicles make together, and how often its navigators reset."""
    case, seed = job
    log = open_mission(case.mission, seed, None, case.overrides)
    result = run(log, case.navigators, clouds=False)
    rows = metrics.rows(result.tracks, seconds=result.seconds, packets=result.packets)
    found = {}
    for i, navigator in enumerate(case.navigators):
        own = [row for row in rows if row["navigator"] == navigator]
        found[case.label(navigator)] = _of_run(own, result.tracks.isel(navigator=i))
    return found


def _of_run(rows: Sequence[Row], tracks: Any) -> Row:
    counts = {
        name: float(np.nansum(tracks[name].values[:, -1]))
        for name in ("resets", "reconstructions")
        if name in tracks
    }

    def pooled(key: str) -> float:
        values = [row[key] for row in rows]
        return float(np.sqrt(np.mean(np.square([np.nan if v is None else v for v in values]))))

    anees = [row["state_anees_per_dof"] for row in rows if row["state_anees_per_dof"] is not None]
    return {
        "seed": rows[0]["seed"],
        "rmse_m": pooled("rmse_m"),
        "yaw_rmse_deg": pooled("yaw_rmse_deg"),
        "worst_m": max(row["rmse_m"] for row in rows),
        "worst_deg": max(row["yaw_rmse_deg"] or 0.0 for row in rows),
        "anees": float(np.mean(anees)) if anees else float("nan"),
        "sub_anees": float(np.mean(anees[2:])) if len(anees) > 2 else float("nan"),
        "bytes": rows[0]["packet_bytes_max"],
        "seconds": rows[0]["seconds"],
        **counts,
    }


def many(cases: Sequence[Case], runs: int, processes: int) -> dict[str, list[Row]]:
    """Every line on the same seeds."""
    jobs = [(case, seed) for case in cases for seed in range(min(runs, case.runs))]
    found: dict[str, list[Row]] = {}
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        for rows in pool.map(fly, jobs, chunksize=2):
            for label, row in rows.items():
                found.setdefault(label, []).append(row)
    return found


def summary(rows: Iterable[Row]) -> Row:
    """What a table says of one case."""
    table = list(rows)

    def column(key: str) -> Any:
        return np.array(
            [row.get(key, np.nan) if row.get(key) is not None else np.nan for row in table], dtype=float
        )

    error, yaw = column("rmse_m"), column("yaw_rmse_deg")
    failed = (column("worst_m") > FAILED[0]) | (column("worst_deg") > FAILED[1])
    return {
        "runs": len(table),
        "rmse_m": float(np.median(error)),
        "yaw_deg": float(np.median(yaw)),
        "within": float(((error <= WITHIN[0]) & (yaw <= WITHIN[1])).mean()),
        "under_035": float((error <= 0.35).mean()),
        "failed": float(failed.mean()),
        "anees": float(np.mean(column("anees"))),
        "sub_anees": float(np.mean(column("sub_anees"))),
        "bytes": float(np.nanmax(column("bytes"))) if np.isfinite(column("bytes")).any() else None,
        "resets": float(np.nansum(column("resets"))),
        "reconstructions": float(np.nanmean(column("reconstructions")))
        if "reconstructions" in table[0]
        else None,
        "seconds": float(np.median(column("seconds"))),
    }


CHEAP = ("dead-reckoning-dvl", "landmark-ekf", "landmark")
PAPER = ("landmark-paper",)
TRIAL = ("navigator.landmark-paper.particles=300", "navigator.landmark-paper.reconstruction=false")
LINEAR = ("navigator.landmark-paper.monitor_reading=linear",)
RECOVERY = ("kidnap", "tried")
"""Tables that say how many runs stay below 0.35 m."""
SIZES = (8, 16, 32, 40, 64, 128)
FEW = 12
"""Runs of lines that illustrate: 3,000 particles take a second a mission."""


def four(mission: str, *overrides: str, paper: int = FEW) -> list[Case]:
    return [Case(mission, CHEAP, overrides), Case(mission, PAPER, overrides, runs=paper)]


def states(on: bool, share: float = 0.5) -> tuple[str, ...]:
    return (
        f"navigator.landmark.bias_states={'true' if on else 'false'}",
        f"navigator.landmark.bias_share={share}",
    )


def others(*variants: tuple[str, str]) -> list[Case]:
    """What was tried, on the two missions that recovery is torn between."""
    return [
        Case(mission, ("landmark",), (*overrides, f"navigator.landmark.{option}"), f"{note}: {name}")
        for note, option in variants
        for name, mission, overrides in (
            ("turned", "seafloor-survey-kidnap", ()),
            ("20 % outliers", "seafloor-survey-outliers", ("mutual.outlier_share=0.2",)),
        )
    ]


def voted(mission: str, *overrides: str) -> Case:
    vote = "navigator.landmark.recovery_by=consensus"
    return Case(mission, ("landmark",), (*overrides, vote), "by consensus")


def sized(mission: str, sizes: Sequence[int], runs: int) -> list[Case]:
    return [
        Case(mission, ("landmark",), (f"navigator.landmark.packet_bytes={size}",), f"{size} B", runs)
        for size in sizes
    ]


TABLES: dict[str, tuple[str, str, list[Case]]] = {
    "survey": (
        "The sea trial's mission (`seafloor-survey`)",
        "Table 4's white noise, 1,070 s, three exchanges. *As in the trial*: 300 particles, no reconstruction.",
        [
            Case("seafloor-survey", CHEAP),
            Case("seafloor-survey", PAPER),
            Case("seafloor-survey", PAPER, TRIAL, "as in the trial"),
            Case("seafloor-survey", PAPER, LINEAR, "monitor as printed", FEW),
            Case("seafloor-survey", ("landmark",), states(True), "bias states"),
            Case("seafloor-survey", ("landmark",), states(True, 1.0), "bias states alone"),
        ],
    ),
    "kidnap": (
        "Turned by 20° without a measurement of it (`seafloor-survey-kidnap`)",
        "The error includes the time before the turn is detected. *By consensus*: a vote of the last "
        "positionings in place of alternative hypotheses with odds.",
        [
            *four("seafloor-survey-kidnap"),
            voted("seafloor-survey-kidnap"),
            Case("seafloor-survey-kidnap", PAPER, TRIAL, "as in the trial"),
        ],
    ),
    "outliers": (
        "10 % outliers in each measurement (`seafloor-survey-outliers`)",
        "",
        four("seafloor-survey-outliers"),
    ),
    "outliers20": (
        "20 % outliers (`--set mutual.outlier_share=0.2`)",
        "",
        [
            *four("seafloor-survey-outliers", "mutual.outlier_share=0.2"),
            voted("seafloor-survey-outliers", "mutual.outlier_share=0.2"),
        ],
    ),
    "bias": (
        "Gyro bias, DVL scale and misalignment (`seafloor-survey-bias`)",
        "One sigma: 0.01 °/s, 1 %, 0.5°. *Alone*: without a second filter that assumes no biases.",
        [
            Case("seafloor-survey-bias", ("landmark",), states(True), "bias states"),
            Case("seafloor-survey-bias", ("landmark",), states(True, 1.0), "bias states alone"),
            Case("seafloor-survey-bias", ("dead-reckoning-dvl", "landmark-ekf", "landmark"), states(False)),
            Case("seafloor-survey-bias", PAPER, runs=FEW),
        ],
    ),
    "tried": (
        "What was tried and did not help",
        """Recovery must detect a turn soon and must not mistake outliers for a turn. Defaults: odds 10, outlier
share 0.05, jumps of 0.2 m and 30°, a window of 8.

* A vote of the last positionings was the earlier method (*by consensus*, above). A lower threshold detects turns
  sooner and gives more false alarms, which cannot be reversed. A vote in addition to the odds had the same false
  alarms.
* Lower odds detect a turn sooner and give more false alarms; higher odds give as many false alarms and detect a turn
  later.
* A likelihood with a larger outlier share gives as many false alarms, and detects a turn later.
* Wider jumps and a longer window change nothing.
* Fewer states for biases: without the gyro's, the misalignment or the scale, the loss where there are no biases is
  still at least a third of that with all three. Averaging over the models with and without biases helps.""",
        others(
            ("odds 1", "jump_odds=1"),
            ("odds 100", "jump_odds=100"),
            ("odds 1,000", "jump_odds=1000"),
            ("outlier share 0.15", "outlier_share=0.15"),
            ("jumps of 60°", "jump_sigma_yaw_deg=60"),
            ("window of 15", "jump_window=15"),
        ),
    ),
    "bytes": (
        "Bytes of the exchange packet (`seafloor-survey`)",
        "An estimate with one mode is sent in 32 bytes where 64 or 128 are allowed.",
        sized("seafloor-survey", SIZES, 50),
    ),
    "team": (
        "Two main vehicles and three subs (`seafloor-survey-team`)",
        "",
        four("seafloor-survey-team"),
    ),
    "km": (
        "A kilometre, 66 exchanges (`seafloor-survey-1km`)",
        "Only the first landmark's pose is known: errors grow, and the covariances must grow with them. 8 and"
        " 16 bytes are too few for so many exchanges: an estimate that does not fit is not sent.",
        [*sized("seafloor-survey-1km", (32, 40), 20), *sized("seafloor-survey-1km", (8, 16), 6)],
    ),
}


def recorded(runs: int, processes: int) -> dict[str, list[Row]] | None:
    """The real robots, with other priors and losses in each run; None where the data set is absent."""
    folder = REFERENCE / "data" / "mrclam" / "MRCLAM_Dataset6"
    if not folder.is_dir():
        return None
    return many(four(str(folder)), runs, processes)


def page(found: Mapping[str, Mapping[str, Row]]) -> str:
    """The page's text."""
    text = HEADER.format(
        machine=f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    )
    for key, (title, note, _) in {**TABLES, "recorded": RECORDED}.items():
        if key not in found:
            continue
        text += f"\n## {title}\n\n" + (f"{note}\n\n" if note else "")
        only = f" --only {key}" if key != "recorded" else " --only recorded"
        runs = max(row["runs"] for row in found[key].values())
        text += f"<!-- no-run: takes minutes -->\n```console\n{COMMAND}{only} --runs {runs}\n```\n\n"
        text += _table(found[key], key)
    return text


def _table(cases: Mapping[str, Row], key: str) -> str:
    heads = [
        "navigator",
        "runs",
        "error, RMS (m)",
        "yaw, RMS (°)",
        "within 0.3 m, 1°",
        "failed",
        "state NEES / dof",
    ]
    heads += ["≤ 0.35 m"] * (key in RECOVERY) + ["subs' NEES / dof"] * (key == "team")
    heads += ["resets", "packet (B)", "run time (s)"]
    text = "| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|\n"
    for label, row in cases.items():
        cells = [
            label,
            f"{row['runs']}",
            f"{row['rmse_m']:.3g}",
            f"{row['yaw_deg']:.2g}",
            f"{row['within']:.0%}",
            f"{row['failed']:.0%}",
        ]
        cells += [f"{row['anees']:.2f}"]
        cells += [f"{row['under_035']:.0%}"] * (key in RECOVERY) + [f"{row['sub_anees']:.2f}"] * (
            key == "team"
        )
        again = f"{row['reconstructions']:.1f} a run" if row["reconstructions"] else f"{row['resets']:.0f}"
        cells += [again, "-" if row["bytes"] is None else f"{row['bytes']:.0f}", f"{row['seconds']:.2f}"]
        text += "| " + " | ".join(cells) + " |\n"
    return text


HEADER = """\
# Alternating landmark

Two hovering vehicles take turns as the landmark (Matsuda et al. 2017). Run k has seed k for every line of a table.
A run's error is the root mean square over both (all) vehicles and all instants after the
first 100 s; the tables give its median over runs. *Within*: share of runs whose error is at most 0.3 m and 1.0°, what
the paper reports. *Failed*: share of runs in which one vehicle's is above 1 m or 5°. State NEES: of east, north and
yaw, per degree of freedom, mean over runs; ideal 1, above it overconfident. Resets: of all runs together, or
reconstructions of particles a run. The paper's figures, and time against particles, are on
[their own page](matsuda2017.md). Measured on {machine}.
"""
RECORDED = (
    "Real robots (UTIAS MRCLAM, data set 6)",
    "Ranges and bearings of real robots: R1 stood still for 128 s (by its odometry), R3, R4 and R5 moved. Priors "
    "(1 m, 5°), the schedule (one fix a second at most) and 10 % losses are simulated, with new random draws "
    "in each run. "
    "Errors count after 10 s. No role is exchanged.",
    [],
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--only", default="")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--figures", type=Path, help="folder for bytes.png")
    told = parser.parse_args()
    chosen = told.only.split(",") if told.only else [*TABLES, "recorded"]
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {"tables": {}}
    for key in chosen:
        found = (
            recorded(told.runs, told.processes)
            if key == "recorded"
            else many(TABLES[key][2], told.runs, told.processes)
        )
        if found is not None:
            kept["tables"][key] = {label: summary(rows) for label, rows in found.items()}
            print(_table(kept["tables"][key], key), flush=True)
        PAGE.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps(kept, indent=1) + "\n")
    KEPT.write_text(json.dumps(kept, indent=1) + "\n")
    PAGE.write_text(page(kept["tables"]), encoding="utf-8")
    if told.figures and "bytes" in kept["tables"]:
        from uwcoop.figures.landmark_study import bytes_figure

        told.figures.mkdir(exist_ok=True)
        bytes_figure(kept["tables"]["bytes"].values()).savefig(told.figures / "bytes.png")


if __name__ == "__main__":
    main()
