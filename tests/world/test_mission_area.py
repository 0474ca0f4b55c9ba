"""Where a mission takes place, told before its chart is read, and the part of a large chart that is read for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from uwcoop.charts import grid_source, raster
from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame
from uwcoop.scenario import parse
from uwcoop.scenario.models import Scenario
from uwcoop.world.mission_area import MARGIN_M, mission_area
from uwcoop.world.simulate import simulate

WAYPOINTS = {"kind": "waypoints", "waypoints_deg": [[47.6, -122.4], [47.605, -122.4]]}
MOWER = {
    "kind": "lawnmower", "start_deg": [47.601, -122.399], "heading_deg": 0, "leg_m": 300, "spacing_m": 30, "legs": 4,
}  # fmt: skip


def scenario(*paths: dict[str, Any], chart: dict[str, Any] | None = None, **more: Any) -> Scenario:
    vehicles = [{"name": f"v{k}", "path": path} for k, path in enumerate(paths)]
    table: dict[str, Any] = {
        "name": "m", "duration_s": 100, "vehicles": vehicles,
        "acoustics": {"modem": "micromodem-64", "slot_s": 4.0, "max_range_m": 1000.0},
    }  # fmt: skip
    return parse(table | ({} if chart is None else {"chart": chart}) | more, "m")


def a_grid(folder: Path) -> Path:
    """40 km² at 20 m or so: depths that tell where a node lies."""
    latitude, longitude = 47.57 + 0.0002 * np.arange(300), -122.44 + 0.0002 * np.arange(400)
    depth = 20 + 100 * (latitude[:, None] - 47.57) + 50 * (longitude[None] + 122.44)
    xr.Dataset(
        {"depth": (("lat", "lon"), depth.astype("f4"), {"units": "m", "positive": "down"})},
        {"lat": ("lat", latitude, {"units": "degrees_north"}), "lon": ("lon", longitude, {"units": "degrees_east"})},
    ).to_netcdf(folder / "large.nc", engine="h5netcdf")  # fmt: skip
    return folder / "large.nc"


@pytest.fixture
def few_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid of 120,000 nodes counts as too large to be read whole."""
    for module in (grid_source, raster):
        monkeypatch.setattr(module, "MAX_NODES", 60_000)


@given(
    latitude=st.floats(-80, 80), longitude=st.floats(-180, 180), margin_m=st.none() | st.floats(0, 5000),
    north=st.floats(-0.02, 0.02), east=st.floats(-0.02, 0.02),
)  # fmt: skip
@settings(max_examples=30, deadline=None)
def test_the_box_holds_every_place_and_its_margin(
    latitude: float, longitude: float, margin_m: float | None, north: float, east: float
) -> None:
    end = [latitude + north + 0.001, (longitude + east + 180) % 360 - 180]
    path = {"kind": "waypoints", "waypoints_deg": [[latitude, longitude], end]}
    chart = {"source": "x.nc"} | ({} if margin_m is None else {"margin_m": margin_m})
    area = mission_area(scenario(path, chart=chart))
    assert area is not None
    frame = LocalFrame.at(latitude, longitude)
    far = frame.to_local(end[0], end[1])[0]
    low, high = np.minimum(far, 0), np.maximum(far, 0)
    box = frame.to_local([area.south_deg, area.north_deg], [area.west_deg, area.east_deg])
    margin = MARGIN_M if margin_m is None else margin_m
    # A box of degrees is no box of metres, but for a few metres of each kilometre this far north.
    slack = 2.0 + 0.02 * float(np.ptp(box, axis=0).max())
    np.testing.assert_allclose(box, [low - margin, high + margin], atol=slack)
    assert area.east_deg >= area.west_deg


def test_a_large_grid_is_read_where_the_mission_is(tmp_path: Path, few_nodes: None) -> None:
    log = simulate(scenario(WAYPOINTS, MOWER, chart={"source": str(a_grid(tmp_path))}))
    said = [note for note in log.chart.notes if "the mission's area" in note]
    assert len(said) == 1
    assert said[0].endswith("of 300 x 400 nodes read")
    assert log.chart.depth_m.size < 30_000
    at = LocalFrame(log.chart.origin).to_local([47.6025, 47.6], [-122.4, -122.4])
    np.testing.assert_allclose(log.chart.depth_at(at), [25.25, 25.0], atol=0.02)
    assert not any("off the chart" in note for note in log.notes)
    # The margin, on each side of 556 m of the path.
    wide = simulate(scenario(WAYPOINTS, chart={"source": str(tmp_path / "large.nc"), "margin_m": 1500.0}))
    _, south, _, north = wide.chart.extent
    assert north - south == pytest.approx(556 + 3000, abs=60)


def test_a_grid_that_is_read_whole_stays_whole(tmp_path: Path) -> None:
    log = simulate(scenario(WAYPOINTS, chart={"source": str(a_grid(tmp_path))}))
    assert not any("area" in note for note in log.chart.notes)
    assert log.chart.depth_m.size > 100_000


def test_tracks_and_areas_tell_the_place_too(tmp_path: Path, few_nodes: None) -> None:
    rows = "".join(f"{k},{-122.41 + 1e-5 * k:.6f},47.59,{25:g}\n" for k in range(200))
    (tmp_path / "t.csv").write_text("time,longitude,latitude,sounding\n" + rows)
    chart = {"source": str(a_grid(tmp_path))}
    tracked = scenario(WAYPOINTS, chart=chart)
    vehicles = [{"name": "t", "track": {"file": str(tmp_path / "t.csv")}}]
    tracked = parse(tracked.resolved() | {"vehicles": vehicles}, "m")
    area = mission_area(tracked)
    assert area is not None
    assert (area.south_deg, area.north_deg) == pytest.approx((47.5855, 47.5945), abs=1e-4)
    assert (area.west_deg, area.east_deg) == pytest.approx((-122.41667, -122.40134), abs=1e-4)
    corners = [[47.59, -122.41], [47.59, -122.40], [47.6, -122.40], [47.6, -122.41]]
    for polygon in (
        {"polygon_deg": corners},
        {"wkt": "POLYGON((" + ",".join(f"{b} {a}" for a, b in [*corners, corners[0]]) + "))"},
    ):
        shared = scenario({"kind": "area"}, chart=chart, area={**polygon, "line_spacing_m": 100.0})
        box = mission_area(shared)
        assert box is not None
        assert (box.south_deg, box.north_deg) == pytest.approx((47.5855, 47.6045), abs=1e-4)


def test_metres_do_not_tell_a_place_and_a_place_beside_the_grid_is_refused(
    tmp_path: Path, few_nodes: None
) -> None:
    chart = {"source": str(a_grid(tmp_path))}
    metres = {"kind": "waypoints", "waypoints_m": [[0, 0], [300, 0]]}
    assert mission_area(scenario(WAYPOINTS, metres, chart=chart)) is None
    with pytest.raises(ChartError, match="is above 60,000: give the mission's area"):
        simulate(scenario(WAYPOINTS, metres, chart=chart))
    elsewhere = {"kind": "waypoints", "waypoints_deg": [[47.6, 122.4], [47.605, 122.4]]}
    with pytest.raises(ChartError, match=r"the mission's area .* lies off large.nc"):
        simulate(scenario(elsewhere, chart=chart))
