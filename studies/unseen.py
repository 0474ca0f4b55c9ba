"""The tables of docs/results/unseen-recordings.md: recordings with default options, and options chosen without them.

python studies/unseen.py table DATA
python studies/unseen.py left-out DATA

DATA holds goats/, plaza/, labyrinth/ and mrclam/. GTSAM's column needs the `gtsam` wheel.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import uwcoop
from uwcoop.importers.datasets.labyrinth import read_labyrinth
from uwcoop.importers.datasets.mrclam import read_mrclam
from uwcoop.importers.datasets.plaza import read_plaza
from uwcoop.importers.datasets.pyfg import read_pyfg
from uwcoop.importers.datasets.recording import (
    LabyrinthOptions,
    Options,
    PlazaOptions,
    PyfgOptions,
    Recording,
)

PATHS = {
    "goats-14": "goats/goats_14.pyfg",
    "goats-15": "goats/goats_15.pyfg",
    "plaza-1": "plaza/Plaza1_.mat",
    "labyrinth": "labyrinth/Indoor_UWB_Input.txt",
}
PLAZA_TURNS_DEG = (90, 180, -90)
WHITE = [
    "recording.sigma_range_bias_share=0", "recording.sigma_range_drift_share=0",
    "recording.late_share=0", "recording.noise_scale_max=1",
]  # fmt: skip
"""As if every error of a range were new, and noise as stated."""
HUBER = 1.345
ANEES_MOST = 3.0
SHARES, DRIFT_S = (0.0, 0.5, 1.0, 1.5), (15.0, 30.0, 60.0)
POSE_S = {"goats-14": 7.0, "goats-15": 9.0}
"""Mean time between poses, where the mission's second is a pose."""


def main() -> None:
    """One table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("table", choices=["table", "left-out"])
    parser.add_argument("data", type=Path)
    parser.add_argument("--runs", type=int, default=30, help="draws of priors and losses, for MRCLAM")
    arguments = parser.parse_args()
    if arguments.table == "table":
        defaults(arguments.data)
        mrclam(arguments.data, arguments.runs)
    else:
        left_out(arguments.data)


def scored(path: Path, overrides: Sequence[str] = ()) -> dict[str, float]:
    """Error and consistency of `mdeif` for the moving vehicle."""
    summary = uwcoop.run(path, ["mdeif"], overrides=list(overrides), clouds=False).summary
    return next(iter(summary["navigators"]["mdeif"]["vehicles"].values()))


def defaults(data: Path) -> None:
    """`mdeif` with default options beside what it was with white noise, and GTSAM's robust smoother."""
    print(
        "| recording | RMSE (m) | 95 % (m) | ANEES | gated | RMSE, white (m) | ANEES, white | ISAM2, Huber (m) | ratio |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, place in PATHS.items():
        path = data / place
        reference = robust_rmse_m(name, path)
        for told, stated in variants(name, path):
            found, white = scored(path, stated), scored(path, [*stated, *WHITE])
            ratio = "-" if reference is None else f"{found['rmse_m'] / reference:.2f}"
            print(
                f"| {told} | {found['rmse_m']:.3g} | {found['p95_error_m']:.3g} | {found['anees']:.2f} | "
                f"{found['rejected']} | {white['rmse_m']:.3g} | {white['anees']:.1f} | "
                f"{'-' if reference is None else f'{reference:.3g}'} | {ratio} |",
                flush=True,
            )


def variants(name: str, path: Path) -> list[tuple[str, list[str]]]:
    """A recording as it is, and the mower's with headings of its start that are stated wrongly or known."""
    if name != "plaza-1":
        return [(name, [])]
    yaw_rad = read_plaza(path).start[2]
    turned = [
        (f"{name}, heading turned by {turn}°",
         [f"recording.start_yaw_rad={np.angle(np.exp(1j * (yaw_rad + np.radians(turn)))):.6f}"])
        for turn in PLAZA_TURNS_DEG
    ]  # fmt: skip
    known = (f"{name}, heading known to 3°", ["recording.sigma_start_yaw_rad=0.05"])
    return [(name, []), *turned, known]


def robust_rmse_m(name: str, path: Path) -> float | None:
    """ISAM2 with a Huber loss on the same odometry and ranges, told the true heading at the start."""
    if find_spec("gtsam") is None:
        return None
    from plaza_gtsam import online_rmse_m

    found, options = recording_of(name, path)
    return online_rmse_m(found, options, HUBER)


def recording_of(name: str, path: Path) -> tuple[Recording, Options]:
    """What the reader makes of a file, with its options' defaults."""
    if name.startswith("goats"):
        return read_pyfg(path), PyfgOptions()
    if name == "plaza-1":
        return read_plaza(path), PlazaOptions()
    found = read_labyrinth(path)
    return replace(found, start=(*found.start[:2], float(found.truth[0, 2]))), LabyrinthOptions()


def mrclam(data: Path, runs: int) -> None:
    """`landmark` for each robot that can be the landmark; priors and losses are drawn anew in each run."""
    folder = data / "mrclam" / "MRCLAM_Dataset6"
    print(f"\nMRCLAM 6, {runs} runs each\n")
    print("| landmark | robot | RMSE, median (m) | dead reckoning (m) | ANEES, mean | median |")
    print("|---|---|---|---|---|---|")
    for number in range(1, 6):
        rows: dict[str, list[tuple[float, float, float]]] = {}
        try:
            for seed in range(runs):
                log = read_mrclam(folder, seed, landmark=number)
                summary = uwcoop.run(log, ["landmark", "dead-reckoning-dvl"], clouds=False).summary
                ours, alone = (
                    summary["navigators"][n]["vehicles"] for n in ("landmark", "dead-reckoning-dvl")
                )
                for vehicle, found in ours.items():
                    if vehicle != f"R{number}" and found["rmse_m"] is not None:
                        rows.setdefault(vehicle, []).append(
                            (found["rmse_m"], alone[vehicle]["rmse_m"], found["anees"])
                        )
        except uwcoop.errors.UwcoopError as reason:
            print(f"| R{number} | - | {str(reason).rsplit(': ', 1)[-1]} | | | |")
            continue
        if not rows:
            print(f"| R{number} | - | it stands for {log.duration_ns / 1e9:.1f} s only | | | |")
        for vehicle, told in rows.items():
            rmse, alone_m, anees = np.array(told).T
            print(
                f"| R{number} | {vehicle} | {np.median(rmse):.2f} | {np.median(alone_m):.2f} | "
                f"{anees.mean():.2f} | {np.median(anees):.2f} |",
                flush=True,
            )


def left_out(data: Path) -> None:
    """Prior of a range's lasting errors chosen on three recordings, judged on the fourth.

    Of the choices with which each of the three has an ANEES of at most 3, that with the least product of their errors;
    where there is none, that with the least of the largest ANEES.
    """
    grid = [(bias, drift, time) for bias, drift, time in itertools.product(SHARES, SHARES, DRIFT_S)
            if drift > 0 or time == DRIFT_S[0]]  # fmt: skip
    table = {
        name: [
            scored(data / place, [
                f"recording.sigma_range_bias_share={bias}", f"recording.sigma_range_drift_share={drift}",
                f"recording.range_drift_s={time / POSE_S.get(name, 1.0)}",
            ])
            for bias, drift, time in grid
        ]
        for name, place in PATHS.items()
    }  # fmt: skip
    print(
        "| left out | bias, share of sigma | drift, share | drift time (s) | largest ANEES of the others | RMSE (m) "
        "| ANEES |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in PATHS:
        others = [
            (max(table[other][k]["anees"] for other in PATHS if other != name),
             float(np.prod([table[other][k]["rmse_m"] for other in PATHS if other != name])), k)
            for k in range(len(grid))
        ]  # fmt: skip
        fit = [(error, anees, k) for anees, error, k in others if anees <= ANEES_MOST]
        k = min(fit)[2] if fit else min(others)[2]
        (bias, drift, time), found = grid[k], table[name][k]
        print(f"| {name} | {bias:g} | {drift:g} | {time:g} | {others[k][0]:.2f} | "
              f"{found['rmse_m']:.3g} | {found['anees']:.2f} |")  # fmt: skip


if __name__ == "__main__":
    main()
