"""The indoor UWB files of libRSF: made up and, where they are at hand, real."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from uwcoop.errors import LogError
from uwcoop.experiment.mission import open_mission
from uwcoop.importers.datasets.labyrinth import read_labyrinth

ANCHORS = {105: (0.0, 0.0), 107: (0.0, 3.0), 108: (3.0, 3.0)}


def files(folder: Path, steps: int = 80, step_s: float = 0.25) -> Path:
    """A robot that drives an arc of 1 m radius at 0.1 m/s, wheels 0.2 m apart (half of it in the file)."""
    turn = 0.1 * step_s
    angle = np.arange(steps + 1) * turn
    place = np.column_stack([1.5 + np.sin(angle), 1.0 + 1.0 - np.cos(angle)])
    times = 0.5 + np.arange(steps + 1) * step_s
    rows = ["odom2diff 0.5 0 0 0 0.1 1e-4 1e-4 1e-4"]
    rows += [f"odom2diff {t} 0.09 0.11 0 0.1 1e-4 1e-4 1e-4" for t in times[1:]]
    for k, t in enumerate(times):
        number = list(ANCHORS)[k % 3]
        x, y = ANCHORS[number]
        rows.append(f"range2 {t} {math.dist(place[k], (x, y))} 0.01 {x} {y} {number} 0")
    path = folder / "arc_Input.txt"
    path.write_text("\n".join(rows) + "\n")
    truth = [f"point2 {t} {x} {y} 0 0 0 0" for t, (x, y) in zip(times, place, strict=True)]
    (folder / "arc_GT.txt").write_text("\n".join(truth) + "\n")
    return path


def dead_reckoning_m(path: Path, heading_rad: float) -> float:
    """RMS error of the odometry from the true start."""
    found = read_labyrinth(path)
    yaw = heading_rad + np.concatenate([[0.0], np.cumsum(found.yaw_change_rad)])[:-1]
    forward, left = found.displacement_m.T
    step = np.column_stack(
        [forward * np.cos(yaw) - left * np.sin(yaw), forward * np.sin(yaw) + left * np.cos(yaw)]
    )
    place = np.cumsum(step, axis=0) + found.start[:2]
    true = np.column_stack([np.interp(found.odometry_s, found.truth_s, found.truth[:, k]) for k in range(2)])
    return float(np.sqrt(((place - true) ** 2).sum(axis=1).mean()))


def test_odometry_follows_the_truth(tmp_path: Path) -> None:
    path = files(tmp_path)
    assert dead_reckoning_m(path, 0.0) < 1e-3
    log = open_mission(path)
    assert log.name == "arc"
    assert log.vehicles == ("robot", "L105", "L107", "L108")
    assert log.events["heading"]["sigma_rad"][0] > math.pi
    assert read_labyrinth(path).truth[0, 2] == pytest.approx(0.0125, abs=1e-3)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("range3 1 2 3 4 5 6 7", "line 2 is 'range3 1 2 3"),
        ("range2 1 2 3", "line 2 is 'range2 1 2 3'"),
        ("range2 1 x 0.01 0 0 105 0", "line 2 holds what is not a finite number"),
        ("range2 1 -2 0.01 0 0 105 0", "must be above 0"),
        ("odom2diff 0.1 0 0 0 0.1 0 0 0", "times of odom2diff and point2 must ascend"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, line: str, message: str) -> None:
    path = files(tmp_path)
    first, rest = path.read_text().split("\n", 1)
    path.write_text(f"{first}\n{line}\n{rest}")
    with pytest.raises(LogError, match=message) as refused:
        open_mission(path)
    assert "\n" not in str(refused.value)


def test_the_truth_must_be_beside_it(tmp_path: Path) -> None:
    path = files(tmp_path)
    (tmp_path / "arc_GT.txt").unlink()
    with pytest.raises(LogError, match=r"no arc_GT\.txt beside it"):
        open_mission(path)


def test_the_real_odometry_follows_the_truth(reference: Path) -> None:
    """Left wheel first, twice the stated distance between the wheels: at the heading that fits best, 0.1 m."""
    path = reference / "data/labyrinth/Indoor_UWB_Input.txt"
    best_m = min(dead_reckoning_m(path, heading) for heading in np.radians(np.arange(-180.0, 180.0, 2.0)))
    assert best_m < 0.15
