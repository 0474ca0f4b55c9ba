"""Vehicles: paths and pursuit, errors and their signs, current, exact kinematics, recorded tracks."""

from __future__ import annotations

import copy
import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.charts import Chart
from uwcoop.errors import ScenarioError
from uwcoop.frames import LocalFrame, Origin
from uwcoop.scenario import Scenario
from uwcoop.world.paths import Pursuit, lawnmower, sampled
from uwcoop.world.vehicles import Motion, current_of, team_motion

BASE: dict[str, Any] = {
    "name": "bay",
    "duration_s": 600,
    "chart": {"source": "synthetic:st-john"},
    "vehicles": [{"name": "auv", "path": {"kind": "waypoints", "waypoints_m": [[100, 100], [100, 900]]}}],
    "drift": {"velocity_noise_m_per_sqrt_s": 0},
    "acoustics": {"modem": "unlimited", "slot_s": 5.0, "max_range_m": 1000.0},
}


def world(*overrides: str, base: dict[str, Any] = BASE) -> Scenario:
    return scenario.parse(scenario.apply_overrides(base, overrides))


def flat(depth: float = 20.0, size: int = 1001) -> Chart:
    return Chart(np.full((size, size), depth, dtype=np.float32), 0.0, 0.0, 1.0)


FLAT = flat()


def dead_reckoned(moved: Motion) -> np.ndarray[Any, Any]:
    """Positions at every second from the true start and the commands alone."""
    return moved.position_m[0] + np.vstack([[0, 0], np.cumsum(moved.command_mps[:-1], axis=0)])


def distance_from_path(points: np.ndarray[Any, Any], corners: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    line = sampled(np.asarray(corners, dtype=float), 0.5)
    return np.sqrt(((points[:, None, :] - line[None]) ** 2).sum(axis=2).min(axis=1))


# --- paths ---


def test_a_lawn_mower_turns_to_the_right_of_its_first_leg() -> None:
    corners = lawnmower((10, 20), math.pi / 2, 100.0, 5.0, 3)  # heading north: to the right is east
    np.testing.assert_allclose(
        corners, [[10, 20], [10, 120], [15, 120], [15, 20], [20, 20], [20, 120]], atol=1e-12
    )
    np.testing.assert_allclose(
        lawnmower((0, 0), 0.0, 10.0, -2.0, 2), [[0, 0], [10, 0], [10, 2], [0, 2]], atol=1e-12
    )


def test_pursuit_stays_on_a_lawn_mower_at_its_speed() -> None:
    path = "{kind='lawnmower', start_m=[200, 200], heading_deg=30, leg_m=150, spacing_m=30, legs=4}"
    moved = team_motion(world(f"vehicles.auv.path={path}"), FLAT, 0)[0]
    corners = lawnmower((200, 200), math.pi / 3, 150, 30, 4)
    np.testing.assert_allclose(np.hypot(*np.diff(moved.position_m, axis=0).T), 1.5, atol=1e-9)
    off = distance_from_path(moved.position_m, corners)
    assert off.max() < 3.0  # corners are cut by less than half the look-ahead
    assert np.median(off) < 0.5
    for corner in corners:  # every corner is passed: the whole path is driven
        assert np.hypot(*(moved.position_m - corner).T).min() < 4.0


def test_pursuit_holds_its_path_against_a_current() -> None:
    moved = team_motion(world("current={model='constant', velocity_mps=[0.5, 0]}"), FLAT, 0)[0]
    assert np.abs(moved.position_m[30:400, 0] - 100).max() < 4.0


def test_a_path_is_retraced_at_its_end() -> None:
    moved = team_motion(world("vehicles.auv.path.waypoints_m=[[100, 100], [100, 250]]"), FLAT, 0)[0]
    north = moved.position_m[:, 1]
    assert (north.min(), north.max()) == (pytest.approx(100, abs=2), pytest.approx(250, abs=2))
    assert np.abs(moved.position_m[:, 0] - 100).max() < 1e-6
    np.testing.assert_allclose(north[100], 250, atol=2.0)
    np.testing.assert_allclose(north[200], 100, atol=4.0)
    np.testing.assert_allclose(north[300], 250, atol=6.0)


def test_a_path_shorter_than_a_step_ends() -> None:
    pursuit = Pursuit(np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]]), 6.0)
    assert math.isfinite(pursuit.yaw(50.0, 50.0))


@pytest.mark.parametrize("seed", range(5))
def test_random_paths_stay_inside_the_chart_and_over_water(seed: int) -> None:
    depth = np.full((601, 801), 20.0, dtype=np.float32)
    depth[200:400, 300:420] = np.nan  # a hole
    depth[:, 700:] = 2.5  # too shallow for 2 m of depth and 1 m of clearance
    chart = Chart(depth, 1000.0, -500.0, 1.0)
    team = world("vehicles={count = 4}")
    for moved in team_motion(team, chart, seed):
        assert (moved.position_m >= (1000 + 20, -500 + 20)).all()
        assert (moved.position_m[:, 0] <= 1000 + 700).all()
        assert (moved.position_m[:, 1] <= -500 + 600 - 20).all()
        inside_hole = np.isnan(chart.depth_at(moved.position_m))
        assert inside_hole.mean() < 0.02  # a cut corner at most
    assert inside_hole.dtype == bool


def test_random_paths_differ_between_vehicles_and_seeds() -> None:
    team = world("vehicles={count = 2}", "duration_s=10")
    starts = {tuple(m.position_m[0]) for seed in range(10) for m in team_motion(team, FLAT, seed)}
    assert len(starts) == 20


def test_a_small_chart_gets_small_paths_and_a_tiny_one_a_clear_refusal() -> None:
    moved = team_motion(world("vehicles={count = 1}"), flat(size=201), 0)[0]
    assert ((moved.position_m > 15) & (moved.position_m < 185)).all()
    with pytest.raises(
        ScenarioError, match=r"vehicle V1: no random lawn mower fits the chart .*\(50 x 50 m, 0 % holes\)"
    ):
        team_motion(world("vehicles={count = 1}"), flat(size=51), 0)
    with pytest.raises(ScenarioError, match="3 m of water"):
        team_motion(world("vehicles={count = 1}"), flat(depth=2.9), 0)


# --- errors and their signs ---


def test_without_errors_commands_are_the_truth() -> None:
    moved = team_motion(world("vehicles={count = 1}"), FLAT, 1)[0]
    np.testing.assert_allclose(dead_reckoned(moved), moved.position_m, atol=1e-9)


def test_a_compass_errs_clockwise() -> None:
    # True heading = believed + 2 deg: driving north, the vehicle believes to head 358, west of north.
    moved = team_motion(world("drift.compass_bias_deg=2", "duration_s=100"), FLAT, 0)[0]
    np.testing.assert_allclose(moved.yaw_rad, math.pi / 2, atol=1e-9)
    np.testing.assert_allclose(moved.believed_yaw_rad - moved.yaw_rad, math.radians(2))
    error = dead_reckoned(moved)[-1] - moved.position_m[-1]
    np.testing.assert_allclose(
        error, [-150 * math.sin(math.radians(2)), 150 * (math.cos(math.radians(2)) - 1)], atol=1e-6
    )
    # to first order true = u + bias (u_n, -u_e)
    u, bias = moved.command_mps[0], math.radians(2)
    np.testing.assert_allclose(
        u + bias * np.array([u[1], -u[0]]), np.diff(moved.position_m, axis=0)[0], atol=2e-3
    )


def test_a_thrust_bias_is_speed_that_the_command_does_not_know_of() -> None:
    moved = team_motion(world("drift.thrust_bias_mps=0.1", "duration_s=100"), FLAT, 0)[0]
    np.testing.assert_allclose(np.diff(moved.position_m, axis=0), [[0, 1.6]] * 100, atol=1e-9)
    np.testing.assert_allclose(moved.command_mps, [[0, 1.5]] * 101, atol=1e-9)


@pytest.mark.parametrize(
    ("key", "measure"),
    [
        ("compass_bias_sigma_deg", lambda m: math.degrees(m.believed_yaw_rad[0] - m.yaw_rad[0])),
        ("thrust_bias_sigma_mps", lambda m: float(np.hypot(*(m.position_m[1] - m.position_m[0])) - 1.5)),
        ("velocity_bias_sigma_mps", lambda m: m.current_mps[0, 0]),
        ("velocity_noise_m_per_sqrt_s", lambda m: (m.position_m[1] - m.position_m[0] - m.command_mps[0])[1]),
    ],
)
def test_biases_are_drawn_for_each_mission_with_their_sigma(key: str, measure: Any) -> None:
    s = world(f"drift.{key}=0.2", "duration_s=2")
    drawn = np.array([measure(team_motion(s, FLAT, seed)[0]) for seed in range(400)])
    assert drawn.std() == pytest.approx(0.2, rel=0.15)
    assert abs(drawn.mean()) < 4 * 0.2 / 20


def test_velocity_noise_is_white_and_grows_with_the_root_of_time() -> None:
    s = world("drift.velocity_noise_m_per_sqrt_s=0.05", "duration_s=400")
    errors = np.array(
        [
            (dead_reckoned(m) - m.position_m)[[100, 400]]
            for m in (team_motion(s, FLAT, k)[0] for k in range(150))
        ]
    )
    assert errors[:, 0].std() == pytest.approx(0.5, rel=0.15)
    assert errors[:, 1].std() == pytest.approx(1.0, rel=0.15)


def test_the_dvl_preset_sees_the_current_and_the_other_does_not() -> None:
    current = "current={model='constant', velocity_mps=[0.3, -0.2]}"
    none = ["compass_bias_sigma_deg", "compass_noise_deg", "thrust_bias_sigma_mps", "velocity_bias_sigma_mps"]
    none += ["velocity_bias_walk_mps_per_sqrt_s", "velocity_noise_m_per_sqrt_s"]
    clean = [f"drift.{key}=0" for key in none]
    over_ground = team_motion(world(current, "drift.preset=dvl", *clean), FLAT, 0)[0]
    through_water = team_motion(world(current, "drift.preset=no-dvl", *clean), FLAT, 0)[0]
    np.testing.assert_allclose(dead_reckoned(over_ground), over_ground.position_m, atol=1e-9)
    np.testing.assert_array_equal(over_ground.current_mps, 0)
    error = dead_reckoned(through_water)[-1] - through_water.position_m[-1]
    np.testing.assert_allclose(error, [-180, 120], atol=1e-6)
    np.testing.assert_allclose(through_water.current_mps, [[0.3, -0.2]] * 601)


# --- current ---


def test_currents() -> None:
    def of(text: str, seed: int = 0) -> np.ndarray[Any, Any]:
        return current_of(world(f"current={text}").current, 900, seed)

    np.testing.assert_array_equal(of("{model='none'}"), 0)
    south = of("{model='constant', speed_mps=0.25, direction_deg=180}")
    np.testing.assert_allclose(south, [[0, -0.25]] * 901, atol=1e-12)
    drawn = np.array([of("{model='constant', speed_mps=0.1}", seed)[7] for seed in range(400)])
    np.testing.assert_allclose(np.hypot(*drawn.T), 0.1)
    assert np.abs(drawn.mean(axis=0)).max() < 0.02  # every direction
    walks = np.array([of("{model='random-walk', walk_mps_per_sqrt_s=0.01}", seed) for seed in range(300)])
    np.testing.assert_array_equal(walks[:, 0], 0)
    assert walks[:, 100].std() == pytest.approx(0.1, rel=0.1)
    assert walks[:, 900].std() == pytest.approx(0.3, rel=0.1)
    start = "{model='random-walk', walk_mps_per_sqrt_s=0, initial_mps=[1, 0], initial_sigma_mps=0.2}"
    starts = np.array([of(start, seed)[0] for seed in range(400)])
    np.testing.assert_allclose(starts.mean(axis=0), [1, 0], atol=0.04)
    assert starts.std(axis=0) == pytest.approx([0.2, 0.2], rel=0.15)


def test_the_current_is_common_to_the_team() -> None:
    s = world("vehicles={count = 3}", "current={model='random-walk', walk_mps_per_sqrt_s=0.01}")
    a, b, c = team_motion(s, FLAT, 4)
    np.testing.assert_array_equal(a.current_mps, b.current_mps)
    np.testing.assert_array_equal(a.current_mps, c.current_mps)


# --- kinematics, streams ---


def test_positions_between_seconds_are_on_the_straight_line() -> None:
    moved = team_motion(world("vehicles={count = 1}"), FLAT, 2)[0]
    t = np.array([0.0, 0.25, 17.5, 599.999, 600.0])
    k = np.minimum(t.astype(int), 599)
    expected = moved.position_m[k] + (t - k)[:, None] * (moved.position_m[k + 1] - moved.position_m[k])
    np.testing.assert_allclose(moved.position_at(t), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(moved.depth_at(t), 2.0)


def test_a_further_vehicle_changes_nothing_for_the_others() -> None:
    keys = ("drift.preset=no-dvl", "current={model='random-walk', walk_mps_per_sqrt_s=0.01}", "duration_s=60")
    two = team_motion(world("vehicles={count = 2}", *keys), FLAT, 9)
    three = team_motion(world("vehicles={count = 3}", *keys), FLAT, 9)
    for a, b in zip(two, three, strict=False):
        np.testing.assert_array_equal(a.position_m, b.position_m)
        np.testing.assert_array_equal(a.command_mps, b.command_mps)


def test_one_error_more_changes_no_other() -> None:
    base = team_motion(world("drift.preset=no-dvl", "duration_s=60"), FLAT, 9)[0]
    more = team_motion(world("drift.preset=no-dvl", "drift.thrust_noise_mps=0.3", "duration_s=60"), FLAT, 9)[
        0
    ]
    np.testing.assert_allclose(
        base.believed_yaw_rad - base.yaw_rad, more.believed_yaw_rad - more.yaw_rad, atol=1e-12
    )
    np.testing.assert_array_equal(base.current_mps, more.current_mps)


# --- recorded tracks ---

ORIGIN = Origin(35.16, 139.61, "EPSG:32654")
BAY = Chart(np.full((101, 101), 10.0, dtype=np.float32), -500.0, -500.0, 10.0, origin=ORIGIN)


def track_world(file: Path, *overrides: str, columns: str = "time='t', east='e', north='n'") -> Scenario:
    table = copy.deepcopy(BASE)
    table["vehicles"] = [{"name": "boat", "depth_m": 0.5, "track": {"file": str(file), "columns": {}}}]
    return world("duration_s=8", f"vehicles.boat.track.columns={{{columns}}}", *overrides, base=table)


def write(file: Path, text: str) -> Path:
    if file.suffix == ".gz":
        with gzip.open(file, "wt") as handle:
            handle.write(text)
    else:
        file.write_text(text)
    return file


LOCAL = "t,e,n,z\n100,0,0,5.0\n102,2,0,5.2\n102.3,2,0.6,9.9\n104.4,2,4.8,\n108.6,2,9,5.6\n109,3,9,5.7\n"


@pytest.mark.parametrize("name", ["track.csv", "track.csv.gz"])
def test_a_recorded_track_is_followed_exactly(tmp_path: Path, name: str) -> None:
    file = write(tmp_path / name, LOCAL)
    moved = team_motion(track_world(file), BAY, 0)[0]
    expected = [[0, 0], [1, 0], [2, 0], [2, 2], [2, 4], [2, 5.4], [2, 6.4], [2, 7.4], [2, 8.4]]
    np.testing.assert_allclose(moved.position_m, expected, atol=1e-9)
    np.testing.assert_array_equal(moved.depth_m, 0.5)
    assert moved.soundings_m is None
    np.testing.assert_allclose(dead_reckoned(moved), moved.position_m, atol=1e-9)
    np.testing.assert_allclose(moved.yaw_rad[:4], [0, 0, math.pi / 2, math.pi / 2], atol=1e-9)


def test_soundings_are_delivered_at_the_nearest_second_and_never_made_up(tmp_path: Path) -> None:
    file = write(tmp_path / "track.csv", LOCAL)
    moved = team_motion(track_world(file, columns="time='t', east='e', north='n', sounding='z'"), BAY, 0)[0]
    assert moved.soundings_m is not None
    # 108.6 (8.6 s) rounds to second 9, beyond the end; the empty cell at 4.4 s is a gap
    np.testing.assert_allclose(moved.soundings_m, [5.0, np.nan, 5.2] + [np.nan] * 6)
    longer = track_world(file, "duration_s=9", columns="time='t', east='e', north='n', sounding='z'")
    soundings = team_motion(longer, BAY, 0)[0].soundings_m
    assert soundings is not None
    assert soundings[9] == 5.7  # of two within a second the nearer one


def test_start_where_and_milliseconds_select_a_part(tmp_path: Path) -> None:
    rows = "".join(f"day{day},{1000 * t},{t + 100 * day},{2 * t}\n" for day in (1, 2) for t in range(20))
    file = write(tmp_path / "track.csv", "f,ms,e,n\n" + rows)
    s = track_world(
        file, "vehicles.boat.track.where={f='day2'}", "vehicles.boat.track.start_s=5.5",
        "vehicles.boat.track.time_unit=ms", columns="time='ms', east='e', north='n'",
    )  # fmt: skip
    moved = team_motion(s, BAY, 0)[0]
    np.testing.assert_allclose(moved.position_m[[0, 8]], [[205.5, 11], [213.5, 27]])


def test_own_depth_can_be_recorded(tmp_path: Path) -> None:
    file = write(tmp_path / "track.csv", "t,e,n,d\n0,0,0,1\n10,10,0,6\n")
    moved = team_motion(track_world(file, columns="time='t', east='e', north='n', depth='d'"), BAY, 0)[0]
    np.testing.assert_allclose(moved.depth_m, 1 + 0.5 * np.arange(9))


def test_geographic_and_projected_tracks_land_in_the_charts_frame(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    local = np.array([[0.0, 0.0], [5.0, -3.0], [11.0, 7.0]])
    frame = LocalFrame(ORIGIN)
    degrees = frame.to_geographic(local)
    projected = local + frame.offset_m
    text = "t,lat,lon,e,n\n" + "".join(
        f"{4 * k},{degrees[k, 0]:.12f},{degrees[k, 1]:.12f},{projected[k, 0]:.6f},{projected[k, 1]:.6f}\n"
        for k in range(3)
    )
    file = write(tmp_path / "track.csv", text)
    geographic = track_world(file, columns="time='t', longitude='lon', latitude='lat'")
    utm = track_world(file, "vehicles.boat.track.crs='EPSG:32654'")
    for s in (geographic, utm):
        np.testing.assert_allclose(team_motion(s, BAY, 0)[0].position_m[[0, 4, 8]], local, atol=1e-4)
    with pytest.raises(
        ScenarioError, match=r"cannot be placed on chart .*: local frame has no geographic origin"
    ):
        team_motion(geographic, FLAT, 0)


def test_commands_of_a_record_err_as_those_of_a_simulated_vehicle(tmp_path: Path) -> None:
    rows = "".join(f"{t},{1.2 * t},{0.9 * t}\n" for t in range(0, 301, 3))
    file = write(tmp_path / "track.csv", "t,e,n\n" + rows)
    s = track_world(file, "duration_s=300", "drift.compass_bias_deg=2", "drift.thrust_bias_mps=0.1")
    moved = team_motion(s, BAY, 0)[0]
    np.testing.assert_allclose(moved.believed_yaw_rad - moved.yaw_rad, math.radians(2))
    np.testing.assert_allclose(np.hypot(*moved.command_mps.T), 1.4)
    course = np.arctan2(moved.command_mps[:, 1], moved.command_mps[:, 0])
    np.testing.assert_allclose(course, math.atan2(0.9, 1.2) + math.radians(2))
    current = track_world(file, "duration_s=300", "current={model='constant', velocity_mps=[0.2, 0]}")
    moved = team_motion(current, BAY, 0)[0]
    np.testing.assert_allclose(moved.command_mps, [[1.0, 0.9]] * 301, atol=1e-9)
    np.testing.assert_allclose(moved.yaw_rad, math.atan2(0.9, 1.0))  # it crabs


@pytest.mark.parametrize(("preset", "low", "high"), [("dvl", 10, 40), ("no-dvl", 45, 120)])
def test_drift_presets_give_the_errors_they_promise(
    tmp_path: Path, preset: str, low: float, high: float
) -> None:
    legs = lawnmower((0, 0), 0.3, 250, 40, 6)
    along = sampled(legs, 1.0)[:1001]
    rows = "".join(f"{t},{e:.3f},{n:.3f}\n" for t, (e, n) in enumerate(along))
    file = write(tmp_path / "track.csv", "t,e,n\n" + rows)
    s = world("duration_s=900", f"drift={{preset='{preset}'}}", base=track_world(file).resolved())
    means = []
    for seed in range(40):
        moved = team_motion(s, BAY, seed)[0]
        means.append(np.hypot(*(dead_reckoned(moved) - moved.position_m).T).mean())
    assert low < np.median(means) < high


def test_a_record_that_stands_still_keeps_its_yaw(tmp_path: Path) -> None:
    file = write(tmp_path / "track.csv", "t,e,n\n0,0,0\n2,0,2\n6,0,2\n9,3,2\n")
    moved = team_motion(track_world(file), BAY, 0)[0]
    np.testing.assert_allclose(moved.yaw_rad[:7], [math.pi / 2] * 6 + [0], atol=1e-9)
    assert np.isfinite(moved.command_mps).all()


BROKEN = [
    ("t,e,n\n0,0,0\n", "has 1 row: must have at least 2"),
    ("t,e,n\n", "has no row: must have at least 2"),
    ("", "track.csv is empty"),
    ("t,east,n\n0,0,0\n9,1,1\n", "has no column 'e'"),
    ("t,e,n\n0,0,0\n5,x,0\n9,1,1\n", "column 'e' holds 'x' in line 3"),
    ("t,e,n\n0,0,0\n5,,0\n9,1,1\n", "e is empty or not finite in line 3: must be a finite number"),
    ("t,e,n\n0,0,0\n5,inf,0\n9,1,1\n", "e is empty or not finite in line 3: must be a finite number"),
    ("t,e,n\n0,0,0\n,1,0\n9,1,1\n", "t is '' in line 3: must be a time"),
    (
        "t,e,n\n0,0,0\n5,90,0\n9,1,1\n",
        "moves 90.0 m in 5 s to line 3, 18 m/s: must be at most track.max_speed_mps = 15",
    ),
    ("t,e,n\n0,0,0\n5,1,0\n4,2,0\n9,1,1\n", "time goes back by 1 s in line 4: must ascend"),
    ("t,e,n\n0,0,0\n5,1,1\n", "ends 5.0 s after its first row: the mission needs it until 8 s"),
    (
        "t,e,n\n0,0,0\n1,1,1\n200,2,2\n",
        "gap of 199 s before line 4, 1 s into the record, is longer than track.max_gap",
    ),
]


@pytest.mark.parametrize(("content", "says"), BROKEN)
def test_a_track_that_cannot_be_used_is_refused_in_one_line(tmp_path: Path, content: str, says: str) -> None:
    file = write(tmp_path / "track.csv", content)
    with pytest.raises(ScenarioError) as caught:
        team_motion(track_world(file), BAY, 0)
    assert str(caught.value).startswith(f"vehicle boat: track {file}")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_soundings_must_be_depths(tmp_path: Path) -> None:
    file = write(tmp_path / "track.csv", "t,e,n,z\n0,0,0,5\n5,1,0,-5\n9,1,1,5\n")
    with pytest.raises(ScenarioError, match="is -5 m in line 3: must be above 0 m"):
        team_motion(track_world(file, columns="time='t', east='e', north='n', sounding='z'"), BAY, 0)


def test_a_missing_track_and_a_gap_that_is_allowed(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot be read: No such file"):
        team_motion(track_world(tmp_path / "none.csv"), BAY, 0)
    file = write(tmp_path / "track.csv", "t,e,n\n0,0,0\n1,1,1\n200,2,2\n")
    moved = team_motion(track_world(file, "vehicles.boat.track.max_gap_s=300"), BAY, 0)[0]
    assert np.isfinite(moved.position_m).all()


def test_repeated_times_keep_the_first_row_and_an_edited_file_is_read_again(tmp_path: Path) -> None:
    file = write(tmp_path / "track.csv", "t,e,n\n0,0,0\n0,50,50\n9,9,0\n")
    np.testing.assert_allclose(team_motion(track_world(file), BAY, 0)[0].position_m[8], [8, 0])
    write(file, "t,e,n\n0,0,0\n9,0,9\n10,0,10\n")
    np.testing.assert_allclose(team_motion(track_world(file), BAY, 0)[0].position_m[8], [0, 8])


def test_a_real_survey_day_becomes_a_vehicle(reference: Path) -> None:
    file = reference / "data" / "aburatsubo" / "sessions_valid.csv.gz"
    pytest.importorskip("pyproj")
    columns = "time='ms', longitude='lon', latitude='lat', sounding='z'"
    s = track_world(
        file, "duration_s=900", "vehicles.boat.track.where={f='20220115_0717'}",
        "vehicles.boat.track.time_unit=ms", "drift={preset='dvl'}", columns=columns,
    )  # fmt: skip
    moved = team_motion(s, BAY, 0)[0]
    assert moved.soundings_m is not None
    assert np.isfinite(moved.soundings_m).sum() > 600
    assert 0.5 < np.median(np.hypot(*np.diff(moved.position_m, axis=0).T)) < 2.0
    assert 1 < np.hypot(*(dead_reckoned(moved) - moved.position_m)[-1]) < 200


# --- waves ---


def test_waves_wash_the_track_and_the_command_stays_that_of_the_plan() -> None:
    calm = team_motion(world("duration_s=300"), FLAT, 3)[0]
    washed = team_motion(world("duration_s=300", "waves={amplitude_m=2, period_s=12}"), FLAT, 3)[0]
    np.testing.assert_array_equal(washed.command_mps, calm.command_mps)
    np.testing.assert_array_equal(washed.yaw_rad, calm.yaw_rad)
    np.testing.assert_array_equal(washed.believed_yaw_rad, calm.believed_yaw_rad)
    swing = washed.position_m - calm.position_m  # heading north: across the track is east
    np.testing.assert_allclose(swing[:, 1], 0, atol=1e-9)
    assert np.abs(swing[:, 0]).max() == pytest.approx(2.0, rel=0.04)
    assert swing[:, 0].std() == pytest.approx(2 / math.sqrt(2), rel=0.02)
    np.testing.assert_allclose(swing[12:, 0], swing[:-12, 0], atol=1e-9)  # its period
    np.testing.assert_allclose(swing[6:, 0], -swing[:-6, 0], atol=1e-9)


def test_waves_may_have_a_direction_and_each_vehicle_a_phase_of_its_own() -> None:
    team = ["vehicles={count=2}", "duration_s=120"]
    calm = team_motion(world(*team), FLAT, 3)
    for washed, still, phase_of in [
        (team_motion(world(*team, "waves={amplitude_m=1.5, period_s=8, direction_deg=30}"), FLAT, 3), calm, 3),
        (team_motion(world(*team, "waves={amplitude_m=1.5, period_s=8, direction_deg=30}"), FLAT, 4),
         team_motion(world(*team), FLAT, 4), 4),
    ]:  # fmt: skip
        swings = [a.position_m - b.position_m for a, b in zip(washed, still, strict=True)]
        for swing in swings:
            along = swing @ [math.sin(math.radians(30)), math.cos(math.radians(30))]
            np.testing.assert_allclose(np.hypot(*swing.T), np.abs(along), atol=1e-9)
        assert np.abs(swings[0] - swings[1]).max() > 0.1, phase_of


def test_waves_are_refused_when_they_are_shorter_than_the_world_can_show() -> None:
    with pytest.raises(ScenarioError, match=r"waves.period_s is 3: must be at least 4"):
        world("waves={amplitude_m=1, period_s=3}")
    with pytest.raises(ScenarioError, match=r"waves.amplitude_m is -1: must be at least 0"):
        world("waves.amplitude_m=-1")


def test_yaw_is_held_between_seconds() -> None:
    moved = team_motion(world("vehicles={count = 1}", "duration_s=60"), FLAT, 2)[0]
    np.testing.assert_array_equal(moved.yaw_at(np.array([0.0, 7.9, 59.5])), moved.yaw_rad[[0, 7, 59]])
