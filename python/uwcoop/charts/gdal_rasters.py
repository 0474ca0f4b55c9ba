"""Rasters that GDAL reads: GeoTIFF, BAG of one and of variable resolution, S-102.

GDAL is asked for the one driver that the file's content tells: left to choose, it takes a virtual raster of any name,
which fetches whatever files and addresses it lists.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.grid_source import GridSource, Reading, check_axes, stated_crs
from uwcoop.charts.stored import HEADER
from uwcoop.charts.vertical import Stated, direction_of
from uwcoop.errors import ChartError, MissingDependencyError
from uwcoop.frames import crs_of

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

_DRIVERS = {"tiff": "GTiff", "bag": "BAG", "s102": "S102"}
_CACHE_MB = 32
_STDERR = 2
_LARGEST_BLOCK = 1 << 24
"""Values of one tile or strip, which GDAL must hold whole."""
_UNCERTAIN = ("uncertainty", "sigma", "standard deviation", "std", "tvu")


@contextmanager
def open_raster(path: Path, kind: str, reading: Reading) -> Iterator[GridSource]:
    """The depths of a raster, and their standard deviations where a band holds them.

    Pixel-is-area and pixel-is-point files both give the position of each value: GDAL moves the latter by half a
    pixel, so a value always lies in the middle of its pixel.

    Args:
        path: the file.
        kind: "tiff", "bag" or "s102", as `file_kind` tells it.
        reading: its `crs` and, of a BAG of variable resolution, `cell_m` matter here.

    Raises:
        ChartError: not such a raster, rotated, a picture, or without a projection when none is asked for.
    """
    try:
        import rasterio
        from rasterio.errors import RasterioError
    except ImportError as error:
        raise MissingDependencyError("rasterio", "maps") from error
    with _quietly(kind), warnings.catch_warnings(), rasterio.Env(GDAL_CACHEMAX=_CACHE_MB):
        warnings.simplefilter("ignore")  # a raster without a place is judged below
        try:
            options, notes = _bag_options(rasterio, path, reading) if kind == "bag" else ({}, ())
            with rasterio.open(path, driver=_DRIVERS[kind], **options) as file:
                yield _source(file, path.name, kind, reading, notes)
        except RasterioError as error:
            raise ChartError(f"{path.name} cannot be read as a chart: {error}") from error


@contextmanager
def _quietly(kind: str) -> Iterator[None]:
    """Keep what the libraries below write to the terminal about a damaged file off it: our error says it in one line.

    GDAL's copy of HDF5 writes its stack to the standard error of the process, which nothing but the file descriptor
    itself can stop; rasterio reports messages of GDAL that are no UTF-8 as exceptions that nobody can catch.
    """
    unraisable, uncaught = sys.unraisablehook, sys.excepthook
    sys.unraisablehook = lambda said: (
        None if isinstance(said.exc_value, UnicodeDecodeError) else unraisable(said)
    )
    sys.excepthook = lambda kind, error, at: (
        None if isinstance(error, UnicodeDecodeError) else uncaught(kind, error, at)
    )
    sys.stderr.flush()
    kept = os.dup(_STDERR) if kind != "tiff" else None
    try:
        if kept is not None:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), _STDERR)
        yield
    finally:
        if kept is not None:
            os.dup2(kept, _STDERR)
            os.close(kept)
        sys.unraisablehook, sys.excepthook = unraisable, uncaught


def _bag_options(rasterio: Any, path: Path, reading: Reading) -> tuple[dict[str, str], tuple[str, ...]]:
    """How to open a BAG: one of variable resolution at its finest cells, or at the cells asked for.

    Opened without a word, it gives its overview, which is many times coarser.
    """
    with rasterio.open(path, driver="BAG") as file:
        if file.tags().get("HAS_SUPERGRIDS") != "TRUE":
            return {}, ()
        overview = (
            f"its overview has {file.width} x {file.height} cells of {file.res[0]:.4g} x {file.res[1]:.4g} m"
        )
    options = {"MODE": "RESAMPLED_GRID"}
    if reading.cell_m is not None:
        options |= {"RESX": str(reading.cell_m), "RESY": str(reading.cell_m), "VALUE_POPULATION": "MEAN"}
    with rasterio.open(path, driver="BAG", **options) as file:
        cells = f"{file.width} x {file.height} nodes of {file.res[0]:.2f} x {file.res[1]:.2f} m"
    which = "the cell asked for" if reading.cell_m is not None else "its finest cells"
    return options, (f"BAG of variable resolution read at {which}: {cells}; {overview}",)


def _source(file: Any, name: str, kind: str, reading: Reading, notes: tuple[str, ...]) -> GridSource:
    check_axes(name, file.height, file.width)
    place = file.transform
    if place.b != 0 or place.d != 0:
        raise ChartError(f"{name} is rotated against its projection's axes: warp it north-up first")
    if place.is_identity and file.gcps[0]:
        raise ChartError(f"{name} is placed by ground control points: warp it to a projection first")
    band, sigma_band, band_notes = _bands(file, name, kind)
    if max(height * width for height, width in file.block_shapes) > _LARGEST_BLOCK:
        raise ChartError(f"{name} has tiles of {file.block_shapes[0]} values: rewrite it with smaller ones")
    header = str(file.tags().get(HEADER, ""))
    if header and not file.crs and reading.crs is None:
        crs: Any = None
        crs_notes: tuple[str, ...] = ()  # written from a chart of local metres
    else:
        crs, crs_notes = stated_crs(
            reading.crs, lambda: crs_of(file.crs.to_wkt()) if file.crs else None, name
        )

    def read(rows: slice, cols: slice) -> tuple[NDArray[Any], NDArray[Any] | None]:
        window = ((rows.start, rows.stop), (cols.start, cols.stop))
        values = _values(file, band, window)
        return values, None if sigma_band is None else _values(file, sigma_band, window)

    return GridSource(
        name=name,
        x=place.c + place.a * (np.arange(file.width) + 0.5),
        y=place.f + place.e * (np.arange(file.height) + 0.5),
        crs=crs,
        stated=_stated(file, band, kind),
        read=read,
        notes=(*notes, *band_notes, *crs_notes),
        header=header,
    )


def _bands(file: Any, name: str, kind: str) -> tuple[int, int | None, tuple[str, ...]]:
    """The band of the depths, that of their standard deviations, and notes."""
    from rasterio.enums import ColorInterp

    if file.count == 0:
        raise ChartError(f"{name} holds no band of values")
    if np.dtype(file.dtypes[0]).kind == "c":
        raise ChartError(f"{name} holds complex numbers, no depths")
    if file.colorinterp[0] in (ColorInterp.red, ColorInterp.palette):
        raise ChartError(f"{name} is a picture of a chart: it holds colours, no depths")
    if kind != "tiff":
        return 1, 2 if file.count > 1 else None, ()
    called = [(description or "").lower() for description in file.descriptions]
    depths = [k for k, text in enumerate(called) if direction_of(text) and not _uncertain(text)]
    band = depths[0] if depths else 0
    sigmas = [k for k, text in enumerate(called) if k != band and _uncertain(text)]
    if file.count == 1:
        return 1, None, ()
    used = f"band {band + 1} of {file.count} ({file.descriptions[band] or 'unnamed'}) as depths"
    if sigmas:
        used += f", band {sigmas[0] + 1} ({file.descriptions[sigmas[0]]}) as their standard deviation"
    return band + 1, sigmas[0] + 1 if sigmas else None, (used,)


def _uncertain(text: str) -> bool:
    return any(word in text for word in _UNCERTAIN)


def _stated(file: Any, band: int, kind: str) -> Stated:
    tags = {key.lower(): str(value) for key, value in (file.tags() | file.tags(band)).items()}
    unit = file.units[band - 1] or tags.get("units", "") or tags.get("unittype", "")
    hint = file.descriptions[band - 1] or tags.get("long_name", "") or tags.get("description", "")
    if kind == "s102":
        return Stated(unit="m", positive="down", hint="depth")
    if kind == "bag":
        return Stated(unit=unit, standard_name="altitude", hint=hint)
    vertical = _vertical_axis(file)
    if vertical is not None:
        # A band's own word counts before that of the heights it is referred to.
        unit, hint = unit or str(vertical.unit_name), hint or str(vertical.name)
    return Stated(unit, tags.get("positive", ""), tags.get("standard_name", ""), hint)


def _vertical_axis(file: Any) -> Any:
    """The axis of heights or depths of the raster's projection; None where it has none."""
    if not file.crs:
        return None
    crs = crs_of(file.crs.to_wkt())
    parts = crs.sub_crs_list if crs.is_compound else [crs]
    axes = [axis for part in parts for axis in part.axis_info if axis.direction in ("up", "down")]
    return axes[0] if axes else None


def _values(file: Any, band: int, window: Any) -> NDArray[Any]:
    read = file.read(band, window=window, masked=True)
    kind = np.float32 if read.dtype in (np.float32, np.int16, np.uint16, np.uint8, np.int8) else np.float64
    scale, offset = file.scales[band - 1], file.offsets[band - 1]
    if (scale, offset) == (1.0, 0.0):
        return np.asarray(read.astype(kind).filled(np.nan))
    return np.asarray(read.astype(np.float64).filled(np.nan) * scale + offset)
