"""Grids written by the test and read back: GeoTIFF and NetCDF, their signs, units and projections."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from uwcoop.charts import Chart, load_chart
from uwcoop.charts.raster import Quality, Raster, chart_from_raster
from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame, Origin

rasterio = pytest.importorskip("rasterio")

ROWS, COLS, CELL = 30, 40, 5.0
WEST, SOUTH = 374_000.0, 3_891_000.0  # EPSG:32654, in Sagami Bay
HOLE = (4, 7)


def depths() -> Any:
    """Depths (rows, cols), south first, no two alike in both directions, with one hole."""
    i, j = np.mgrid[:ROWS, :COLS]
    grid = 8.0 + 0.21 * i + 0.13 * j + 0.02 * i * j
    grid[HOLE] = np.nan
    return grid


def write_geotiff(path: Path, values: Any, *, crs: str | None = "EPSG:32654", **changes: Any) -> Path:
    """`values` south first with their nodes at WEST + j CELL, SOUTH + i CELL."""
    from affine import Affine

    top = SOUTH + (ROWS - 0.5) * CELL
    profile = {
        "nodata": -9999.0,
        "transform": Affine(CELL, 0, WEST - CELL / 2, 0, -CELL, top),
        "dtype": "float32",
    }
    tags, unit, name = (changes.pop(key, None) for key in ("tags", "unit", "description"))
    profile |= changes
    filled = np.where(np.isnan(values), profile["nodata"], values)[::-1]
    with rasterio.open(
        path, "w", driver="GTiff", height=ROWS, width=COLS, count=1, crs=crs, **profile
    ) as target:
        target.write(filled.astype(profile["dtype"]), 1)
        target.update_tags(**(tags or {}))
        if unit:
            target.set_band_unit(1, unit)
        if name:
            target.set_band_description(1, name)
    return path


def same_as_written(chart: Chart) -> None:
    np.testing.assert_allclose(chart.depth_m, depths(), rtol=2e-6)
    assert chart.cell_m == pytest.approx(CELL)
    assert chart.extent == pytest.approx((-97.5, -72.5, 97.5, 72.5))


def notes(chart: Chart) -> str:
    return " | ".join(chart.notes)


def test_geotiff_keeps_its_nodes_around_its_own_middle(tmp_path: Path) -> None:
    chart = load_chart(write_geotiff(tmp_path / "bay.tif", depths()))
    same_as_written(chart)
    assert chart.name == "bay"
    assert chart.origin.crs == "EPSG:32654"
    middle = LocalFrame(chart.origin).offset_m
    assert middle == pytest.approx((WEST + 97.5, SOUTH + 72.5), abs=1e-3)
    for said in ("depth unit not stated: metres assumed", "positive down: not stated, found because",
                 "grid north", "sigma_map 0 and correlation length 0"):  # fmt: skip
        assert said in notes(chart)


def test_pixel_is_point_and_pixel_is_area_place_values_alike(tmp_path: Path) -> None:
    area = load_chart(write_geotiff(tmp_path / "a.tif", depths(), tags={"AREA_OR_POINT": "Area"}))
    point = load_chart(write_geotiff(tmp_path / "p.tif", depths(), tags={"AREA_OR_POINT": "Point"}))
    assert area == point


def test_scale_offset_and_integer_nodata(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "scaled.tif", np.round(depths() * 100), dtype="int16")
    with rasterio.open(path, "r+") as target:
        target.scales, target.offsets = (0.01,), (-1.0,)
    chart = load_chart(path)
    np.testing.assert_allclose(chart.depth_m, depths() - 1, atol=0.006)
    assert np.isnan(chart.depth_m[HOLE])


@pytest.mark.parametrize(
    ("sign", "written", "said"),
    [
        (-1, {}, "positive up: not stated, found because the median value is -1"),
        (-1, {"tags": {"positive": "up"}}, "positive up: stated by the attribute positive"),
        (1, {"tags": {"positive": "down"}}, "positive down: stated by the attribute positive"),
        (-1, {"description": "elevation"}, "positive up: named 'elevation', and the values agree"),
        (-1, {"description": "depth"}, "found because the median value is -1"),
        (
            1,
            {"tags": {"standard_name": "sea_floor_depth_below_geoid"}},
            "positive down: stated by the standard",
        ),
    ],
)
def test_direction_is_stated_or_found_and_said(
    tmp_path: Path, sign: int, written: dict[str, Any], said: str
) -> None:
    chart = load_chart(write_geotiff(tmp_path / "x.tif", sign * depths(), **written))
    same_as_written(chart)
    assert said in notes(chart)


def test_direction_can_be_asked_for_and_an_impossible_one_is_refused(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "x.tif", depths())
    same_as_written(load_chart(path, positive="down"))
    with pytest.raises(ChartError, match="leave no depth below the surface when read as positive up"):
        load_chart(path, positive="up")
    with pytest.raises(ChartError, match="positive 'sideways' is unknown: choose up or down"):
        load_chart(path, positive="sideways")


def test_land_becomes_holes(tmp_path: Path) -> None:
    heights = -depths() + 10.0
    chart = load_chart(write_geotiff(tmp_path / "x.tif", heights, description="elevation"))
    np.testing.assert_array_equal(np.isnan(chart.depth_m), ~(heights < 0))
    assert "at or above the surface: made holes" in notes(chart)


@pytest.mark.parametrize(("unit", "option", "metres"), [("ft", "ft", 0.3048), ("Fathoms", "fathom", 1.8288)])
def test_feet_are_converted_as_stated_or_asked_and_noted(
    tmp_path: Path, unit: str, option: str, metres: float
) -> None:
    path = write_geotiff(tmp_path / "x.tif", depths() / metres, unit=unit)
    for asked, said in ((None, f"depth unit stated: {unit}, converted to metres"),
                        (option, f"depth unit {option} as asked")):  # fmt: skip
        chart = load_chart(path, depth_unit=asked)
        np.testing.assert_allclose(chart.depth_m, depths(), rtol=1e-6)
        assert said in notes(chart)
    assert "against the file's" in notes(load_chart(path, depth_unit="m"))


def test_units_that_nobody_knows_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ChartError, match="depth unit 'dbar' is unknown"):
        load_chart(write_geotiff(tmp_path / "x.tif", depths(), unit="dbar"))
    with pytest.raises(ChartError, match="depth_unit 'yd' is unknown: choose m, ft or fathom"):
        load_chart(write_geotiff(tmp_path / "y.tif", depths()), depth_unit="yd")


def test_projection_absent_unknown_or_asked_for(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "x.tif", depths(), crs=None)
    with pytest.raises(ChartError, match="states no projection: give crs, such as EPSG:32654"):
        load_chart(path)
    with pytest.raises(ChartError, match="projection 'EPSG:99999999' is unknown"):
        load_chart(path, crs="EPSG:99999999")
    same_as_written(load_chart(path, crs="EPSG:32654"))
    local = load_chart(path, crs="local")
    assert local.extent[:2] == pytest.approx((WEST, SOUTH))
    assert local.origin == Origin()
    assert "place on Earth unknown" in notes(local)


def test_origin_moves_the_zero_and_not_the_seabed(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "x.tif", depths())
    own = load_chart(path)
    assert own.origin.latitude_deg is not None
    assert own.origin.longitude_deg is not None
    place = (own.origin.latitude_deg - 0.001, own.origin.longitude_deg)
    moved = load_chart(path, origin=place)
    assert moved.origin == Origin(*place, "EPSG:32654")
    shift = LocalFrame(moved.origin).to_local(own.origin.latitude_deg, own.origin.longitude_deg)[0]
    assert np.hypot(*shift) == pytest.approx(110.9, abs=0.2)
    np.testing.assert_allclose(moved.extent[:2], np.add(own.extent[:2], shift), atol=1e-6)
    np.testing.assert_array_equal(moved.depth_m, own.depth_m)


def test_another_cell_is_resampled_and_coarse_cells_average(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "x.tif", depths())
    fine, written = load_chart(path, cell_m=2.5), load_chart(path)
    nodes = np.stack(np.meshgrid(fine.east_m, fine.north_m), axis=-1).reshape(-1, 2)
    known = np.isfinite(written.depth_at(nodes))
    np.testing.assert_allclose(fine.depth_m.ravel()[known], written.depth_at(nodes)[known], atol=1e-5)
    assert "resampled bilinearly from cells of 5 x 5 m to 2.5 m" in notes(fine)
    rng = np.random.default_rng(0)
    noisy = write_geotiff(tmp_path / "n.tif", 20 + rng.normal(size=(ROWS, COLS)))
    assert np.nanstd(load_chart(noisy, cell_m=25.0).depth_m) < 0.4


def test_oblong_cells_become_square(tmp_path: Path) -> None:
    from affine import Affine

    oblong = Affine(4.0, 0, WEST, 0, -8.0, SOUTH)
    chart = load_chart(write_geotiff(tmp_path / "x.tif", depths(), transform=oblong))
    assert chart.cell_m == 4.0
    assert chart.shape == (2 * ROWS - 1, COLS)


def test_rotated_and_oversized_rasters_are_refused(tmp_path: Path) -> None:
    from affine import Affine

    turned = Affine(4.7, 1.7, WEST, 1.7, -4.7, SOUTH)
    with pytest.raises(ChartError, match="is rotated against its projection's axes"):
        load_chart(write_geotiff(tmp_path / "r.tif", depths(), transform=turned))
    path = write_geotiff(tmp_path / "x.tif", depths())
    with pytest.raises(ChartError, match=r"nodes is above 16,000,000: give the mission's area, or choose"):
        load_chart(path, cell_m=0.001)
    with pytest.raises(ChartError, match="cell_m -1 must be finite and above 0"):
        load_chart(path, cell_m=-1)


def test_all_holes_cut_off_or_not_a_chart(tmp_path: Path) -> None:
    with pytest.raises(ChartError, match="holds no depth: all are holes"):
        load_chart(write_geotiff(tmp_path / "x.tif", np.full((ROWS, COLS), np.nan)))
    whole = write_geotiff(tmp_path / "y.tif", depths()).read_bytes()
    for name, content in (("cut.tif", whole[:200]), ("cut.nc", b"\x89HDF\r\n\x1a\n" + b"0" * 99)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(
            ChartError, match=f"{name} cannot be read|{name} is no chart but an HDF5 file that is cut off"
        ) as caught:
            load_chart(tmp_path / name)
        assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------------------------- NetCDF


def write_netcdf(path: Path, dataset: xr.Dataset, *, classic: bool = False, **encoding: Any) -> Path:
    names = {str(name): encoding for name in dataset.data_vars if dataset[name].ndim == 2} if encoding else {}
    dataset.to_netcdf(path, engine="scipy" if classic else "h5netcdf", encoding=names)
    return path


def metric(values: Any, name: str = "z", **attributes: Any) -> xr.Dataset:
    """A grid over x and y in UTM metres, as GMT and CF write them."""
    axes = {
        "y": ("y", SOUTH + CELL * np.arange(ROWS), {"units": "m"}),
        "x": ("x", WEST + CELL * np.arange(COLS), {"units": "m"}),
    }
    return xr.Dataset({name: (("y", "x"), values, attributes)}, axes)


@pytest.mark.parametrize("classic", [False, True])
@pytest.mark.parametrize("with_range", [False, True])
def test_gmt_grid_with_and_without_actual_range(tmp_path: Path, classic: bool, with_range: bool) -> None:
    dataset = metric(-depths(), long_name="z")
    if with_range:
        dataset["z"].attrs["actual_range"] = [float(np.nanmin(-depths())), float(np.nanmax(-depths()))]
        dataset["x"].attrs["actual_range"] = [WEST, WEST + CELL * (COLS - 1)]
    dataset.attrs |= {"node_offset": 0, "Conventions": "CF-1.7"}
    chart = load_chart(write_netcdf(tmp_path / "gmt.grd", dataset, classic=classic))
    np.testing.assert_allclose(chart.depth_m, depths(), rtol=1e-6)
    assert chart.extent[:2] == pytest.approx((WEST, SOUTH))
    assert "no projection: positions taken as local metres" in notes(chart)
    same_as_written(load_chart(tmp_path / "gmt.grd", crs="EPSG:32654"))


def test_cf_grid_with_mapping_packing_and_descending_rows(tmp_path: Path) -> None:
    from pyproj import CRS

    dataset = metric(depths(), "depth", standard_name="sea_floor_depth_below_mean_sea_level", units="m",
                     grid_mapping="utm")  # fmt: skip
    mapping = CRS.from_epsg(32654).to_cf()
    del mapping["crs_wkt"]
    dataset["utm"] = xr.DataArray(0, attrs=mapping)
    packed = {"dtype": "int16", "scale_factor": 0.01, "add_offset": 20.0, "_FillValue": -32768}
    chart = load_chart(write_netcdf(tmp_path / "cf.nc", dataset.isel(y=slice(None, None, -1)), **packed))
    np.testing.assert_allclose(chart.depth_m, depths(), atol=0.006)
    assert chart.extent == pytest.approx((-97.5, -72.5, 97.5, 72.5))
    assert "depth unit stated: metres" in notes(chart)
    assert "stated by the standard name" in notes(chart)


def test_a_transposed_grid_is_turned(tmp_path: Path) -> None:
    dataset = metric(depths()).transpose("x", "y").expand_dims(time=[0])
    same_as_written(load_chart(write_netcdf(tmp_path / "t.nc", dataset), crs="EPSG:32654"))


def geographic(cell_deg: float = 1e-4, name: str = "elevation", **attributes: Any) -> xr.Dataset:
    """A plane over longitude and latitude, positive up, as GEBCO writes it."""
    latitude = 1.2 + cell_deg * np.arange(60)
    longitude = 103.8 + cell_deg * np.arange(50)
    plane = -(12 + 500 * (latitude[:, None] - 1.2) + 200 * (longitude[None, :] - 103.8))
    axes = {
        "lat": ("lat", latitude, {"units": "degrees_north"}),
        "lon": ("lon", longitude, {"units": "degrees_east"}),
    }
    return xr.Dataset({name: (("lat", "lon"), plane, attributes)}, axes)


def test_gebco_like_grid_is_projected_to_local_metres(tmp_path: Path) -> None:
    dataset = geographic(units="m", standard_name="height_above_mean_sea_level", sdn_uom_name="Metres")
    chart = load_chart(write_netcdf(tmp_path / "gebco.nc", dataset))
    frame = LocalFrame(chart.origin)
    assert chart.origin.latitude_deg == pytest.approx(1.2 + 29.5e-4)
    places = frame.to_geographic([[0, 0], [150, -200], [-200, 120]])
    expected = 12 + 500 * (places[:, 0] - 1.2) + 200 * (places[:, 1] - 103.8)
    np.testing.assert_allclose(chart.depth_at([[0, 0], [150, -200], [-200, 120]]), expected, atol=1e-4)
    assert chart.cell_m == pytest.approx(11.1, abs=0.1)
    assert (chart.east0_m / chart.cell_m) % 1 == pytest.approx(0, abs=1e-6)
    for said in ("datum not stated: WGS 84 assumed", "projected and resampled", "transverse Mercator",
                 "positive up: stated by the standard name"):  # fmt: skip
        assert said in notes(chart)


def test_a_chart_around_another_origin_shares_the_seabed(tmp_path: Path) -> None:
    path = write_netcdf(tmp_path / "g.nc", geographic())
    own, moved = load_chart(path), load_chart(path, origin=(1.201, 103.801), cell_m=5.0)
    places = LocalFrame(own.origin).to_geographic([[40.0, 60.0], [-90.0, 10.0]])
    local = LocalFrame(moved.origin).to_local(places[:, 0], places[:, 1])
    np.testing.assert_allclose(moved.depth_at(local), own.depth_at([[40, 60], [-90, 10]]), atol=1e-4)


def test_degrees_counted_to_360_and_beyond_the_date_line(tmp_path: Path) -> None:
    dataset = geographic()
    dataset = dataset.assign_coords(
        lon=("lon", dataset["lon"].values - 103.8 + 179.9975, {"units": "degrees_east"})
    )
    chart = load_chart(write_netcdf(tmp_path / "d.nc", dataset))
    assert chart.hole_share < 0.05


def write_flat(path: Path, values: Any, x_range: Any, y_range: Any, offset: int = 0) -> Path:
    """The layout of GMT before version 4: one long row from the north-west."""
    rows, cols = values.shape
    dataset = xr.Dataset(
        {
            "x_range": ("side", np.array(x_range), {"units": "user_x_unit"}),
            "y_range": ("side", np.array(y_range), {"units": "user_y_unit"}),
            "z_range": ("side", np.array([np.nanmin(values), np.nanmax(values)]), {"units": "user_z_unit"}),
            "spacing": ("side", np.array([CELL, CELL])),
            "dimension": ("side", np.array([cols, rows], dtype=np.int32)),
            "z": ("xysize", values[::-1].ravel(), {"node_offset": offset}),
        }
    )
    dataset.to_netcdf(path, engine="scipy")
    return path


@pytest.mark.parametrize("pixel", [0, 1])
def test_oldest_gmt_layout_in_both_registrations(tmp_path: Path, pixel: int) -> None:
    half = CELL / 2 * pixel
    x = (WEST - half, WEST + CELL * (COLS - 1) + half)
    y = (SOUTH - half, SOUTH + CELL * (ROWS - 1) + half)
    path = write_flat(tmp_path / "old.grd", -depths(), x, y, pixel)
    same_as_written(load_chart(path, crs="EPSG:32654"))
    degrees = write_flat(tmp_path / "deg.grd", -depths(), (103.0, 103.1), (1.0, 1.1))
    with pytest.raises(ChartError, match="does not say whether its x and y are degrees or metres"):
        load_chart(degrees)
    assert load_chart(degrees, crs="EPSG:4326").origin.latitude_deg == pytest.approx(1.05)


def test_netcdf_that_is_no_chart(tmp_path: Path) -> None:
    lines = xr.Dataset({"t": ("time", np.arange(5.0))})
    with pytest.raises(
        ChartError, match=r"holds no grid over x and y or longitude and latitude: it holds t\('time'"
    ):
        load_chart(write_netcdf(tmp_path / "a.nc", lines))
    two = metric(depths(), "first").assign(second=metric(depths(), "second")["second"])
    with pytest.raises(ChartError, match=r"holds several grids \(first, second\)"):
        load_chart(write_netcdf(tmp_path / "b.nc", two))
    bare = metric(depths()).assign_coords(x=np.arange(COLS) * 1.0, y=np.arange(ROWS) * 1.0)
    with pytest.raises(ChartError, match="does not say whether its x and y are degrees or metres"):
        load_chart(write_netcdf(tmp_path / "c.nc", bare))
    assert load_chart(tmp_path / "c.nc", crs="local").cell_m == 1.0
    uneven = metric(depths()).assign_coords(x=WEST + np.arange(COLS) ** 2.0)
    with pytest.raises(ChartError, match="axis x is uneven: steps of 1 to 77"):
        load_chart(write_netcdf(tmp_path / "d.nc", uneven), crs="EPSG:32654")
    feet = metric(depths(), "depth", units="feet")
    converted = load_chart(write_netcdf(tmp_path / "e.nc", feet), crs="EPSG:32654")
    assert converted.depth_range_m[0] == pytest.approx(8.0 * 0.3048)
    assert "depth unit stated: feet, converted to metres" in notes(converted)


def test_options_of_soundings_are_refused_for_grids(tmp_path: Path) -> None:
    with pytest.raises(
        ChartError, match="is a grid: columns, max_gap_m, align and error_by_slope are for soundings"
    ):
        load_chart(write_geotiff(tmp_path / "x.tif", depths()), columns="e,n,depth")


def test_quality_is_as_asked(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "x.tif", depths())
    chart = load_chart(path, sigma_map_m=0.3, correlation_length_m=12.0)
    assert (chart.sigma_map_m, chart.correlation_length_m) == (0.3, 12.0)
    with pytest.raises(ChartError, match="sigma_map_m -1 must be finite and at least 0 m"):
        load_chart(path, sigma_map_m=-1)


def test_esri_ascii_grid(tmp_path: Path) -> None:
    rows = "\n".join(
        " ".join(f"{v:.3f}" if np.isfinite(v) else "-9999" for v in row) for row in depths()[::-1]
    )
    head = f"ncols {COLS}\nnrows {ROWS}\nxllcenter {WEST}\nyllcenter {SOUTH}\ncellsize {CELL}\n"
    (tmp_path / "grid.asc").write_text(head + "NODATA_value -9999\n" + rows + "\n")
    chart = load_chart(tmp_path / "grid.asc", crs="EPSG:32654")
    np.testing.assert_allclose(chart.depth_m, depths(), atol=6e-4)


@pytest.mark.parametrize("corner", ["corner", "center"])
def test_esri_ascii_places_its_nodes_by_corner_or_centre(tmp_path: Path, corner: str) -> None:
    shift = CELL / 2 if corner == "corner" else 0.0
    head = f"NCOLS 3\nNROWS 2\nXLL{corner.upper()} {100 - shift}\nYLL{corner.upper()} {50 - shift}\nCELLSIZE {CELL}\n"
    (tmp_path / "small.asc").write_text(head + "NODATA_VALUE -1\n4 5 6\n-1 2 3\n")
    chart = load_chart(tmp_path / "small.asc", crs="local")
    assert chart.extent == pytest.approx((100, 50, 110, 55))
    np.testing.assert_array_equal(chart.depth_m, [[np.nan, 2, 3], [4, 5, 6]])
    assert (chart.sigma_map_m, chart.correlation_length_m) == (0.0, 0.0)


def test_a_bag_keeps_its_uncertainty_per_node(tmp_path: Path) -> None:
    from affine import Affine

    known = np.isfinite(depths())
    sigma = 0.3 + 0.01 * np.mgrid[:ROWS, :COLS][1]
    layers = [np.where(known, layer, 1e6)[::-1].astype("float32") for layer in (-depths(), sigma)]
    place = Affine(CELL, 0, WEST - CELL / 2, 0, -CELL, SOUTH + (ROWS - 0.5) * CELL)
    path = tmp_path / "bay.bag"
    with rasterio.open(
        path, "w", driver="BAG", height=ROWS, width=COLS, count=2, dtype="float32", nodata=1e6,
        crs="EPSG:32654", transform=place,
    ) as target:  # fmt: skip
        for band, layer in enumerate(layers, start=1):
            target.write(layer, band)
    chart = load_chart(path)
    same_as_written(chart)
    np.testing.assert_allclose(chart.sigma_map_m, np.where(known, sigma, np.nan), rtol=1e-6)
    assert chart.sigma_at([[0.0, 0.0]]) == pytest.approx(0.3 + 0.01 * 19.5, abs=1e-3)
    # No format says over which distance its errors hold: not taken as each node's own.
    assert chart.correlation_length_m == 10
    assert "correlation length of the chart's error not stated: 10 m assumed" in notes(chart)
    told = load_chart(path, correlation_length_m=0.0)
    assert told.correlation_length_m == 0
    assert np.max(load_chart(path, sigma_map_m=0.2).sigma_map_m) == 0.2


def test_bag_with_holes_and_uncertainty(reference: Path) -> None:
    chart = load_chart(reference / "data/navo_bag/JD211_public_Release_1-4_UTM.bag")
    assert chart.shape == (1707, 1478) or chart.shape == (1478, 1707)
    assert chart.cell_m == pytest.approx(2.0)
    assert chart.hole_share == pytest.approx(0.54, abs=0.02)
    assert 50 < chart.depth_range_m[0] < chart.depth_range_m[1] < 54
    sigma = np.asarray(chart.sigma_map_m)
    assert 0.2 < np.nanmin(sigma) < np.nanmax(sigma) < 0.7
    np.testing.assert_array_equal(np.isnan(sigma), np.isnan(chart.depth_m))
    assert chart.correlation_length_m == 10
    assert chart.origin.crs == "EPSG:32602"


def test_sparse_nodes_keep_their_depths_by_the_nearest_node() -> None:
    depth = np.full((24, 36), np.nan)
    depth[::3, ::3] = 10.0 + np.arange(8)[:, None] + 0.1 * np.arange(12)
    sparse = Raster(depth, 5.0 * np.arange(36), 5.3 * np.arange(24), None, ())
    chart = chart_from_raster(sparse, name="s", cell_m=None, origin=None, quality=Quality())
    assert any("resampled by the nearest node" in note for note in chart.notes)
    share = np.isfinite(chart.depth_m).mean() / np.isfinite(depth).mean()
    assert 0.8 < share < 1.2
    # Each depth is one of those within half a cell, none is made up.
    found, held = chart.depth_m[np.isfinite(chart.depth_m)], depth[np.isfinite(depth)]
    assert np.abs(found[:, None] - held[None]).min(axis=1).max() < 1e-5
    full = Raster(np.full((24, 36), 9.0), sparse.x, sparse.y, None, ())
    dense = chart_from_raster(full, name="d", cell_m=None, origin=None, quality=Quality())
    assert any("resampled bilinearly" in note for note in dense.notes)
