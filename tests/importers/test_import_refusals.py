"""What cannot be imported is refused in one line that says what there is and what is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from recorded_dive import (
    LAT0,
    LON0,
    Array,
    channel,
    source,
    swim,
    write_alog,
    write_bags,
    write_dataflash,
    write_lsf,
    write_tables,
    write_tlog,
    yaw_quaternion,
)  # fmt: skip
from uwcoop.cli import app
from uwcoop.errors import LogError, MissingDependencyError, ScenarioError
from uwcoop.experiment.mission import open_mission
from uwcoop.importers.channels import Channel
from uwcoop.importers.import_config import load_config
from uwcoop.importers.mapping.mission import mission_of
from uwcoop.importers.recordings import import_recordings
from uwcoop.missionlog import MissionLog

T = np.arange(60.0)


def imu(name: str, yaw: Array) -> Channel:
    return channel(
        name, "sensor_msgs/msg/Imu", T, **{k.replace(".", "__"): v for k, v in yaw_quaternion(yaw).items()}
    )


def dvl(name: str = "/v/dvl", left: float = 0.0) -> Channel:
    return channel(
        name, "geometry_msgs/msg/TwistWithCovarianceStamped", T, twist__twist__linear__x=1.3 + 0 * T,
        twist__twist__linear__y=left + 0 * T,
    )  # fmt: skip


def gps(name: str = "/v/gps") -> Channel:
    own = swim(0)
    return channel(
        name, "sensor_msgs/msg/NavSatFix", T, latitude=LAT0 + own["north"][:60] / 111_132.0,
        longitude=LON0 + own["east"][:60] / (111_320 * np.cos(np.deg2rad(LAT0))),
    )  # fmt: skip


def usbl() -> Channel:
    place = {"pose__pose__position__x": T, "pose__pose__position__y": T}
    return channel("/v/usbl", "geometry_msgs/msg/PoseWithCovarianceStamped", T, **place)


def table(**columns: Any) -> Channel:
    values = {label: np.asarray(v, dtype=np.float64) * np.ones(len(T)) for label, v in columns.items()}
    return Channel("v.csv", "v.csv", "table", channel("", "", T).t_ns, values)


def of(*channels: Channel, **told: Any) -> MissionLog:
    return mission_of([source(*channels)], load_config(None, {"vehicles": [{"name": "v"}], **told}))


def refusal(*channels: Channel, **told: Any) -> str:
    with pytest.raises((LogError, ScenarioError)) as caught:
        of(*channels, **told)
    assert "\n" not in str(caught.value)
    return str(caught.value)


POSITION = {"lat": LAT0 + 1e-5 * T, "lon": LON0}
CASES: dict[str, tuple[list[Channel], dict[str, Any], tuple[str, ...]]] = {
    "needed topics are missing": (
        [imu("/v/imu", 0 * T), channel("/v/camera", "sensor_msgs/msg/Image", T, height=T)], {},
        ("vehicle v", "nothing that says how it moves", "fix, usbl, ground_velocity", "/v/camera (sensor_msgs/msg/Im"),
    ),
    "two channels may be it": (
        [imu("/v/imu", 0 * T), imu("/v/ahrs", 0 * T), dvl()], {},
        ("heading may be any of /v/imu (sensor_msgs/msg/Imu), /v/ahrs", '[vehicles.heading] topic = "…"'),
    ),
    "no such topic": (
        [dvl()], {"vehicles": [{"name": "v", "ground_velocity": {"topic": "/v/dvll"}}]},
        ("ground_velocity: there is no topic '/v/dvll': did you mean '/v/dvl'?",),
    ),
    "no such column": (
        [table(**POSITION, dpth=5.0)],
        {"vehicles": [{"name": "v", "depth": {"topic": "v.csv", "columns": {"depth": "dept"}}}]},
        ("has no column 'dept': did you mean 'dpth'?",),
    ),
    "which column": (
        [dvl(), channel("/v/my", "my_msgs/msg/Depth", T, below=T, error=T)],
        {"vehicles": [{"name": "v", "depth": {"topic": "/v/my"}}]},
        ("depth needs (depth) or (up); /v/my (my_msgs/msg/Depth) has the columns below, error",
         'columns = { depth = "…" }'),
    ),
    "headings in radians": (
        [table(**POSITION, heading=np.linspace(0.1, 6.2, len(T)))], {},
        ("heading is 0.100 to 6.200 throughout: degrees, or radians?", 'unit = "rad"'),
    ),
    "headings in degrees that the type states as radians": (
        [channel("ATTITUDE", "mavlink/ATTITUDE", T, yaw=6.0 * T, roll=0 * T, pitch=0 * T), gps()], {},
        ("yaw is 1031.32 to 20282.7 deg in 57 of 60 rows, must be -720 to 720: another unit (unit = …)",),
    ),
    "latitudes in radians": (
        [table(lat=np.deg2rad(LAT0) + 1e-7 * T, lon=np.deg2rad(LON0))], {}, ("degrees, or radians?", 'unit = "rad"')
    ),
    "latitude and longitude changed over": (
        [table(lat=-122.4 + 1e-5 * T, lon=47.6)], {},
        ("latitude is -122.4 to -122.399 deg in 60 of 60 rows, must be -90 to 90",)
    ),
    "centimetres as metres": (
        [table(**POSITION, altitude=np.linspace(2e4, 3e4, len(T)), depth=5.0)], {},
        ("altitude is 20000 to 30000 m in 60 of 60 rows", "unit = …"),
    ),
    "depth that is an altitude": (
        [table(**POSITION, depth=-12.0)], {}, ("above the surface: positive up?", "columns = { up")
    ),
    "no unit": (
        [table(**POSITION, depth=3.0)], {"sensors": {"depth": {"unit": "feets"}}},
        ("'feets' is no unit of length: did you mean 'feet'?",)
    ),
    "metres without an origin": (
        [gps(), usbl()],
        {}, ("usbl of /v/usbl is in metres and vehicle v: fix of /v/gps in degrees: origin_deg = [latitude, longitude]",),
    ),
    "condition": (
        [gps()], {"sensors": {"fix": {"valid": "quality > 3"}}}, ("valid = 'quality > 3' must be a column", "latitude")
    ),
    "nothing left": (
        [gps()], {"sensors": {"fix": {"valid": "latitude > 80"}}}, ("none of its 60 rows can be used: 60 without",)
    ),
    "a range to whom": (
        [gps(), channel("/v/modem", "sensor_msgs/msg/Range", T, range=30 + T)], {"ranges": [{"topic": "/v/modem"}]},
        ('ranges of /v/modem from v: to = "…" is missing: nobody else',),
    ),
    "a range to a stranger": (
        [gps(), channel("/v/modem", "sensor_msgs/msg/Range", T, range=30 + T)],
        {"ranges": [{"topic": "/v/modem", "to": "w"}]},
        ("'w' is no vehicle or beacon",),
    ),
    "a date that is none": ([gps()], {"start": "yesterday"}, ("start = 'yesterday'",)),
    "a span without data": ([gps()], {"start": "2030-01-01T00:00:00Z"}, ("nothing was recorded between start 2030",)),
    "a modem": (
        [gps(), gps("/w/gps"), channel("/v/modem", "sensor_msgs/msg/Range", T, range=30 + T)],
        {"modem": "micromodem", "vehicles": [{"name": "v"}, {"name": "w"}], "ranges": [{"topic": "/v/modem"}]},
        ("modem 'micromodem': did you mean 'micromodem-",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_one_line_says_what_is_wrong(case: str) -> None:
    channels, told, parts = CASES[case]
    line = refusal(*channels, **told)
    for part in parts:
        assert part in line, line


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[vehicle]]\nname = 'v'\n", "did you mean 'vehicles'"),
        ("[[vehicles]]\nname = 'v'\n[vehicles.ground_velocty]\n", "did you mean 'ground_velocity'"),
        ("[sensors.heading]\ndeclination = 3\n", "did you mean 'declination_deg'"),
        ("[[vehicles]]\nname = 'v'\n[[vehicles]]\nname = 'v'\n", "name 'v' is given 2 times"),
        ("preset = 'bluerov'\n", "did you mean 'bluerov2'"),
        ("[sensors.fix]\nsigma_m = -1\n", "sigma_m"),
        ("[[beacons]]\nname = 'b'\n", "one of place_deg and place_m"),
        ("name = \n", "import.toml"),
    ],
)
def test_a_slip_in_the_toml_is_named_with_the_nearest_key(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "import.toml"
    path.write_text(text)
    with pytest.raises(ScenarioError) as caught:
        load_config(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_ned_taken_as_enu_is_said() -> None:
    own = swim(0)
    yaw = own["yaw"][:60]
    right = of(gps(), imu("/v/imu", yaw), dvl(), origin_deg=[LAT0, LON0])
    wrong = of(gps(), imu("/v/imu", np.pi / 2 - yaw), dvl(), origin_deg=[LAT0, LON0])
    assert not any(note.startswith("CHECK") for note in right.notes)
    line = next(
        note for note in wrong.notes if note.startswith("CHECK v: heading and course over ground differ by")
    )
    assert 'they agree with frame = "ned" in its place' in line


def test_a_file_of_no_recording_says_what_it_is(tmp_path: Path) -> None:
    picture = tmp_path / "a.mcap"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    empty = tmp_path / "empty.csv"
    empty.write_text("time,lat,lon\n")
    folder = tmp_path / "folder"
    folder.mkdir()
    clockless = tmp_path / "clockless.csv"
    clockless.write_text("lat,lon\n41,2\n41,2.1\n")
    for path, said in (
        (picture, "is a PNG picture"), (empty, "a header and no rows"), (clockless, "no column of times"),
        (tmp_path / "none.mcap", "No such file"), (folder, "is a folder without parts of a ROS 2 bag"),
    ):  # fmt: skip
        shown = CliRunner().invoke(app, ["import", str(path), "-o", str(tmp_path / "out.mcap")])
        assert shown.exit_code == 2, shown.output
        assert said in shown.stderr
        assert shown.stderr.count("\n") == 1
        assert not (tmp_path / "out.mcap").exists()


def test_two_files_of_one_name_and_a_bag_without_sensors(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.mkdir()
    two.mkdir()
    files = [write_tables(one)[0], write_tables(two)[0]]
    with pytest.raises(LogError, match=r"two files are called 'alpha.csv'"):
        import_recordings(files)
    bag = write_bags(tmp_path, ("ros1",))["ros1"]
    with pytest.raises(
        LogError, match=r"vehicle charlie: no channel is one of its sensors; the files hold /alpha/altimeter"
    ):
        import_recordings([bag], overrides={"vehicles": [{"name": "charlie", "namespace": "charlie"}]})
    with pytest.raises(LogError, match=r"source 'delta' is none of the files"):
        import_recordings([bag], overrides={"vehicles": [{"name": "alpha", "source": "delta"}]})


def test_every_preset_is_a_valid_file() -> None:
    for name in ("bluerov2", "cougars", "holoocean", "iver"):
        assert load_config(None, {"preset": name}).preset == name


def test_a_recording_that_is_run_names_the_command_that_imports_it(tmp_path: Path) -> None:
    made = write_bags(tmp_path)
    table_ = write_tables(tmp_path)[0]
    for path, said in (
        (made["mcap"], "makes a mission of a ROS 2 bag"), (made["sqlite3"], "a folder but no MRCLAM"),
        (made["ros1"], "is a ROS 1 bag:"),
        (next(made["sqlite3"].glob("*.db3")), "is a ROS 2 bag (SQLite):"), (table_, "is a text table:"),
    ):  # fmt: skip
        with pytest.raises(LogError) as caught:
            open_mission(path)
        assert said in str(caught.value)
        assert f"`uwcoop import {path} -o mission.mcap`" in str(caught.value)
    with pytest.raises(LogError, match="`uwcoop import` makes one of it"):
        open_mission(next(made["mcap"].glob("*.mcap")))


@pytest.mark.parametrize(
    "name", ["a.mcap", "a.db3", "a.bag", "a.alog", "a.lsf", "a.tlog", "a.bin", "alpha.csv"]
)
def test_a_damaged_recording_gives_a_mission_or_one_line(name: str, tmp_path: Path) -> None:
    package = {"a.lsf": "imcpy", "a.tlog": "pymavlink", "a.bin": "pymavlink"}.get(name)
    if package:
        pytest.importorskip(package)
    if name in ("a.mcap", "a.db3", "a.bag"):
        kind = {"a.mcap": "mcap", "a.db3": "sqlite3", "a.bag": "ros1"}[name]
        made = write_bags(tmp_path, (kind,))[kind]
        whole = (
            made if made.is_file() else next(p for p in made.iterdir() if p.suffix != ".yaml")
        ).read_bytes()
    elif name == "alpha.csv":
        whole = write_tables(tmp_path)[0].read_bytes()
    else:
        write = {"a.alog": write_alog, "a.lsf": write_lsf, "a.tlog": write_tlog, "a.bin": write_dataflash}[
            name
        ]
        whole = write(tmp_path / f"whole-{name}").read_bytes()
    rng = np.random.default_rng(sum(map(ord, name)))
    folder = tmp_path / "damaged"
    folder.mkdir()
    for _ in range(6):
        content = bytearray(whole[: len(whole) if rng.random() < 0.7 else rng.integers(200, len(whole))])
        for place in rng.integers(0, len(content) - 4, rng.choice([1, 5, 30])):
            content[place : place + 4] = b"\xff\xff\xff\x7f" if rng.random() < 0.3 else rng.bytes(4)
        (folder / name).write_bytes(content)
        refusals: list[str] = []
        try:
            import_recordings([folder / name], overrides={"origin_deg": [LAT0, LON0]})
        except (LogError, MissingDependencyError) as error:
            refusals.append(str(error))
        assert not any("\n" in line for line in refusals)
