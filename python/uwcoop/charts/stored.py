"""Charts as files for others: GeoTIFF or NetCDF with depth, its standard deviation, and what terrain tells of position.

Both hold every number of the chart, its projection, units and notes, and beside them one line of JSON with what neither
format has a place for; `load_chart` reads the same chart back, bit for bit.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.chart import Chart
from uwcoop.charts.information import Sounding, reachable_sigma
from uwcoop.charts.plausible import DEEPEST_M
from uwcoop.charts.slopes import node_sigma
from uwcoop.errors import ChartError, MissingDependencyError
from uwcoop.frames import LocalFrame, Origin, crs_of

if TYPE_CHECKING:
    from os import PathLike

    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.charts.grid_source import GridSource
    from uwcoop.charts.raster import Quality

__all__ = ["HEADER", "chart_as_stored", "check_suffix", "stored_quality", "write_chart"]

HEADER = "uwcoop_chart"
"""Tag of a GeoTIFF and attribute of a NetCDF file that hold the chart's header."""
SUFFIXES = (".tif", ".tiff", ".nc")
_NUMBERS = ("east0_m", "north0_m", "cell_m", "correlation_length_m", "horizontal_error_m", "level_sigma_m")
_SAME_PLACE_M = 1e-3
_LAYERS = {
    "depth": "water depth, positive down",
    "sigma_map": "standard deviation of the chart's own error",
    "reachable_position_sigma": (
        "standard deviation of position, in the worse direction, after one crossing of {0:g} m; "
        "no value where a direction stays unknown"
    ),
}


def write_chart(chart: Chart, path: str | PathLike[str]) -> None:
    """Write a chart as GeoTIFF (.tif) or NetCDF (.nc), told by the suffix; whole or not at all.

    Bands or variables: `depth`, `sigma_map` and `reachable_position_sigma`, float32 metres, NaN where there is none.

    Raises:
        ChartError: another suffix.
        MissingDependencyError: the extra `maps` is needed and not installed.
        OSError: the file cannot be written.
    """
    from uwcoop.report.atomic_files import atomic_write

    path = Path(path)
    check_suffix(path)
    with atomic_write(path) as partial:
        (_write_netcdf if path.suffix.lower() == ".nc" else _write_geotiff)(chart, partial)


def check_suffix(path: Path) -> None:
    """Refuse a file that is to hold a chart and whose name does not tell a format for it."""
    if path.suffix.lower() not in SUFFIXES:
        raise ChartError(f"chart {path} must end in one of {', '.join(SUFFIXES)}")


def chart_as_stored(source: GridSource) -> Chart | None:
    """The chart that `write_chart` wrote; None where the file is another's, or was changed since."""
    header = _header_in(source)
    if header is None:
        return None
    depth, sigma = source.read(slice(0, source.y.size), slice(0, source.x.size))
    if source.y[0] > source.y[-1]:
        depth, sigma = depth[::-1], None if sigma is None else sigma[::-1]
    with np.errstate(invalid="ignore"):
        if ((depth <= 0) | (depth > DEEPEST_M)).any():
            return None  # no depths of ours: read with every check
    stated = header["sigma_map_m"]
    return Chart(
        depth_m=depth,
        sigma_map_m=sigma if stated is None and sigma is not None else stated,
        origin=Origin(*header["origin"]),
        name=header["name"],
        notes=tuple(header["notes"]),
        **{name: header[name] for name in _NUMBERS},
    )


def stored_quality(source: GridSource, asked: Quality) -> Quality:
    """The quality asked for, and where nothing is asked, what a chart written by `write_chart` states of itself."""
    from dataclasses import replace

    header = _header_in(source)
    if header is None:
        return asked
    own = {"sigma_map_m": header["sigma_map_m"], "correlation_length_m": header["correlation_length_m"]}
    return replace(asked, **{key: value for key, value in own.items() if getattr(asked, key) is None})


def _header_in(source: GridSource) -> dict[str, Any] | None:
    """The header of a file, where it has one that fits its grid."""
    if not source.header:
        return None
    try:
        header = json.loads(source.header)
        origin = Origin(*header["origin"])
        east, north = _offset(origin)
        numbers = [float(header[name]) for name in _NUMBERS]
        shape = tuple(header["shape"])
        fits = shape == (source.y.size, source.x.size) and all(
            abs(float(axis.min()) - zero - offset) < _SAME_PLACE_M
            for axis, zero, offset in ((source.x, numbers[0], east), (source.y, numbers[1], north))
        )
        known = isinstance(header["name"], str) and isinstance(header["notes"], list)
    except (ValueError, KeyError, TypeError, ChartError):
        return None
    return header if fits and known else None


def _header(chart: Chart) -> str:
    sigma = chart.sigma_map_m
    return json.dumps(
        {name: getattr(chart, name) for name in _NUMBERS}
        | {
            "shape": chart.shape,
            "sigma_map_m": sigma if isinstance(sigma, float) else None,
            "origin": [chart.origin.latitude_deg, chart.origin.longitude_deg, chart.origin.crs],
            "name": chart.name,
            "notes": chart.notes,
        }
    )


def _layers(chart: Chart) -> dict[str, NDArray[np.float32]]:
    # What is stored is the sigma from which the chart is made again; with an error by slope it is the middle.
    sigma = chart.sigma_map_m
    if isinstance(sigma, float):
        by_node = node_sigma(chart) if chart.horizontal_error_m > 0 else np.full(chart.shape, sigma)
        sigma = np.where(np.isfinite(chart.depth_m), by_node, np.nan).astype(np.float32)
    reachable = reachable_sigma(chart)
    return {
        "depth": chart.depth_m,
        "sigma_map": sigma,
        "reachable_position_sigma": np.where(np.isfinite(reachable), reachable, np.nan).astype(np.float32),
    }


def _frame(origin: Origin) -> LocalFrame | None:
    return (
        LocalFrame(origin) if origin.latitude_deg is not None and origin.longitude_deg is not None else None
    )


def _offset(origin: Origin) -> tuple[float, float]:
    frame = _frame(origin)
    return frame.offset_m if frame else (0.0, 0.0)


def _crs(chart: Chart) -> Any:
    """The pyproj CRS of the positions; None for a chart whose place on Earth is not known."""
    frame = _frame(chart.origin)
    return None if frame is None else crs_of(frame.crs_text)


def _write_geotiff(chart: Chart, path: Path) -> None:
    try:
        import rasterio
        from rasterio.transform import Affine
    except ImportError as error:
        raise MissingDependencyError("rasterio", "maps") from error
    import warnings

    layers, crs = _layers(chart), _crs(chart)
    west, _, _, north = chart.extent
    east0, north0 = _offset(chart.origin)
    half = chart.cell_m / 2
    place = Affine(chart.cell_m, 0, west + east0 - half, 0, -chart.cell_m, north + north0 + half)
    rows, cols = chart.shape
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(
            path, "w", driver="GTiff", height=rows, width=cols, count=len(layers), dtype="float32",
            crs=None if crs is None else crs.to_wkt(), transform=place, nodata=float("nan"), compress="deflate",
            predictor=3, tiled=True, blockxsize=256, blockysize=256,
        ) as file:  # fmt: skip
            for band, (name, values) in enumerate(layers.items(), start=1):
                file.write(values[::-1], band)
                file.set_band_description(band, name)
                file.set_band_unit(band, "m")
                file.update_tags(
                    band, long_name=_long_name(name), **({"positive": "down"} if name == "depth" else {})
                )
            file.update_tags(**{HEADER: _header(chart), "TIFFTAG_IMAGEDESCRIPTION": "\n".join(chart.notes)})


def _write_netcdf(chart: Chart, path: Path) -> None:
    data = _dataset(chart)
    packed = {name: {"zlib": True, "complevel": 4} for name in _LAYERS}
    data.to_netcdf(path, engine="h5netcdf", encoding=packed)


def _dataset(chart: Chart) -> xr.Dataset:
    import xarray as xr

    crs = _crs(chart)
    east0, north0 = _offset(chart.origin)
    mapping = {} if crs is None else {"grid_mapping": "crs"}
    variables: dict[str, Any] = {}
    for name, values in _layers(chart).items():
        attributes = {"units": "m", "long_name": _long_name(name), **mapping}
        if name == "depth":
            attributes["positive"] = "down"
        variables[name] = (("y", "x"), values, attributes)
    if crs is not None:
        variables["crs"] = ((), 0, crs.to_cf())
    axis = {"units": "m"}
    axes = {
        "y": ("y", chart.north_m + north0, axis | {"standard_name": "projection_y_coordinate"}),
        "x": ("x", chart.east_m + east0, axis | {"standard_name": "projection_x_coordinate"}),
    }
    about = {
        "Conventions": "CF-1.11", "title": chart.name, "comment": "\n".join(chart.notes), HEADER: _header(chart)
    }  # fmt: skip
    return xr.Dataset(variables, axes, about)


def _long_name(name: str) -> str:
    return _LAYERS[name].format(Sounding().window_m)
