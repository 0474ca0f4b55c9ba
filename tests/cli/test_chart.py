"""`uwcoop chart` as a user meets it: parts of charts, several files, charts written and read back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from uwcoop.charts import load_chart
from uwcoop.cli import app

pytest.importorskip("rasterio")


def chart(*args: str | Path) -> Any:
    return CliRunner().invoke(app, ["chart", *map(str, args)])


def facts(*args: str | Path) -> dict[str, Any]:
    result = chart(*args, "--json")
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def survey(path: Path, shift: float = 0.0, fill: float | None = None) -> Path:
    lines = ["Longitude (°),Latitude (°),Depth (m)"]
    for i, j in np.ndindex(30, 40):
        depth = 10 + np.sin(j / 9) * np.cos(i / 5) if fill is None or (i + j) % 9 else fill
        lines.append(f"{-122.4 + 5e-5 * j + shift:.6f},{47.6 + 5e-5 * i:.6f},{depth:.2f}")
    path.write_text("\n".join(lines) + "\n", encoding="cp1252")
    return path


@pytest.mark.parametrize("suffix", ["tif", "nc"])
def test_a_chart_is_written_and_read_back(tmp_path: Path, suffix: str) -> None:
    source, written = survey(tmp_path / "s.csv"), tmp_path / f"out.{suffix}"
    result = chart(source, "--cell", "5", "-o", written)
    assert result.exit_code == 0, result.output
    assert f"wrote {written}" in result.stderr
    assert load_chart(written) == load_chart(source, cell_m=5.0)
    assert facts(written)["sha256"] == facts(source, "--cell", "5")["sha256"]


def test_corners_in_degrees_are_printed_and_read_as_an_area(tmp_path: Path) -> None:
    source = survey(tmp_path / "s.csv")
    whole = facts(source, "--cell", "5")
    south_west, _, north_east, _ = whole["corners_deg"]
    assert south_west == pytest.approx([47.6, -122.4], abs=1e-4)
    result = chart(source, "--cell", "5")
    assert f"SW {south_west[0]:.6f}° {south_west[1]:.6f}°" in " ".join(result.stdout.split())
    middle = np.mean([south_west, north_east], axis=0)
    area = ",".join(f"{value:.7f}" for value in (*south_west, *middle))
    part = facts(source, "--cell", "5", f"--area={area}")
    assert part["rows"] < 0.6 * whole["rows"]
    assert part["cols"] < 0.6 * whole["cols"]
    assert facts("synthetic:st-john")["corners_deg"] is None


def test_several_files_and_a_value_of_no_data(tmp_path: Path) -> None:
    files = survey(tmp_path / "a.csv", fill=7.77), survey(tmp_path / "b.csv", shift=2e-5, fill=7.77)
    found = facts(*files, "--cell", "5", "--nodata", "7.77")
    assert found["depth_m"]["min"] > 8.9
    said = " | ".join(found["notes"])
    assert "hold 7.77: taken as no data" in said
    assert "leaving out one of 2 surveys" in said


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["--picture", "x.tif"],
            "picture x.tif would be a TIFF without positions: -o x.tif writes a GeoTIFF",
        ),
        (["-o", "x.png"], "chart x.png must end in one of .tif, .tiff, .nc"),
        (["--area=1,2,3"], "must be latitude,longitude,latitude,longitude of two opposite corners, degrees"),
        (["--area=10,10,11,11"], "holds none of the soundings of s.csv"),
    ],
)
def test_what_cannot_be_done_is_one_line(tmp_path: Path, options: list[str], says: str) -> None:
    result = chart(survey(tmp_path / "s.csv"), "--cell", "5", *options)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert says in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s.csv"]
