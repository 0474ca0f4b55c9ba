"""The Plaza files of CMU's robotic mower (`Plaza1_.mat`): UWB ranges to four radio beacons, truth by GPS to centimetres.

Tables: `DR` time, distance and change of heading; `GT` time, x, y and heading of the truth; `TD` time, source, beacon and
range; `TL` beacon, x and y. Seconds, metres, radians.
"""

from __future__ import annotations

import struct
import zlib
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError, MissingDependencyError
from uwcoop.importers.bounded import (
    ReadLimitError,
    beyond,
    read_bytes,
    read_limit_bytes,
    refused,
)
from uwcoop.importers.datasets.matlab_tables import tables_of
from uwcoop.importers.datasets.recording import Recording

if TYPE_CHECKING:
    from numpy.typing import NDArray


COLUMNS = {"DR": 3, "GT": 4, "TD": 4, "TL": 3}
COMPRESSED = 15
"""Type of a compressed element (MathWorks, "MAT-File Level 5 file format")."""


def read_plaza(path: Path) -> Recording:
    """Read the mower's odometry, ranges, beacons and truth.

    Raises:
        LogError: not such a file.
        MissingDependencyError: without scipy.
    """
    tables = _tables(path)
    dr, gt, td, tl = (tables[name] for name in COLUMNS)
    start_s = gt[0, 0]
    beacons = {f"L{row[0]:.0f}": (float(row[1]), float(row[2])) for row in tl}
    heard = [f"L{number:.0f}" for number in td[:, 2]]
    if unknown := sorted(set(heard) - set(beacons)):
        raise LogError(f"recording {path}: TD has ranges to {unknown[0]}, which TL does not place")
    if (td[:, 3] <= 0).any():
        raise LogError(f"recording {path}: TD has a range of {td[:, 3].min():g} m: must be above 0")
    if (np.diff(dr[:, 0]) <= 0).any() or (np.diff(gt[:, 0]) <= 0).any():
        raise LogError(f"recording {path}: times of DR and GT must ascend")
    return Recording(
        name=path.stem.strip("_"),
        vehicle="mower",
        beacons=beacons,
        start=(float(gt[0, 1]), float(gt[0, 2]), float(gt[0, 3])),
        odometry_s=dr[:, 0] - start_s,
        displacement_m=np.column_stack([dr[:, 1], np.zeros(len(dr))]),
        yaw_change_rad=dr[:, 2],
        range_s=np.maximum(td[:, 0] - start_s, 0.0),
        range_beacon=heard,
        range_m=td[:, 3],
        truth_s=gt[:, 0] - start_s,
        truth=gt[:, 1:4],
    )


def _tables(path: Path) -> dict[str, NDArray[np.float64]]:
    if find_spec("scipy") is None:
        raise MissingDependencyError("scipy", "maps")
    with refused(LogError, f"recording {path}"):
        content = tables_of(_inflated(read_bytes(path)), list(COLUMNS))
    tables = {}
    for name, width in COLUMNS.items():
        table = content.get(name)
        if table is None or table.ndim != 2 or table.shape[1] != width or len(table) < 2:
            raise LogError(f"recording {path} has no table {name} of {width} columns: not a Plaza file")
        tables[name] = np.asarray(table, dtype=np.float64)
        if not np.isfinite(tables[name]).all():
            raise LogError(f"recording {path}: {name} holds what is not a finite number")
    return tables


def _inflated(content: bytes) -> bytes:
    """A MATLAB 5 file with its compressed elements inflated, so that what they hold is bounded before it is parsed."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if content[:10] == b"MATLAB 7.3":
        raise ValueError("it is of MATLAB 7.3, which is HDF5: save it as version 7")
    if order is None:
        raise ValueError("it is no MATLAB file of version 5 to 7.2")
    parts, at, left = [content[:128]], 128, read_limit_bytes()
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if size > len(content) - at - 8:
            raise ValueError(f"an element states {size} bytes, {len(content) - at - 8} are left")
        element = content[at : at + 8 + size]
        if kind == COMPRESSED:
            stream = zlib.decompressobj()
            element = stream.decompress(element[8:], left + 1)
            if len(element) > left:
                raise ReadLimitError(beyond(read_limit_bytes()))
            if not stream.eof:
                raise EOFError
        left -= len(element)
        parts.append(element)
        at += 8 + size
    return b"".join(parts)
