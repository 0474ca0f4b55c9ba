"""Charts written as GeoTIFF and NetCDF: what others read, and the same chart read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uwcoop.charts import Chart, load_chart, reachable_sigma, synthetic, write_chart
from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame, Origin

rasterio = pytest.importorskip("rasterio")
FRAMES = [
    Origin(),
    Origin(47.6, -122.4),
    Origin(47.6, -122.4, "EPSG:32610"),
    Origin(-33.2, 179.9999, "EPSG:32760"),
]


def bay(origin: Origin, per_node: bool, by_slope: bool) -> Chart:
    r, c = np.mgrid[0:12, 0:17]
    depth = (12 + 3 * np.sin(c / 3) * np.cos(r / 4)).astype(np.float32)
    depth[3:5, 6:9] = np.nan
    sigma: Any = (
        np.where(np.isnan(depth), np.nan, 0.1 + 0.01 * c).astype(np.float32) if per_node else 0.123456789
    )
    slope = {"horizontal_error_m": 2.5, "level_sigma_m": 0.07} if by_slope else {}
    return Chart(
        depth, -41.7000001, 13.1, 5.3, sigma, 12.5, origin, "a bay", ("first note", "zweite Größe"), **slope
    )


@settings(max_examples=48, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(FRAMES), st.booleans(), st.booleans(), st.sampled_from(["tif", "nc"]))
def test_a_chart_is_read_back_as_it_was(
    tmp_path: Path, origin: Origin, per_node: bool, by_slope: bool, suffix: str
) -> None:
    chart = bay(origin, per_node, by_slope and not per_node)
    write_chart(chart, tmp_path / f"x.{suffix}")
    again = load_chart(tmp_path / f"x.{suffix}")
    assert again == chart
    assert (again.origin, again.name, again.notes) == (chart.origin, chart.name, chart.notes)


def test_others_find_bands_units_projection_and_notes(tmp_path: Path) -> None:
    chart = bay(FRAMES[2], per_node=True, by_slope=False)
    write_chart(chart, tmp_path / "x.tif")
    with rasterio.open(tmp_path / "x.tif") as file:
        assert file.descriptions == ("depth", "sigma_map", "reachable_position_sigma")
        assert file.units == ("m", "m", "m")
        assert file.crs.to_epsg() == 32610
        assert np.isnan(file.nodata)
        east, north = LocalFrame(chart.origin).offset_m
        assert file.xy(0, 0) == pytest.approx((chart.east0_m + east, chart.extent[3] + north))
        np.testing.assert_array_equal(file.read(1)[::-1], chart.depth_m)
        reachable = reachable_sigma(chart)
        np.testing.assert_allclose(
            file.read(3)[::-1], np.where(np.isfinite(reachable), reachable, np.nan), rtol=1e-6
        )
        assert "first note" in file.tags()["TIFFTAG_IMAGEDESCRIPTION"]
    write_chart(chart, tmp_path / "x.nc")
    with xr.open_dataset(tmp_path / "x.nc", engine="h5netcdf") as data:
        assert {
            name: data[name].attrs["units"] for name in ("depth", "sigma_map", "reachable_position_sigma")
        } == dict.fromkeys(("depth", "sigma_map", "reachable_position_sigma"), "m")
        assert data["depth"].attrs["positive"] == "down"
        assert "crs_wkt" in data["crs"].attrs
        assert "first note" in data.attrs["comment"]


def test_a_part_or_another_cell_of_a_stored_chart_keeps_its_quality(tmp_path: Path) -> None:
    chart = bay(FRAMES[1], per_node=False, by_slope=False)
    write_chart(chart, tmp_path / "x.tif")
    part = load_chart(tmp_path / "x.tif", cell_m=10.6)
    assert (part.sigma_map_m, part.correlation_length_m) == (chart.sigma_map_m, 12.5)
    assert load_chart(tmp_path / "x.tif", sigma_map_m=0.5).sigma_map_m == 0.5


def test_a_header_that_no_longer_fits_is_not_believed(tmp_path: Path) -> None:
    from rasterio.transform import Affine

    chart = bay(FRAMES[2], per_node=False, by_slope=False)
    write_chart(chart, tmp_path / "x.tif")
    with rasterio.open(tmp_path / "x.tif", "r+") as file:
        file.transform = Affine(7, 0, 540000, 0, -7, 5280000)
    assert load_chart(tmp_path / "x.tif").cell_m == pytest.approx(7)
    with rasterio.open(tmp_path / "x.tif", "r+") as file:
        file.update_tags(uwcoop_chart="{}")
    assert load_chart(tmp_path / "x.tif").cell_m == pytest.approx(7)


def test_other_suffixes_are_refused_and_a_synthetic_chart_is_written(tmp_path: Path) -> None:
    chart = synthetic("poor-bay")
    with pytest.raises(ChartError, match=r"must end in one of .tif, .tiff, .nc"):
        write_chart(chart, tmp_path / "x.xyz")
    write_chart(chart, tmp_path / "x.nc")
    assert load_chart(tmp_path / "x.nc") == chart
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.nc"]
