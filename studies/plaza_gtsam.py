"""Plaza 1 through `cekf` and through GTSAM's incremental smoother (ISAM2), on the same odometry and ranges.

    python studies/plaza_gtsam.py DATA/plaza/Plaza1_.mat

Needs the `gtsam` wheel. Both are judged online: by the pose of each instant when it is the newest.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import uwcoop
from uwcoop.importers.datasets.plaza import read_plaza
from uwcoop.importers.datasets.recording import Options, PlazaOptions, Recording


def compared(path: Path) -> tuple[float, float]:
    """RMSE of `cekf` and of ISAM2 on the 1 Hz grid, m."""
    known = ["recording.sigma_start_yaw_rad=0.01"]
    result = uwcoop.run(path, ["cekf"], overrides=known, clouds=False)
    ours = result.summary["navigators"]["cekf"]["vehicles"]["mower"]["rmse_m"]
    found = read_plaza(path)
    return ours, online_rmse_m(found, PlazaOptions())


def online_rmse_m(found: Recording, options: Options, huber: float | None = None) -> float:
    """RMSE of ISAM2 on the 1 Hz grid; `huber`: its loss of a range bends at so many sigmas."""
    time_s, place = isam(found, options, huber)
    grid = np.arange(1.0, found.truth_s[-1])
    # The newest pose at each second; between two, a filter holds the last one.
    held = place[np.searchsorted(time_s, grid, side="right") - 1]
    true = np.column_stack([np.interp(grid, found.truth_s, found.truth[:, axis]) for axis in range(2)])
    return float(np.sqrt(((held - true) ** 2).sum(axis=1).mean()))


def isam(found: Recording, options: Options, huber: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Times and newest positions; an update at every range."""
    import gtsam

    smoother = gtsam.ISAM2(gtsam.ISAM2Params())
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pose = gtsam.Pose2(*found.start)
    sigma = np.array([options.sigma_start_m, options.sigma_start_m, 0.01])
    factors.add(gtsam.PriorFactorPose2(0, pose, gtsam.noiseModel.Diagonal.Sigmas(sigma)))
    values.insert(0, pose)
    keys = {name: gtsam.symbol("l", k) for k, name in enumerate(found.beacons)}
    for name, place in found.beacons.items():
        known = gtsam.noiseModel.Isotropic.Sigma(2, options.sigma_beacon_m)
        factors.add(gtsam.PriorFactorPoint2(keys[name], np.array(place), known))
        values.insert(keys[name], np.array(place))
    order = np.argsort(found.range_s, kind="stable")
    heard = gtsam.noiseModel.Isotropic.Sigma(1, options.sigma_range_m)
    if huber is not None:
        heard = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(huber), heard)
    time_s, place, k = [0.0], [found.start[:2]], 0
    rows = zip(found.odometry_s, found.displacement_m, found.yaw_change_rad, strict=True)
    for i, (at_s, (forward, left), turn) in enumerate(rows, 1):
        moved = gtsam.Pose2(forward, left, turn)
        slip = options.sigma_odometry_share * float(np.hypot(forward, left))
        sigma = np.array([
            np.hypot(options.sigma_odometry_m, slip), np.hypot(options.sigma_odometry_m, slip / 3), options.sigma_yaw_rad,
        ])  # fmt: skip
        factors.add(gtsam.BetweenFactorPose2(i - 1, i, moved, gtsam.noiseModel.Diagonal.Sigmas(sigma)))
        pose = pose.compose(moved)
        values.insert(i, pose)
        ranged = False
        # A range is of the pose that is nearest in time.
        next_s = found.odometry_s[i] if i < len(found.odometry_s) else np.inf
        while k < len(order) and found.range_s[order[k]] <= 0.5 * (at_s + next_s):
            row, k, ranged = order[k], k + 1, True
            factors.add(gtsam.RangeFactor2D(i, keys[found.range_beacon[row]], found.range_m[row], heard))
        if ranged:
            smoother.update(factors, values)
            factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            pose = smoother.calculateEstimatePose2(i)
        time_s.append(at_s)
        place.append((pose.x(), pose.y()))
    return np.array(time_s), np.array(place)


if __name__ == "__main__":
    ours, theirs = compared(Path(sys.argv[1]))
    print(f"online RMSE on the 1 Hz grid: cekf {ours:.3f} m, ISAM2 {theirs:.3f} m, ratio {ours / theirs:.4f}")
