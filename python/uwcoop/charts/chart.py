"""The chart: an immutable grid of water depths in the local frame, with the quality of its own depths."""

from __future__ import annotations

import hashlib
import io
import json
import struct
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.grid_bytes import canonical_bytes, packed, unpacked
from uwcoop.charts.slopes import node_sigma
from uwcoop.errors import ChartError
from uwcoop.frames import Origin
from uwcoop.importers.bounded import ReadLimitError, refuse_array, refused

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_MAGIC = b"uwcoop-chart-1\x00"
_LARGEST_HEADER = 1 << 20
"""Bytes of a packed chart's header, of which the notes are most."""
_BY_SLOPE = ("horizontal_error_m", "level_sigma_m")
"""Attributes that say how the error grows with the slope."""


@dataclass(frozen=True, eq=False, init=False)
class Chart:
    """Water depth on a square, node-registered grid in local ENU metres.

    Row i lies at northing `north0_m + i * cell_m` (south first), column j at easting `east0_m + j * cell_m`.
    The arrays are copied on construction and cannot be written to. Depths and sigmas are taken as float64, float32 or
    integers and kept as float32, rounded to the nearest: at 100 m by 4 µm at most, at 11 000 m by 0.5 mm. What rounding
    does not explain is refused: numbers too large for float32, texts, complex numbers. Two charts are equal when their
    geometry, depths and quality are, whatever their names and notes.

    Attributes:
        depth_m: float32 (rows, cols), metres, positive down; NaN is a hole.
        east0_m: easting of the first column, metres.
        north0_m: northing of the first row, metres.
        cell_m: distance between neighbouring nodes, metres, > 0.
        sigma_map_m: standard deviation of the chart's own error, metres: one number or float32 (rows, cols);
            0 for a perfect chart.
        correlation_length_m: distance over which that error keeps its value, metres; 0 for a perfect chart.
        horizontal_error_m: how far off the chart is sideways, metres: its error is then level_sigma_m² + (slope ·
            horizontal_error_m)², of which sigma_map_m² is the middle; 0: sigma_map_m says all.
        level_sigma_m: standard deviation of its error where the seabed is level, metres.
        origin: where on Earth the local frame's zero lies, as far as it is known.
        name: for titles and tables.
        notes: what was assumed while the chart was read or made, one sentence each, to be printed.

    Raises:
        ChartError: a grid smaller than 2 x 2, all holes, a cell that is not positive, anything not finite, or a depth
            that float32 cannot hold.
    """

    depth_m: NDArray[np.float32]
    east0_m: float
    north0_m: float
    cell_m: float
    sigma_map_m: float | NDArray[np.float32]
    correlation_length_m: float
    origin: Origin
    name: str
    notes: tuple[str, ...]
    horizontal_error_m: float
    level_sigma_m: float

    # Written out, because depths and sigmas are taken in any precision and kept in float32.
    def __init__(
        self,
        depth_m: ArrayLike,
        east0_m: float,
        north0_m: float,
        cell_m: float,
        sigma_map_m: ArrayLike = 0.0,
        correlation_length_m: float = 0.0,
        origin: Origin | None = None,
        name: str = "chart",
        notes: Iterable[str] = (),
        horizontal_error_m: float = 0.0,
        level_sigma_m: float = 0.0,
    ) -> None:
        per_node = np.ndim(sigma_map_m) > 0
        values = {
            "depth_m": _frozen_grid(depth_m, "depth"),
            "east0_m": float(east0_m),
            "north0_m": float(north0_m),
            "cell_m": float(cell_m),
            "sigma_map_m": _frozen_grid(sigma_map_m, "sigma_map_m") if per_node else _number(sigma_map_m),
            "correlation_length_m": float(correlation_length_m),
            "origin": Origin() if origin is None else origin,
            "name": name,
            "notes": tuple(notes),
            "horizontal_error_m": float(horizontal_error_m),
            "level_sigma_m": float(level_sigma_m),
        }
        for key, value in values.items():
            object.__setattr__(self, key, value)
        self._validate()

    def _validate(self) -> None:
        shape = self.depth_m.shape
        if len(shape) != 2 or min(shape) < 2:
            raise ChartError(f"chart grid of shape {shape} is smaller than 2 x 2 nodes")
        if np.isinf(self.depth_m).any():
            raise ChartError("chart depth holds infinite values: every depth must be finite or a hole (NaN)")
        if not np.isfinite(self.depth_m).any():
            raise ChartError(f"chart of {shape[0]} x {shape[1]} nodes holds no depth: all are holes")
        if not (np.isfinite(self.cell_m) and self.cell_m > 0):
            raise ChartError(f"chart cell {self.cell_m} m must be finite and above 0 m")
        for name in ("east0_m", "north0_m"):
            if not np.isfinite(getattr(self, name)):
                raise ChartError(f"chart {name} {getattr(self, name)} must be finite")
        for name in ("correlation_length_m", *_BY_SLOPE):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ChartError(f"chart {name} {value} must be finite and at least 0 m")
        sigma = np.asarray(self.sigma_map_m)
        if sigma.ndim and sigma.shape != shape:
            raise ChartError(f"chart sigma_map_m of shape {sigma.shape} does not match the depths' {shape}")
        known = sigma[np.isfinite(self.depth_m)] if sigma.ndim else sigma
        if not (np.isfinite(known).all() and (known >= 0).all()):
            raise ChartError("chart sigma_map_m must be finite and at least 0 m wherever there is a depth")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of nodes."""
        rows, cols = self.depth_m.shape
        return rows, cols

    @property
    def east_m(self) -> NDArray[np.float64]:
        """Easting of each column, metres, (cols,)."""
        return self.east0_m + self.cell_m * np.arange(self.shape[1], dtype=np.float64)

    @property
    def north_m(self) -> NDArray[np.float64]:
        """Northing of each row, metres, (rows,), south first."""
        return self.north0_m + self.cell_m * np.arange(self.shape[0], dtype=np.float64)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """West, south, east and north of the outermost nodes, metres."""
        rows, cols = self.shape
        return (
            self.east0_m,
            self.north0_m,
            self.east0_m + (cols - 1) * self.cell_m,
            self.north0_m + (rows - 1) * self.cell_m,
        )

    @cached_property
    def hole_share(self) -> float:
        """Share of nodes without a depth, 0 to below 1."""
        return float(np.isnan(self.depth_m).mean())

    @cached_property
    def depth_range_m(self) -> tuple[float, float]:
        """Shallowest and deepest depth, metres."""
        return float(np.nanmin(self.depth_m)), float(np.nanmax(self.depth_m))

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the canonical content, hexadecimal: same number, same depths at the same places.

        Hashed are, little-endian: a magic string; rows and columns (u32); east0, north0, cell and correlation
        length (f64); sigma (one f64, or float32 per node, after a byte telling which); depths (float32, row
        by row from the south); horizontal error and level sigma, if the chart states them (f64). Holes and zeros
        each have one bit pattern. Name, notes and origin are left out.
        """
        digest = hashlib.sha256(_MAGIC)
        numbers = (self.east0_m, self.north0_m, self.cell_m, self.correlation_length_m)
        digest.update(struct.pack("<IIdddd", *self.shape, *(x + 0.0 for x in numbers)))
        if isinstance(self.sigma_map_m, float):
            digest.update(struct.pack("<Bd", 0, self.sigma_map_m + 0.0))
        else:
            digest.update(b"\x01" + canonical_bytes(self.sigma_map_m))
        digest.update(canonical_bytes(self.depth_m))
        if self.horizontal_error_m > 0:
            digest.update(struct.pack("<dd", self.horizontal_error_m, self.level_sigma_m + 0.0))
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return self.sha256 == other.sha256 if isinstance(other, Chart) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)

    def depth_at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Water depth at `points` (N, 2) [east, north] in metres: (N,) metres, bilinear between four nodes.

        NaN off the chart and wherever one of the four nodes is a hole; never a clamp. Points on the last row
        or column use the cell before it.
        """
        return bilinear_depth(self.depth_m, self.east0_m, self.north0_m, self.cell_m, points)

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Slope at `points` (N, 2): (N, 2) [dh/deast, dh/dnorth], NaN as `depth_at`."""
        i, j, fe, fn, inside = _cells(
            self.depth_m.shape, self.east0_m, self.north0_m, self.cell_m, _points(points)
        )
        h00, h01, h10, h11 = (self.depth_m[i + a, j + b].astype(float) for a in (0, 1) for b in (0, 1))
        east = (1 - fn) * (h01 - h00) + fn * (h11 - h10)
        north = (1 - fe) * (h10 - h00) + fe * (h11 - h01)
        slope = np.column_stack([east, north]) / self.cell_m
        slope[~(inside & np.isfinite(h00 + h01 + h10 + h11))] = np.nan
        return slope

    def sigma_at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Standard deviation of the chart's error at `points` (N, 2): (N,) metres; NaN off the chart."""
        if isinstance(self.sigma_map_m, float) and self.horizontal_error_m <= 0:
            depth = self.depth_at(points)
            return np.where(np.isfinite(depth), self.sigma_map_m, np.nan)
        return bilinear_depth(node_sigma(self), self.east0_m, self.north0_m, self.cell_m, points)

    def to_bytes(self) -> bytes:
        """Everything in the chart, lossless and compressed; `from_bytes` gives back an equal chart.

        A zip file: `chart.json` (geometry, quality, origin, name, notes) and `depth` (and `sigma`, when it is
        per node): float32 little-endian, coded as differences along each row of the bit patterns, byte plane
        by byte plane, because neighbouring depths share their leading bits.
        """
        header: dict[str, Any] = {
            "shape": list(self.shape),
            "east0_m": self.east0_m,
            "north0_m": self.north0_m,
            "cell_m": self.cell_m,
            "sigma_map_m": self.sigma_map_m if isinstance(self.sigma_map_m, float) else None,
            "correlation_length_m": self.correlation_length_m,
            "origin": [self.origin.latitude_deg, self.origin.longitude_deg, self.origin.crs],
            "name": self.name,
            "notes": list(self.notes),
        }
        if self.horizontal_error_m > 0:
            header |= {name: getattr(self, name) for name in _BY_SLOPE}
        members = {"chart.json": json.dumps(header).encode(), "depth": packed(self.depth_m)}
        if not isinstance(self.sigma_map_m, float):
            members["sigma"] = packed(self.sigma_map_m)
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for member, content in members.items():
                # A fixed date: the same chart gives the same bytes.
                archive.writestr(
                    zipfile.ZipInfo(member, (1980, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED
                )
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes) -> Chart:
        """The chart that `to_bytes` wrote.

        Raises:
            ChartError: the bytes are cut off, changed, something else, or more than is read (`importers.bounded`).
        """
        with (
            refused(ChartError, f"packed chart of {len(content):,} bytes"),
            zipfile.ZipFile(io.BytesIO(content)) as archive,
        ):
            header = json.loads(_member(archive, "chart.json", _LARGEST_HEADER))
            rows, cols = (int(n) for n in header["shape"])
            refuse_array("its grid", (rows, cols), 4)
            depth, *own = (
                unpacked(_member(archive, name, 4 * rows * cols), (rows, cols))
                for name in ("depth", *(("sigma",) if header["sigma_map_m"] is None else ()))
            )
            return cls(
                depth_m=depth,
                east0_m=header["east0_m"],
                north0_m=header["north0_m"],
                cell_m=header["cell_m"],
                sigma_map_m=own[0] if own else header["sigma_map_m"],
                correlation_length_m=header["correlation_length_m"],
                origin=Origin(*header["origin"]),
                name=header["name"],
                notes=tuple(header["notes"]),
                **{name: header[name] for name in _BY_SLOPE if name in header},
            )


def _member(archive: zipfile.ZipFile, name: str, limit_bytes: int) -> bytes:
    """One member of a packed chart, inflated to at most `limit_bytes`, whatever the archive states."""
    if archive.getinfo(name).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        # `zipfile` inflates the other kinds without a bound.
        raise ValueError(f"{name} is not deflated")
    with archive.open(name) as member:
        content = member.read(limit_bytes + 1)
    if len(content) > limit_bytes:
        raise ReadLimitError(f"{name} holds more than {limit_bytes:,} bytes")
    return content


def bilinear_depth(
    grid: NDArray[Any], east0_m: float, north0_m: float, cell_m: float, points: ArrayLike
) -> NDArray[np.float64]:
    """Bilinear lookup in a node-registered grid (rows south first), in float64, as `Chart.depth_at`."""
    i, j, fe, fn, inside = _cells(grid.shape, east0_m, north0_m, cell_m, _points(points))
    h00, h01, h10, h11 = (grid[i + a, j + b].astype(np.float64) for a in (0, 1) for b in (0, 1))
    depth: NDArray[np.float64] = (1 - fn) * ((1 - fe) * h00 + fe * h01) + fn * ((1 - fe) * h10 + fe * h11)
    depth[~inside] = np.nan
    return depth


def _points(points: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"points of shape {array.shape} must be (N, 2): east, north")
    return array


def _cells(
    shape: tuple[int, ...], east0_m: float, north0_m: float, cell_m: float, points: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Row, column and fractions of the cell around each point, and which points lie on the chart."""
    rows, cols = shape
    x = (points[:, 0] - east0_m) / cell_m
    y = (points[:, 1] - north0_m) / cell_m
    inside = (x >= 0) & (x <= cols - 1) & (y >= 0) & (y <= rows - 1)  # false for NaN
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    j = np.minimum(x.astype(np.intp), cols - 2)
    i = np.minimum(y.astype(np.intp), rows - 2)
    return i, j, x - j, y - i, inside


def _frozen_grid(values: ArrayLike, quantity: str) -> NDArray[np.float32]:
    """A read-only copy in float32 that differs from the values by rounding alone."""
    given = np.asarray(values)
    if given.dtype.kind not in "fiu":
        raise ChartError(f"chart {quantity} is of type {given.dtype}: it must be real numbers, metres")
    with np.errstate(over="ignore"):
        grid = np.array(given, dtype=np.float32, order="C")
    lost = np.isinf(grid) & np.isfinite(given)
    if lost.any():
        raise ChartError(
            f"chart {quantity} holds {given[lost].flat[0]:g} m: "
            f"float32 holds up to {np.finfo(np.float32).max:.4g} m"
        )
    grid.setflags(write=False)
    return grid


def _number(value: ArrayLike) -> float:
    return float(np.asarray(value, dtype=np.float64))
