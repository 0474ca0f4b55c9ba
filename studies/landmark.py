"""Runs of an alternating landmark scenario one by one: the shares of runs inside the paper's limits.

    python studies/landmark.py seafloor-survey --runs 50 -n landmark,landmark-paper [--set key=value …]

`uwcoop study` pools all instants; the paper's 0.3 m and 1.0° are limits of a run. Errors count after the scenario's
settling time, over all vehicles of a run.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

import uwcoop

LIMIT_M, LIMIT_DEG = 0.3, 1.0
"""Section V of Matsuda et al. (2017)."""
FAILED_M, FAILED_DEG = 1.0, 5.0


@dataclass(frozen=True)
class Run:
    """One mission of one navigator."""

    rms_m: float
    rms_deg: float
    state_anees_per_dof: tuple[float, ...]
    """By vehicle."""
    resets: float


def measure(tracks: xr.Dataset, navigator: str) -> Run:
    """Errors of a run after the settling time, over all vehicles."""
    own = tracks.sel(navigator=navigator)
    settled = own.time.values > float(tracks.attrs["settle_s"])
    error = (own.position_m - own.truth_position_m).transpose("vehicle", "time", "axis").values[:, settled]
    yaw = (own.yaw_rad - own.truth_yaw_rad).transpose("vehicle", "time").values[:, settled]
    yaw = (yaw + np.pi) % (2 * np.pi) - np.pi
    covariance = own.pose_covariance.values[:, settled]
    pose = np.concatenate([error, yaw[..., None]], axis=-1)
    square = np.einsum("vti,vti->vt", pose, np.linalg.solve(covariance, pose[..., None])[..., 0])
    resets = float(own["resets"].values[:, -1].sum()) if "resets" in own else float("nan")
    return Run(
        rms_m=float(np.sqrt((error**2).sum(-1).mean())),
        rms_deg=float(np.degrees(np.sqrt((yaw**2).mean()))),
        state_anees_per_dof=tuple(float(v) for v in square.mean(1) / 3),
        resets=resets,
    )


def line(name: str, runs: Sequence[Run]) -> str:
    """One navigator's figures."""
    metres = np.array([run.rms_m for run in runs])
    degrees = np.array([run.rms_deg for run in runs])
    anees = np.array([run.state_anees_per_dof for run in runs])
    inside = (metres <= LIMIT_M) & (degrees <= LIMIT_DEG)
    failed = (metres > FAILED_M) | (degrees > FAILED_DEG)
    resets = np.array([run.resets for run in runs])
    each = " ".join(f"{v:.2f}" for v in anees.mean(0))
    return (
        f"{name:20s} rms {np.median(metres):.3f} m {np.median(degrees):.2f} deg (worst {metres.max():.2f} m"
        f" {degrees.max():.2f} deg) | within {LIMIT_M} m and {LIMIT_DEG} deg {inside.mean():.0%} | rms <= 0.35 m"
        f" {(metres <= 0.35).mean():.0%} | failed {failed.mean():.0%} | state_anees_per_dof {anees.mean():.2f}"
        f" (by vehicle {each}) | resets in {(resets > 0).mean():.0%}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("-n", "--navigator", default="landmark")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    chosen = parser.parse_args()
    names = chosen.navigator.split(",")
    runs: dict[str, list[Run]] = {name: [] for name in names}
    for seed in range(chosen.runs):
        result = uwcoop.run(chosen.scenario, names, seed=seed, overrides=chosen.overrides, clouds=False)
        for name in names:
            runs[name].append(measure(result.tracks, name))
    print(f"{chosen.scenario} {' '.join(chosen.overrides)}: {chosen.runs} runs")
    for name in names:
        print(line(name, runs[name]))


if __name__ == "__main__":
    main()
