"""Soundings to charts: columns, projections, holes, the chart's own error, and what is refused."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uwcoop.charts import Chart, grid_soundings, load_chart
from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame, Origin

pytest.importorskip("scipy")

LATITUDE, LONGITUDE = 35.16, 139.61


def seabed(east: Any, north: Any) -> Any:
    return 12 + 0.03 * np.asarray(east) - 0.02 * np.asarray(north)


def tracks(spacing_m: float = 8.0) -> Any:
    """A lawn-mower survey of 200 x 160 m: (N, 3) [east, north, depth] in local metres, one per 2 m."""
    north, east = np.meshgrid(np.arange(-80, 81, spacing_m), np.arange(-100, 101, 2.0), indexing="ij")
    return np.column_stack([east.ravel(), north.ravel(), seabed(east, north).ravel()])


def write(path: Path, rows: Any, header: str = "", separator: str = ",", comment: str = "") -> Path:
    lines = [comment] * bool(comment) + [header] * bool(header)
    lines += [separator.join(f"{v:.7f}" for v in row) for row in rows]
    text = "\n".join(lines) + "\n"
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text)
    return path


def geographic(rows: Any) -> Any:
    places = LocalFrame.at(LATITUDE, LONGITUDE).to_geographic(rows[:, :2])
    return np.column_stack([places[:, 1], places[:, 0], rows[:, 2]])


def projected(rows: Any) -> Any:
    frame = LocalFrame.at(LATITUDE, LONGITUDE, "EPSG:32654")
    return np.column_stack([rows[:, :2] + frame.offset_m, rows[:, 2]])


def is_the_seabed(chart: Chart, tolerance: float = 1e-4) -> None:
    points = np.random.default_rng(1).uniform((-80, -60), (80, 60), (100, 2))
    np.testing.assert_allclose(chart.depth_at(points), seabed(*points.T), atol=tolerance)


def notes(chart: Chart) -> str:
    return " | ".join(chart.notes)


def test_soundings_in_memory() -> None:
    rows = tracks()
    chart = grid_soundings(*rows.T, cell_m=4.0)
    # The medians of cells lie on the plane, and triangles between them too.
    is_the_seabed(chart)
    assert (chart.cell_m, chart.correlation_length_m) == (4.0, 10.0)
    assert (chart.east0_m % 4, chart.north0_m % 4) == (0, 0)
    assert chart.sigma_map_m == pytest.approx(0.0, abs=1e-6)
    assert "medians of cells, linear between them; holes beyond 10 m" in notes(chart)


def test_cells_far_from_any_sounding_are_holes() -> None:
    rows = tracks()
    gap = (np.abs(rows[:, 0]) < 40) & (np.abs(rows[:, 1]) < 30)
    chart = grid_soundings(*rows[~gap].T, cell_m=4.0, max_gap_m=12.0, sigma_map_m=0.1)
    east, north = np.meshgrid(chart.east_m, chart.north_m)
    left = rows[~gap, :2]
    distance = np.hypot(east.ravel()[:, None] - left[:, 0], north.ravel()[:, None] - left[:, 1]).min(axis=1)
    hole = np.isnan(chart.depth_m.ravel())
    assert hole[distance > 12].all()
    inner = (np.abs(east) < 95) & (np.abs(north) < 75)
    assert not hole[(distance < 12) & inner.ravel()].any()
    assert np.isnan(chart.depth_at([[0.0, 0.0]]))
    filled = grid_soundings(*rows[~gap].T, cell_m=4.0, max_gap_m=100.0, sigma_map_m=0.1)
    assert filled.depth_at([[0.0, 0.0]]) == pytest.approx(12, abs=1e-3)


def test_stray_echoes_and_stray_positions_do_not_make_seabed() -> None:
    rows = tracks(spacing_m=2.0)
    echoes = np.random.default_rng(2).choice(len(rows), 40, replace=False)
    rows[echoes, 2] += 30
    strays = np.array([[5000.0, 5000, 9], [5001, 5001, 9], [5001, 5000, 9], [5000, 5001, 9]])
    chart = grid_soundings(*np.vstack([rows, strays]).T, cell_m=8.0)
    is_the_seabed(chart, tolerance=0.25)
    assert chart.extent[2] < 200
    assert "in 1 stray patches far from the rest left out" in notes(chart)


def test_chart_error_is_found_from_what_surveys_say_of_each_other() -> None:
    rng = np.random.default_rng(3)
    rows = np.vstack([tracks(), tracks() + np.array([0.7, 3.0, 0.0])])
    day = np.repeat([0, 1], len(rows) // 2)
    noisy = rows[:, 2] + rng.normal(0, 0.05, len(rows)) + np.where(day == 0, 0.3, -0.3)
    chart = grid_soundings(rows[:, 0], rows[:, 1], noisy, cell_m=4.0, survey=day)
    # Two clusters 1.2 m apart: how far the robust spread reaches depends on which holds one sounding more.
    assert chart.sigma_map_m == pytest.approx(0.6, abs=0.2)
    assert "leaving out one of 2 surveys" in notes(chart)
    one_day = grid_soundings(*rows[day == 0, :2].T, noisy[day == 0], cell_m=4.0)
    assert 0.02 < float(np.max(one_day.sigma_map_m)) < 0.15
    assert "leaving out blocks of 10 m" in notes(one_day)
    assert grid_soundings(*rows.T, cell_m=4.0, sigma_map_m=0.4, correlation_length_m=25).sigma_map_m == 0.4


@pytest.mark.parametrize(
    ("name", "header", "separator", "options"),
    [
        ("a.csv", "lon,lat,depth", ",", {}),
        ("a.csv", "Longitude, Latitude, Depth_m", ", ", {}),
        ("a.csv.gz", "", ",", {"columns": "lon,lat,depth"}),
        ("a.xyz", "", " ", {"columns": ("lon", "lat", "depth")}),
        ("a.txt", "", "\t", {"columns": "lon,lat,depth"}),
        ("a.csv", "lon;lat;z", ";", {}),
    ],
)
def test_degrees_in_many_dresses(
    tmp_path: Path, name: str, header: str, separator: str, options: dict[str, Any]
) -> None:
    path = write(tmp_path / name, geographic(tracks()), header, separator)
    origin = Origin(LATITUDE, LONGITUDE)
    chart = load_chart(path, cell_m=4.0, sigma_map_m=0.1, origin=origin, **options)
    is_the_seabed(chart, tolerance=1e-3)
    assert chart.name == "a"
    assert (chart.origin.latitude_deg, chart.origin.longitude_deg) == (LATITUDE, LONGITUDE)
    assert "datum not stated: WGS 84 assumed" in notes(chart)


def test_eastings_in_a_projection(tmp_path: Path) -> None:
    path = write(tmp_path / "utm.csv", projected(tracks()), "easting,northing,depth", comment="# a survey")
    chart = load_chart(path, crs="EPSG:32654", cell_m=4.0, sigma_map_m=0.1, origin=(LATITUDE, LONGITUDE))
    is_the_seabed(chart, tolerance=1e-3)
    assert chart.origin.crs == "EPSG:32654"
    own = load_chart(path, crs="EPSG:32654", cell_m=4.0, sigma_map_m=0.1)
    assert own.extent == pytest.approx((-100, -80, 100, 80), abs=8)
    bare = load_chart(path, cell_m=4.0, sigma_map_m=0.1)
    assert bare.origin == Origin()
    assert bare.east0_m > 300_000
    assert "no projection: positions taken as local metres" in notes(bare)


def test_both_kinds_of_position_in_one_file(tmp_path: Path) -> None:
    rows = np.column_stack([geographic(tracks())[:, :2], projected(tracks())])
    path = write(tmp_path / "both.csv", rows, "lon,lat,e,n,z")
    by_degrees = load_chart(path, cell_m=4.0, sigma_map_m=0.1)
    assert "positions from lon and lat; e and n not used" in notes(by_degrees)
    by_metres = load_chart(path, cell_m=4.0, sigma_map_m=0.1, crs="EPSG:32654")
    assert "positions from e and n; lon and lat not used" in notes(by_metres)
    chosen = load_chart(path, cell_m=4.0, sigma_map_m=0.1, columns="e,n,z", crs="EPSG:32654")
    assert chosen == by_metres


def test_columns_with_names_of_their_own(tmp_path: Path) -> None:
    path = write(tmp_path / "own.csv", tracks(), "P1,P2,Q")
    chart = load_chart(path, columns="P1,P2,Q", cell_m=4.0, sigma_map_m=0.1)
    is_the_seabed(chart)
    assert "columns P1, P2, Q taken in the order east, north, depth" in notes(chart)


def test_survey_column_judges_the_error(tmp_path: Path) -> None:
    rows = np.column_stack([tracks(), np.repeat([1, 2, 3], len(tracks()) // 3)])
    path = write(tmp_path / "s.csv", rows, "e,n,depth,survey")
    assert "leaving out one of 3 surveys" in notes(load_chart(path, cell_m=8.0, max_gap_m=30))


def test_heights_and_feet(tmp_path: Path) -> None:
    rows = tracks() * [1, 1, -1]
    chart = load_chart(write(tmp_path / "h.csv", rows, "e,n,elevation"), cell_m=4.0, sigma_map_m=0.1)
    is_the_seabed(chart)
    assert "positive up: named 'elevation', and the values agree" in notes(chart)
    feet = write(tmp_path / "f.csv", tracks() / [1, 1, 0.3048], "e,n,depth_ft")
    for asked in (None, "ft"):
        is_the_seabed(load_chart(feet, cell_m=4.0, depth_unit=asked, sigma_map_m=0.1))
    assert "depth unit stated: ft, converted to metres" in notes(load_chart(feet, cell_m=4.0))


def test_empty_cells_are_left_out_and_counted(tmp_path: Path) -> None:
    path = write(tmp_path / "gaps.csv", tracks(), "e,n,depth")
    with path.open("a") as lines:
        lines.write("1,2,\n3,,4\n")
    assert "2 rows with an empty cell left out" in notes(load_chart(path, cell_m=4.0, sigma_map_m=0.1))


def test_cell_is_chosen_after_the_density() -> None:
    chart = grid_soundings(*tracks().T, sigma_map_m=0.1)
    assert chart.cell_m == 5.0  # 2121 soundings on 200 x 160 m: one per 15 m²
    assert "cell not asked for: 5 m" in notes(chart)


HEADER = "e,n,depth\n"
SQUARE = HEADER + "0,0,3\n90,0,3\n0,90,3\n90,90,3\n"


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        ("", {}, "is empty"),
        ("\n\n", {}, "is empty: it holds no rows"),
        ("hello\n", {}, "first line 'hello' does not hold three columns"),
        ("1,2,3\n2,3,4\n", {}, "has no header: say what its 3 columns are"),
        ("1,2,3\n", {"columns": "lon,lat,depth,survey"}, "has 3 columns, fewer than the 4 of columns"),
        ("a,b,c\n1,2,3\n", {}, "no column for the position .* its header 'a,b,c'"),
        ("e,n,c\n1,2,3\n", {}, "no column for the depth"),
        (HEADER + "1,2,3\n", {"columns": "e,n,q"}, "has no column 'q': it has e, n, depth"),
        (HEADER + "1,2,3\n4,5,shallow\n", {}, "column 'depth' holds 'shallow' in line 3 of bad.csv: not a number"),
        (HEADER + "1,2,3,4,5\n1,2,3,4,5,6,7\n", {}, "line 2 has 5 cells, more than the 3"),
        (HEADER + ",,\n", {}, "holds no sounding with a position and a depth"),
        (HEADER + "1,2,3\n2,3,4\n", {}, "2 soundings are too few for a chart: at least 4"),
        (HEADER + "".join(f"{k},{k},5\n" for k in range(50)), {"cell_m": 1.0}, "lie on one line"),
        (HEADER + "1,1,5\n1,8,6\n8,1,7\n8,8,8\n", {"cell_m": 10.0}, "1 cells with soundings are too few for a chart"),
        (HEADER + "1,2,3\n" * 4, {"crs": "EPSG:4326"}, "but crs='EPSG:4326' is in degrees"),
        ("lon,lat,depth\n1,2,3\n", {"crs": "EPSG:32654"}, "longitudes and latitudes, which crs='EPSG:32654'"),
        ("lat,lon,depth\n139.6,35.1,9\n", {}, "latitude 139.6 deg is outside -90 to 90 deg: are"),
        (HEADER + "1,2,3\n", {"crs": "EPSG:1"}, "projection 'EPSG:1' is unknown"),
        (SQUARE, {"cell_m": 0.001}, "nodes, above 16,000,000: choose at least"),
        (HEADER + "1,1,3\n900,1,3\n1,900,3\n899,898,3\n", {"cell_m": 70.0, "max_gap_m": 0.1}, "all are holes"),
        (SQUARE, {"cell_m": 9.0}, "to judge the chart's error, below 20: give"),
        (SQUARE, {"max_gap_m": -1.0}, "max_gap_m -1.0 must be finite and above"),
    ],
)  # fmt: skip
def test_bad_files_get_one_clear_line(
    tmp_path: Path, content: str, options: dict[str, Any], message: str
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(content)
    with pytest.raises(ChartError, match=message) as caught:
        load_chart(path, **options)
    assert "\n" not in str(caught.value)


def test_files_that_are_not_there_or_not_files(tmp_path: Path) -> None:
    with pytest.raises(ChartError, match=r"nothing.tif does not exist"):
        load_chart(tmp_path / "nothing.tif")
    with pytest.raises(ChartError, match="is not a file"):
        load_chart(tmp_path)
    (tmp_path / "noise.bin").write_bytes(bytes(range(128, 256)))
    with pytest.raises(ChartError, match=r"noise\.bin is no text: neither UTF-8"):
        load_chart(tmp_path / "noise.bin")
    (tmp_path / "cut.gz").write_bytes(gzip.compress(b"e,n,depth\n1,2,3\n" * 99)[:30])
    with pytest.raises(ChartError, match="cut"):
        load_chart(tmp_path / "cut.gz")


def test_arrays_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ChartError, match="columns differ in length: 3, 2, 3"):
        grid_soundings([1, 2, 3], [1, 2], [1, 2, 3])
    with pytest.raises(ChartError, match="depth holds 1 values not finite"):
        grid_soundings([0, 1, 2, 3], [0, 1, 0, 1], [1, 2, np.nan, 3])


def test_real_soundings_make_a_chart(reference: Path) -> None:
    chart = load_chart(
        reference / "data/aburatsubo/sessions_valid.csv.gz", columns="e,n,z,f", crs="EPSG:32654", cell_m=5
    )
    assert chart.extent[0] > -3000
    assert chart.extent[3] < 3000
    # Days disagree by half a metre: tide is not removed, positions are a consumer receiver's.
    assert 0.4 < float(np.max(chart.sigma_map_m)) < 1.2
    assert "leaving out one of 21 surveys" in notes(chart)
    assert 1.0 < chart.depth_range_m[0] < chart.depth_range_m[1] < 45.0
    assert chart.origin.latitude_deg == pytest.approx(35.16, abs=0.02)
