"""Factor graphs in the plane as PyFactorGraph writes them (`.pyfg`): the GOATS runs of an AUV among LBL beacons.

Lines: `VERTEX_XY Lk x y`, `VERTEX_SE2 t Ak x y yaw`, `EDGE_SE2 t Ai Aj dx dy dyaw` and the upper triangle of its
covariance, `EDGE_RANGE t Ai Lk range variance`. The edges of these runs have no times: the pose k stands at k seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.bounded import refused, text_lines
from uwcoop.importers.datasets.recording import Recording

FIELDS = {"VERTEX_XY": 4, "VERTEX_SE2": 6, "EDGE_SE2": 13, "EDGE_RANGE": 6}
"""Words of each line that is used, its name included."""
MOVED_S, HEARD_S = 0.6, 0.5
"""So long before a pose's second its edge is done and its ranges are heard: what is recorded at that second then knows
of them."""
PART_S = 0.1
"""Between an edge's first part, the ranges heard there, and its second part."""


def read_pyfg(path: Path) -> Recording:
    """Read one vehicle's poses (as truth), odometry and ranges.

    Raises:
        LogError: not such a file; one line with the number of the line that is wrong.
    """
    beacons: dict[str, tuple[float, float]] = {}
    poses: dict[str, list[float]] = {}
    edges: list[tuple[str, str, list[float]]] = []
    ranges: list[tuple[str, str, float]] = []
    for number, words in _lines(path):
        kind = words[0]
        try:
            values = [float(word) for word in words[{"VERTEX_XY": 2, "VERTEX_SE2": 3}.get(kind, 4) :]]
        except ValueError:
            values = [np.nan]
        if not np.isfinite(values).all():
            raise LogError(f"recording {path}: line {number} holds what is not a finite number")
        if kind == "VERTEX_XY":
            beacons[words[1]] = (values[0], values[1])
        elif kind == "VERTEX_SE2":
            poses[words[2]] = values
        elif kind == "EDGE_SE2":
            edges.append((words[2], words[3], values))
        else:
            if values[0] <= 0:
                raise LogError(f"recording {path}: line {number}: range is {values[0]:g} m, must be above 0")
            ranges.append((words[2], words[3], values[0]))
    return _recording(path, beacons, poses, edges, ranges)


def heard_on_the_way(found: Recording, delay_edges: float) -> Recording:
    """The same with every range heard `delay_edges` (above 0, below 1) of an edge before its pose.

    Each edge becomes two displacements with the ranges between them; the vehicle turns at the end of the second, so that
    dead reckoning is as before.
    """
    share = np.tile([1.0 - delay_edges, delay_edges], len(found.odometry_s))
    zero = np.zeros_like(found.yaw_change_rad)
    return replace(
        found,
        odometry_s=np.column_stack([found.odometry_s - 2 * PART_S, found.odometry_s]).ravel(),
        displacement_m=np.repeat(found.displacement_m, 2, axis=0) * share[:, None],
        yaw_change_rad=np.column_stack([zero, found.yaw_change_rad]).ravel(),
        range_s=np.maximum(found.range_s - (MOVED_S - HEARD_S) - PART_S, 0.0),
        odometry_share=share,
    )


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    with refused(LogError, f"recording {path}"):
        for number, line in enumerate(text_lines(path), 1):
            words = line.split()
            if not words:
                continue
            if words[0] not in FIELDS:
                raise LogError(
                    f"recording {path}: line {number} is {words[0][:20]!r}, must be one of {', '.join(FIELDS)}"
                )
            if len(words) != FIELDS[words[0]]:
                raise LogError(
                    f"recording {path}: line {number} has {len(words)} words, {words[0]} has {FIELDS[words[0]]}"
                )
            yield number, words


def _recording(
    path: Path,
    beacons: dict[str, tuple[float, float]],
    poses: dict[str, list[float]],
    edges: list[tuple[str, str, list[float]]],
    ranges: list[tuple[str, str, float]],
) -> Recording:
    """Poses in the order of the edges, which must be a chain."""
    chain = [edges[0][0]] if edges else []
    for start, end, _ in edges:
        if start != chain[-1]:
            raise LogError(
                f"recording {path}: odometry goes from {start} to {end} after {chain[-1]}: no chain"
            )
        chain.append(end)
    if not chain or not beacons or not ranges or chain[0] not in poses:
        raise LogError(f"recording {path} has no odometry, beacons, ranges or first pose")
    place = {name: k for k, name in enumerate(chain)}
    for pose, beacon, _ in ranges:
        if pose not in place or beacon not in beacons:
            raise LogError(f"recording {path}: a range from {pose} to {beacon}: one of them is unknown")
    known = [k for k, name in enumerate(chain) if name in poses]
    step = np.array([values[:3] for _, _, values in edges])
    return Recording(
        name=path.stem.replace(".", "-"),
        vehicle="auv",
        beacons=beacons,
        start=tuple(poses[chain[0]][:3]),  # type: ignore[arg-type]
        odometry_s=np.arange(1.0, len(chain)) - MOVED_S,
        displacement_m=step[:, :2],
        yaw_change_rad=step[:, 2],
        range_s=np.array([max(float(place[pose]) - HEARD_S, 0.0) for pose, _, _ in ranges]),
        range_beacon=[beacon for _, beacon, _ in ranges],
        range_m=np.array([value for _, _, value in ranges]),
        truth_s=np.array(known, dtype=np.float64),
        truth=np.array([poses[chain[k]][:3] for k in known]),
    )
