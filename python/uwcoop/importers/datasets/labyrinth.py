"""The indoor UWB files of libRSF ("Labyrinth", TU Chemnitz): a wheeled robot, ranges to four anchors, many of them late.

`NAME_Input.txt`: `range2 t range variance anchor_x anchor_y anchor snr` and `odom2diff t left right sideways radius …`;
`NAME_GT.txt` beside it: `point2 t x y …`. Seconds, metres, metres per second. Speeds are those of
the interval that ends at t.

The file's description has the right wheel first and calls the last number the distance between the wheels. Only with the
left wheel first and twice that distance does the odometry follow the truth (0.1 m rms over 9 m instead of 1 m): so it is
read here. No heading is measured and the truth has none: its course over ground stands in.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.bounded import refused, text_lines
from uwcoop.importers.datasets.recording import Recording

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

INPUT, TRUTH = "_Input.txt", "_GT.txt"
FIELDS = {"range2": 7, "odom2diff": 5, "point2": 3}
"""Numbers that are read of each line, the first of those that it has."""
MOVED_M = 0.005
"""A course over ground is taken from displacements above this."""


def read_labyrinth(path: Path) -> Recording:
    """Read the robot's odometry, ranges, anchors and truth.

    Raises:
        LogError: not such a file, or no truth beside it; one line.
    """
    beside = path.with_name(path.name.removesuffix(INPUT) + TRUTH)
    if not beside.is_file():
        raise LogError(f"recording {path}: there is no {beside.name} beside it, which holds the truth")
    tables = _tables(path)
    ranges, odometry = tables["range2"], tables["odom2diff"]
    truth = _tables(beside)["point2"]
    if len(ranges) < 1 or len(odometry) < 2 or len(truth) < 2:
        raise LogError(
            f"recording {path} has {len(ranges)} ranges, {len(odometry)} odometry and {len(truth)} truth lines: "
            "must have 1, 2 and 2 at least"
        )
    if (np.diff(odometry[:, 0]) <= 0).any() or (np.diff(truth[:, 0]) <= 0).any():
        raise LogError(f"recording {path}: times of odom2diff and point2 must ascend")
    if (ranges[:, 1] <= 0).any() or (odometry[:, 4] <= 0).any():
        raise LogError(f"recording {path}: ranges and the distance between the wheels must be above 0")
    beacons = {f"L{row[5]:.0f}": (float(row[3]), float(row[4])) for row in ranges}
    start_s = truth[0, 0]
    step_s = np.diff(odometry[:, 0], prepend=odometry[0, 0])
    left, right = odometry[:, 1], odometry[:, 2]
    turn = (right - left) / (2 * odometry[:, 4]) * step_s
    moved = (left + right) / 2 * step_s
    return Recording(
        name=path.name.removesuffix(INPUT).replace(".", "-"),
        vehicle="robot",
        beacons=beacons,
        start=(float(truth[0, 1]), float(truth[0, 2]), 0.0),
        odometry_s=np.maximum(odometry[:, 0] - start_s, 0.0),
        # Along the chord: half of the turn comes before.
        displacement_m=np.column_stack([moved * np.cos(turn / 2), moved * np.sin(turn / 2)]),
        yaw_change_rad=turn,
        range_s=np.maximum(ranges[:, 0] - start_s, 0.0),
        range_beacon=[f"L{number:.0f}" for number in ranges[:, 5]],
        range_m=ranges[:, 1],
        truth_s=truth[:, 0] - start_s,
        truth=np.column_stack([truth[:, 1:3], _course_rad(truth[:, 1:3])]),
    )


def _course_rad(place_m: Floats) -> Floats:
    """Course over ground (N,) of places (N, 2), held where they stand still."""
    step = np.diff(place_m, axis=0, append=place_m[-1:])
    moves = np.hypot(*step.T) > MOVED_M
    if not moves.any():
        return np.zeros(len(place_m))
    known = np.maximum.accumulate(np.where(moves, np.arange(len(moves)), int(np.argmax(moves))))
    course: Floats = np.arctan2(step[known, 1], step[known, 0])
    return course


def _tables(path: Path) -> dict[str, Floats]:
    rows: dict[str, list[list[float]]] = {kind: [] for kind in FIELDS}
    with refused(LogError, f"recording {path}"):
        for number, line in enumerate(text_lines(path), 1):
            words = line.split()
            if not words:
                continue
            count = FIELDS.get(words[0])
            if count is None or len(words) <= count:
                raise LogError(
                    f"recording {path}: line {number} is {line.strip()[:30]!r}, must be one of "
                    f"{', '.join(FIELDS)} with its numbers"
                )
            try:
                values = [float(word) for word in words[1 : count + 1]]
            except ValueError:
                values = [np.nan]
            if not np.isfinite(values).all():
                raise LogError(f"recording {path}: line {number} holds what is not a finite number")
            rows[words[0]].append(values)
    return {kind: np.array(found, dtype=np.float64).reshape(-1, FIELDS[kind]) for kind, found in rows.items()}
