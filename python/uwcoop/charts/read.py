"""`load_chart`: which reader a file needs, told by its content and never by its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.esri_ascii import open_esri_ascii
from uwcoop.charts.gdal_rasters import open_raster
from uwcoop.charts.grid_source import GridSource, Reading, raster_of
from uwcoop.charts.gridding import Gridded, grid_and_judge
from uwcoop.charts.netcdf import open_netcdf
from uwcoop.charts.places import Area
from uwcoop.charts.raster import Quality, chart_from_raster
from uwcoop.charts.soundings import joined, load_soundings
from uwcoop.charts.stored import chart_as_stored, stored_quality
from uwcoop.errors import ChartError, UwcoopError
from uwcoop.frames import Origin
from uwcoop.importers.file_kind import FileKind, file_kind

if TYPE_CHECKING:
    from uwcoop.charts.chart import Chart

File = str | PathLike[str]
_GRIDS = ("tiff", "bag", "s102", "netcdf3", "netcdf4", "esri-ascii")


def load_chart(
    path: File | Sequence[File],
    *,
    crs: str | None = None,
    positive: str | None = None,
    depth_unit: str | None = None,
    nodata: float | None = None,
    area: Sequence[float] | str | None = None,
    columns: str | Sequence[str] | None = None,
    cell_m: float | None = None,
    sigma_map_m: float | None = None,
    correlation_length_m: float | None = None,
    max_gap_m: float | None = None,
    align: bool = False,
    error_by_slope: bool = False,
    origin: Origin | tuple[float, float] | None = None,
    mission_area: Callable[[], Area | None] | None = None,
) -> Chart:
    """Read a chart: GeoTIFF, NetCDF (CF, GMT, GEBCO), BAG, S-102, ESRI ASCII grid, or soundings as CSV or XYZ text
    (.gz).

    What the file does not say is found or assumed, and stands in the chart's `notes`. Numbers that no depth can be
    are left out and counted there. Nodes with no water (depth of zero or less) become holes. Positions become local
    metres around `origin`: a grid or soundings in a metric projection whose metres are metres on the ground (within
    0.2 %) are shifted, anything else goes to a transverse Mercator centred there.

    Args:
        path: the file; several files of soundings become one chart, each a survey that judges the others.
        crs: projection of the positions ("EPSG:32654", WKT, PROJ), or "local" for local metres; None: the
            file's.
        positive: "up" or "down", the way the file's numbers grow; None: the file's word, or the values' sign.
        depth_unit: "m", "ft" or "fathom"; None: the file's, or metres where it states none.
        nodata: a number in the file that means "no data", beside those that it declares or that are no depths.
        area: latitude and longitude of two opposite corners, degrees, as numbers or "47.60,-122.40,47.61,-122.38":
            only this part is read, with memory for this part alone.
        columns: of soundings: their names in the header, or without a header what each is: "lon,lat,depth".
            A fourth names the survey (a day, a line) that a sounding belongs to; surveys judge each other.
            A fifth names its time, in any form that `uwcoop.importers.times` reads, for `align`.
        cell_m: distance between nodes; None: the grid's own, or after the soundings' density.
        sigma_map_m: standard deviation of the chart's error; None: the file's, else 0 for grids, from residuals
            for soundings.
        correlation_length_m: of that error; None: 0 for grids without and 10 m for grids with a sigma; for
            soundings from residuals between surveys, or 10 m.
        max_gap_m: of soundings: nodes farther than this from all of them are holes; None: 10 m or two cells.
        align: of soundings: shift segments of 900 s until crossing soundings agree.
        error_by_slope: of soundings: the chart's error grows with its slope, as their residuals do, in place of one sigma
            everywhere. For surveys whose positions err more than their depths.
        origin: latitude and longitude of the local zero, degrees; None: the chart's middle.
        mission_area: tells the area of a mission (None: unknown), which is read in place of a grid of more than 16
            million nodes where no `area` is given.

    Raises:
        ChartError: one line that names what is wrong with the file or an argument.
        MissingDependencyError: the extra `maps` is needed and not installed.
    """
    files = _files(path)
    kinds = [_kind(file) for file in files]
    reading = replace(_reading(crs, positive, depth_unit, nodata, area, cell_m), mission_area=mission_area)
    if not any(kind.key in _GRIDS for kind in kinds):
        return load_sounded(
            files, crs=crs, positive=positive, depth_unit=depth_unit, nodata=nodata, area=area, columns=columns,
            cell_m=cell_m, sigma_map_m=sigma_map_m, correlation_length_m=correlation_length_m,
            max_gap_m=max_gap_m, align=align, error_by_slope=error_by_slope, origin=origin, report_residuals=False,
        ).chart  # fmt: skip
    if len(files) > 1:
        grids = ", ".join(f.name for f, kind in zip(files, kinds, strict=True) if kind.key in _GRIDS)
        raise ChartError(f"{grids}: several files make one chart when all hold soundings; merge grids first")
    file = files[0]
    if columns is not None or max_gap_m is not None or align or error_by_slope:
        raise ChartError(
            f"{file.name} is a grid: columns, max_gap_m, align and error_by_slope are for soundings"
        )
    quality = _asked(sigma_map_m, correlation_length_m)
    with _one_line(file), _opened(file, kinds[0], reading) as source:
        if reading == Reading() and quality == Quality() and origin is None:
            as_stored = chart_as_stored(source)
            if as_stored is not None:
                return as_stored
        raster = raster_of(source, reading)
        quality = stored_quality(source, quality)
    return chart_from_raster(raster, name=file.stem, cell_m=cell_m, origin=_place(origin), quality=quality)


def load_sounded(
    path: File | Sequence[File],
    *,
    crs: str | None = None,
    positive: str | None = None,
    depth_unit: str | None = None,
    nodata: float | None = None,
    area: Sequence[float] | str | None = None,
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
        path, crs, positive, depth_unit, nodata, area, columns, cell_m, sigma_map_m, correlation_length_m, max_gap_m,
            align, error_by_slope, origin: see `load_chart`.

    Raises:
        ChartError: a file is a grid, or see `load_chart`.
        MissingDependencyError: the extra `maps` is needed and not installed.
    """
    quality = replace(_asked(sigma_map_m, correlation_length_m), by_slope=error_by_slope)
    reading = _reading(crs, positive, depth_unit, nodata, area, cell_m)
    surveys = []
    place = _place(origin)
    for file in _files(path):
        if _kind(file).key in _GRIDS:
            raise ChartError(f"{file.name} is a grid: residuals come from soundings")
        with _one_line(file):
            surveys.append(
                load_soundings(
                    file, crs=crs, positive=positive, depth_unit=depth_unit, nodata=nodata, area=reading.area,
                    columns=columns, origin=place,
                )
            )  # fmt: skip
        # All further files come around the first one's middle.
        place = surveys[0].origin if surveys[0].origin.latitude_deg is not None else place
    return grid_and_judge(
        surveys[0] if len(surveys) == 1 else joined(surveys),
        cell_m=cell_m,
        max_gap_m=max_gap_m,
        align=align,
        quality=quality,
        report_residuals=report_residuals,
    )


@contextmanager
def _one_line(file: Path) -> Iterator[None]:
    """Turn whatever the libraries below raise about a damaged file into one error of one line."""
    try:
        yield
    except UwcoopError as error:
        if "\n" in str(error) and isinstance(error, ChartError):
            raise ChartError(" ".join(str(error).split())) from error
        raise
    except MemoryError as error:
        raise ChartError(
            f"{file.name} cannot be read as a chart: it asks for more memory than there is"
        ) from error
    except Exception as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise ChartError(f"{file.name} cannot be read as a chart: {said}") from error


def _opened(file: Path, kind: FileKind, reading: Reading) -> AbstractContextManager[GridSource]:
    if kind.key == "esri-ascii":
        return open_esri_ascii(file, reading)
    if kind.key in ("netcdf3", "netcdf4"):
        return open_netcdf(file, kind.key, reading)
    return open_raster(file, kind.key, reading)


def _files(path: File | Sequence[File]) -> list[Path]:
    files = [Path(path)] if isinstance(path, str | PathLike) else [Path(one) for one in path]
    if not files:
        raise ChartError("no chart file is given")
    for file in files:
        if not file.exists():
            raise ChartError(f"chart {file} does not exist")
        if not file.is_file():
            raise ChartError(f"chart {file} is not a file")
        if file.stat().st_size == 0:
            raise ChartError(f"chart {file} is empty")
    return files


def _kind(file: Path) -> FileKind:
    """The kind of a file that is a chart.

    Raises:
        ChartError: it is something else, which the message names.
    """
    kind = file_kind(file)
    if kind.key not in (*_GRIDS, "text"):
        raise ChartError(
            f"{file.name} is no chart but {kind.name}" + (f": {kind.advice}" if kind.advice else "")
        )
    return kind


def _place(origin: Origin | tuple[float, float] | None) -> Origin | None:
    return Origin(*origin) if isinstance(origin, tuple) else origin


def _reading(
    crs: str | None,
    positive: str | None,
    depth_unit: str | None,
    nodata: float | None,
    area: Sequence[float] | str | None,
    cell_m: float | None,
) -> Reading:
    if nodata is not None and np.isinf(nodata):
        raise ChartError(f"nodata {nodata} must be a number: infinite values are holes already")
    return Reading(crs, positive, depth_unit, nodata, None if area is None else Area.of(area), cell_m)


def _asked(sigma_map_m: float | None, correlation_length_m: float | None) -> Quality:
    for label, value in (("sigma_map_m", sigma_map_m), ("correlation_length_m", correlation_length_m)):
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise ChartError(f"{label} {value} must be finite and at least 0 m")
    return Quality(sigma_map_m, correlation_length_m)
