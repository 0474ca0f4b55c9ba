"""GeoTIFF and other rasters that GDAL reads (ESRI ASCII grid, BAG): values, axes, what the file states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.raster import Raster, ascending, check_size, horizontal
from uwcoop.charts.vertical import Stated, depths_from
from uwcoop.errors import ChartError, MissingDependencyError
from uwcoop.frames import crs_of

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def read_geotiff(path: Path, *, crs: str | None, positive: str | None, depth_unit: str | None) -> Raster:
    """The first band as depths; a BAG's second band as the depths' standard deviation.

    Pixel-is-area and pixel-is-point files both give the position of each value: GDAL moves the latter by half
    a pixel, so a value always lies in the middle of its pixel.

    Raises:
        ChartError: not a raster, rotated, without a projection when `crs` is None, or see `depths_from`.
    """
    try:
        import rasterio
        from rasterio.errors import RasterioError
    except ImportError as error:
        raise MissingDependencyError("rasterio", "maps") from error
    try:
        with rasterio.open(path) as source:
            return _read(source, path, crs, positive, depth_unit)
    except RasterioError as error:
        raise ChartError(f"{path.name} cannot be read as a chart: {error}") from error


def _read(source: Any, path: Path, crs: str | None, positive: str | None, depth_unit: str | None) -> Raster:
    check_size(source.height, source.width)
    place = source.transform
    if place.b != 0 or place.d != 0:
        raise ChartError(f"{path.name} is rotated against its projection's axes: warp it north-up first")
    axes_crs, notes = _projection(source, path, crs)
    values = _band(source, 1)
    x = place.c + place.a * (np.arange(source.width) + 0.5)
    y = place.f + place.e * (np.arange(source.height) + 0.5)
    tags = {key.lower(): str(value) for key, value in (source.tags() | source.tags(1)).items()}
    is_bag = source.driver == "BAG"
    stated = Stated(
        unit=source.units[0] or tags.get("units", "") or tags.get("unittype", ""),
        positive=tags.get("positive", ""),
        standard_name="altitude" if is_bag else tags.get("standard_name", ""),
        hint=source.descriptions[0] or tags.get("long_name", "") or tags.get("description", ""),
    )
    depth, vertical_notes = depths_from(values, stated, positive, depth_unit)
    depth, x_up, y_up = ascending(depth, x, y)
    sigma = ascending(_band(source, 2), x, y)[0] if is_bag and source.count > 1 else None
    return Raster(depth, x_up, y_up, axes_crs, (*notes, *vertical_notes), sigma)


def _band(source: Any, band: int) -> NDArray[np.float64]:
    values = source.read(band, masked=True).astype(np.float64).filled(np.nan)
    values = values * source.scales[band - 1] + source.offsets[band - 1]
    return np.where(np.isfinite(values), values, np.nan)


def _projection(source: Any, path: Path, asked: str | None) -> tuple[Any, tuple[str, ...]]:
    if asked == "local":
        return None, ("projection: local metres as asked",)
    if asked is not None:
        return horizontal(crs_of(asked)), (f"projection {asked} as asked",)
    if source.crs is None:
        raise ChartError(
            f"{path.name} states no projection: give crs, such as EPSG:32654, or crs='local' for local metres"
        )
    return horizontal(crs_of(source.crs.to_wkt())), ()
