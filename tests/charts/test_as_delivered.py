"""Charts and soundings as people get them: formats told by content, places, scales, dialects, parts of large files."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uwcoop.charts import Chart, load_chart
from uwcoop.charts.places import Area
from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame

rasterio = pytest.importorskip("rasterio")
ROWS, COLS = 60, 80
R, C = np.mgrid[0:ROWS, 0:COLS]
ELEVATION = -(12 + 3 * np.sin(C / 9) * np.cos(R / 7))


def write_tif(
    path: Path, values: Any = ELEVATION, crs: Any = "EPSG:32610", place: Any = None, **extra: Any
) -> Path:
    from rasterio.transform import Affine

    place = place or Affine(5, 0, 540000, 0, -5, 5280000)
    shape = {"height": values.shape[0], "width": values.shape[1], "count": 1}
    with rasterio.open(
        path, "w", driver="GTiff", dtype="float32", crs=crs, transform=place, **(shape | extra)
    ) as file:
        for band in range(1, file.count + 1):
            file.write(values.astype("float32"), band)
    return path


def notes(chart: Chart) -> str:
    return " | ".join(chart.notes)


def soundings(path: Path, lon0: float, lat0: float, wrap: bool, extra: str = "") -> Path:
    lines = ["lon,lat,depth", *extra.splitlines()]
    for row, col in np.ndindex(40, 40):
        lon = lon0 + 5e-5 * col
        depth = 10 + np.sin(col / 9) * np.cos(row / 5)
        lines.append(f"{(lon + 180) % 360 - 180 if wrap else lon:.6f},{lat0 + 5e-5 * row:.6f},{depth:.2f}")
    path.write_text("\n".join(lines) + "\n")
    return path


# ------------------------------------------------------------------------------------------- told by content


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"#ROSBAG V2.0\nx", r"x.bag is no chart but a ROS 1 bag: `uwcoop import` makes a mission of it"),
        (b"\x89PNG\r\n\x1a\n", "is no chart but a PNG picture"),
        (b"SQLite format 3\x00", "is no chart but an SQLite database"),
        (b"\x89MCAP0\r\n", "is no chart but an MCAP recording"),
        (b"%PDF-1.7", "is no chart but a PDF"),
        (b"<html>", "is no chart but an XML or HTML document"),
        (b"version https://git-lfs.github.com/spec/v1\n", "is no chart but a Git LFS pointer"),
        (b'{"type": "FeatureCollection"}', "is no chart but a JSON document"),
    ],
)
def test_what_is_no_chart_is_named_for_what_it_is(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.bag").write_bytes(content)
    with pytest.raises(ChartError, match=message):
        load_chart(tmp_path / "x.bag")


def test_a_virtual_raster_is_not_followed_whatever_it_is_called(tmp_path: Path) -> None:
    real = write_tif(tmp_path / "real.tif")
    text = (
        f'<VRTDataset rasterXSize="{COLS}" rasterYSize="{ROWS}"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
        f"<SourceFilename>{real}</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    for name in ("x.bag", "x.tif", "x.asc", "x.csv"):
        (tmp_path / name).write_text(text)
        with pytest.raises(
            ChartError, match="is no chart but a GDAL virtual raster, which names other files"
        ):
            load_chart(tmp_path / name)


def test_names_do_not_count(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "a.tif")
    for name in ("a.csv", "a.bag", "a"):
        (tmp_path / name).write_bytes(path.read_bytes())
        assert load_chart(tmp_path / name) == load_chart(path)
    with zipfile.ZipFile(tmp_path / "a.xyz", "w") as archive:
        archive.write(path)
    with pytest.raises(ChartError, match="is no chart but a ZIP archive"):
        load_chart(tmp_path / "a.xyz")


def write_s102(path: Path) -> Path:
    hole = np.hypot(R - 30, C - 60) < 8
    with h5py.File(path, "w") as file:
        file.attrs["horizontalCRS"] = np.int32(32610)
        file.attrs["productSpecification"] = "INT.IHO.S-102.2.2"
        file.create_group("Group_F")
        instance = file.create_group("BathymetryCoverage").create_group("BathymetryCoverage.01")
        file["BathymetryCoverage"].attrs["dataCodingFormat"] = np.int32(2)
        for key, value in {
            "gridOriginLatitude": 5279700.0, "gridOriginLongitude": 540000.0, "gridSpacingLatitudinal": 5.0,
            "gridSpacingLongitudinal": 5.0, "numPointsLatitudinal": np.uint32(ROWS),
            "numPointsLongitudinal": np.uint32(COLS),
        }.items():  # fmt: skip
            instance.attrs[key] = value
        instance.attrs["startSequence"] = "0,0"
        values = np.zeros((ROWS, COLS), dtype=[("depth", "<f4"), ("uncertainty", "<f4")])
        values["depth"], values["uncertainty"] = np.where(hole, 1e6, -ELEVATION), np.where(hole, 1e6, 0.2)
        instance.create_group("Group_001").create_dataset("values", data=values)
    return path


def test_s102_with_its_uncertainty(tmp_path: Path) -> None:
    chart = load_chart(write_s102(tmp_path / "s102.h5"))
    assert (chart.shape, chart.cell_m) == ((ROWS, COLS), 5.0)
    assert chart.hole_share == pytest.approx(0.0402, abs=1e-4)
    np.testing.assert_allclose(chart.depth_m[0, :5], -ELEVATION[0, :5], rtol=1e-6)
    assert np.nanmax(chart.sigma_map_m) == pytest.approx(0.2)


def test_a_bag_of_variable_resolution_is_not_read_at_its_overview(reference: Path) -> None:
    path = reference / "cases/real/test_vr.bag"
    chart = load_chart(path)
    assert "read at its finest cells: 36 x 24 nodes of 4.98 x 5.32 m; its overview has 6 x 4 cells" in notes(
        chart
    )
    assert chart.cell_m == pytest.approx(4.99, abs=0.02)
    coarse = load_chart(path, cell_m=10.0)
    assert coarse.cell_m == 10.0
    assert "read at the cell asked for" in notes(coarse)
    assert 0 < np.nanmedian(chart.sigma_map_m) < 10


# ------------------------------------------------------------------------------------------- GeoTIFF and NetCDF


def test_a_band_of_uncertainty_and_overviews_of_a_cog(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "two.tif", count=2, tiled=True, blockxsize=16, blockysize=16)
    with rasterio.open(path, "r+") as file:
        file.descriptions = ("Elevation", "Uncertainty")
        file.write(np.full((ROWS, COLS), 0.3, "float32"), 2)
        file.build_overviews([2, 4])
    chart = load_chart(path)
    assert chart.shape == (ROWS, COLS)
    assert np.nanmax(chart.sigma_map_m) == pytest.approx(0.3)
    assert "band 1 of 2 (Elevation) as depths, band 2 (Uncertainty) as their standard deviation" in notes(
        chart
    )


def test_vertical_units_of_a_compound_projection(tmp_path: Path) -> None:
    # NAD83(2011) / UTM zone 10N with NAVD88 heights in US survey feet.
    path = write_tif(tmp_path / "feet.tif", ELEVATION / 0.3048, crs="EPSG:6339+6360")
    chart = load_chart(path)
    assert chart.depth_range_m == pytest.approx((9, 15), abs=0.02)
    assert "converted to metres" in notes(chart)


def test_a_picture_of_a_chart_is_refused(tmp_path: Path) -> None:
    from rasterio.transform import Affine

    path = tmp_path / "rgb.tif"
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=9,
        width=9,
        count=3,
        dtype="uint8",
        photometric="RGB",
        crs="EPSG:32610",
        transform=Affine(5, 0, 540000, 0, -5, 5280000),
    ) as file:
        file.write(np.ones((3, 9, 9), "uint8"))
    with pytest.raises(ChartError, match="is a picture of a chart: it holds colours, no depths"):
        load_chart(path, crs="EPSG:32610")


@pytest.mark.parametrize(
    ("crs", "x", "y"), [("EPSG:3857", -13628000, 6048000), ("EPSG:3395", -13628000, 6015000)]
)
def test_metres_that_are_not_metres_on_the_ground(tmp_path: Path, crs: str, x: float, y: float) -> None:
    from rasterio.transform import Affine

    chart = load_chart(write_tif(tmp_path / "m.tif", crs=crs, place=Affine(10, 0, x, 0, -10, y)))
    assert chart.cell_m == pytest.approx(6.74, abs=0.03)
    west, south, east, north = chart.extent
    assert (east - west, north - south) == pytest.approx((533, 398), abs=7)
    assert "so positions go to a local transverse Mercator" in notes(chart)
    # The distance between two places is that on the ellipsoid.
    from pyproj import Geod

    corner = LocalFrame(chart.origin).to_geographic([[west, south], [east, north]])
    apart = Geod(ellps="WGS84").inv(corner[0, 1], corner[0, 0], corner[1, 1], corner[1, 0])[2]
    assert np.hypot(east - west, north - south) == pytest.approx(apart, rel=1e-4)


def test_a_wrong_zone_is_noted(tmp_path: Path) -> None:
    from rasterio.transform import Affine

    inside = load_chart(write_tif(tmp_path / "z.tif"))
    assert "lies outside of the area" not in notes(inside)
    far = load_chart(write_tif(tmp_path / "f.tif", place=Affine(5, 0, 1_200_000, 0, -5, 5280000)))
    assert "lies outside of the area that WGS 84 / UTM zone 10N is made for" in notes(far)
    with pytest.raises(ChartError, match=r"lies off s.tif"):
        load_chart(
            write_tif(tmp_path / "s.tif", place=Affine(5, 0, 5280000, 0, -5, 540000)), area="47,-122,48,-121"
        )


def test_classes_are_no_depths(tmp_path: Path) -> None:
    axes = {
        "lat": ("lat", 47.6 + np.arange(9) / 7200, {"units": "degrees_north"}),
        "lon": ("lon", -122.4 + np.arange(9) / 7200, {"units": "degrees_east"}),
    }
    flags = {"flag_values": np.array([0, 11], "int8"), "flag_meanings": "land multibeam"}
    tid = xr.Dataset({"tid": (("lat", "lon"), np.full((9, 9), 11, "int8"), flags)}, axes)
    tid.to_netcdf(tmp_path / "tid.nc", engine="h5netcdf")
    with pytest.raises(
        ChartError, match="variable 'tid' is no depth: it has flag_values and no unit of length"
    ):
        load_chart(tmp_path / "tid.nc")
    both = tid.assign(elevation=(("lat", "lon"), ELEVATION[:9, :9], {"units": "m"}))
    both.to_netcdf(tmp_path / "both.nc", engine="h5netcdf")
    assert load_chart(tmp_path / "both.nc").depth_range_m[0] > 9


# ------------------------------------------------------------------------------------------------- ESRI ASCII


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    order=st.permutations(["ncols", "nrows", "xllcorner", "yllcorner", "cellsize"]),
    upper=st.booleans(), blanks=st.sampled_from(["", "  ", "\t"]), comma=st.booleans(),
    ending=st.sampled_from(["\n", "\r\n"]), wrap=st.sampled_from([1, 3, COLS]),
)  # fmt: skip
def test_ascii_grids_in_all_dialects(
    tmp_path: Path, order: list[str], upper: bool, blanks: str, comma: bool, ending: str, wrap: int
) -> None:
    keys = {"ncols": COLS, "nrows": ROWS, "xllcorner": 540000, "yllcorner": 5279700, "cellsize": 5}
    lines = [f"{blanks}{name.upper() if upper else name} {keys[name]}" for name in order]
    numbers = [f"{v:.2f}" for v in ELEVATION.ravel()]
    lines += [" ".join(numbers[k : k + wrap]) for k in range(0, len(numbers), wrap)]
    text = ending.join(lines) + ending
    (tmp_path / "g.asc").write_bytes((text.replace(".", ",") if comma else text).encode())
    chart = load_chart(tmp_path / "g.asc", crs="EPSG:32610")
    np.testing.assert_allclose(chart.depth_m, -ELEVATION[::-1], atol=0.006)
    assert chart.extent == pytest.approx((-197.5, -147.5, 197.5, 147.5))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("cellsize 5", "cellsize -5"), "cellsize -5 must be above 0"),
        (("nrows 2", "nrows 3"), "declares 3 x 3 values and holds 6: it is damaged"),
        (("nrows 2", "nrows 2.5"), "nrows 2.5 must be a whole number above 0"),
        (("ncols 3", "ncols 99999999999"), "declares 2 x 99,999,999,999 nodes: it is damaged"),
        (("6\n", "six\n"), "holds 'six', not a number"),
        (("xllcorner 0", ""), "has neither xllcorner nor xllcenter"),
    ],
)
def test_damaged_ascii_grids(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 5\n1 2 3\n4 5 6\n"
    (tmp_path / "g.asc").write_text(text.replace(*change))
    with pytest.raises(ChartError, match=message):
        load_chart(tmp_path / "g.asc", crs="local")


def test_the_projection_beside_an_ascii_grid(tmp_path: Path) -> None:
    from pyproj import CRS

    (tmp_path / "g.asc").write_text(
        "ncols 3\nnrows 2\nxllcorner 540000\nyllcorner 5279700\ncellsize 5\n1 2 3\n4 5 6\n"
    )
    with pytest.raises(ChartError, match="states no projection"):
        load_chart(tmp_path / "g.asc")
    (tmp_path / "g.prj").write_text(CRS.from_epsg(32610).to_wkt("WKT1_ESRI"))
    assert load_chart(tmp_path / "g.asc").origin.latitude_deg == pytest.approx(47.67, abs=0.01)


# ------------------------------------------------------------------------------------------------- soundings


@pytest.mark.parametrize("turns", [0, 360])
def test_soundings_across_the_date_line_are_one_chart(tmp_path: Path, turns: int) -> None:
    chart = load_chart(soundings(tmp_path / "d.csv", 179.9993, 51.9, wrap=not turns))
    assert chart.origin.latitude_deg == pytest.approx(51.900975)
    assert chart.origin.longitude_deg is not None
    assert chart.origin.longitude_deg % 360 == pytest.approx(180.000275)
    assert chart.depth_range_m == pytest.approx((9, 11), abs=0.02)
    assert chart.extent[2] - chart.extent[0] < 140


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(-180, 180), st.floats(-75, 75))
def test_soundings_anywhere_give_the_same_chart_in_both_ways_of_counting(
    tmp_path: Path, lon: float, lat: float
) -> None:
    lon, lat = round(lon, 4), round(lat, 4)
    plain, wrapped = (load_chart(soundings(tmp_path / "s.csv", lon % 360, lat, wrap=wrap), sigma_map_m=0.1, cell_m=10.0)
                      for wrap in (False, True))  # fmt: skip
    # On edges of cells the last bit of a position decides which of two a sounding belongs to.
    np.testing.assert_allclose(plain.depth_m, wrapped.depth_m, atol=0.1)
    assert plain.extent == pytest.approx(wrapped.extent)


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (
            "0.0,0.0,3.1\n" * 5,
            "5 of 1,605 soundings lie far from all others and are left out: the first at 0 N, 0 E in line 2",
        ),
        ("-1.0,47.6,3\n", "1 of 1,601 soundings lie far from all others"),
    ],
)
def test_stray_positions_are_left_out_and_noted(tmp_path: Path, extra: str, said: str) -> None:
    clean = load_chart(soundings(tmp_path / "c.csv", -122.4, 47.6, wrap=False))
    chart = load_chart(soundings(tmp_path / "s.csv", -122.4, 47.6, wrap=False, extra=extra))
    assert chart == clean
    assert said in notes(chart)


def test_columns_called_x_and_y_that_can_only_be_degrees(tmp_path: Path) -> None:
    path = soundings(tmp_path / "s.csv", -122.4, 47.6, wrap=False)
    path.write_text(path.read_text().replace("lon,lat,depth", "x,y,depth"))
    with pytest.raises(ChartError, match="look like degrees, not metres: name the columns lon and lat"):
        load_chart(path)


def test_several_files_are_surveys_that_judge_each_other(tmp_path: Path) -> None:
    files = [soundings(tmp_path / f"{name}.csv", -122.4 + shift, 47.6, wrap=False)
             for name, shift in (("monday", 0.0), ("tuesday", 2e-5))]  # fmt: skip
    chart = load_chart(files)
    assert "leaving out one of 2 surveys" in notes(chart)
    assert "2 files, each a survey of its own" in notes(chart)
    with pytest.raises(ChartError, match="several files make one chart when all hold soundings"):
        load_chart([files[0], write_tif(tmp_path / "g.tif")])


# ------------------------------------------------------------------------------------------------- areas


def corners(chart: Chart, west: float, south: float, east: float, north: float) -> str:
    places = LocalFrame(chart.origin).to_geographic([[west, south], [east, north]])
    return ",".join(f"{value:.8f}" for value in places.ravel())


@pytest.mark.parametrize("kind", ["tif", "nc", "asc"])
def test_an_area_is_the_part_of_the_whole(tmp_path: Path, kind: str) -> None:
    whole = load_chart(write_tif(tmp_path / "g.tif"))
    path = tmp_path / f"g.{kind}"
    if kind == "nc":
        axes = {"y": ("y", 5279997.5 - 5.0 * np.arange(ROWS), {"units": "m"}),
                "x": ("x", 540002.5 + 5.0 * np.arange(COLS), {"units": "m"})}  # fmt: skip
        xr.Dataset({"z": (("y", "x"), ELEVATION)}, axes).to_netcdf(path, engine="h5netcdf")
    elif kind == "asc":
        rows = "\n".join(" ".join(f"{v!r}" for v in row) for row in ELEVATION.tolist())
        path.write_text(
            f"ncols {COLS}\nnrows {ROWS}\nxllcorner 540000\nyllcorner 5279700\ncellsize 5\n{rows}\n"
        )
    area = corners(whole, -100, -50, 120, 90)
    part = load_chart(path, crs="EPSG:32610", area=area, origin=whole.origin)
    points = np.random.default_rng(0).uniform((-99, -49), (119, 89), (200, 2))
    np.testing.assert_allclose(part.depth_at(points), whole.depth_at(points), atol=1e-4)
    assert part.shape[0] * part.shape[1] < 0.4 * ROWS * COLS
    assert "nodes read" in notes(part)


def test_an_area_off_the_chart_or_in_another_order_is_refused(tmp_path: Path) -> None:
    axes = {"lat": ("lat", 47.6 + np.arange(40) / 7200, {"units": "degrees_north"}),
            "lon": ("lon", 12.4 + np.arange(40) / 7200, {"units": "degrees_east"})}  # fmt: skip
    xr.Dataset({"z": (("lat", "lon"), ELEVATION[:40, :40])}, axes).to_netcdf(
        tmp_path / "g.nc", engine="h5netcdf"
    )
    with pytest.raises(ChartError, match=r"lies off g.nc, which reaches from 12.4 to 12.4\d+ east"):
        load_chart(tmp_path / "g.nc", area="10,10,11,11")
    with pytest.raises(ChartError, match="is it longitude,latitude"):
        load_chart(tmp_path / "g.nc", area="12.401,47.601,12.404,47.604")
    with pytest.raises(ChartError, match="must be latitude,longitude,latitude,longitude"):
        load_chart(tmp_path / "g.nc", area="47.6,12.4")
    with pytest.raises(ChartError, match=r"area's latitude -122.4 is outside -90 to 90 deg"):
        load_chart(tmp_path / "g.nc", area="-122.4,47,-122,48")
    assert load_chart(tmp_path / "g.nc", area=(47.601, 12.401 - 360, 47.604, 12.404 - 360)).hole_share < 0.1


def test_an_area_of_soundings_and_one_across_the_date_line(tmp_path: Path) -> None:
    path = soundings(tmp_path / "d.csv", 179.9993, 51.9, wrap=True)
    part = load_chart(path, area="51.9003,179.9996,51.9015,-179.9990", sigma_map_m=0.1)
    assert "of 1,600 soundings" in notes(part)
    assert part.depth_range_m[0] > 8.9
    assert Area.of("0,179,1,-179").east_deg == 181
    with pytest.raises(ChartError, match="positions are local metres: give crs"):
        load_chart(path, columns="lon,lat,depth", crs="local", area="0,0,1,1")


def test_a_large_grid_is_refused_whole_and_read_by_area(tmp_path: Path) -> None:
    # 100 million nodes of which none is written: the file is small, its declared size is not.
    from rasterio.transform import Affine

    path = tmp_path / "large.tif"
    with rasterio.open(
        path, "w", driver="GTiff", height=10_000, width=10_000, count=1, dtype="float32", crs="EPSG:32610",
        transform=Affine(1, 0, 540000, 0, -1, 5280000), tiled=True, blockxsize=256, blockysize=256, sparse_ok=True,
        compress="deflate",
    ) as file:  # fmt: skip
        file.write((ELEVATION).astype("float32"), 1, window=((5000, 5000 + ROWS), (5000, 5000 + COLS)))
    with pytest.raises(ChartError, match=r"100,000,000 nodes is above 16,000,000: give the mission's area"):
        load_chart(path)
    frame = LocalFrame.at(47.6291, -122.4, "EPSG:32610")
    low, high = (
        frame.to_geographic([np.array(p) - frame.offset_m])[0] for p in ((545005, 5274945), (545075, 5274995))
    )
    chart = load_chart(path, area=(*low, *high))
    assert chart.depth_range_m == pytest.approx((9, 15), abs=0.1)
    assert chart.shape[0] < 60
