"""The files of an MRCLAM data set: odometry, measurements, true poses of each robot, and the barcodes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.bounded import refused, text_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["Robot", "is_mrclam", "read_data_set"]

BARCODES = "Barcodes.dat"


@dataclass(frozen=True)
class Robot:
    """Recording of one robot, and its true poses."""

    odometry: Array
    """(N, 3) time s, forward m/s, yaw rate rad/s; each holds until the next."""
    measured: Array
    """(N, 4) time s, barcode, range m, bearing rad."""
    truth: Array
    """(N, 4) time s, x m, y m, yaw rad."""


def is_mrclam(path: str | Path) -> bool:
    """Whether this is the folder of an MRCLAM data set."""
    return any((Path(path) / name).is_file() for name in (BARCODES, f"{BARCODES}.gz"))


def read_data_set(folder: Path) -> tuple[dict[int, Robot], dict[int, int]]:
    """Robots by number, and the barcode of each subject.

    Raises:
        LogError: a file that is missing or damaged; one line.
    """
    barcode_of = {int(subject): int(barcode) for subject, barcode in _rows(folder, BARCODES, 2)}
    robots = {}
    for number in range(1, 6):
        if _file(folder, f"Robot{number}_Odometry.dat") is not None:
            robots[number] = Robot(
                _rows(folder, f"Robot{number}_Odometry.dat", 3),
                _rows(folder, f"Robot{number}_Measurement.dat", 4),
                _rows(folder, f"Robot{number}_Groundtruth.dat", 4),
            )
            if number not in barcode_of:
                raise LogError(f"mrclam {folder}: {BARCODES} has no subject {number}")
    return robots, barcode_of


def _file(folder: Path, name: str) -> Path | None:
    return next((path for path in (folder / name, folder / f"{name}.gz") if path.is_file()), None)


def _rows(folder: Path, name: str, columns: int) -> Array:
    path = _file(folder, name)
    if path is None:
        raise LogError(f"mrclam {folder}: has no {name} (or {name}.gz)")
    return _read(path, path.stat().st_mtime_ns, columns)


@lru_cache(maxsize=32)
def _read(path: Path, _changed_ns: int, columns: int) -> Array:
    # A study reads the same data set for each of its missions; an edited file is read again.
    with refused(LogError, f"mrclam {path}"):
        lines = [
            (k, line)
            for k, line in enumerate(text_lines(path), 1)
            if line.strip() and line.lstrip()[0] != "#"
        ]
    if not lines:
        raise LogError(f"mrclam {path}: holds no rows of {columns} numbers")
    try:
        rows = np.loadtxt([line for _, line in lines], dtype=np.float64, ndmin=2)
    except ValueError:
        rows = np.empty((0, 0))
    if rows.shape != (len(lines), columns) or not np.isfinite(rows).all():
        bad = next((k for k, line in lines if not _numbers(line.split(), columns)), len(lines))
        raise LogError(f"mrclam {path}: line {bad} is not {columns} numbers")
    if "Barcodes" not in path.name and (np.diff(rows[:, 0]) < 0).any():
        k = int(np.argmax(np.diff(rows[:, 0]) < 0)) + 1
        raise LogError(f"mrclam {path}: time goes back in line {lines[k][0]}: must ascend")
    return rows


def _numbers(cells: list[str], columns: int) -> bool:
    try:
        return len(cells) == columns and all(math.isfinite(float(cell)) for cell in cells)
    except ValueError:
        return False
