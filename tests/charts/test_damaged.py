"""Charts of every format, damaged in every way: one error or a chart, never a traceback, a crash or a full memory.

Run as a program, this file reads damaged charts in a process of its own, so that a crash of a library below is seen.
"""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

KINDS = ("tif", "cog", "bag", "s102", "nc4", "nc3", "asc", "csv", "gz", "own-tif", "own-nc")

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a program, too
from peak_memory import peak_of_this_process_mb  # noqa: E402

MOST_MB = 500
R, C = np.mgrid[0:30, 0:40]
DEPTH = (12 + 3 * np.sin(C / 9) * np.cos(R / 7)).astype("float32")


def write(kind: str, path: Path) -> None:
    """A small whole chart of a kind."""
    import h5py
    import rasterio
    import xarray as xr
    from rasterio.transform import Affine

    from uwcoop.charts import Chart, write_chart
    from uwcoop.frames import Origin

    profile = {
        "height": 30, "width": 40, "dtype": "float32", "crs": "EPSG:32610",
        "transform": Affine(5, 0, 540000, 0, -5, 5280000), "nodata": 1e6,
    }  # fmt: skip
    if kind in ("tif", "cog", "bag"):
        driver = "BAG" if kind == "bag" else "GTiff"
        extra = (
            {"tiled": True, "blockxsize": 16, "blockysize": 16, "compress": "deflate"}
            if kind == "cog"
            else {}
        )
        count = 2 if kind == "bag" else 1
        with rasterio.open(path, "w", driver=driver, count=count, **profile, **extra) as file:
            for band in range(count):
                file.write(DEPTH * 0 + 0.2 if band else -DEPTH, band + 1)
    elif kind == "s102":
        with h5py.File(path, "w") as file:
            file.attrs["horizontalCRS"] = np.int32(32610)
            instance = file.create_group("BathymetryCoverage").create_group("BathymetryCoverage.01")
            file.create_group("Group_F")
            for name, value in {
                "gridOriginLatitude": 5279700.0, "gridOriginLongitude": 540000.0, "gridSpacingLatitudinal": 5.0,
                "gridSpacingLongitudinal": 5.0, "numPointsLatitudinal": np.uint32(30),
                "numPointsLongitudinal": np.uint32(40),
            }.items():  # fmt: skip
                instance.attrs[name] = value
            values = np.zeros((30, 40), dtype=[("depth", "<f4"), ("uncertainty", "<f4")])
            values["depth"], values["uncertainty"] = DEPTH, 0.2
            instance.create_group("Group_001").create_dataset("values", data=values)
    elif kind in ("nc3", "nc4"):
        axes = {"lat": ("lat", 47.6 + np.arange(30) / 7200, {"units": "degrees_north"}),
                "lon": ("lon", -122.4 + np.arange(40) / 7200, {"units": "degrees_east"})}  # fmt: skip
        data = xr.Dataset({"depth": (("lat", "lon"), DEPTH, {"units": "m", "positive": "down"})}, axes)
        data.to_netcdf(path, engine="scipy" if kind == "nc3" else "h5netcdf")
    elif kind == "asc":
        rows = "\n".join(" ".join(f"{v:.2f}" for v in row) for row in DEPTH)
        path.write_text(
            f"ncols 40\nnrows 30\nxllcorner 540000\nyllcorner 5279700\ncellsize 5\nnodata_value -1\n{rows}\n"
        )
    elif kind in ("csv", "gz"):
        lines = ["lon,lat,depth,day,time", *(
            f"{-122.4 + 5e-5 * j:.6f},{47.6 + 5e-5 * i:.6f},{DEPTH[i, j]:.2f},{i % 2},{1.7e9 + 40 * i + j:.1f}"
            for i, j in np.ndindex(30, 40)
        )]  # fmt: skip
        text = ("\n".join(lines) + "\n").encode()
        path.write_bytes(gzip.compress(text) if kind == "gz" else text)
    else:
        chart = Chart(DEPTH, 0.0, 0.0, 5.0, 0.2, 10.0, Origin(47.6, -122.4, "EPSG:32610"))
        stored = path.with_suffix(".tif" if kind == "own-tif" else ".nc")
        write_chart(chart, stored)
        stored.rename(path)


def damaged(whole: bytes, rng: np.random.Generator) -> bytes:
    """One of the ways in which files get damaged."""
    content = bytearray(whole)
    way = rng.integers(5)
    if way == 0:
        return bytes(content[: rng.integers(1, len(content))])
    if way == 1:  # a header's byte, where sizes and offsets are
        content[rng.integers(min(512, len(content)))] = rng.integers(256)
    elif way == 2:
        for at in rng.integers(0, len(content), rng.integers(1, 30)):
            content[at] = rng.integers(256)
    elif way == 3:
        start, size = rng.integers(len(content)), rng.integers(1, 200)
        content[start : start + size] = bytes(rng.integers(0, 256, size, dtype=np.uint8))
    else:
        start, size, to = rng.integers(len(content)), rng.integers(1, 400), rng.integers(len(content))
        content[to:to] = content[start : start + size]
    return bytes(content)


def main(kinds: str, folder: str, count: int, seed: int) -> None:
    """Read `count` damaged charts of each of some kinds; print what was raised that no user must see."""
    for kind in kinds.split(","):
        read_damaged(kind, folder, count, seed)


def read_damaged(kind: str, folder: str, count: int, seed: int) -> None:
    from uwcoop.charts import load_chart
    from uwcoop.errors import UwcoopError

    path, rng = Path(folder) / "chart", np.random.default_rng(seed)
    write(kind, path)
    whole = path.read_bytes()
    charts = 0
    for k in range(count):
        path.write_bytes(damaged(whole, rng))
        try:
            chart = load_chart(path, crs="EPSG:32610" if kind == "asc" else None)
        except UwcoopError as error:
            if "\n" in str(error):
                print(f"{kind} {k}: several lines: {error!r}")
        except BaseException as error:
            print(f"{kind} {k}: {type(error).__name__}: {error}")
        else:
            charts += 1
            low, high = chart.depth_range_m
            if not (0 < low <= high <= 12_000):
                print(f"{kind} {k}: depths of {low} to {high} m")
    peak_mb = peak_of_this_process_mb()
    if peak_mb > MOST_MB:
        print(f"{kind}: {peak_mb:.0f} MB")
    print(f"{kind}: read {count}, of which {charts} were charts", file=sys.stderr)


def said_of(kinds: str, folder: Path, count: int, seed: int) -> str:
    pytest.importorskip("rasterio")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", __file__, kinds, str(folder), str(count), str(seed)],
        capture_output=True, text=True, timeout=1800, check=False,
    )  # fmt: skip
    for kind in kinds.split(","):
        line = f"{kind}: read {count}"
        assert line in done.stderr, f"{kind}: ended with {done.returncode}: {done.stderr[-600:]}"
    assert "Traceback" not in done.stderr
    assert "Error" not in done.stderr
    assert "HDF5-DIAG" not in done.stderr
    return done.stdout


def test_damaged_charts_are_refused_in_one_line(tmp_path: Path) -> None:
    # In one process: its start costs more than what it reads.
    assert said_of(",".join(KINDS), tmp_path, 25, seed=1) == ""


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_three_thousand_damaged_charts(tmp_path: Path, kind: str) -> None:
    assert said_of(kind, tmp_path, 275, seed=2) == ""


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
