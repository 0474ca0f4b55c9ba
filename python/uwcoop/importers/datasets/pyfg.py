"""Factor graphs in the plane as PyFactorGraph writes them (`.pyfg`): the GOATS runs of an AUV among LBL beacons.

Lines: `VERTEX_XY Lk x y`, `VERTEX_SE2 t Ak x y yaw`, `EDGE_SE2 t Ai Aj dx dy dyaw` and the upper triangle of its
covariance, `EDGE_RANGE t Ai Lk range variance`. The edges of these runs have no times: a pose stands at the time of its
`VERTEX_SE2` line, counted from the first; pose k of a file without times, at k seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.bounded import refused, text_lines
from uwcoop.importers.datasets.recording import LONGEST_S, Recording

if TYPE_CHECKING:
    from numpy.typing import NDArray

FIELDS = {"VERTEX_XY": 4, "VERTEX_SE2": 6, "EDGE_SE2": 13, "EDGE_RANGE": 6}
"""Words of each line that is used, its name included."""
MOVED_S, HEARD_S = 0.6, 0.5
"""So long before a pose's second its edge is done and its ranges are heard: what is recorded at that second then knows
of them."""
PART_S = 0.1
"""Between an edge's first part, the ranges heard there, and its second part."""
SECOND_S = 1.0
"""A displacement that lasts for longer is given in pieces of about so much."""


def read_pyfg(path: Path) -> Recording:
    """Read one vehicle's poses (as truth), odometry and ranges.

    Raises:
        LogError: not such a file; one line with the number of the line that is wrong.
    """
    beacons: dict[str, tuple[float, float]] = {}
    poses: dict[str, list[float]] = {}
    stamps: dict[str, float] = {}
    edges: list[tuple[str, str, list[float]]] = []
    ranges: list[tuple[str, str, float]] = []
    for number, words in _lines(path):
        kind = words[0]
        try:
            values = [float(word) for word in words[{"VERTEX_XY": 2, "VERTEX_SE2": 3}.get(kind, 4) :]]
            if kind == "VERTEX_SE2":
                stamps[words[2]] = float(words[1])
        except ValueError:
            values = [np.nan]
        if not np.isfinite([*values, stamps.get(words[2], 0.0) if len(words) > 2 else 0.0]).all():
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
    return _recording(path, beacons, poses, stamps, edges, ranges)


def heard_on_the_way(found: Recording, delay_edges: float) -> Recording:
    """The same with every range heard `delay_edges` (above 0, below 1) of an edge before its pose.

    Each edge becomes two displacements with the ranges between them; the vehicle turns at the end of the second, so that
    dead reckoning is as before.
    """
    share = np.tile([1.0 - delay_edges, delay_edges], len(found.odometry_s))
    zero = np.zeros_like(found.yaw_change_rad)
    lasts = np.diff(found.odometry_s, prepend=-MOVED_S)
    lead = np.clip(delay_edges * lasts, 2 * PART_S, np.maximum(lasts - 3 * PART_S, 2 * PART_S))
    lead = np.where(lasts <= SECOND_S, 2 * PART_S, lead)  # as poses without times have them
    edge = np.clip(np.searchsorted(found.odometry_s, found.range_s) - 1, 0, len(lead) - 1)
    before = found.range_s < found.odometry_s[0]
    return replace(
        found,
        odometry_s=np.column_stack([found.odometry_s - lead, found.odometry_s]).ravel(),
        displacement_m=np.repeat(found.displacement_m, 2, axis=0) * share[:, None],
        yaw_change_rad=np.column_stack([zero, found.yaw_change_rad]).ravel(),
        range_s=np.maximum(
            found.range_s - (MOVED_S - HEARD_S) - np.where(before, 2 * PART_S, lead[edge]) + PART_S, 0.0
        ),
        odometry_share=share,
    )


def in_seconds(found: Recording) -> Recording:
    """The same with each displacement that lasts for long as equal ones of about a second: the vehicle does not wait for
    the end of an edge to move. It turns at the end of the last."""
    lasts = np.diff(found.odometry_s, prepend=-MOVED_S)
    pieces = np.maximum(np.round(lasts / SECOND_S).astype(int), 1)
    if (pieces == 1).all():
        return found
    edge = np.repeat(np.arange(len(pieces)), pieces)
    place = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    last = place == pieces[edge] - 1
    share = np.ones(len(pieces)) if found.odometry_share is None else found.odometry_share
    return replace(
        found,
        odometry_s=found.odometry_s[edge] - lasts[edge] * (1 - (place + 1) / pieces[edge]),
        displacement_m=found.displacement_m[edge] / pieces[edge][:, None],
        yaw_change_rad=np.where(last, found.yaw_change_rad[edge], 0.0),
        odometry_share=(share / pieces)[edge],
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
    stamps: dict[str, float],
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
    at_s = _times_s(path, [stamps.get(name) for name in chain])
    step = np.array([values[:3] for _, _, values in edges])
    return Recording(
        name=path.stem.replace(".", "-"),
        vehicle="auv",
        beacons=beacons,
        start=tuple(poses[chain[0]][:3]),  # type: ignore[arg-type]
        odometry_s=at_s[1:] - MOVED_S,
        displacement_m=step[:, :2],
        yaw_change_rad=step[:, 2],
        range_s=np.array([max(float(at_s[place[pose]]) - HEARD_S, 0.0) for pose, _, _ in ranges]),
        range_beacon=[beacon for _, beacon, _ in ranges],
        range_m=np.array([value for _, _, value in ranges]),
        truth_s=at_s[known],
        truth=np.array([poses[chain[k]][:3] for k in known]),
    )


def _times_s(path: Path, stamps: list[float | None]) -> NDArray[np.float64]:
    """When the vehicle is at each pose of the chain, from the first; poses without a time lie evenly between others.

    Raises:
        LogError: times that do not increase by more than what an edge and its ranges come before its pose.
    """
    known = [k for k, stamp in enumerate(stamps) if stamp is not None]
    values = np.array([stamps[k] for k in known], dtype=np.float64)
    if len(known) < 2 or not values.any():
        return np.arange(float(len(stamps)))
    if known[0] != 0 or known[-1] != len(stamps) - 1 or np.ptp(values) > LONGEST_S:
        return np.arange(float(len(stamps)))
    at_s = np.interp(np.arange(len(stamps)), known, values - values[0])
    step = float(np.diff(at_s).min())
    if step <= MOVED_S + 2 * PART_S:
        raise LogError(
            f"recording {path}: poses are {step:g} s apart at the least: times must increase by more than "
            f"{MOVED_S + 2 * PART_S:g} s"
        )
    return np.asarray(at_s)
