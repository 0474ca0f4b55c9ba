"""NetCDF grids: CF conventions, GMT (also the flat layout of its oldest versions), GEBCO."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.grid_source import LONGEST_AXIS, GridSource, Reading, check_axes
from uwcoop.charts.places import horizontal
from uwcoop.charts.stored import HEADER
from uwcoop.charts.vertical import METRES_PER_UNIT, Stated, unit_of
from uwcoop.errors import ChartError, MissingDependencyError
from uwcoop.frames import crs_of

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

    Grid = NDArray[Any]

_LONGITUDES = {"lon", "longitude", "long"}
_LATITUDES = {"lat", "latitude"}
_EASTS = {"x", "easting", "east", "e", "projection_x_coordinate"}
_NORTHS = {"y", "northing", "north", "n", "projection_y_coordinate"}
_SIGMAS = {
    "sigma_map",
    "sigma",
    "uncertainty",
    "depth_uncertainty",
    "depth_sigma",
    "standard_deviation",
    "tvu",
}
_PREFERRED = ("elevation", "depth", "z", "altitude", "bathymetry", "topo", "band1")


@contextmanager
def open_netcdf(path: Path, kind: str, reading: Reading) -> Iterator[GridSource]:
    """The file's one two-dimensional variable over x and y (or longitude and latitude).

    `scale_factor`, `add_offset` and fill values are applied; `actual_range` is not needed. Axis values are
    taken as the positions of the values in both of GMT's registrations, which is what they are.

    Args:
        path: the file.
        kind: "netcdf3" or "netcdf4", as `file_kind` tells it.
        reading: its `crs` matters here.

    Raises:
        ChartError: not NetCDF, no such variable or several, no projection where one is needed.
    """
    import xarray as xr

    classic = kind == "netcdf3"
    if not classic:
        _check_declared(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # xarray's, about fill values that contradict each other
        try:
            engine = "scipy" if classic else "h5netcdf"
            with xr.open_dataset(path, engine=engine, decode_times=False, cache=False) as dataset:
                if "z" in dataset and dataset["z"].ndim == 1 and "dimension" in dataset:
                    yield _flat_source(dataset, path, reading.crs)
                else:
                    yield _source(dataset, path, reading.crs)
        except ImportError as error:
            raise MissingDependencyError("scipy" if classic else "h5netcdf", "maps") from error


def _check_declared(path: Path) -> None:
    """Refuse an HDF5 file whose axes declare more values than any has: xarray reads axes whole when it opens it."""
    import h5py

    with h5py.File(path, "r") as file:
        for name, item in file.items():
            shape = getattr(item, "shape", None)
            if shape and len(shape) == 1 and shape[0] > LONGEST_AXIS and name != "z":
                raise ChartError(f"{path.name} declares {shape[0]:,} values of {name}: it is damaged")


def _source(dataset: xr.Dataset, path: Path, asked: str | None) -> GridSource:
    variable = _depth_variable(dataset, path)
    y_name, x_name = (str(d) for d in variable.dims[-2:])
    if _is_x(dataset, y_name) and not _is_x(dataset, x_name):
        variable, x_name, y_name = variable.transpose(), y_name, x_name
    check_axes(path.name, *variable.shape)
    x, y = (_axis(dataset, name, path) for name in (x_name, y_name))
    axes_crs, notes, factor = _projection(dataset, variable, x_name, y_name, asked, path)
    attributes = variable.attrs
    sigma = _sigma_variable(dataset, variable)
    used = "" if sigma is None else f", {sigma.name!r} as its standard deviation"

    def read(rows: slice, cols: slice) -> tuple[Grid, Grid | None]:
        part = {y_name: rows, x_name: cols}
        values = _numbers(variable.isel(part))
        return values, None if sigma is None else _numbers(sigma.transpose(*variable.dims).isel(part))

    return GridSource(
        name=path.name,
        x=x * factor,
        y=y * factor,
        crs=axes_crs,
        stated=Stated(
            unit=str(attributes.get("units", "")),
            positive=str(attributes.get("positive", "")),
            standard_name=str(attributes.get("standard_name", "")),
            hint=str(attributes.get("long_name", "") or variable.name),
        ),
        read=read,
        notes=(f"variable {variable.name!r} over {y_name}, {x_name}{used}", *notes),
        header=str(dataset.attrs.get(HEADER, "")),
    )


def _numbers(variable: xr.DataArray) -> Grid:
    values = variable.values
    kind = values.dtype if values.dtype in (np.float32, np.float64) else np.float64
    values = np.asarray(values, dtype=kind)
    return np.where(np.isfinite(values), values, np.asarray(np.nan, kind))


def _depth_variable(dataset: xr.Dataset, path: Path) -> xr.DataArray:
    """The variable that holds the depths; its leading dimensions of length one are dropped."""
    grids = {
        str(name): squeezed
        for name, variable in dataset.data_vars.items()
        if variable.ndim >= 2
        and np.issubdtype(variable.dtype, np.number)
        and (squeezed := variable.squeeze()).ndim == 2
        and _spans_plane(dataset, squeezed)
    }
    if not grids:
        found = ", ".join(f"{name}{tuple(v.dims)}" for name, v in dataset.data_vars.items()) or "nothing"
        raise ChartError(
            f"{path.name} holds no grid over x and y or longitude and latitude: it holds {found}"
        )
    # Classes, such as a type identifier of each node, are numbers too.
    depths = {name: v for name, v in grids.items() if _why_no_depth(v) == ""}
    if not depths:
        name, reason = next((name, _why_no_depth(v)) for name, v in grids.items())
        raise ChartError(f"{path.name}: variable {name!r} is no depth: it {reason}")
    named = [name for wish in _PREFERRED for name in depths if name.lower() == wish]
    if named:
        return depths[named[0]]
    others = {name: v for name, v in depths.items() if not _is_sigma(name, v)}
    if len(others) != 1:
        raise ChartError(
            f"{path.name} holds several grids ({', '.join(depths)}), none of them named depth, "
            "elevation or z: keep one"
        )
    return next(iter(others.values()))


def _why_no_depth(variable: xr.DataArray) -> str:
    """Why a variable's numbers are no lengths; empty where they may be."""
    flags = [key for key in ("flag_values", "flag_masks", "flag_meanings") if key in variable.attrs]
    unit = unit_of(str(variable.attrs.get("units", "")))
    if flags and unit not in METRES_PER_UNIT:
        return f"has {flags[0]} and no unit of length"
    return ""


def _is_sigma(name: str, variable: xr.DataArray) -> bool:
    said = f"{variable.attrs.get('standard_name', '')} {variable.attrs.get('long_name', '')}".lower()
    return name.lower() in _SIGMAS or "standard_error" in said or "standard deviation" in said


def _sigma_variable(dataset: xr.Dataset, depth: xr.DataArray) -> xr.DataArray | None:
    """Standard deviations of the depths; None where the file holds none."""
    for name, variable in dataset.data_vars.items():
        if (
            str(name) != depth.name
            and _is_sigma(str(name), variable)
            and set(depth.dims) <= set(variable.dims)
        ):
            squeezed = variable.squeeze()
            if set(squeezed.dims) == set(depth.dims) and squeezed.shape:
                return squeezed
    return None


def _spans_plane(dataset: xr.Dataset, variable: xr.DataArray) -> bool:
    first, second = (str(d) for d in variable.dims)
    return (_is_x(dataset, second) and _is_y(dataset, first)) or (
        _is_x(dataset, first) and _is_y(dataset, second)
    )


def _names(dataset: xr.Dataset, dimension: str) -> set[str]:
    attributes = dataset[dimension].attrs if dimension in dataset.variables else {}
    return {dimension.lower(), *(str(attributes.get(key, "")).lower() for key in ("standard_name", "axis"))}


def _is_x(dataset: xr.Dataset, dimension: str) -> bool:
    return bool(_names(dataset, dimension) & (_LONGITUDES | _EASTS))


def _is_y(dataset: xr.Dataset, dimension: str) -> bool:
    return bool(_names(dataset, dimension) & (_LATITUDES | _NORTHS))


def _axis(dataset: xr.Dataset, name: str, path: Path) -> Grid:
    if name not in dataset.variables:
        raise ChartError(f"{path.name} has no coordinate values for its axis {name!r}")
    return np.asarray(dataset[name].values, dtype=np.float64)


def _projection(
    dataset: xr.Dataset, variable: xr.DataArray, x_name: str, y_name: str, asked: str | None, path: Path
) -> tuple[Any, tuple[str, ...], float]:
    """The axes' projection (None: local metres), notes, and the factor that brings the axes to its unit."""
    unit = str(dataset[x_name].attrs.get("units", "")).lower()
    factor = 1000.0 if unit in ("km", "kilometer", "kilometers", "kilometre", "kilometres") else 1.0
    if asked == "local":
        return None, ("projection: local metres as asked",), factor
    if asked is not None:
        return horizontal(crs_of(asked)), (f"projection {asked} as asked",), factor
    stated = _grid_mapping(dataset, variable)
    if stated is not None:
        return horizontal(stated), (), factor
    if unit.startswith("degree") or _names(dataset, x_name) & _LONGITUDES:
        return crs_of("EPSG:4326"), ("datum not stated: WGS 84 assumed",), 1.0
    x, y = (np.abs(np.asarray(dataset[name].values, dtype=np.float64)).max() for name in (x_name, y_name))
    if unit in ("m", "meter", "meters", "metre", "metres") or factor != 1.0 or x > 360 or y > 90:
        return None, (), factor
    raise ChartError(
        f"{path.name} does not say whether its {x_name} and {y_name} are degrees or metres: "
        "give crs, such as EPSG:4326, or crs='local' for local metres"
    )


def _grid_mapping(dataset: xr.Dataset, variable: xr.DataArray) -> Any:
    """The pyproj CRS that the variable's CF grid mapping describes, or None."""
    name = variable.attrs.get("grid_mapping") or variable.encoding.get("grid_mapping")
    candidates = [str(name).split(":")[0].split()[0]] if name else ["crs", "spatial_ref"]
    for candidate in candidates:
        if candidate not in dataset.variables:
            continue
        attributes = dict(dataset[candidate].attrs)
        text = attributes.get("crs_wkt") or attributes.get("spatial_ref") or attributes.get("epsg_code")
        if text:
            return crs_of(str(text))
        if "grid_mapping_name" in attributes:
            return _from_cf(attributes)
    return None


def _from_cf(attributes: dict[str, Any]) -> Any:
    crs = crs_of("EPSG:4326")  # also says which extra is missing
    try:
        return type(crs).from_cf(attributes)
    except (KeyError, ValueError) as error:
        name = attributes["grid_mapping_name"]
        raise ChartError(f"grid mapping {name!r} is not understood: give crs, such as EPSG:32654") from error


def _flat_source(dataset: xr.Dataset, path: Path, crs: str | None) -> GridSource:
    """GMT's oldest layout: z as one row after another from the north-west, ranges in place of axes."""
    cols, rows = (int(n) for n in np.asarray(dataset["dimension"].values).ravel()[:2])
    check_axes(path.name, rows, cols)
    z = dataset["z"]
    if z.size != rows * cols:
        raise ChartError(f"{path.name} holds {z.size} values for {rows} x {cols} nodes")
    pixel = int(np.ravel(z.attrs.get("node_offset", dataset.attrs.get("node_offset", 0)))[0]) == 1
    ranges = [np.asarray(dataset[name].values, dtype=np.float64).ravel() for name in ("x_range", "y_range")]
    x, y = (_flat_axis(limits, count, pixel) for limits, count in zip(ranges, (cols, rows), strict=True))
    units = str(dataset["x_range"].attrs.get("units", "")).lower()
    if crs == "local" or (
        crs is None and not ("degree" in units or "lon" in units) and np.abs(x).max() > 360
    ):
        axes_crs, notes = None, ()
    elif crs is None and not ("degree" in units or "lon" in units):
        raise ChartError(
            f"{path.name} does not say whether its x and y are degrees or metres: "
            "give crs, such as EPSG:4326, or crs='local' for local metres"
        )
    else:
        axes_crs, notes = horizontal(crs_of(crs or "EPSG:4326")), ()
    unit = "" if (name := str(dataset["z_range"].attrs.get("units", ""))) in ("z", "user_z_unit") else name

    def read(wanted_rows: slice, wanted_cols: slice) -> tuple[Grid, None]:
        part = _numbers(z[wanted_rows.start * cols : wanted_rows.stop * cols])
        return part.reshape(-1, cols)[:, wanted_cols], None

    return GridSource(
        name=path.name,
        x=x,
        y=y[::-1],
        crs=axes_crs,
        stated=Stated(unit=unit, hint=str(z.attrs.get("long_name", ""))),
        read=read,
        notes=("GMT's flat layout", *notes),
    )


def _flat_axis(limits: Grid, count: int, pixel: bool) -> Grid:
    half = (limits[1] - limits[0]) / count / 2 if pixel else 0.0
    return np.linspace(limits[0] + half, limits[1] - half, count)
