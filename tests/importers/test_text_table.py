"""Text tables as programs of the world write them: one table, whatever its encoding, separator and order."""

from __future__ import annotations

import gzip
import string
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uwcoop.errors import TableError
from uwcoop.importers.column_roles import assign_roles, split_label
from uwcoop.importers.text_table import TextTable, open_table

NAMES = {
    "lon": {"lon", "longitude"},
    "lat": {"lat", "latitude"},
    "depth": {"depth", "water depth", "altitude"},
}
WRITTEN = {
    "lon": ["lon", "Longitude (°)", "LONGITUDE", "lon_deg", "Longitude [degrees_east]", '"lon"'],
    "lat": ["lat", "Latitude (°)", "LATITUDE", "lat_deg", "Latitude [degrees_north]", '"lat"'],
    "depth": ["depth", "Depth (m)", "WaterDepth", "depth_m", "Depth_in_Meters", "Depth [m]"],
}
LONGEST = 1 << 16


def table(path: Path, text: str, encoding: str = "utf-8") -> TextTable:
    path.write_bytes(text.encode(encoding))
    return open_table(path)


def numbers(found: TextTable) -> dict[str, list[float]]:
    read = found.read(assign_roles(found.labels, NAMES).place)
    return {role: values.tolist() for role, values in read.numbers.items()}


@st.composite
def tables(draw: st.DrawFn) -> tuple[str, str, list[list[float]]]:
    """Text, encoding, and the rows of longitude, latitude and depth in it, among unknown columns in any order."""
    separator = draw(st.sampled_from([",", ";", "\t", "|", " "]))
    comma = separator != "," and draw(st.booleans())
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]))
    labels = {role: draw(st.sampled_from(names)) for role, names in WRITTEN.items()}
    if separator == " ":
        labels = dict(zip(labels, ("lon", "Latitude (°)", "Depth[m]"), strict=True))
    unknown = draw(
        st.lists(st.sampled_from(["ping", "Größe", "q1", "beam no", "temp"]), max_size=3, unique=True)
    )
    unknown = [name.replace(" ", "_") for name in unknown]
    order = draw(st.permutations([*labels, *unknown]))
    rows = draw(
        st.lists(
            st.tuples(st.floats(-180, 180), st.floats(-90, 90), st.floats(0.1, 99)), min_size=3, max_size=20
        )
    )
    ending = draw(st.sampled_from(["\n", "\r\n"]))
    lines = [separator.join(labels.get(column, column) for column in order)]
    for row in rows:
        own = dict(zip(labels, (f"{value:.6f}" for value in row), strict=True))
        cells = [own.get(column, "7") for column in order]
        lines.append(separator.join(cell.replace(".", ",") if comma else cell for cell in cells))
    return ending.join(lines) + ending, encoding, [[round(v, 6) for v in row] for row in rows]


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(tables())
def test_one_table_in_any_dress(tmp_path: Path, written: tuple[str, str, list[list[float]]]) -> None:
    text, encoding, rows = written
    read = numbers(table(tmp_path / "t.csv", text, encoding))
    np.testing.assert_allclose(np.column_stack([read["lon"], read["lat"], read["depth"]]), rows, atol=1e-9)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=400) | st.text(string.printable, max_size=400).map(str.encode))
def test_any_bytes_are_a_table_or_one_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(content)
    said = ""
    try:
        found = open_table(path)
        found.read({"x": 0}, {"y": len(found.labels) - 1})
    except TableError as error:
        said = str(error)
    assert "\n" not in said


@pytest.mark.parametrize(
    ("label", "bare", "unit"),
    [
        ("Depth_in_Feet", "depth", "feet"), ("Depth (m)", "depth", "m"), ("Longitude (°)", "longitude", "°"),
        ("WaterDepth", "water depth", ""), ("dist.m", "dist", "m"), ("time_ms", "time", "ms"), ("m", "m", ""),
        ("Latitude [degrees_north]", "latitude", "degrees_north"), ("depth (below keel)", "depth", ""),
        ("lat_deg", "lat", "deg"), ("Time(UTC)", "time", "UTC"), ("temp", "temp", ""),
    ],
)  # fmt: skip
def test_a_label_is_a_name_and_a_unit(label: str, bare: str, unit: str) -> None:
    assert split_label(label) == (bare, unit)


def test_one_word_tells_a_role_unless_another_says_otherwise() -> None:
    roles = assign_roles(["gps_lat", "gps_lon", "Corrected Depth", "depth_sigma", "sensor depth"], NAMES)
    assert roles.place == {"lon": 1, "lat": 0, "depth": 2}
    assert roles.guessed == {"lon": "gps_lon", "lat": "gps_lat", "depth": "Corrected Depth"}
    two = assign_roles(["lat", "lon", "raw depth", "smooth depth"], NAMES)
    assert "depth" not in two.place


def test_a_row_of_units_is_used_and_noted(tmp_path: Path) -> None:
    found = table(tmp_path / "e.csv", "time,latitude,altitude\nUTC,degrees_north,m\n1,47.5,-3\n")
    assert found.units == ("UTC", "degrees_north", "m")
    assert "units from the row below the header: UTC, degrees_north, m" in found.notes
    assert numbers(found) == {"lat": [47.5], "depth": [-3]}


def test_a_header_below_other_text_or_in_a_comment(tmp_path: Path) -> None:
    below = table(tmp_path / "p.csv", "Survey of the bay\nby hand\nlon,lat,depth\n1,2,3\n4,5,6\n7,8,9\n")
    assert numbers(below)["depth"] == [3, 6, 9]
    assert "2 lines before the header left out, the first: 'Survey of the bay'" in below.notes
    comment = table(tmp_path / "c.txt", "# saved by numpy\n# lon lat depth\n1 2 3\n4 5 6\n")
    assert numbers(comment)["depth"] == [3, 6]
    assert (comment.has_header, comment.dialect.header_is_comment) == (True, True)
    bare = table(tmp_path / "b.txt", "# a survey\n1 2 3\n4 5 6\n")
    assert (bare.has_header, bare.labels) == (False, ("column 1", "column 2", "column 3"))


def test_rows_are_selected_and_know_their_lines(tmp_path: Path) -> None:
    found = table(tmp_path / "w.csv", "# c\nlon,lat,who\n1,2,a\n\n3,4,b\n# c\n5,,a\n7,8\n")
    rows = found.read({"lat": 1}, {"who": 2}, {"who": "a"})
    np.testing.assert_array_equal(rows.numbers["lat"], [2, np.nan])
    assert rows.texts["who"].tolist() == ["a", "a"]
    assert rows.line.tolist() == [3, 7]
    assert found.read({"lat": 1}).line.tolist() == [3, 5, 7, 8]


def test_gzip_is_unpacked_within_bounds(tmp_path: Path) -> None:
    path = tmp_path / "t.csv.gz"
    path.write_bytes(gzip.compress(b"lon,lat,depth\n1,2,3\n"))
    assert numbers(open_table(path))["depth"] == [3]
    path.write_bytes(gzip.compress(b"lon,lat,depth\n" + b"1,2,3\n" * 14_000_000))
    with pytest.raises(
        TableError, match=r"t.csv.gz cannot be read: it holds more than .* MiB, the most that is read"
    ):
        open_table(path).read({"lon": 0})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty: it holds no rows"),
        (b"lon,lat\n1,2\n1,two\n", "column 'lat' holds 'two' in line 3 of t.csv: not a number"),
        (b"lon,lat\n1,1_000\n", "column 'lat' holds '1_000' in line 2"),
        (b"lon,lat\n1,2\n1,2,3\n", "line 3 has 3 cells, more than the 2 of the first"),
        (b"lon,lat\n" + b"1" * (LONGEST + 9), "line 2 is longer than 65,536 characters"),
        (bytes(range(128, 256)), "is no text: neither UTF-8, UTF-16 nor Windows-1252"),
        (b"\x00\x01\x02lon", "is no text: it holds control characters"),
        (gzip.compress(b"lon,lat\n1,2\n" * 99)[:40], "t.csv cannot be read: it is cut off"),
    ],
)
def test_what_is_no_table_gets_one_clear_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(content)
    with pytest.raises(TableError, match=message) as caught:
        open_table(path).read({"lon": 0, "lat": 1})
    assert "\n" not in str(caught.value)


def test_a_column_that_is_not_there_names_the_nearest(tmp_path: Path) -> None:
    found = table(tmp_path / "t.csv", "Lon,lat,Depth\n1,2,3\n")
    assert (found.place("lon"), found.place("Depth")) == (0, 2)
    with pytest.raises(TableError, match="has no column 'dept': it has Lon, lat, Depth, nearest 'Depth'"):
        found.place("dept")


def test_real_tables(reference: Path) -> None:
    folder: Any = reference / "cases" / "real"
    found = open_table(folder / "guayama-small.csv")
    assert split_label(found.labels[2]) == ("depth", "feet")
    assert len(found.read({"z": 2}).line) == 200
