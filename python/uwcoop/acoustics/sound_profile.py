"""Sound speed by depth: casts as text tables, and mean speeds between two depths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.teos10 import teos10_mps
from uwcoop.errors import ScenarioError, TableError
from uwcoop.importers.text_table import open_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_LEVEL_M = 1e-6
"""Depths that differ by less are one depth."""


@dataclass(frozen=True)
class CastColumns:
    """Names of a cast's columns."""

    depth: str
    speed: str | None
    temperature: str | None
    salinity: str | None


def read_cast(file: str, columns: CastColumns) -> list[tuple[float, float]]:
    """Depth, m, and sound speed, m/s, of a cast's rows from the top down; of rows at one depth the mean.

    Raises:
        ScenarioError: a file, column or cell that cannot be used; one line.
        MissingDependencyError: gsw is not installed, for a cast of temperatures.
    """
    where = f"sound speed profile {file}"
    if columns.speed is not None and columns.temperature is not None:
        raise ScenarioError(f"{where}: has columns of sound speed and of temperature: must have one of them")
    value = columns.temperature or columns.speed or "sound_speed_mps"
    names = [columns.depth, value, *([columns.salinity] if columns.salinity else [])]
    try:
        table = open_table(file)
        rows = table.read({name: table.place(name) for name in names})
    except OSError as error:
        raise ScenarioError(f"{where} cannot be read: {error.strerror}") from error
    except TableError as error:
        raise ScenarioError(f"{where}: {error}") from error
    for name, values in rows.numbers.items():
        if np.isnan(values).any():
            raise ScenarioError(
                f"{where}: {name} is empty in line {rows.line[np.isnan(values)][0]}: must be a number"
            )
    depth, speed = rows.numbers[columns.depth], rows.numbers[value]
    if columns.temperature is not None:
        salinity = rows.numbers[columns.salinity] if columns.salinity else np.zeros_like(depth)
        try:
            speed = teos10_mps(speed, salinity, depth)
        except ScenarioError as error:
            raise ScenarioError(f"{where}: {error}") from None
    at, row_of = np.unique(depth, return_inverse=True)
    mean = np.bincount(row_of, speed) / np.bincount(row_of)
    return list(zip(at.tolist(), mean.tolist(), strict=True))


class Profile:
    """Sound speed by depth, straight between rows and constant beyond them."""

    def __init__(self, rows: tuple[tuple[float, float], ...]) -> None:
        self._depth, self._speed = np.array(sorted(rows)).T
        self._slope = np.diff(self._speed) / np.diff(self._depth)
        steps = _vertical_time(self._speed[:-1], self._slope, np.diff(self._depth))
        self._time = np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def span_m(self) -> tuple[float, float]:
        """Shallowest and deepest row."""
        return float(self._depth[0]), float(self._depth[-1])

    def at(self, depth_m: Array) -> Array:
        """Speed at depths, m/s, (K,)."""
        return np.asarray(np.interp(depth_m, self._depth, self._speed))

    def between(self, depth_a_m: Array, depth_b_m: Array) -> Array:
        """Mean speed along straight rays between two depths, m/s, (K,): the harmonic mean over depth."""
        apart = np.asarray(depth_b_m - depth_a_m)
        level = np.abs(apart) < _LEVEL_M
        took = self._time_to(depth_b_m) - self._time_to(depth_a_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = apart / took
        return np.where(level, self.at(depth_a_m), mean)

    def _time_to(self, depth_m: Array) -> Array:
        """Time that sound takes from the first row straight down to depths, seconds; negative above it."""
        k = np.clip(np.searchsorted(self._depth, depth_m, side="right") - 1, 0, len(self._slope) - 1)
        inside = np.clip(depth_m, self._depth[0], self._depth[-1])
        time = self._time[k] + _vertical_time(self._speed[k], self._slope[k], inside - self._depth[k])
        beyond = depth_m - inside
        return np.asarray(time + beyond / np.where(beyond < 0, self._speed[0], self._speed[-1]))


def _vertical_time(speed: Array, slope: Array, length_m: Array) -> Array:
    """The integral of 1 / (speed + slope z) over 0 to a length: ln(1 + x) / x of the length over the first speed."""
    x = slope * length_m / speed
    small = np.abs(x) < 1e-8
    ratio = np.where(small, 1.0 - x / 2, np.log1p(x) / np.where(small, 1.0, x))
    return np.asarray(length_m / speed * ratio)
