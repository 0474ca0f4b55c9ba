"""Places in degrees, areas that a team surveys, and paths that cannot be meant."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from uwcoop import scenario
from uwcoop.charts import Chart
from uwcoop.errors import ScenarioError
from uwcoop.frames import LocalFrame, Origin
from uwcoop.scenario import Scenario
from uwcoop.scenario.vehicle import Waypoints
from uwcoop.world.area_lines import path_length_m, survey_paths
from uwcoop.world.places import placed
from uwcoop.world.simulate import simulate

pytest.importorskip("pyproj")
shapely = pytest.importorskip("shapely")

FRAME = LocalFrame.at(43.63, 10.25)
ORIGIN = "origin={latitude_deg=43.63, longitude_deg=10.25}"
BAY = Chart(np.full((61, 61), 20.0, dtype=np.float32), -300.0, -300.0, 10.0, origin=FRAME.origin)


def load(*overrides: str) -> Scenario:
    return scenario.load("flat-bay", ["duration_s=60", *overrides])


def path(text: str) -> str:
    return f"vehicles=[{{name='a', path={{{text}}}}}]"


def corners(found: Scenario, name: str = "a") -> np.ndarray[Any, Any]:
    (chosen,) = (vehicle.path for vehicle in found.team if vehicle.name == name)
    assert isinstance(chosen, Waypoints)
    return np.array(chosen.waypoints_m)


def degrees(points: Any) -> str:
    return json.dumps(FRAME.to_geographic(np.array(points, dtype=float)).tolist())


# --- degrees ---


@pytest.mark.parametrize("by", ["the chart", "the scenario"])
def test_waypoints_in_degrees_lie_where_they_are(by: str) -> None:
    points = [[-120.0, 40.0], [60.0, -80.0], [200.0, 10.0]]
    text = path(f"kind='waypoints', waypoints_deg={degrees(points)}")
    found = placed(load(text), BAY) if by == "the chart" else placed(load(text, ORIGIN), None)
    np.testing.assert_allclose(corners(found.scenario), points, atol=1e-6)
    assert found.origin.latitude_deg == pytest.approx(43.63)


def test_starts_in_degrees_lie_where_they_are() -> None:
    for kind in ("kind='lawnmower', heading_deg=0, leg_m=50, spacing_m=10, legs=2", "kind='adrift'"):
        found = placed(load(path(f"{kind}, start_deg={degrees([[70, -30]])[1:-1]}")), BAY)
        np.testing.assert_allclose(found.scenario.team[0].path.start_m, [70, -30], atol=1e-6)


def test_a_mission_in_degrees_is_the_one_in_metres_and_its_log_keeps_what_was_typed() -> None:
    points = [[-120.0, 40.0], [60.0, -80.0]]
    in_degrees = simulate(load(path(f"kind='waypoints', waypoints_deg={degrees(points)}"), ORIGIN), 1)
    in_metres = simulate(load(path(f"kind='waypoints', waypoints_m={points}")), 1)
    assert in_degrees.truth is not None
    assert in_metres.truth is not None
    np.testing.assert_allclose(in_degrees.truth["position_m"], in_metres.truth["position_m"], atol=1e-5)
    assert in_degrees.origin.latitude_deg == pytest.approx(43.63)
    assert "waypoints_deg" in json.dumps(in_degrees.setup.tables())


def test_degrees_need_one_origin() -> None:
    text = path(f"kind='waypoints', waypoints_deg={degrees([[0, 0], [50, 50]])}")
    nowhere = Chart(np.full((61, 61), 20.0, dtype=np.float32), -300.0, -300.0, 10.0, origin=Origin())
    for chart in (None, nowhere):
        with pytest.raises(ScenarioError, match=r"^vehicle a: latitude and longitude need an origin: "):
            placed(load(text), chart)
    with pytest.raises(ScenarioError, match=r"states an origin, and chart .* has one"):
        placed(load(text, ORIGIN), BAY)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("kind='waypoints', waypoints_deg=[[91, 0], [43, 10]]", "waypoints_deg.0.0 is 91: must be at most 90"),
        ("kind='waypoints', waypoints_deg=[[43, 10], [43, 10]]", "waypoints_deg 0 and 1 are the same point [43, 10]"),
        ("kind='waypoints'", "needs waypoints_m or waypoints_deg, one of the two"),
        ("kind='lawnmower', heading_deg=0, leg_m=5, spacing_m=1, legs=1", "needs start_m or start_deg"),
        ("kind='adrift', start_m=[0, 0], start_deg=[0, 0]", "needs start_m or start_deg, one of the two"),
    ],
)  # fmt: skip
def test_places_that_cannot_be_are_refused(text: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(path(text))
    assert says in str(caught.value)


def test_degrees_in_a_metre_field_are_refused_with_the_hint() -> None:
    for points, says in [
        ("[[43.63, 10.25], [43.64, 10.26]]", "its path of 0.0141 m is shorter than its step of 1.5 m: [43.63, 10.25] "
         "looks like latitude and longitude, which waypoints_deg and start_deg take"),
        ("[[43.6312, 10.2513], [44.6312, 11.9513]]", "its path of 1.97 m: [43.6312, 10.2513] looks like latitude"),
    ]:  # fmt: skip
        with pytest.raises(ScenarioError) as caught:
            placed(load(path(f"kind='waypoints', waypoints_m={points}")), None)
        assert says in str(caught.value)
    with pytest.raises(ScenarioError, match=r"its path of 1 m is shorter than its step of 1\.5 m$"):
        placed(load(path("kind='waypoints', waypoints_m=[[500, 0], [501, 0]]")), None)
    found = placed(load(path("kind='adrift', start_m=[43.63127, 10.25342]")), None)
    assert any("start_m: [43.63127, 10.25342] looks like latitude" in note for note in found.notes)


@settings(deadline=None, max_examples=200)
@given(
    lat=st.floats(-89, 89), lon=st.floats(-179, 179), span=st.floats(1e-4, 0.5), count=st.integers(2, 6),
    seed=st.integers(0, 10**6),
)  # fmt: skip
def test_no_path_in_degrees_passes_for_metres(
    lat: float, lon: float, span: float, count: int, seed: int
) -> None:
    assume(max(abs(lat), abs(lon)) > 1.5)
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(lat, lat + span, count), rng.uniform(lon, lon + span, count)])
    assume(np.all(np.any(np.diff(points, axis=0) != 0, axis=1)))
    assume(np.abs(points[:, 0]).max() <= 90)
    with pytest.raises(ScenarioError, match="looks like latitude"):
        placed(load(path(f"kind='waypoints', waypoints_m={points.tolist()}")), None)


def test_what_lies_off_the_chart_is_noted() -> None:
    log = simulate(load("duration_s=200", path("kind='waypoints', waypoints_m=[[250, 0], [600, 0]]")), 1, BAY)
    assert any("vehicle a: " in note and "off the chart" in note for note in log.notes)
    inside = simulate(load(path("kind='waypoints', waypoints_m=[[-200, 0], [200, 0]]")), 1, BAY)
    assert inside.notes == ()


# --- areas ---

U_SHAPE = shapely.Polygon(
    [(0, 0), (300, 0), (300, 200), (200, 200), (200, 50), (100, 50), (100, 200), (0, 200)]
)
HOLED = shapely.Polygon(
    [(0, 0), (300, 0), (300, 200), (0, 200)], [[(100, 60), (200, 60), (200, 140), (100, 140)]]
)


def polygons() -> st.SearchStrategy[Any]:
    """Polygons of radii drawn around a middle: star-shaped, often far from convex."""
    radii = st.lists(st.floats(40, 300), min_size=3, max_size=12)
    return radii.map(_star)


def _star(radii: list[float]) -> Any:
    angles = 2 * math.pi * np.arange(len(radii)) / len(radii)
    return shapely.Polygon(np.column_stack([np.cos(angles), np.sin(angles)]) * np.array(radii)[:, None])


def shared_or_refused(polygon: Any, spacing: float, yaw: float, team: int) -> list[Any]:
    """Paths; none where there are too few lines, which only a team of several may be told."""
    try:
        return survey_paths(polygon, spacing, yaw, 0.0, [1.0] * team)
    except ScenarioError as error:
        if team == 1 or "leave one without" not in str(error):
            raise
        return []


@settings(deadline=None, max_examples=60)
@given(
    polygon=st.one_of(polygons(), st.sampled_from([U_SHAPE, HOLED])), spacing=st.floats(8, 40), yaw=st.floats(-3, 3),
    team=st.integers(1, 4),
)  # fmt: skip
def test_lines_cover_the_area_stay_inside_and_are_shared(
    polygon: Any, spacing: float, yaw: float, team: int
) -> None:
    paths = shared_or_refused(polygon, spacing, yaw, team)
    assume(paths)
    lines = [shapely.LineString(path) for path in paths]
    room = polygon.buffer(1e-3)
    assert all(room.covers(line) for line in lines)
    across = np.array([-math.sin(yaw), math.cos(yaw)])
    swept = shapely.union_all([line.buffer(spacing * 0.75) for line in lines])
    # Slivers that no line crosses lie within a line spacing of one, seen along the lines.
    missed = polygon.difference(swept)
    for part in [] if missed.is_empty else shapely.get_parts(missed):
        extent = np.asarray(part.exterior.coords) @ across
        assert np.ptp(extent) <= spacing + 1e-6
    lengths = [path_length_m(path) for path in paths]
    longest_line = max(np.ptp(np.asarray(polygon.exterior.coords), axis=0)) * 1.5
    assert max(lengths) - min(lengths) <= 4 * longest_line + 0.6 * sum(lengths)


def test_a_rectangle_is_mown_as_a_planner_would() -> None:
    (found,) = survey_paths(shapely.box(0, 0, 100, 40), 10.0, None, 0.0, [1.0])
    rows = found[:, 1]
    np.testing.assert_allclose(np.unique(np.round(rows, 6)), [5, 15, 25, 35])
    assert path_length_m(found) == pytest.approx(4 * 100 + 3 * 10)
    turned = survey_paths(shapely.box(0, 0, 100, 40), 10.0, math.pi / 2, 0.0, [1.0])[0]
    assert len(np.unique(np.round(turned[:, 0], 6))) == 10


def test_a_faster_vehicle_gets_more() -> None:
    slow, fast = survey_paths(shapely.box(0, 0, 1000, 300), 5.0, 0.0, 0.0, [1.0, 2.0])
    assert path_length_m(fast) / path_length_m(slow) == pytest.approx(2.0, rel=0.05)


AREA = "vehicles={count=2, path={kind='area'}}"


def test_every_way_to_write_an_area_gives_the_same_paths(tmp_path: Path) -> None:
    local = [[-150.0, -100.0], [150.0, -100.0], [150.0, 100.0], [-150.0, 100.0]]
    places = FRAME.to_geographic(np.array(local))
    ring = [[lon, lat] for lat, lon in places.tolist()]
    ring.append(ring[0])
    wkt = "POLYGON((" + ", ".join(f"{lon!r} {lat!r}" for lon, lat in ring) + "))"
    geometry = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {}, "geometry": geometry}
    files = {
        "a.geojson": json.dumps({"type": "FeatureCollection", "features": [feature]}),
        "b.json": json.dumps(geometry),
        "c.wkt": wkt,
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    ways = [f"polygon_m={local}", f"polygon_deg={json.dumps(places.tolist())}", f"wkt='{wkt}'"]
    ways += [f"file='{tmp_path / name}'" for name in files]
    found = []
    for way in ways:
        made = load(AREA, f"area={{{way}, line_spacing_m=20, heading_deg=90}}")
        scenario.parse(made.resolved())
        place = placed(made, BAY)
        assert sum("area: V" in note for note in place.notes) == 2
        found.append([corners(place.scenario, name) for name in ("V1", "V2")])
    for paths in found[1:]:
        for path_, first in zip(paths, found[0], strict=True):
            np.testing.assert_allclose(path_, first, atol=1e-4)
    assert len(np.unique(np.round(np.concatenate(found[0])[:, 1], 3))) == 10


def test_an_area_is_simulated() -> None:
    area = "area={polygon_m=[[-200, -200], [200, -200], [200, 200], [-200, 200]], line_spacing_m=40}"
    log = simulate(load("duration_s=300", AREA, area), 0, BAY)
    assert log.truth is not None
    inside = np.abs(log.truth["position_m"].to_numpy()) <= 215
    assert inside.all()
    assert sum(note.startswith("area: V") for note in log.notes) == 2


@pytest.mark.parametrize(
    ("area", "says"),
    [
        ("{polygon_m=[[0, 0], [100, 100], [100, 0], [0, 100]], line_spacing_m=5}", "is not valid: Self-intersection"),
        ("{polygon_m=[[0, 0], [100, 0], [100, 100]], line_spacing_m=500}", "1 lines for 2 vehicles leave one without"),
        ("{polygon_m=[[0, 0], [100, 0], [100, 100]], line_spacing_m=5, margin_m=60}", "nothing left of the polygon"),
        ("{polygon_m=[[0, 0], [1e6, 0], [1e6, 1e6]], line_spacing_m=5}", "at most 5000 fit"),
        ("{wkt='POINT(1 2)', line_spacing_m=5}", "must be one POLYGON"),
        ("{wkt='POLYGON((', line_spacing_m=5}", "area.wkt cannot be read"),
        ("{wkt='POLYGON((0 0, 500 0, 500 500, 0 0))', line_spacing_m=5}", "metres go into polygon_m"),
    ],
)  # fmt: skip
def test_areas_that_cannot_be_surveyed_are_refused(area: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        placed(load(AREA, f"area={area}"), BAY)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_area_and_its_vehicles_belong_together(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r'has a vehicle with path\.kind = "area" but no table area'):
        load(AREA)
    with pytest.raises(ScenarioError, match=r'has a table area but no vehicle with path\.kind = "area"'):
        load("area={polygon_m=[[0, 0], [1, 0], [1, 1]], line_spacing_m=5}")
    with pytest.raises(
        ScenarioError, match=r"area has none of them: must have one of polygon_deg, polygon_m, wkt, file"
    ):
        load(AREA, "area={line_spacing_m=5}")
    for text in (
        "{",
        '{"type": "FeatureCollection", "features": []}',
        "LINESTRING(0 0, 1 1)",
        '{"type": "Point"}',
    ):
        (tmp_path / "a.geojson").write_text(text)
        with pytest.raises(ScenarioError, match=r"area file .*a\.geojson (cannot be read|holds a)"):
            load(AREA, f"area={{file='{tmp_path / 'a.geojson'}', line_spacing_m=5}}")
