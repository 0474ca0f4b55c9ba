"""Tracks in the formats of other programs: read back by their own rules and libraries."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import uwcoop
from uwcoop import scenario
from uwcoop.errors import TracksError
from uwcoop.frames import LocalFrame, Origin
from uwcoop.report.export import FORMATS, export_tracks
from uwcoop.report.run_folder import write_run
from uwcoop.world.simulate import simulate

EPOCH_NS = 1_780_000_000_250_000_000
ORIGIN = Origin(18.32, -64.76, "EPSG:32620")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose place and date are known."""
    log = simulate(scenario.load("flat-bay", ("duration_s=60", "navigator.all.particles=100")), seed=2)
    log = replace(log, origin=ORIGIN, epoch_ns=EPOCH_NS)
    made: Path = tmp_path_factory.mktemp("run")
    write_run(uwcoop.run(log, ["mpf", "dead-reckoning"], clouds=False), made, print)
    return made


def tracks(folder: Path) -> xr.Dataset:
    with xr.open_dataset(folder / "tracks.nc", decode_times=False) as opened:
        return opened.load()


def expected_degrees(folder: Path, navigator: str, vehicle: str) -> np.ndarray:
    position = tracks(folder).position_m.sel(navigator=navigator, vehicle=vehicle).values
    return LocalFrame(ORIGIN).to_geographic(position[np.isfinite(position).all(-1)])


def test_tracks_follow_the_conventions(folder: Path) -> None:
    found = tracks(folder)
    assert found.attrs["Conventions"] == "CF-1.11"
    for name, standard in (("latitude", "latitude"), ("longitude", "longitude"), ("depth_m", "depth")):
        assert found[name].attrs["standard_name"] == standard
    assert found.latitude.attrs["units"] == "degrees_north"
    mapping = found[str(found.position_m.attrs["grid_mapping"])]
    assert mapping.attrs["grid_mapping_name"] == "transverse_mercator"
    assert found.time_utc.attrs["units"].startswith("seconds since 2026-05-28")
    decoded = xr.decode_cf(found[["latitude", "time_utc"]])
    assert abs(decoded.time_utc.values[0] - np.datetime64(EPOCH_NS, "ns")) < np.timedelta64(1, "ms")
    point = found.sel(navigator="mpf", vehicle="V2").isel(time=20)
    degrees = LocalFrame(ORIGIN).to_geographic(point.position_m.values[None])[0]
    np.testing.assert_allclose([point.latitude, point.longitude], degrees, atol=1e-9)
    # East and north of the projection, less the local origin, are the local metres.
    zero = LocalFrame(ORIGIN).to_geographic([[0.0, 0.0]])[0]
    assert abs(zero[0] - ORIGIN.latitude_deg) < 1e-9
    for variable in found.data_vars.values():
        assert "long_name" in variable.attrs or variable.dtype.kind in "SU" or variable.attrs, variable.name


def test_geojson(folder: Path) -> None:
    path, _ = export_tracks(folder, "geojson")
    features = json.loads(path.read_text())["features"]
    assert len(features) == 3 * 3
    one = next(
        f for f in features if f["properties"]["navigator"] == "mpf" and f["properties"]["vehicle"] == "V2"
    )
    assert one["geometry"]["type"] == "LineString"
    coordinates = np.array(one["geometry"]["coordinates"])
    wanted = expected_degrees(folder, "mpf", "V2")
    # RFC 7946: longitude first.
    np.testing.assert_allclose(coordinates[0, :2], wanted[0, ::-1], atol=1e-7)
    np.testing.assert_allclose(coordinates[-1, :2], wanted[-1, ::-1], atol=1e-7)
    assert one["properties"]["times"][0].startswith("2026-05-28T")


def test_gpx_and_kml_are_xml_with_the_places_and_times(folder: Path) -> None:
    gpx = ElementTree.parse(export_tracks(folder, "gpx")[0]).getroot()
    space = {"g": "http://www.topografix.com/GPX/1/1"}
    segments = gpx.findall("g:trk", space)
    assert len(segments) == 9
    track = next(t for t in segments if t.findtext("g:name", "", space) == "mpf V2")
    first = track.find("g:trkseg/g:trkpt", space)
    assert first is not None
    wanted = expected_degrees(folder, "mpf", "V2")[0]
    np.testing.assert_allclose([float(first.attrib["lat"]), float(first.attrib["lon"])], wanted, atol=1e-7)
    stamp = datetime.fromisoformat(first.findtext("g:time", "", space))
    assert abs(stamp.timestamp() - EPOCH_NS / 1e9) < 2
    kml = export_tracks(folder, "kml")[0].read_text()
    assert kml.count("<Placemark") == 9
    ElementTree.fromstring(kml)


def test_csv_and_tum_hold_local_metres(folder: Path) -> None:
    found = tracks(folder)
    with export_tracks(folder, "csv")[0].open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    mine = [row for row in rows if row["navigator"] == "mpf" and row["vehicle"] == "V2"]
    position = found.position_m.sel(navigator="mpf", vehicle="V2").values
    known = position[np.isfinite(position).all(-1)]
    assert len(mine) == len(known)
    np.testing.assert_allclose([float(mine[5]["east_m"]), float(mine[5]["north_m"])], known[5], atol=1e-3)
    target, _ = export_tracks(folder, "tum", navigators=["mpf"])
    files = sorted(file.name for file in target.iterdir())
    assert len(files) == 6
    poses = np.loadtxt(next(file for file in target.iterdir() if "mpf" in file.name and "V2" in file.name))
    assert poses.shape[1] == 8
    np.testing.assert_allclose(np.linalg.norm(poses[:, 4:], axis=1), 1.0, atol=1e-6)


def test_mcap_opens_with_the_right_date_and_place(folder: Path) -> None:
    from mcap.reader import make_reader

    path, _ = export_tracks(folder, "mcap")
    with path.open("rb") as file:
        reader = make_reader(file)
        channels = reader.get_summary().channels.values()  # type: ignore[union-attr]
        topics = {channel.topic for channel in channels}
        first = next(message for _, _, message in reader.iter_messages())
    assert {"/mpf/V2/navsat", "/mpf/V2/odometry", "/mpf/V2/pose"} <= topics
    assert abs(first.log_time - EPOCH_NS) < 2e9


def test_what_is_not_there_is_one_line(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(TracksError, match="is unknown"):
        export_tracks(folder, "geojso")
    with pytest.raises(TracksError, match="uwcoop run MISSION -o"):
        export_tracks(tmp_path, "csv")
    with pytest.raises(TracksError, match="navigator 'mpff'"):
        export_tracks(folder, "csv", navigators=["mpff"])
    log = simulate(scenario.load("flat-bay", ("duration_s=20", "navigator.all.particles=50")), seed=2)
    write_run(uwcoop.run(log, ["mpf"], clouds=False), tmp_path, print)
    for kind, form in FORMATS.items():
        if form.geographic:
            with pytest.raises(TracksError, match="no latitude and longitude"):
                export_tracks(tmp_path, kind)
        else:
            export_tracks(tmp_path, kind)
    (tmp_path / "tracks.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + b"\0" * 200)
    with pytest.raises(TracksError, match="tracks"):
        export_tracks(tmp_path, "csv")
