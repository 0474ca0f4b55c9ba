"""`load_chart`: which reader a file needs, told by its first bytes and not by its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.geotiff import read_geotiff
from uwcoop.charts.gridding import Gridded, grid_and_judge
from uwcoop.charts.netcdf import read_netcdf
from uwcoop.charts.raster import Quality, chart_from_raster
from uwcoop.charts.soundings import load_soundings
from uwcoop.errors import ChartError
from uwcoop.frames import Origin

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from os import PathLike

    from uwcoop.charts.chart import Chart
    from uwcoop.charts.raster import Raster

_TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_NETCDF = (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF")
_ESRI_ASCII = b"ncols"


def load_chart(
    path: str | PathLike[str],
    *,
    crs: str | None = None,
    positive: str | None = None,
    depth_unit: str | None = None,
    columns: str | Sequence[str] | None = None,
    cell_m: float | None = None,
    sigma_map_m: float | None = None,
    correlation_length_m: float | None = None,
    max_gap_m: float | None = None,
    align: bool = False,
    error_by_slope: bool = False,
    origin: Origin | tuple[float, float] | None = None,
) -> Chart:
    """Read a chart: GeoTIFF, NetCDF (CF, GMT, GEBCO), ESRI ASCII grid, BAG, or soundings as CSV or XYZ text
    (.gz).

    What the file does not say is found or assumed, and stands in the chart's `notes`. Nodes with no water
    (depth of zero or less) become holes. Positions become local metres around `origin`: a grid or soundings
    in a metric projection are shifted, anything else goes to a transverse Mercator centred there.

    Args:
        path: the file.
        crs: projection of the positions ("EPSG:32654", WKT, PROJ), or "local" for local metres; None: the
            file's.
        positive: "up" or "down", the way the file's numbers grow; None: the file's word, or the values' sign.
        depth_unit: "m", "ft" or "fathom"; None: the file's, where feet and fathoms are refused.
        columns: of soundings: their names in the header, or without a header what each is: "lon,lat,depth".
            A fourth names the survey (a day, a line) that a sounding belongs to; surveys judge each other.
            A fifth names its time (seconds, milliseconds if it is called so, or ISO 8601), for `align`.
        cell_m: distance between nodes; None: the grid's own, or after the soundings' density.
        sigma_map_m: standard deviation of the chart's error; None: 0 for grids, from residuals for soundings.
        correlation_length_m: of that error; None: 0 for grids without and 10 m for grids with a sigma; for
            soundings from residuals between surveys, or 10 m.
        max_gap_m: of soundings: nodes farther than this from all of them are holes; None: 10 m or two cells.
        align: of soundings: shift segments of 900 s until crossing soundings agree.
        error_by_slope: of soundings: the chart's error grows with its slope, as their residuals do, in place of one sigma
            everywhere. For surveys whose positions err more than their depths.
        origin: latitude and longitude of the local zero, degrees; None: the chart's middle.

    Raises:
        ChartError: one line that names what is wrong with the file or an argument.
        MissingDependencyError: the extra `maps` is needed and not installed.
    """
    file = _file(path)
    grid_reader = _grid_reader(file)
    if grid_reader is None:
        return load_sounded(
            file, crs=crs, positive=positive, depth_unit=depth_unit, columns=columns, cell_m=cell_m,
            sigma_map_m=sigma_map_m, correlation_length_m=correlation_length_m, max_gap_m=max_gap_m,
            align=align, error_by_slope=error_by_slope, origin=origin, report_residuals=False,
        ).chart  # fmt: skip
    if columns is not None or max_gap_m is not None or align or error_by_slope:
        raise ChartError(
            f"{file.name} is a grid: columns, max_gap_m, align and error_by_slope are for soundings"
        )
    quality = _asked(sigma_map_m, correlation_length_m)
    raster = grid_reader(file, crs=crs, positive=positive, depth_unit=depth_unit)
    return chart_from_raster(raster, name=file.stem, cell_m=cell_m, origin=_place(origin), quality=quality)


def load_sounded(
    path: str | PathLike[str],
    *,
    crs: str | None = None,
    positive: str | None = None,
    depth_unit: str | None = None,
    columns: str | Sequence[str] | None = None,
    cell_m: float | None = None,
    sigma_map_m: float | None = None,
    correlation_length_m: float | None = None,
    max_gap_m: float | None = None,
    align: bool = False,
    error_by_slope: bool = False,
    origin: Origin | tuple[float, float] | None = None,
    report_residuals: bool = True,
) -> Gridded:
    """As `load_chart` of soundings, with what their residuals say beside the chart.

    Args:
        report_residuals: find them even where the chart's quality is given.
        path, crs, positive, depth_unit, columns, cell_m, sigma_map_m, correlation_length_m, max_gap_m, align,
            error_by_slope, origin: see `load_chart`.

    Raises:
        ChartError: the file is a grid, or see `load_chart`.
        MissingDependencyError: the extra `maps` is needed and not installed.
    """
    file = _file(path)
    if _grid_reader(file) is not None:
        raise ChartError(f"{file.name} is a grid: residuals come from soundings")
    quality = replace(_asked(sigma_map_m, correlation_length_m), by_slope=error_by_slope)
    soundings = load_soundings(
        file, crs=crs, positive=positive, depth_unit=depth_unit, columns=columns, origin=_place(origin)
    )
    return grid_and_judge(
        soundings,
        cell_m=cell_m,
        max_gap_m=max_gap_m,
        align=align,
        quality=quality,
        report_residuals=report_residuals,
    )


def _file(path: str | PathLike[str]) -> Path:
    file = Path(path)
    if not file.exists():
        raise ChartError(f"chart {file} does not exist")
    if not file.is_file():
        raise ChartError(f"chart {file} is not a file")
    if file.stat().st_size == 0:
        raise ChartError(f"chart {file} is empty")
    return file


def _place(origin: Origin | tuple[float, float] | None) -> Origin | None:
    return Origin(*origin) if isinstance(origin, tuple) else origin


def _asked(sigma_map_m: float | None, correlation_length_m: float | None) -> Quality:
    for label, value in (("sigma_map_m", sigma_map_m), ("correlation_length_m", correlation_length_m)):
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise ChartError(f"{label} {value} must be finite and at least 0 m")
    return Quality(sigma_map_m, correlation_length_m)


def _grid_reader(file: Path) -> Callable[..., Raster] | None:
    """The reader of a grid, by the file's first bytes; None for anything else."""
    with file.open("rb") as stream:
        start = stream.read(8)
    if start.startswith(_TIFF) or start[:5].lower() == _ESRI_ASCII or file.suffix.lower() == ".bag":
        return read_geotiff
    return read_netcdf if start.startswith(_NETCDF) else None
