"""Scenario files: packaged ones, defaults, overrides, and one line for everything that can be wrong."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from uwcoop import scenario
from uwcoop.errors import ScenarioError

BASE: dict[str, Any] = {
    "name": "bay",
    "duration_s": 60,
    "chart": {"source": "synthetic:st-john"},
    "vehicles": [{"name": "ship", "depth_m": 0}, {"name": "auv"}],
    "acoustics": {"modem": "unlimited", "slot_s": 5.0, "max_range_m": 1000.0},
}


def test_the_packaged_scenarios_are_the_four_of_the_papers_and_ours() -> None:
    names = [name for name, description in scenario.packaged() if description]
    assert {"st-john", "st-john-drift", "flat-bay", "poor-bay"} <= set(names)
    assert names == sorted(names)


@pytest.mark.parametrize("name", [name for name, _ in scenario.packaged()])
def test_a_resolved_scenario_is_json_and_makes_the_same_scenario(name: str) -> None:
    loaded = scenario.load(name)
    resolved = json.loads(json.dumps(loaded.resolved(), allow_nan=False))
    again = scenario.parse(resolved)
    assert again == loaded
    assert again.resolved() == resolved
    assert loaded.name == name


def test_resolved_says_what_the_author_left_out() -> None:
    resolved = scenario.parse(BASE).resolved()
    assert resolved["metrics"]["settle_s"] == 50.0
    assert resolved["acoustics"]["sound_speed_mps"] == 1500.0
    assert resolved["acoustics"]["range_sigma_m"] == 1.0
    assert resolved["sensors"]["water_depth"] == {"rate_hz": 1.0, "sigma_m": 0.05, "faults": []}
    assert resolved["sensors"]["fix"]["radius_m"] == 10.0
    assert resolved["drift"]["velocity_noise_m_per_sqrt_s"] == 0.05
    assert resolved["vehicles"][1]["speed_mps"] == 1.5
    assert scenario.parse(resolved) == scenario.parse(BASE)


def test_st_john_is_table_1() -> None:
    s = scenario.load("st-john")
    assert (len(s.team), s.duration_s, s.acoustics.slot_s * len(s.team)) == (3, 900, 9)
    assert [vehicle.name for vehicle in s.team] == ["V1", "V2", "V3"]
    assert all(vehicle.speed_mps == 1.5 for vehicle in s.team)
    assert s.drift.velocity_noise_m_per_sqrt_s == 0.05
    assert s.drift.compass_bias_sigma_deg == s.drift.thrust_bias_sigma_mps == 0
    assert (s.sensors.water_depth.sigma_m, s.acoustics.range_sigma_m) == (0.05, 1)
    assert s.current.model == "none"
    assert scenario.load("st-john-drift").current.model == "random-walk"


def test_the_drift_scenarios_differ_from_st_john_in_what_they_say_and_nothing_else() -> None:
    base = scenario.load("st-john").resolved()
    drift = scenario.load("st-john-drift").resolved()
    flat = scenario.load("flat-bay").resolved()
    assert drift["current"]["walk_mps_per_sqrt_s"] == 0.01
    assert (flat["chart"]["relief"], flat["acoustics"]["loss"]["probability"]) == (0.15, 0.2)
    for changed, key in [(base, "current"), (drift, "current"), (flat, "current")]:
        del changed[key]
    del flat["chart"]["relief"]
    flat["acoustics"]["loss"] = base["acoustics"]["loss"]
    for table in (base, drift, flat):
        del table["name"], table["description"], table["navigator"]
    assert base == drift == flat


def test_poor_bay_is_the_list_of_its_method() -> None:
    s = scenario.load("poor-bay").resolved()
    assert s["chart"]["source"] == "synthetic:poor-bay"
    assert s["tide"]["offset_sigma_m"] == 0.3
    assert s["current"] == {"model": "constant", "speed_mps": 0.1}
    assert s["drift"]["compass_bias_sigma_deg"] == 1.0
    assert s["drift"]["thrust_bias_sigma_mps"] == 0.05
    assert s["drift"]["velocity_noise_m_per_sqrt_s"] == 0.05
    assert s["sensors"]["water_depth"]["sigma_m"] == 0.3
    assert s["acoustics"]["loss"] == {
        "model": "independent",
        "probability": 0.2,
        "senders": [],
        "receivers": [],
    }
    assert s["acoustics"]["slot_s"] == 3
    assert s["navigator"]["all"]["sigma_position_m_per_sqrt_s"] == 0.1
    assert s["navigator"]["all"]["sigma_current_mps_per_sqrt_s"] == 0.01


def test_scenarios_are_frozen() -> None:
    s = scenario.load("st-john")
    with pytest.raises(ValueError, match="frozen"):
        s.duration_s = 3.0  # type: ignore[misc]


def test_a_vehicle_takes_the_teams_drift_and_sensors_unless_it_has_its_own() -> None:
    table = copy.deepcopy(BASE)
    table["drift"] = {"preset": "no-dvl", "compass_bias_sigma_deg": 2.0}
    table["sensors"] = {"water_depth": {"sigma_m": 0.2}, "heading": {}}
    table["vehicles"][0] |= {"drift": {"preset": "dvl"}, "sensors": {"gps": {"sigma_m": 2.0}}}
    ship, auv = scenario.parse(table).team
    assert (auv.drift, auv.sensors) == (scenario.parse(table).drift, scenario.parse(table).sensors)
    assert auv.drift is not None
    assert ship.drift is not None
    assert auv.drift.compass_bias_sigma_deg == 2.0  # given beside the preset: wins
    assert auv.drift.thrust_bias_sigma_mps == 0.05  # the preset's
    assert ship.drift.ground_referenced
    assert ship.sensors is not None
    assert ship.sensors.gps is not None
    assert ship.sensors.gps.sigma_m == 2.0
    assert ship.sensors.water_depth.sigma_m == 0.2
    assert ship.sensors.heading is not None
    assert scenario.parse(scenario.parse(table).resolved()).team == scenario.parse(table).team


OVERRIDES = [
    ("duration_s=120", lambda s: s.duration_s == 120),
    ("acoustics.loss.probability=0.6", lambda s: s.acoustics.loss.probability == 0.6),
    ("acoustics.modem=aloc", lambda s: s.acoustics.modem == "aloc"),
    ('acoustics.modem="aloc"', lambda s: s.acoustics.modem == "aloc"),
    ('acoustics.order=["auv", "ship", "auv"]', lambda s: s.acoustics.order == ("auv", "ship", "auv")),
    ("vehicles.1.depth_m=7.5", lambda s: s.team[1].depth_m == 7.5),
    ("vehicles.ship.depth_m=1", lambda s: s.team[0].depth_m == 1),
    ("vehicles={count = 5}", lambda s: [v.name for v in s.team] == ["V1", "V2", "V3", "V4", "V5"]),
    ("navigator.mpf.particles=1500", lambda s: s.navigator == {"mpf": {"particles": 1500}}),
    ("current={model = 'constant', velocity_mps = [0, -0.5]}", lambda s: s.current.velocity_mps == (0, -0.5)),
    ("description=a = b", None),
    ('description="a = b"', lambda s: s.description == "a = b"),
]


@pytest.mark.parametrize(("override", "holds"), OVERRIDES)
def test_overrides_set_single_keys_in_toml_syntax(override: str, holds: Any) -> None:
    before = copy.deepcopy(BASE)
    if holds is None:
        with pytest.raises(ScenarioError, match="no TOML value"):
            scenario.apply_overrides(BASE, [override])
        return
    assert holds(scenario.parse(scenario.apply_overrides(BASE, [override])))
    assert before == BASE  # untouched


def test_later_overrides_win() -> None:
    assert scenario.load("st-john", ["duration_s=10", "duration_s=20"]).duration_s == 20


def test_an_override_cannot_smuggle_in_a_second_key() -> None:
    with pytest.raises(ScenarioError, match="no TOML value"):
        scenario.apply_overrides(BASE, ["duration_s=3\nname = 'x'"])


WRONG = [
    # unknown keys, with the nearest known one
    ("acoustics.slots_s=3", "unknown key 'acoustics.slots_s': did you mean 'slot_s'?"),
    ("vehicles.ship.dept_m=3", "unknown key 'vehicles.0.dept_m': did you mean 'depth_m'?"),
    ("sensors.water_depth.sigma=3", "unknown key 'sensors.water_depth.sigma': did you mean 'sigma_m'?"),
    ("vehicles={count = 3, sped_mps = 1}", "unknown key 'vehicles.sped_mps': did you mean 'speed_mps'?"),
    ("current.speed_mps=1", "key 'current.model' is missing"),
    ("qqq=1", "unknown key 'qqq': known: acoustics, area, chart,"),
    # values outside their bound
    ("sensors.water_depth.sigma_m=-0.05", "sensors.water_depth.sigma_m is -0.05: must be at least 0"),
    ("acoustics.range_sigma_m=-1", "acoustics.range_sigma_m is -1: must be at least 0"),
    ("acoustics.loss.probability=1.2", "acoustics.loss.probability is 1.2: must be at most 1"),
    ("acoustics.slot_s=0", "acoustics.slot_s is 0: must be above 0"),
    ("drift.compass_noise_deg=nan", "drift.compass_noise_deg is nan: must be finite"),
    ("drift.velocity_noise_m_per_sqrt_s=-1", "drift.velocity_noise_m_per_sqrt_s is -1: must be at least 0"),
    ("chart.relief=-0.1", "chart.relief is -0.1: must be at least 0"),
    ("duration_s=10.5", "duration_s is 10.5 s: must be a whole number of seconds"),
    ("seed=-1", "seed is -1: must be at least 0"),
    ("vehicles={count = 0}", "vehicles.count is 0: must be at least 1"),
    ("vehicles=[]", "vehicles has 0 entries: must have at least 1"),
    ("name=''", "name is empty: must not be"),
    ("vehicles.auv.name='a b'", "vehicles.1.name is 'a b': must be letters, digits, '-' or '_' only"),
    # values of the wrong kind
    ("duration_s='x'", "duration_s is 'x': must be a number"),
    ("sensors.water_depth.sigma_m=true", "sensors.water_depth.sigma_m is True: must be a number"),
    ("vehicles={count = 2.5}", "vehicles.count is 2.5: must be a whole number"),
    ("current=3", "current is 3: must be a table"),
    ("vehicles=3", "vehicles is 3: must be a list"),
    ("description=true", "description is True: must be a text"),
    # choices
    ("acoustics.modem=micromodem", "acoustics.modem is 'micromodem': must be one of 'micromodem-32', "),
    (
        "acoustics.loss.model=bursts",
        "acoustics.loss.model is 'bursts': must be one of 'none', 'independent', 'distance', 'burst', 'aspect', "
        "'blackout'",
    ),
    ("current.model=eddy", "current.model is 'eddy': must be one of 'none', 'constant', 'random-walk'"),
    ("drift.preset=ins", "drift.preset is 'ins': must be one of 'table-1', 'no-dvl', 'dvl'"),
    (
        "vehicles.ship.path={kind = 'spiral'}",
        "vehicles.0.path.kind is 'spiral': must be one of 'random-lawnm",
    ),
    ("vehicles.ship.path={}", "key 'vehicles.0.path.kind' is missing"),
    # what does not go together
    ("current.model=constant", "current needs exactly one of velocity_mps and speed_mps"),
    (
        "current={model='constant', velocity_mps=[0, 1], direction_deg=3}",
        "current direction_deg goes with speed_mps, not with velocity_mps",
    ),
    ("vehicles.1.name=ship", "vehicle name 'ship' is used 2 times: must be unique"),
    ("acoustics.order=['shp']", "acoustics.order names 'shp': no such vehicle, did you mean 'ship'?"),
    ("chart.crs='EPSG:32654'", "chart crs can only be given for a chart file, not for 'synthetic:st-john'"),
    (
        "chart={source='a.tif', relief=2}",
        "chart relief can only be given for a synthetic chart, not for 'a.tif'",
    ),
    (
        "vehicles.auv.path={kind='waypoints', waypoints_m=[[0, 0], [1, 1], [1, 1]]}",
        "vehicles.1.path waypoints_m 1 and 2 are the same point [1, 1]",
    ),
    (
        "vehicles.auv.path={kind='random-lawnmower', leg_m=[300, 100]}",
        "vehicles.1.path leg_m is [300, 100]: must be two lengths above 0 in ascending order",
    ),
    (
        "vehicles.auv.track={file='a.csv', columns={time='t', east='e'}}",
        "vehicles.1.track.columns needs either east and north, or longitude and latitude",
    ),
    (
        "acoustics.sound_speed_error_mps=-1500",
        "acoustics sound_speed_mps + sound_speed_error_mps is 0 m/s: must be above 0",
    ),
    ("sensors.odometry.sigma_m_per_sqrt_s=0", "sensors odometry.sigma_m_per_sqrt_s is 0: must be above 0"),
]


@pytest.mark.parametrize(("override", "says"), WRONG)
def test_what_is_wrong_is_said_in_one_line(override: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.parse(scenario.apply_overrides(BASE, [override]), "bay.toml")
    message = str(caught.value)
    assert message.startswith(f"bay.toml: {says}")
    assert "\n" not in message
    assert "pydantic" not in message
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__  # no pydantic traceback either


def test_a_missing_key_is_named() -> None:
    table = copy.deepcopy(BASE)
    del table["acoustics"]["modem"]
    with pytest.raises(ScenarioError, match=r"^scenario: key 'acoustics.modem' is missing$"):
        scenario.parse(table)


def test_more_than_one_mistake_is_counted() -> None:
    table = copy.deepcopy(BASE) | {"duration_s": -1, "seed": -1}
    with pytest.raises(ScenarioError, match=r"\(and 1 more\)$"):
        scenario.parse(table)


def test_a_vehicle_cannot_have_a_path_and_a_track() -> None:
    table = copy.deepcopy(BASE)
    track = {"file": "a.csv", "columns": {"time": "t", "east": "e", "north": "n"}}
    table["vehicles"][0] |= {"path": {"kind": "random-lawnmower"}, "track": track}
    with pytest.raises(ScenarioError, match="vehicle ship has both a path and a track"):
        scenario.parse(table)


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("duration_s", "override 'duration_s' is not of the form dotted.key=value"),
        (".x=1", "override '.x=1' is not of the form dotted.key=value"),
        ("name.x=1", "override 'name.x=1': 'name' is 'bay', not a table"),
        (
            "vehicles.5.depth_m=1",
            "override 'vehicles.5.depth_m=1': 'vehicles' has no entry '5': 0 to 1 or ship, auv",
        ),
        ("duration_s=3 s", "override 'duration_s=3 s': '3 s' is no TOML value"),
    ],
)
def test_overrides_that_cannot_be_applied(override: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.apply_overrides(BASE, [override])
    assert str(caught.value).startswith(says)


def test_an_unknown_scenario_is_refused_with_the_nearest() -> None:
    with pytest.raises(
        ScenarioError, match=r"'st-jon' is neither a file nor packaged: did you mean 'st-john'"
    ):
        scenario.load("st-jon")


FILE = """
name = "mine"
duration_s = 30
[chart]
source = "charts/bay.tif"
positive = "up"
[[vehicles]]
name = "boat"
track = {file = "boat.csv", columns = {time = "t", east = "e", north = "n"}}
[acoustics]
modem = "unlimited"
slot_s = 5.0
max_range_m = 500.0
"""


def test_relative_paths_of_a_file_start_at_its_folder_and_those_of_an_override_do_not(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(FILE)
    loaded = scenario.load(file)
    assert loaded.chart.source == str(tmp_path / "charts/bay.tif")
    assert loaded.chart.options() == {"positive": "up"}
    assert loaded.team[0].track is not None
    assert loaded.team[0].track.file == str(tmp_path / "boat.csv")
    assert scenario.load(str(file), ["chart.source=other.tif"]).chart.source == "other.tif"


def test_a_resolved_scenario_can_be_loaded_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "scenario.json"
    loaded = scenario.load("poor-bay", ["duration_s=60"])
    file.write_text(json.dumps(loaded.resolved()))
    assert scenario.load(file) == loaded


@pytest.mark.parametrize(
    ("content", "says"), [(b"name = ", "cannot be read"), (b"\xff\xfe", "cannot be read")]
)
def test_a_broken_file_is_one_line(tmp_path: Path, content: bytes, says: str) -> None:
    file = tmp_path / "broken.toml"
    file.write_bytes(content)
    with pytest.raises(ScenarioError, match=says) as caught:
        scenario.load(file)
    assert "\n" not in str(caught.value)
