"""The command line as a user meets it: commands, files, JSON, one-line errors and exit codes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner, Result

from uwcoop.cli import app
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.navigators import NAVIGATORS

SHORT = ("--set", "duration_s=60", "--set", "navigator.all.particles=100")
VEHICLE_KEYS = {
    "rmse_m", "median_error_m", "p95_error_m", "final_error_m", "anees", "state_anees_per_dof", "yaw_rmse_deg",
    "rejected", "rmse_over_bound", "rmse_over_linearised_bound",
}  # fmt: skip


def uwcoop(*args: str | Path) -> Result:
    return CliRunner().invoke(app, [str(a) for a in args])


def succeeds(*args: str | Path) -> Result:
    result = uwcoop(*args)
    assert result.exit_code == 0, result.output
    return result


def refusal(*args: str | Path) -> str:
    """The one line on stderr of a refused command, without its "error: "."""
    result = uwcoop(*args)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    return line.removeprefix("error: ")


def in_process(*args: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from uwcoop.cli import main; main()", *args]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test starts in an empty folder: whatever is written without being asked for shows."""
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mission") / "mission.mcap"
    succeeds("simulate", "st-john-drift", *SHORT, "--seed", "3", "-o", path)
    return path


# ------------------------------------------------------------------------------------------------- the process


def test_help_is_there_fast_without_the_heavy_imports() -> None:
    heavy = ("numpy", "xarray", "pydantic", "matplotlib", "rerun")
    code = f"import uwcoop.cli, sys; print([m for m in {heavy} if m in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"
    done = in_process("--help")
    assert done.returncode == 0
    for command in ("demo", "scenarios", "keys", "chart", "simulate", "run", "study", "budget", "view"):
        assert command in done.stdout


def test_version_and_unknown_options() -> None:
    assert re.fullmatch(r"uwcoop \d+\.\d+\S*\n", succeeds("--version").stdout)


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        ("run st-john --nonsense", "No such option: --nonsense"),
        ("fly", "No such command 'fly'"),
        ("--nonsense", "No such option: --nonsense"),
        ("run", "Missing argument 'MISSION'"),
        ("study st-john", "Missing option '--runs'"),
        ("run st-john --seed x", "Invalid value for '--seed'"),
        ("run st-john --seed -1", "Invalid value for '--seed'"),
        ("run st-john --figures", "Invalid value for --figures: needs the folder of the results"),
        ("run st-john flat-bay", "Got unexpected extra argument"),
    ],
)
def test_wrong_usage_ends_in_one_line_that_names_the_help(typed: str, says: str) -> None:
    line = refusal(*typed.split())
    assert line.startswith(says)
    command = typed.split()[0]
    shown = "uwcoop" if command in ("fly", "--nonsense") else f"uwcoop {command}"
    assert line.endswith(f"`{shown} --help` shows its use")


def test_bad_input_ends_the_process_in_one_line_and_code_2() -> None:
    done = in_process("run", "no-such-mission", "-o", "out")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: scenario 'no-such-mission' is neither a file nor packaged")
    assert done.stderr.count("\n") == 1
    assert not os.listdir(".")


def test_json_is_all_that_stdout_holds() -> None:
    done = in_process("run", "st-john", *SHORT, "-n", "dead-reckoning,mpf", "--json")
    assert done.returncode == 0
    assert set(json.loads(done.stdout)["navigators"]) == {"dead-reckoning", "mpf"}
    assert "ANEES" in done.stderr  # the table went there


def test_interrupt_is_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    from uwcoop.experiment.run import run

    monkeypatch.setitem(run.__globals__, "open_mission", interrupted)
    result = uwcoop("run", "st-john")
    assert (result.exit_code, result.stderr) == (130, "interrupted\n")


# ------------------------------------------------------------------------------------------------- commands


def test_scenarios_lists_what_is_packaged() -> None:
    listed = succeeds("scenarios").stdout
    for name in ("st-john", "st-john-drift", "flat-bay", "poor-bay", *NAVIGATORS):
        assert name in listed


def test_run_writes_its_folder_and_prints_a_table(mission: Path) -> None:
    result = succeeds("run", mission, "-n", "dead-reckoning,dmpf,mpf", "-o", "out")
    files = {"summary.json", "scenario.json", "tracks.nc", "errors.png", "map.png", "replay.rrd"}
    assert {p.name for p in Path("out").iterdir()} == files
    summary = json.loads(Path("out/summary.json").read_text())
    assert (summary["mission"], summary["seed"]) == ("st-john-drift", 3)
    assert list(summary["navigators"]) == ["dead-reckoning", "dmpf", "mpf"]
    assert summary["navigators"]["dead-reckoning"]["unused"].keys() == {"depth", "water_depth"}
    soundings = summary["navigators"]["dead-reckoning"]["unused"]["water_depth"]
    assert f"not used by dead-reckoning: depth {soundings}, water_depth {soundings}" in result.stdout
    assert "not used by mpf" not in result.stdout
    for navigator in summary["navigators"].values():
        assert set(navigator) - {"unused"} == {
            "seconds", "speedup", "packet_bytes", "vehicles", "sent", "consistency", "disagreement",
        }  # fmt: skip
        assert set(navigator["vehicles"]) == {"V1", "V2", "V3"}
        for vehicle in navigator["vehicles"].values():
            assert set(vehicle) >= VEHICLE_KEYS
    assert "ANEES" in result.stdout
    assert "wrote out: summary.json" in result.stderr


def test_run_json_is_the_content_of_summary_json(mission: Path) -> None:
    result = succeeds("run", mission, "-n", "mpf", "-o", "out", "--json")
    assert result.stdout == Path("out/summary.json").read_text(encoding="utf-8")


def test_the_log_replays_to_the_bits_of_the_simulation(mission: Path) -> None:
    succeeds("run", "st-john-drift", *SHORT, "--seed", "3", "-o", "simulated")
    succeeds("run", mission, "--threads", "2", "-o", "replayed")
    with xr.open_dataset("simulated/tracks.nc") as a, xr.open_dataset("replayed/tracks.nc") as b:
        assert a.identical(b)
        assert a.sizes["navigator"] == sum(
            not (spec.needs_bandwidth or spec.listed_only) for spec in NAVIGATORS.values()
        )
        assert np.isfinite(a["position_m"]).all()
    assert Path("simulated/scenario.json").read_bytes() == Path("replayed/scenario.json").read_bytes()


def test_the_resolved_scenario_gives_the_same_run_again(mission: Path) -> None:
    succeeds("run", mission, "-n", "dmpf,mpf", "-o", "first")
    succeeds("run", "first/scenario.json", "-n", "dmpf,mpf", "-o", "again")
    with xr.open_dataset("first/tracks.nc") as a, xr.open_dataset("again/tracks.nc") as b:
        assert a.identical(b)


def test_a_log_takes_navigator_options_and_nothing_else(mission: Path) -> None:
    few = json.loads(succeeds("run", mission, "-n", "mpf", "--json").stdout)
    many = json.loads(
        succeeds("run", mission, "-n", "mpf", "--set", "navigator.mpf.particles=300", "--json").stdout
    )
    assert few["navigators"]["mpf"]["vehicles"] != many["navigators"]["mpf"]["vehicles"]
    line = refusal("run", mission, "--set", "acoustics.slot_s=9")
    assert line.startswith("override 'acoustics.slot_s'")
    assert "of acoustics only acoustics.loss, acoustics.losses, acoustics.modem can be changed" in line
    line = refusal("run", mission, "--set", "duration_s=9")
    assert "only navigator.*, log.* and, as what would have been, acoustics.loss" in line


def test_a_missing_extra_leaves_its_file_out_with_a_note(
    mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    result = succeeds("run", mission, "-n", "mpf", "-o", "out")
    assert 'replay.rrd is left out: rerun-sdk is not installed: pip install "uwcoop[viz]"' in result.stderr
    assert not Path("out/replay.rrd").exists()
    assert Path("out/map.png").exists()


def test_chart_describes_and_draws() -> None:
    result = succeeds("chart", "synthetic:st-john", "--picture", "chart.png")
    for piece in ("1001 × 1001", "1 m apart", "positive down", "holes", "slope", "terrain"):
        assert piece in result.stdout
    assert Path("chart.png").read_bytes().startswith(b"\x89PNG")
    assert "must end in one of" in refusal("chart", "synthetic:st-john", "--picture", "chart.xyz")


def test_chart_reads_soundings_as_told() -> None:
    east, north = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 60, 2), np.arange(0.0, 50, 2)))
    lines = [f"{x},{y},{(10 + 0.1 * x) / 0.3048:.4f}" for x, y in zip(east, north, strict=True)]
    Path("soundings.csv").write_text("x,y,z\n" + "\n".join(lines) + "\n")
    options = (
        "--columns",
        "x,y,z",
        "--crs",
        "local",
        "--positive",
        "down",
        "--depth-unit",
        "ft",
        "--cell",
        "2",
    )
    told = succeeds("chart", "soundings.csv", *options).stdout
    assert "2 m apart" in told
    depths = re.search(r"depth +([\d.]+) to ([\d.]+) m", told)
    assert depths is not None
    assert (float(depths[1]), float(depths[2])) == pytest.approx((10.0, 15.7), abs=0.2)


def _bay(path: Path) -> None:
    depth = 10 + np.random.default_rng(0).normal(size=(201, 201)).astype(np.float32).cumsum(axis=0) / 20
    axes = {"y": np.arange(0.0, 1005, 5), "x": np.arange(0.0, 1005, 5)}
    grid = xr.Dataset({"depth": (("y", "x"), depth.clip(3), {"units": "m", "positive": "down"})}, coords=axes)
    grid.to_netcdf(path, engine="h5netcdf")


def test_a_chart_file_takes_the_place_of_the_scenarios() -> None:
    bay = Path("bay.nc")
    _bay(bay)
    local = ("--chart", bay, "--set", "chart.crs=local")
    succeeds("simulate", "st-john", *SHORT, *local, "-o", "own.mcap")
    log = load_log("own.mcap")
    assert log.chart is not None
    assert log.chart.cell_m == 5
    assert log.setup.tables()["chart"]["source"] == str(bay.resolve())
    succeeds("run", "own.mcap", *local, "-n", "mpf", "-o", "same")
    assert "unknown key 'crss'" in refusal("run", "own.mcap", "--chart", bay, "--set", "chart.crss=local")
    write_log(replace(log, chart=None), "bare.mcap")
    succeeds("run", "bare.mcap", *local, "-n", "mpf", "-o", "added")
    with xr.open_dataset("same/tracks.nc") as a, xr.open_dataset("added/tracks.nc") as b:
        assert a.identical(b)


def test_a_packaged_scenario_is_printed_to_start_from(tmp_path: Path) -> None:
    text = succeeds("scenarios", "flat-bay").stdout
    (tmp_path / "mine.toml").write_text(text)
    succeeds("simulate", tmp_path / "mine.toml", "--set", "duration_s=20", "-o", tmp_path / "mine.mcap")
    assert refusal("scenarios", "flat-boy") == "scenario 'flat-boy' is not packaged: did you mean 'flat-bay'?"


def test_keys_are_printed_and_as_json() -> None:
    shown = succeeds("keys", "acoustics.two_way").stdout
    assert "acoustics.two_way.poll_bytes" in shown
    assert "byte" in shown
    listed = json.loads(succeeds("keys", "acoustics.", "--json").stdout)
    slot = next(key for key in listed if key["name"] == "acoustics.slot_s")
    assert (slot["unit"], slot["default"], slot["bound"]) == ("s", "required", "> 0")
    assert refusal("keys", "acoustic.modem").endswith("did you mean 'acoustics.modem'?")


def test_budget_as_json_is_the_plan() -> None:
    own = (
        "--set",
        "acoustics.modem={frame_bytes=24, bits_per_s=80, preamble_s=0.2}",
        "--set",
        "acoustics.slot_s=4",
    )
    plan = json.loads(succeeds("budget", "flat-bay", "-n", "mpf", "--json", *own).stdout)
    assert (plan["modem"], plan["frame_bytes"], plan["preamble_s"]) == ("own", 24, 0.2)
    cost = plan["costs"]["mpf"]
    assert cost["air_time_s"] == pytest.approx(0.2 + cost["frames"] * 2.4)
    assert sum(field["bits"] * field["count"] for field in cost["fields"]) == 8 * cost["packet_bytes"]


def test_budget_shows_the_arithmetic_and_refuses_what_does_not_fit() -> None:
    shown = succeeds("budget", "flat-bay", "-n", "mpf,dead-reckoning").stdout
    (line,) = (line for line in shown.splitlines() if line.strip().startswith("mpf"))
    # 15 bytes, 1 frame of 2.048 s behind 0.3 s, guard 950 / 1500 s, slot 3 s; 2 of 3 slots of 3 s, 20 % lost
    assert line.split() == ["mpf", "15", "1", "2.35", "2.98", "99", "80", "10.7"]
    assert "cycle 9 s" in shown
    tight = ("--set", "acoustics.modem=micromodem-32", "--set", "acoustics.slot_s=6")
    line = refusal("budget", "flat-bay", *tight, "--set", "navigator.mpf.packet=f64")
    assert line == (
        "mpf's packet of 47 bytes needs 2 frames of 32 bytes: micromodem-32 sends at most 1 (32 bytes)"
    )


def test_study_compares_variants_on_the_same_missions() -> None:
    vary = ("--vary", "acoustics.loss.probability=0,0.5")
    result = succeeds(
        "study",
        "flat-bay",
        "--runs",
        "2",
        *SHORT,
        "-n",
        "dead-reckoning,mpf",
        *vary,
        "-o",
        "s",
        "--json",
        "--processes",
        "1",
    )
    summary = json.loads(result.stdout)
    assert result.stdout == Path("s/summary.json").read_text(encoding="utf-8")
    assert [variant["set"] for variant in summary["variants"]] == [
        {"acoustics.loss.probability": 0}, {"acoustics.loss.probability": 0.5}
    ]  # fmt: skip
    mute, lossy = (variant["navigators"] for variant in summary["variants"])
    assert mute["dead-reckoning"]["rmse_m"] == lossy["dead-reckoning"]["rmse_m"]  # same missions
    assert mute["mpf"]["rmse_m"] != lossy["mpf"]["rmse_m"]
    assert "acoustics.loss.probability = 0.5" in result.stderr


def test_view_needs_a_replay() -> None:
    assert refusal("view", ".") == "no replay replay.rrd: `uwcoop run MISSION -o .` writes one"


def test_demo_writes_everything() -> None:
    succeeds("demo")
    assert {p.name for p in Path("uwcoop-demo").iterdir()} == {
        "mission.mcap", "chart.png", "summary.json", "scenario.json", "tracks.nc", "errors.png", "map.png", "replay.rrd"
    }  # fmt: skip


# ------------------------------------------------------------------------------------------------- bad input


def _all_holes(path: Path) -> None:
    axes = {"y": np.arange(0.0, 50, 5), "x": np.arange(0.0, 50, 5)}
    depth = xr.Dataset({"depth": (("y", "x"), np.full((10, 10), np.nan), {"positive": "down"})}, coords=axes)
    depth.to_netcdf(path, engine="h5netcdf")


def _soundings(path: Path) -> None:
    path.write_text("x,y,z\n" + "\n".join(f"{k % 9},{k // 9},10" for k in range(81)) + "\n")


@pytest.mark.parametrize(
    ("make", "options", "says"),
    [
        (lambda path: None, (), "does not exist"),
        (lambda path: path.touch(), (), "is empty"),
        (_all_holes, ("--crs", "local"), "hole|no depth"),
        (_soundings, ("--crs", "EPSG:999999"), "EPSG:999999"),
    ],
    ids=["missing", "empty", "all holes", "unknown projection"],
)
def test_bad_charts_are_refused(make: Callable[[Path], None], options: tuple[str, ...], says: str) -> None:
    path = Path("chart.nc" if make is _all_holes else "chart.csv")
    make(path)
    before = os.listdir(".")
    assert re.search(says, refusal("chart", path, *options, "--picture", "chart.png"))
    settings = ("--set", f"chart.crs={options[1]}") if options else ()
    assert re.search(says, refusal("run", "st-john", *SHORT, "--chart", path, *settings, "-o", "out"))
    assert re.search(says, refusal("simulate", "st-john", *SHORT, "--chart", path, *settings, "-o", "m.mcap"))
    assert os.listdir(".") == before


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("sensors.water_depht.sigma_m=0.1", "unknown key 'sensors.water_depht'.*did you mean 'water_depth'"),
        ("sensors.water_depth.sigma_m=-0.1", r"sigma_m is -0\.1: must be at least 0"),
        ("acoustics.slot_s=2", r"slot of 2\.00 s is shorter than 1 frame x 2\.05 s .* = 2\.98 s"),
        ("acoustics.packet_bytes=100", r"packet of 100 bytes: slot of 3\.00 s is shorter than 2 frames"),
        ("navigator.mpf.particle=9", "navigator.mpf.particle: no such option"),
        ("nonsense", "not of the form"),
    ],
)
def test_bad_scenarios_are_refused(setting: str, says: str) -> None:
    for command in (("run", "st-john", "-o", "out"), ("study", "st-john", "--runs", "1", "-o", "out")):
        assert re.search(says, refusal(*command, "--set", setting))
    assert not os.listdir(".")


def test_navigators_that_do_not_exist_or_come_twice_are_refused(mission: Path) -> None:
    assert "did you mean 'mpf'" in refusal("run", mission, "-n", "mfp", "-o", "out")
    assert "more than once" in refusal("run", mission, "-n", "mpf,mpf", "-o", "out")
    assert not os.listdir(".")


def test_a_packet_longer_than_its_slot_is_refused_with_the_arithmetic(mission: Path) -> None:
    aloc = ("--set", "acoustics.modem=aloc", "--set", "navigator.all.packet=f64")
    says = r"mpf's packet of 47 bytes: slot of 3\.00 s is shorter than 6 frames x 0\.64 s .* = 4\.47 s"
    assert re.search(says, refusal("run", "st-john", *SHORT, *aloc, "-n", "mpf", "-o", "out"))
    assert not os.listdir(".")


def _damaged(log: MissionLog, change: Callable[[dict[str, Any]], None]) -> MissionLog:
    table = {name: column.copy() for name, column in log.events["water_depth"].items()}
    change(table)
    return replace(log, events={**log.events, "water_depth": table})


def _out_of_order(table: dict[str, Any]) -> None:
    table["t_ns"][[6, 9]] = table["t_ns"][[9, 6]]


def _nan(table: dict[str, Any]) -> None:
    table["water_depth_m"][5] = np.nan


@pytest.mark.parametrize(
    ("change", "says"), [(_out_of_order, "order|ascend|earlier|before"), (_nan, "water_depth_m.*nan")]
)
def test_bad_logs_are_refused(
    change: Callable[[dict[str, Any]], None],
    says: str,
    mission: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    bad = tmp_path / "bad.mcap"
    with monkeypatch.context() as patched:
        patched.setattr("uwcoop.missionlog.mcap.validate", lambda log: None)
        write_log(_damaged(load_log(mission), change), bad)
    assert re.search(says, refusal("run", bad, "-o", "out"))
    assert not os.listdir(".")


def test_a_log_cut_off_or_with_another_chart_is_refused(mission: Path, tmp_path: Path) -> None:
    content = mission.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: len(content) // 2])
    assert "cut off" in refusal("run", cut, "-o", "out")
    other = tmp_path / "other.nc"
    _bay(other)
    line = refusal("run", mission, "--chart", other, "--set", "chart.crs=local", "-o", "out")
    assert "belongs to chart 'st-john' with SHA-256" in line
    assert not os.listdir(".")


def test_outputs_that_cannot_be_are_refused(mission: Path, tmp_path: Path) -> None:
    assert "is a file, the output must be a folder" in refusal("run", mission, "-o", mission)
    assert "there is no such folder" in refusal(
        "simulate", "st-john", *SHORT, "-o", tmp_path / "no" / "m.mcap"
    )
    assert uwcoop("simulate", "st-john", "-o", "mission.bag").exit_code == 2
    assert not os.listdir(".")


def test_every_command_has_an_example_in_its_help_that_the_program_understands() -> None:
    import shlex

    from typer.main import get_command

    from uwcoop.cli.commands import EXAMPLES

    commands = get_command(app).commands  # type: ignore[attr-defined]
    assert set(EXAMPLES) == set(commands)
    for name, command in commands.items():
        said = CliRunner().invoke(app, [name, "--help"])
        assert f"uwcoop {name}" in said.stdout, name
        program, called, *arguments = shlex.split(EXAMPLES[name].partition(" > ")[0])
        assert (program, called) == ("uwcoop", name)
        command.make_context(name, list(arguments))  # a usage error would be raised here


def test_scenarios_as_json() -> None:
    listed = json.loads(CliRunner().invoke(app, ["scenarios", "--json"]).stdout)
    assert "flat-bay" in listed["scenarios"]
    assert listed["navigators"]["team"]
    one = json.loads(CliRunner().invoke(app, ["scenarios", "flat-bay", "--json"]).stdout)
    assert one["name"] == "flat-bay"
