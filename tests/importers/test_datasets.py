"""Recordings of ranges to beacons: factor graphs and the Plaza files, made up and, where they are at hand, real."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from typer.testing import CliRunner

import uwcoop
from uwcoop.cli import app
from uwcoop.errors import LogError, ScenarioError, UwcoopError
from uwcoop.experiment.mission import open_mission

BEACONS = {"L0": (0.0, 0.0), "L1": (300.0, 0.0)}


def circle(count: int, radius_m: float = 80.0) -> np.ndarray[Any, Any]:
    """East, north, yaw of poses on a circle around (150, 120)."""
    angle = np.linspace(0.0, 2 * math.pi, count)
    return np.column_stack(
        [150 + radius_m * np.cos(angle), 120 + radius_m * np.sin(angle), angle + math.pi / 2]
    )


def steps(poses: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Forward, left and turn from each pose to the next."""
    moved, yaw = np.diff(poses[:, :2], axis=0), poses[:-1, 2]
    forward = moved[:, 0] * np.cos(yaw) + moved[:, 1] * np.sin(yaw)
    left = -moved[:, 0] * np.sin(yaw) + moved[:, 1] * np.cos(yaw)
    return np.column_stack([forward, left, np.diff(poses[:, 2])])


def graph_text(count: int = 60, odometer: float = 1.0, outlier: int | None = None, seed: int = 0) -> str:
    """A factor graph of a vehicle on a circle, its odometer reading too much by a factor, ranges with 1 m of noise."""
    rng = np.random.default_rng(seed)
    poses = circle(count)
    lines = [f"VERTEX_SE2 0.0 A{k} {e} {n} {yaw}" for k, (e, n, yaw) in enumerate(poses)]
    lines += [f"VERTEX_XY {name} {e} {n}" for name, (e, n) in BEACONS.items()]
    for k, (forward, left, turn) in enumerate(steps(poses) * (odometer, odometer, 1.0)):
        lines.append(f"EDGE_SE2 0.0 A{k} A{k + 1} {forward} {left} {turn} 4e-4 0 0 4e-4 0 4e-6")
    for k in range(1, count):
        name = f"L{k % 2}"
        away = math.dist(poses[k, :2], BEACONS[name]) + rng.standard_normal() + (90 if k == outlier else 0)
        lines.append(f"EDGE_RANGE 0.0 A{k} {name} {away} 0.5625")
    return "\n".join(lines) + "\n"


WHITE = [
    "recording.sigma_range_bias_share=0", "recording.sigma_range_drift_share=0",
    "recording.late_share=0", "recording.noise_scale_max=1",
]  # fmt: skip
"""Errors of ranges as the references have them: each is new."""
KNOWN = "recording.sigma_start_yaw_rad=0.01"
TUNED = ["recording.sigma_range_m=1", "recording.sigma_beacon_m=0.1", "recording.sigma_odometry_m=1"]


def own(summary: dict[str, Any], navigator: str) -> dict[str, Any]:
    return next(iter(summary["navigators"][navigator]["vehicles"].values()))


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    path = tmp_path / "made.up.pyfg"
    path.write_text(graph_text(odometer=1.1, outlier=40))
    return path


def test_a_pose_stands_at_its_second_and_beacons_stand_still(graph: Path) -> None:
    log = open_mission(graph)
    assert log.vehicles == ("auv", "L0", "L1")
    assert log.duration_ns == 59_000_000_000
    assert log.truth is not None
    np.testing.assert_allclose(log.truth.position_m.values[0], circle(60)[:, :2])
    np.testing.assert_allclose(log.truth.position_m.values[2], np.tile(BEACONS["L1"], (60, 1)))
    o = log.opportunities
    assert (np.diff(log.slots["tol_ns"]) > 0).all()
    travelled = (o["toa_ns"] - o["tol_ns"]) * 1e-9 * log.link.sound_speed_mps
    first = math.dist(circle(60)[1, :2], BEACONS["L1"])
    assert travelled[o["sender"] == 2][0] == pytest.approx(first, abs=4)
    assert (o["receiver"] == 0).all()


def test_exact_odometry_leads_back_to_the_truth(tmp_path: Path) -> None:
    path = tmp_path / "exact.pyfg"
    path.write_text(graph_text())
    summary = uwcoop.run(path, ["local-only"], clouds=False).summary
    # The start is known to 0.1 m and its fix is exact.
    assert own(summary, "local-only")["rmse_m"] < 1e-6


def test_ranges_mend_an_odometer_and_an_outlier_is_gated_and_counted(graph: Path) -> None:
    summary = uwcoop.run(graph, overrides=TUNED, clouds=False).summary
    lost = own(summary, "local-only")["rmse_m"]
    for navigator in ("cekf", "nekf"):
        assert own(summary, navigator)["rmse_m"] < 0.5 * lost, navigator
        assert own(summary, navigator)["rejected"] == 1, navigator
    assert summary["navigators"]["local-only"]["packet_bytes"]["max"] is None


@pytest.mark.parametrize("beacons", [[], ["L1"]])
@pytest.mark.parametrize("navigator", ["mdeif", "deif", "deif-redundant"])
def test_pose_graphs_of_beacons_tell_what_their_places_tell(
    graph: Path, navigator: str, beacons: list[str]
) -> None:
    """A beacon is a ship that stands still: who rebuilds its graph knows as much as who is told everything."""
    chosen = [f"recording.beacons={beacons}"] if beacons else []
    result = uwcoop.run(graph, [navigator, "cekf"], overrides=[*chosen, *WHITE], clouds=False)
    ours, reference = result.tracks["position_m"].values[:, 0]
    assert np.hypot(*(ours - reference).T).max() < 0.1
    spread = np.trace(result.tracks["covariance_m2"].values[:, 0], axis1=-2, axis2=-1)
    assert np.allclose(spread[0], spread[1], rtol=0.05)
    assert own(result.summary, navigator)["rejected"] == own(result.summary, "cekf")["rejected"]


def test_an_edge_in_parts_is_the_edge_and_its_ranges_lie_between(graph: Path) -> None:
    whole = open_mission(graph)
    parts = open_mission(graph, overrides=["recording.range_delay_edges=0.25"])
    one, two = (log.events["odometry"] for log in (whole, parts))

    def moved(events: Any) -> Any:
        return events["vehicle"] == 0

    for name in ("forward_m", "left_m", "yaw_change_rad", "cov_ff", "cov_ll", "cov_yy"):
        told = two[name][moved(two)].reshape(-1, 2).sum(axis=1)
        assert np.allclose(told, one[name][moved(one)], rtol=1e-12, atol=1e-15), name
    assert np.allclose(two["forward_m"][moved(two)][::2], 0.75 * one["forward_m"][moved(one)])
    # Heard after the first part of its edge and before the second, which is done before the pose's second.
    done_ns = two["t_ns"][moved(two)].reshape(-1, 2)
    heard_ns = np.sort(parts.opportunities["toa_ns"])
    edge = np.searchsorted(done_ns[:, 1], heard_ns)
    inside = edge < len(done_ns)
    assert inside.sum() > 50
    assert (heard_ns[inside] > done_ns[edge[inside], 0]).mean() > 0.9
    ends = [
        uwcoop.run(log, ["local-only"], clouds=False).tracks["position_m"].values[0, 0, -1]
        for log in (whole, parts)
    ]
    assert np.allclose(*ends, rtol=0, atol=1e-9)
    with pytest.raises(ScenarioError, match="range_delay_edges"):
        open_mission(graph, overrides=["recording.range_delay_edges=1"])


def test_one_beacon_is_a_single_ship(graph: Path) -> None:
    log = open_mission(graph, overrides=["recording.beacons=['L1']"])
    assert log.vehicles == ("auv", "L1")
    assert set(log.slots["sender"]) == {1}
    with pytest.raises(LogError, match="has no beacon 'L7'"):
        open_mission(graph, overrides=["recording.beacons=['L7']"])


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (
            lambda text: text.replace("EDGE_RANGE 0.0 A1 ", "EDGE_RANGE 0.0 A1 X ", 1),
            "has 7 words, EDGE_RANGE has 6",
        ),
        (
            lambda text: text.replace("EDGE_RANGE 0.0 A1 L1", "EDGE_RANGE 0.0 A1 L9", 1),
            "from A1 to L9: one of them",
        ),
        (
            lambda text: text.replace("EDGE_SE2 0.0 A3 A4", "EDGE_SE2 0.0 A3 A9", 1),
            "from A4 to A5 after A9: no chain",
        ),
        (lambda text: text.replace("VERTEX_XY L0 0.0", "VERTEX_XY L0 nan", 1), "is not a finite number"),
        (lambda text: text + "EDGE_RANGE 0.0 A1 L0 -3 1\n", "range is -3 m, must be above 0"),
        (lambda text: text + "FRAGMENT 1 2\n", "is 'FRAGMENT', must be one of VERTEX_XY"),
        (lambda _: "", "has no odometry"),
    ],
)
def test_damage_is_named_in_one_line(tmp_path: Path, spoil: Any, line: str) -> None:
    path = tmp_path / "bad.pyfg"
    path.write_text(spoil(graph_text()))
    with pytest.raises(LogError, match=line) as error:
        open_mission(path)
    assert "\n" not in str(error.value)


def test_options_are_checked_and_a_log_has_happened(graph: Path) -> None:
    with pytest.raises(ScenarioError, match="unknown key 'sigma_rnage_m': did you mean 'sigma_range_m'"):
        open_mission(graph, overrides=["recording.sigma_rnage_m=3"])
    with pytest.raises(ScenarioError, match="has happened"):
        open_mission(graph, overrides=["acoustics.slot_s=3"])
    with pytest.raises(LogError, match="no such file"):
        open_mission(graph.with_name("none.pyfg"))


def test_the_command_line_runs_a_recording(graph: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    asked = ["run", str(graph), "-n", "cekf,nekf", "-o", str(out), "--figures"]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 0, result.output
    assert {"summary.json", "tracks.nc", "map.png", "uncertainty.png", "setup.png"} <= {
        p.name for p in out.iterdir()
    }
    assert "not realisable" in result.output


def mower(path: Path) -> Path:
    poses = circle(400, 30.0)
    time = 100.0 + 0.2 * np.arange(400)
    moved = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    # A mower moves along its heading: half the turn before, half after.
    dr = np.column_stack([time[1:], moved, np.diff(poses[:, 2])])
    seen = range(5, 400, 5)
    td = [[time[k], 2.0, k % 2, math.dist(poses[k, :2], BEACONS[f"L{k % 2}"])] for k in seen]
    tl = [[0.0, *BEACONS["L0"]], [1.0, *BEACONS["L1"]]]
    savemat(path, {"DR": dr, "GT": np.column_stack([time, poses]), "TD": np.array(td), "TL": np.array(tl)})
    return path


def test_plaza_files_are_read(tmp_path: Path) -> None:
    path = mower(tmp_path / "Plaza9_.mat")
    log = open_mission(path)
    assert log.name == "Plaza9"
    assert log.vehicles == ("mower", "L0", "L1")
    summary = uwcoop.run(path, ["cekf"], overrides=[KNOWN], clouds=False).summary
    assert own(summary, "cekf")["rmse_m"] < 0.5
    assert own(uwcoop.run(path, clouds=False).summary, "mdeif")["rmse_m"] < 1.0
    assert "heading at the start: not measured" in log.notes[0]
    with pytest.raises(UwcoopError, match=r"sigma of the heading .*mdeif alone .* is 3\.2"):
        uwcoop.run(path, ["cekf"], clouds=False)
    content = loadmat(path)
    savemat(path, {name: content[name] for name in ("DR", "GT", "TL")})
    with pytest.raises(LogError, match="has no table TD of 4 columns"):
        open_mission(path)


def test_numbers_whose_squares_overflow_are_refused_without_a_warning(tmp_path: Path) -> None:
    path = mower(tmp_path / "Plaza9_.mat")
    content = {name: table for name, table in loadmat(path).items() if not name.startswith("_")}
    content["DR"][3, 1] = -1.3e180
    savemat(path, content)
    # A warning would be an error here, and a second line on the command line.
    with pytest.raises(
        LogError, match=r"forward_m -1\.3e\+180 of vehicle 'mower' .* must be at least -1e\+06"
    ):
        open_mission(path)


def test_a_file_of_matlab_73_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "Plaza9_.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(512))
    with pytest.raises(LogError, match=r"Plaza9_\.mat cannot be read: .*HDF") as refused:
        open_mission(path)
    assert "\n" not in str(refused.value)


UNKNOWN = "recording.sigma_start_yaw_rad=3.2"


@pytest.mark.parametrize("turn_rad", [-2.9, -1.5, 0.0, 0.7, math.pi])
def test_ranges_find_a_heading_that_is_not_known(tmp_path: Path, turn_rad: float) -> None:
    """Whatever heading is stated beside a sigma that says nothing; with a small sigma the same heading misleads."""
    path = tmp_path / "circle.pyfg"
    path.write_text(graph_text(seed=3))
    stated = [*TUNED, f"recording.start_yaw_rad={math.pi / 2 + turn_rad - 2 * math.pi * (turn_rad > 1)}"]
    given = own(uwcoop.run(path, ["mdeif"], overrides=TUNED, clouds=False).summary, "mdeif")
    found = own(uwcoop.run(path, ["mdeif"], overrides=[*stated, UNKNOWN], clouds=False).summary, "mdeif")
    assert found["anees"] < 4
    assert found["median_error_m"] < given["median_error_m"] + 1.0
    if abs(turn_rad) > 1:
        misled = own(uwcoop.run(path, ["mdeif"], overrides=stated, clouds=False).summary, "mdeif")
        assert misled["rmse_m"] > 2 * found["rmse_m"]


def test_a_pose_stands_at_the_time_of_its_line_and_moves_there_second_by_second(tmp_path: Path) -> None:
    at_s = np.cumsum([0, *([1, 7, 12, 3] * 15)])[:60]
    text = graph_text()
    for k, stamp in enumerate(at_s):
        text = text.replace(f"VERTEX_SE2 0.0 A{k} ", f"VERTEX_SE2 {100.0 + stamp} A{k} ")
    path = tmp_path / "timed.pyfg"
    path.write_text(text)
    log = open_mission(path)
    assert log.duration_ns == int(at_s[-1]) * 10**9
    assert log.truth is not None
    np.testing.assert_array_equal(log.truth["time"].values, at_s)
    heard_s = log.opportunities["toa_ns"] / 1e9
    np.testing.assert_allclose(np.sort(heard_s), at_s[1:] - 0.5, atol=1e-3)
    own_steps = log.events["odometry"]["vehicle"] == 0
    assert own_steps.sum() == at_s[-1], "an edge of 12 s is 12 displacements"
    variance = log.events["odometry"]["cov_ff"][own_steps].sum()
    assert variance == pytest.approx(59 * 0.4**2), "as much as the whole edges"
    summary = uwcoop.run(path, ["local-only"], clouds=False).summary
    # Between two poses the truth is a chord, along which the vehicle moves in steps of a second.
    assert own(summary, "local-only")["rmse_m"] < 9.0


# --- recorded by others -------------------------------------------------------------------------------------


def test_goats_last_as_long_as_their_lines_say(reference: Path) -> None:
    log = open_mission(reference / "data/goats/goats_15.pyfg")
    assert log.duration_ns == 4_233 * 10**9
    assert log.truth is not None
    way = np.hypot(*np.diff(log.truth["position_m"].values[0], axis=0).T)
    assert np.median(way / np.diff(log.truth["time"].values)) == pytest.approx(0.71, abs=0.02)


@pytest.mark.parametrize(("run", "ins_m", "gated"), [(14, 5.84, 14), (15, 4.94, 1)])
def test_goats(reference: Path, run: int, ins_m: float, gated: int) -> None:
    path = reference / f"data/goats/goats_{run}.pyfg"
    summary = uwcoop.run(path, ["local-only", "cekf"], clouds=False).summary
    assert own(summary, "local-only")["rmse_m"] == pytest.approx(ins_m, abs=0.02)
    assert own(summary, "cekf")["rejected"] == gated
    assert own(summary, "cekf")["anees"] is not None
    if run == 14:
        assert own(summary, "cekf")["rmse_m"] < 0.75 * ins_m


@pytest.mark.parametrize(("run", "ins_m"), [(14, 5.84), (15, 4.94)])
def test_goats_with_ranges_heard_on_the_way(reference: Path, run: int, ins_m: float) -> None:
    """The middle of what can be, as nobody says when between two poses a range was heard: better than INS in both."""
    path = reference / f"data/goats/goats_{run}.pyfg"
    half = ["recording.range_delay_edges=0.5", "recording.sigma_beacon_m=3", *WHITE]
    summary = uwcoop.run(path, ["local-only", "cekf"], overrides=half, clouds=False).summary
    assert own(summary, "local-only")["rmse_m"] == pytest.approx(ins_m, abs=0.02)
    assert own(summary, "cekf")["rmse_m"] < own(summary, "local-only")["rmse_m"]
    assert own(summary, "cekf")["anees"] is not None


def test_plaza_against_a_graph_optimiser(reference: Path) -> None:
    """The online error on the 1 Hz grid against that of an incremental smoother fed the same odometry and ranges."""
    path = reference / "data/plaza/Plaza1_.mat"
    ours = own(uwcoop.run(path, ["cekf"], overrides=[KNOWN, *WHITE], clouds=False).summary, "cekf")["rmse_m"]
    # What GTSAM 4.3's ISAM2 gave (studies/plaza_gtsam.py), updated at every range.
    assert ours == pytest.approx(2.545, rel=0.05)


@pytest.mark.long
def test_plaza_against_gtsam_itself(reference: Path, study_module: Callable[[str], ModuleType]) -> None:
    if importlib.util.find_spec("gtsam") is None:
        pytest.skip("the optional gtsam wheel is not installed")
    path = reference / "data/plaza/Plaza1_.mat"
    ours, theirs = study_module("plaza_gtsam").compared(path)
    assert ours == pytest.approx(theirs, rel=0.05)


@pytest.mark.parametrize("turn_rad", [0.0, math.pi / 2, math.pi])
def test_plaza_without_its_heading(reference: Path, turn_rad: float) -> None:
    """The heading of the file is that of the truth: turned, and told as not known, it must not matter."""
    path = reference / "data/plaza/Plaza1_.mat"
    yaw = open_mission(path).events["heading"]["yaw_rad"][0] + turn_rad
    stated = [f"recording.start_yaw_rad={math.remainder(yaw, 2 * math.pi)}", UNKNOWN]
    found = own(uwcoop.run(path, ["mdeif"], overrides=stated, clouds=False).summary, "mdeif")
    assert found["rmse_m"] < 1.5
    assert found["anees"] < 3


@pytest.mark.parametrize(
    ("place", "more"),
    [
        ("goats/goats_14.pyfg", ["recording.sigma_beacon_m=3"]),
        ("goats/goats_15.pyfg", ["recording.sigma_beacon_m=3"]),
        ("labyrinth/Indoor_UWB_Input.txt", []),
    ],
)
def test_default_options_are_honest_and_no_worse_than_with_white_noise(
    reference: Path, place: str, more: list[str]
) -> None:
    """Against `mdeif` that takes every error of a range for a new one."""
    white = [
        "recording.sigma_range_bias_share=0",
        "recording.sigma_range_drift_share=0",
        "recording.late_share=0",
        "recording.noise_scale_max=1",
        *more,
    ]
    path = reference / "data" / place
    plain = own(uwcoop.run(path, ["mdeif"], overrides=white, clouds=False).summary, "mdeif")
    found = own(uwcoop.run(path, ["mdeif"], clouds=False).summary, "mdeif")
    assert found["rmse_m"] <= plain["rmse_m"]
    assert 1 < found["anees"] < 3 < plain["anees"]
