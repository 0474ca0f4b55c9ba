"""The replay: verified by Rerun itself and read back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fake_mission import LINK, Mission, mission
from uwcoop.errors import LogError, MissingDependencyError, UwcoopError
from uwcoop.missionlog import MissionLog

pytest.importorskip("rerun", reason="rerun-sdk is not installed")
pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read recordings back")

import rerun as rr
from rerun import chunk as chunks

from uwcoop import viewer
from uwcoop.viewer import scene, traffic
from uwcoop.viewer.stage import Stage

DURATION_S = 120


@pytest.fixture(scope="module")
def example() -> Mission:
    return mission(duration_s=DURATION_S, particles=150)


@pytest.fixture(scope="module")
def replay(example: Mission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / viewer.REPLAY_NAME
    viewer.write_replay(path, example.tracks, example.packets, example.clouds, example.chart, example.log)
    return path


class Recording:
    """A recording's columns by entity."""

    def __init__(self, path: Path) -> None:
        reader = chunks.RrdReader(path)
        self.blueprints = len(reader.blueprints())
        self.batches: dict[str, list[Any]] = {}
        self.timelines: set[str] = set()
        for chunk in reader.stream():
            self.batches.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
            self.timelines |= set(chunk.timeline_names)

    def column(self, entity: str, component: str) -> list[Any]:
        """All rows of a component; an empty row is an empty list."""
        found: list[Any] = []
        for batch in self.batches[entity]:
            for name in batch.schema.names:
                if name == component or name.endswith(f":{component}"):
                    found += batch.column(name).to_pylist()
        return found

    def seconds(self, entity: str) -> np.ndarray[Any, Any]:
        found = [
            np.asarray(batch.column("mission_time").to_numpy(zero_copy_only=False)) / np.timedelta64(1, "s")
            for batch in self.batches[entity]
            if "mission_time" in batch.schema.names
        ]
        return np.concatenate(found)


@pytest.fixture(scope="module")
def recording(replay: Path) -> Recording:
    return Recording(replay)


def test_rerun_verifies_it(replay: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(replay)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert list(replay.parent.iterdir()) == [replay]  # no temporary file stays
    assert replay.stat().st_size < 4_000_000


def test_everything_is_in_it(recording: Recording, example: Mission) -> None:
    root = next(e.split("/")[1] for e in recording.batches if e.startswith("/scene"))
    assert root == "scene_depth_x2"
    want = {f"/{root}", f"/{root}/chart", f"/{root}/surface"}
    for vehicle in ("auv-1", "auv-2", "auv-3"):
        want |= {f"/{root}/truth/{vehicle}/{part}" for part in ("course", "trail", "body", "body/arrow")}
        for navigator in ("dead-reckoning", "dmpf", "mpf"):
            want |= {
                f"/{root}/{navigator}/{vehicle}/{part}"
                for part in ("trail", "body", "body/position", "body/name", "body/ellipse_95")
            }
            want |= {f"/error_m/{vehicle}/{navigator}", f"/nees/{vehicle}/{navigator}"}
        want |= {f"/nees/{vehicle}/limit"}
        for axis in ("east", "north") if "current_east_mps" in example.tracks else ():
            want |= {
                f"/current_mps/{vehicle}/{axis}/{navigator}{side}"
                for navigator in ("dead-reckoning", "dmpf", "mpf")
                for side in ("", "/above", "/below")
            }
            if example.log.truth is not None and "current_mps" in example.log.truth:
                want |= {f"/current_mps/{vehicle}/{axis}/true"}
        want |= {f"/{root}/{n}/{vehicle}/body/cloud" for n in ("dmpf", "mpf")}
        others = {"auv-1", "auv-2", "auv-3"} - {vehicle}
        want |= {f"/{root}/{n}/packets/{vehicle}_to_{other}" for n in ("dmpf", "mpf") for other in others}
    want |= {"/acoustics/dmpf", "/acoustics/mpf"}
    got = {entity for entity in recording.batches if not entity.startswith("/__")} - {"/"}
    assert got == want
    assert recording.timelines == {"mission_time"}
    assert recording.blueprints == 1


def test_vehicles_move_over_the_whole_mission(recording: Recording, example: Mission) -> None:
    path = "/scene_depth_x2/mpf/auv-2/body"
    seconds = recording.seconds(path)
    np.testing.assert_allclose(seconds, np.arange(DURATION_S + 1))
    at = np.array(recording.column(path, "translation"))[:, 0]
    want = example.tracks.position_m.sel(navigator="mpf", vehicle="auv-2", time=seconds).values
    np.testing.assert_allclose(at[:, :2], want, atol=1e-3)
    np.testing.assert_allclose(at[:, 2], -3.0)  # auv-2 swims 3 m down, z is up


def test_error_and_nees_are_those_of_the_metrics(recording: Recording, example: Mission) -> None:
    from uwcoop.evaluation import metrics

    grid = np.arange(DURATION_S + 1.0)
    for quantity, values in (("error_m", metrics.errors), ("nees", metrics.nees)):
        got = np.array(recording.column(f"/{quantity}/auv-3/dmpf", "scalars"))[:, 0]
        want = values(example.tracks).sel(navigator="dmpf", vehicle="auv-3", time=grid).values
        np.testing.assert_allclose(got, want)


def test_packets_fly_from_launch_until_decoded_and_lost_ones_differ(
    recording: Recording, example: Mission
) -> None:
    p = example.packets
    own = np.flatnonzero((p["navigator"] == 2) & (p["sender"] == 0) & (p["receiver"] == 2))
    entity = "/scene_depth_x2/mpf/packets/auv-1_to_auv-3"
    strips, colours = recording.column(entity, "strips"), recording.column(entity, "colors")
    flights = [strip for strip in strips if strip]
    assert len(flights) == len(own)
    assert len(strips) == 2 * len(own)  # each is taken away again
    air_s = LINK.preamble_s + 2 * LINK.frame_s
    np.testing.assert_allclose(recording.seconds(entity)[0::2], p["tol_ns"][own] / 1e9)
    np.testing.assert_allclose(recording.seconds(entity)[1::2], p["toa_ns"][own] / 1e9 + air_s)
    lost = int(rr.components.Color(traffic.COLOURS[traffic.LOST]).rgba)
    drawn = [colour[0] == lost for colour in colours if colour]
    assert drawn == (~p["received"][own]).tolist()
    assert 0 < sum(drawn) < len(drawn)
    # The line starts where the sender truly was at launch.
    truth = example.log.truth.position_m.values[0]
    launch = p["tol_ns"][own[0]] / 1e9
    want = [np.interp(launch, np.arange(len(truth)), truth[:, axis]) for axis in (0, 1)]
    np.testing.assert_allclose(flights[0][0][0][:2], want, atol=0.01)


def test_the_event_log_tells_each_packet(recording: Recording, example: Mission) -> None:
    p = example.packets
    own = p["navigator"] == 1
    text = [line[0] for line in recording.column("/acoustics/dmpf", "text")]
    assert len(text) == own.sum()
    assert sum(line.endswith(", lost") for line in text) == (own & ~p["received"]).sum() > 0
    assert (
        sum(line.endswith(", refused") for line in text) == (own & p["received"] & ~p["accepted"]).sum() > 0
    )
    assert all("14 bytes in 2 frames" in line for line in text)
    assert (np.diff(recording.seconds("/acoustics/dmpf")) >= 0).all()


def test_clouds_stand_around_the_estimate(recording: Recording, example: Mission) -> None:
    entity = "/scene_depth_x2/dmpf/auv-1/body/cloud"
    clouds = [np.array(c) for c in recording.column(entity, "positions") if c]
    np.testing.assert_allclose(recording.seconds(entity), np.arange(0, DURATION_S + 1, 10))
    want = example.clouds.particles_m.sel(navigator="dmpf", vehicle="auv-1", cloud_time=100)
    centre = example.tracks.position_m.sel(navigator="dmpf", vehicle="auv-1", time=100)
    np.testing.assert_allclose(clouds[10][:, :2], want - centre, atol=1e-3)
    np.testing.assert_allclose(clouds[10][:, 2], 0)


# ---------------------------------------------------------------------------------------------- parts


def test_seabed_leaves_holes_out_and_stays_small(example: Mission) -> None:
    chart = example.chart
    west, south, east, north = chart.extent
    vertices, triangles, colours = scene.seabed_mesh(chart, (west, east, south, north))
    assert vertices.nbytes + triangles.nbytes + colours.nbytes < 2_000_000
    assert np.isfinite(vertices).all()
    assert triangles.max() == len(vertices) - 1
    assert len(colours) == len(vertices) > 30_000
    corners = vertices[triangles]
    middle = corners.mean(1)
    inside = (middle[:, 0] > 85) & (middle[:, 0] < 195) & (middle[:, 1] > 605) & (middle[:, 1] < 755)
    assert not inside.any()
    np.testing.assert_allclose(-vertices[:, 2], chart.depth_at(vertices[:, :2]), atol=1e-4)
    # Every triangle faces up, so that it is lit from above.
    edge_a, edge_b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert (np.cross(edge_a, edge_b)[:, 2] > 0).all()


def test_heights_are_stretched_for_shallow_water_only(example: Mission) -> None:
    stage = Stage.of(example.tracks, example.chart, example.log)
    deepest = stage.exaggeration * example.chart.depth_range_m[1]
    assert 0.05 < deepest / stage.span_m <= 1 / 6
    assert stage.root.endswith(f"x{stage.exaggeration}")


def test_a_log_without_truth_still_replays(example: Mission, tmp_path: Path) -> None:
    tracks = example.tracks.copy(deep=True)
    tracks["truth_position_m"][:] = np.nan
    tracks["covariance_m2"][0, 0] = np.nan
    tracks["position_m"][1, 1, 40:] = np.nan
    depth = {"t_ns": np.array([0]), "vehicle": np.array([1]), "depth_m": np.array([12.0])}
    log = MissionLog("real", 0, example.log.vehicles, example.log.duration_ns, LINK, events={"depth": depth})
    viewer.write_replay(tmp_path / "r.rrd", tracks, example.packets, None, example.chart, log)
    got = Recording(tmp_path / "r.rrd")
    root = Stage.of(tracks, example.chart, log).root
    assert f"/{root}/truth/auv-1/body" not in got.batches
    assert np.array(got.column(f"/{root}/mpf/auv-2/body", "translation"))[:, 0, 2] == pytest.approx(-12.0)
    assert f"/{root}/dead-reckoning/auv-1/body/ellipse_95" not in got.batches
    assert "/acoustics/mpf" in got.batches


def test_a_failed_write_leaves_nothing_and_keeps_the_old(
    example: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("disk full")

    old = tmp_path / "replay.rrd"
    old.write_bytes(b"old")
    monkeypatch.setattr("uwcoop.viewer.plots.send", fail)
    with pytest.raises(RuntimeError, match="disk full"):
        viewer.write_replay(old, example.tracks, example.packets, example.clouds, example.chart, example.log)
    assert [p.name for p in tmp_path.iterdir()] == ["replay.rrd"]
    assert old.read_bytes() == b"old"


def test_without_rerun_the_extra_is_named(
    example: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    (tmp_path / viewer.REPLAY_NAME).touch()
    with pytest.raises(MissingDependencyError, match=r"uwcoop\[viz\]"):
        viewer.view(tmp_path)
    with pytest.raises(MissingDependencyError, match=r"uwcoop\[viz\]"):
        viewer.write_replay(
            tmp_path / "r.rrd", example.tracks, example.packets, None, example.chart, example.log
        )
    assert not (tmp_path / "r.rrd").exists()


def test_view_names_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"no replay .*replay\.rrd"):
        viewer.view(tmp_path)


def test_view_binds_to_this_machine_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[list[str]] = []

    def run(command: list[str], *, check: bool) -> subprocess.CompletedProcess[str]:
        calls.append(command)
        return subprocess.CompletedProcess(command, len(calls) - 1)

    monkeypatch.setattr(subprocess, "run", run)
    (tmp_path / viewer.REPLAY_NAME).touch()
    viewer.view(tmp_path)
    at = calls[0].index("--bind")
    assert calls[0][at + 1] == "127.0.0.1"
    assert "--web-viewer" not in calls[0]
    with pytest.raises(UwcoopError, match="code 1"):
        viewer.view(tmp_path, web=True)
    assert "--web-viewer" in calls[1]


def test_where_the_origin_is_known_paths_are_on_a_map_of_the_earth(example: Mission, tmp_path: Path) -> None:
    pytest.importorskip("pyproj", reason="pyproj is not installed")
    from dataclasses import replace

    from uwcoop.frames import LocalFrame, Origin

    origin = Origin(18.32, -64.76, "EPSG:32620")
    path = tmp_path / viewer.REPLAY_NAME
    log = replace(example.log, origin=origin)
    viewer.write_replay(path, example.tracks, example.packets, example.clouds, example.chart, log)
    recording = Recording(path)
    degrees = recording.column("/earth/mpf/auv-2/now", "GeoPoints:positions")
    estimate = example.tracks.position_m.sel(navigator="mpf", vehicle="auv-2").values
    whole = np.isclose(example.tracks.time.values % 1, 0)
    wanted = LocalFrame(origin).to_geographic(estimate[whole])
    np.testing.assert_allclose(np.array([row[0] for row in degrees if row]), wanted, atol=1e-9)
    assert len(recording.column("/earth/truth/auv-2", "GeoLineStrings:line_strings")) == 1
