"""Numbers that mean "no data" and are declared nowhere: the same rule for grids, NetCDF and soundings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from uwcoop.charts import Chart, load_chart
from uwcoop.charts.plausible import without_fills
from uwcoop.charts.vertical import Stated, depths_from
from uwcoop.errors import ChartError

rasterio = pytest.importorskip("rasterio")
R, C = np.mgrid[0:60, 0:80]
ELEVATION = -(12 + 3 * np.sin(C / 9) * np.cos(R / 7))
HOLE = np.hypot(R - 30, C - 60) < 8
FILLS = [
    1.7976931348623157e308,
    -3.4028234663852886e38,
    1e38,
    -32768,
    -9999,
    -99999,
    1e6,
    9.969209968386869e36,
    32767,
    -999,
]


def write_tif(path: Path, values: Any, dtype: str, **extra: Any) -> Path:
    from rasterio.transform import Affine

    with rasterio.open(
        path, "w", driver="GTiff", height=60, width=80, count=1, dtype=dtype, crs="EPSG:32610",
        transform=Affine(5, 0, 540000, 0, -5, 5280000), **extra,
    ) as file:  # fmt: skip
        file.write(values.astype(dtype), 1)
    return path


def is_the_bay(chart: Chart, value: float, counted: str = "193 nodes (4.0 %)") -> None:
    assert np.count_nonzero(np.isnan(chart.depth_m)) == 193
    assert chart.depth_range_m == pytest.approx((9, 15), abs=0.02)
    assert f"{counted} hold {value:g}: taken as no data" in " | ".join(chart.notes)


@pytest.mark.parametrize("value", FILLS)
@pytest.mark.parametrize("kind", ["tif", "nc", "asc"])
def test_an_undeclared_fill_is_left_out_of_any_grid(tmp_path: Path, value: float, kind: str) -> None:
    values = np.where(HOLE, value, ELEVATION)
    path = tmp_path / f"x.{kind}"
    if kind == "tif":
        write_tif(path, values, "float64")
    elif kind == "nc":
        axes = {
            "y": ("y", 5279700 - 5.0 * np.arange(60), {"units": "m"}),
            "x": ("x", 540000 + 5.0 * np.arange(80), {"units": "m"}),
        }
        xr.Dataset({"z": (("y", "x"), values)}, axes).to_netcdf(path, engine="h5netcdf")
    else:
        rows = "\n".join(" ".join(f"{v!r}" for v in row) for row in values.tolist())
        path.write_text(f"ncols 80\nnrows 60\nxllcorner 540000\nyllcorner 5279700\ncellsize 5\n{rows}\n")
    is_the_bay(load_chart(path, crs="EPSG:32610"), value)


def test_soundings_are_judged_before_anything_is_averaged(tmp_path: Path) -> None:
    lines = ["lon,lat,elevation"]
    for k, (row, col) in enumerate(np.ndindex(40, 40)):
        depth = -9999 if k % 7 == 0 else -(10 + np.sin(col / 9) * np.cos(row / 5))
        lines.append(f"{-122.4 + 5e-5 * col:.6f},{47.6 + 5e-5 * row:.6f},{depth:.2f}")
    (tmp_path / "s.csv").write_text("\n".join(lines))
    chart = load_chart(tmp_path / "s.csv")
    assert chart.depth_range_m == pytest.approx((9, 11), abs=0.02)
    assert "229 soundings (14.3 %) hold -9999: taken as no data" in chart.notes


@settings(max_examples=200, deadline=None)
@given(
    st.one_of(st.sampled_from(FILLS), st.floats(500, 1e30), st.floats(-1e30, -500)),
    st.sampled_from([1, -1]),
    st.booleans(),
)
def test_any_far_value_is_no_depth(value: float, sign: int, wide: bool) -> None:
    wide = wide or abs(value) > 3e38
    values = np.where(HOLE, value, sign * ELEVATION).astype(np.float64 if wide else np.float32)
    depth, notes = depths_from(values, Stated(), None, None)
    assert np.array_equal(np.isnan(depth), HOLE)
    np.testing.assert_allclose(depth[~HOLE], -ELEVATION[~HOLE], rtol=1e-6)
    # A height on land is no fill: it is a hole with a note of its own.
    assert any("193 nodes (4.0 %)" in note for note in notes) or any(
        "above the surface" in note for note in notes
    )


@settings(max_examples=100, deadline=None)
@given(st.floats(1, 5000), st.floats(0.1, 0.9), st.integers(0, 10_000))
def test_a_real_seabed_is_left_alone(middle: float, relief: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = middle * (1 + relief * np.sin(np.cumsum(rng.normal(size=(20, 30)), axis=1) / 3))
    kept, notes = without_fills(values, 1.0, None, "nodes")
    np.testing.assert_array_equal(kept, values)
    assert notes == ()


def test_a_value_that_only_the_user_knows(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "x.tif", np.where(HOLE, 14.5, -ELEVATION), "float32")
    assert load_chart(path).hole_share == 0
    is_the_bay(load_chart(path, nodata=14.5), 14.5)
    with pytest.raises(ChartError, match="nodata inf must be a number"):
        load_chart(path, nodata=float("inf"))


def test_nothing_but_fills_is_refused() -> None:
    with pytest.raises(
        ChartError, match="chart values 1e\\+06 to 1e\\+07 are no depths: none lies within 12,000 m"
    ):
        depths_from(np.array([1e6, 1e7]), Stated(), None, None)
    feet, _ = depths_from(np.array([30_000.0, 20_000.0]), Stated(unit="ft"), None, None)
    assert feet.max() == pytest.approx(9144)
