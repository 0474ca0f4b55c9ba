"""Which robot of an MRCLAM data set is the landmark, and when: it must stand still, and be seen or see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.datasets.mrclam_files import Robot

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

STILL = (1e-9, 1e-9)
"""Below these speeds, m/s and rad/s, a robot is at rest."""


@dataclass(frozen=True)
class Standing:
    """A robot at rest, times of the data set."""

    robot: int
    start_s: float
    end_s: float

    @property
    def length_s(self) -> float:
        """How long."""
        return self.end_s - self.start_s


def stands(robot: Robot) -> tuple[Array, Array]:
    """When a robot begins and ends to stand still by its odometry, (K,) each."""
    table = robot.odometry
    still = (np.abs(table[:, 1]) < STILL[0]) & (np.abs(table[:, 2]) < STILL[1])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    return table[edges[::2], 0], table[np.minimum(edges[1::2], len(table) - 1), 0]


def span(number: int, robot: Robot, start_s: float | None, duration_s: float | None, where: str) -> Standing:
    """The mission of a landmark: from `start_s` after its first odometry (None: where it stands longest) for `duration_s`
    (None: until it moves).

    Raises:
        LogError: it does not stand still in this time; one line.
    """
    table = robot.odometry
    first, last = float(table[0, 0]), float(table[-1, 0])
    begins, ends = stands(robot)
    if not begins.size:
        raise LogError(f"{where}: robot {number} never stands still: it cannot be the landmark")
    if start_s is None:
        k = int(np.argmax(ends - begins))
        begin_s = float(begins[k])
    else:
        begin_s = first + start_s
        k = int(np.searchsorted(begins, begin_s, side="right")) - 1
    stands_until = float(ends[k]) if k >= 0 and begins[k] <= begin_s <= ends[k] else begin_s
    end_s = stands_until if duration_s is None else begin_s + duration_s
    if end_s > stands_until or end_s > last or end_s - begin_s < 1:
        raise LogError(
            f"{where}: robot {number} stands still from {begin_s - first:.1f} s to "
            f"{stands_until - first:.1f} s, the mission would last until {end_s - first:.1f} s: "
            "must be within, and a second at least"
        )
    return Standing(number, begin_s, end_s)


def longest(
    robots: dict[int, Robot],
    start_s: float | None,
    duration_s: float | None,
    settle_s: float,
    sees: Callable[[Standing], bool],
    where: str,
) -> tuple[Standing, str]:
    """The robot that stands longest of those that `sees` accepts, longer than `settle_s`; and a line that says so.

    Raises:
        LogError: there is none; one line with what each of them lacks.
    """
    found, lacking = [], []
    for number, robot in robots.items():
        try:
            one = span(number, robot, start_s, duration_s, where)
        except LogError as error:
            lacking.append(str(error).removeprefix(f"{where}: robot "))
            continue
        if not sees(one):
            lacking.append(f"{number} is not seen and sees nobody while it stands")
        elif one.length_s <= settle_s:
            lacking.append(f"{number} stands still for {one.length_s:.1f} s only")
        else:
            found.append(one)
    if not found:
        raise LogError(
            f"{where}: no robot can be the landmark for longer than settle_s = {settle_s:g} s: robot "
            + ", robot ".join(lacking)
        )
    found.sort(key=lambda one: -one.length_s)
    best = found[0]
    first_s = float(robots[best.robot].odometry[0, 0])
    others = "".join(f"; robot {one.robot}: {one.length_s:.1f} s" for one in found[1:])
    others += "".join(f"; robot {reason}" for reason in lacking)
    return best, (
        f"robot {best.robot} is the landmark: it stands still for {best.length_s:.1f} s, the longest, from "
        f"{best.start_s - first_s:.1f} s on{others}"
    )
