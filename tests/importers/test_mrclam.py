"""MRCLAM data sets as missions: a made one in the same format, and the real one where it is present."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uwcoop.errors import LogError, UwcoopError
from uwcoop.experiment.mission import open_mission
from uwcoop.frames import wrap_angle
from uwcoop.importers.datasets.mrclam import read_mrclam
from uwcoop.importers.datasets.mrclam_files import is_mrclam
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.missionlog.model import MissionLog
from uwcoop.missionlog.validate import validate
from uwcoop.scenario.setup import PositioningSigmas

EPOCH_S = 1248444000.0
HEAD = "# UTIAS Multi-Robot Cooperative Localization and Mapping Dataset\n# columns\n"
STANDS = (2.0, 1.0, 0.5)
"""Robot 1: x, y, yaw."""


def made(folder: Path, *, stop_s: float = 20.0, end_s: float = 80.0, gz: bool = False) -> Path:
    """Robot 1 drives until `stop_s` and stands from then on; robot 2 goes round it and sees it, and is seen."""

    def write(name: str, rows: list[list[float]]) -> None:
        text = HEAD + "".join("\t".join(f"{cell:.8f}" for cell in row) + "\n" for row in rows)
        if gz:
            (folder / f"{name}.gz").write_bytes(gzip.compress(text.encode()))
        else:
            (folder / name).write_text(text)

    folder.mkdir(exist_ok=True)
    (folder / "Barcodes.dat").write_text(HEAD + "  1 \t   5\n  2 \t  14\n  6 \t  63\n")
    t = np.arange(0, end_s + 0.05, 0.1)
    v, w, radius = 0.08, 0.04, 2.0
    angle = w * t
    x2, y2 = STANDS[0] + radius * np.cos(angle), STANDS[1] + radius * np.sin(angle)
    yaw2 = angle + np.pi / 2
    x1 = STANDS[0] + 0.05 * np.minimum(t - stop_s, 0) * np.cos(STANDS[2])
    y1 = STANDS[1] + 0.05 * np.minimum(t - stop_s, 0) * np.sin(STANDS[2])
    write(
        "Robot1_Groundtruth.dat", np.column_stack([EPOCH_S + t, x1, y1, np.full(t.size, STANDS[2])]).tolist()
    )
    write("Robot2_Groundtruth.dat", np.column_stack([EPOCH_S + t, x2, y2, wrap_angle(yaw2)]).tolist())
    write("Robot1_Odometry.dat", np.column_stack([EPOCH_S + t, 0.05 * (t < stop_s), 0 * t]).tolist())
    write("Robot2_Odometry.dat", np.column_stack([EPOCH_S + t, 0 * t + v, 0 * t + w]).tolist())
    sees = t[(np.arange(t.size) % 5) == 0]
    at = np.searchsorted(t, sees)
    gap = np.hypot(x2[at] - x1[at], y2[at] - y1[at])
    to1 = wrap_angle(np.arctan2(y1[at] - y2[at], x1[at] - x2[at]) - yaw2[at])
    to2 = wrap_angle(np.arctan2(y2[at] - y1[at], x2[at] - x1[at]) - STANDS[2])
    write("Robot2_Measurement.dat", [[EPOCH_S + s, 5, r, b] for s, r, b in zip(sees, gap, to1, strict=True)]
          + [[EPOCH_S + end_s, 63, 1.0, 0.0]])  # fmt: skip
    write("Robot1_Measurement.dat", [[EPOCH_S + s, 14, r, b] for s, r, b in zip(sees, gap, to2, strict=True)])
    return folder


def residuals(log: MissionLog) -> tuple[Any, Any, Any]:
    assert log.truth is not None
    fixes = log.events["acoustic_fix"]
    known = log.truth["time"].to_numpy()
    t = fixes["t_ns"] / 1e9
    mover = np.empty((t.size, 2))
    yaw = np.empty(t.size)
    for v in np.unique(fixes["vehicle"]):
        own = fixes["vehicle"] == v
        for axis in (0, 1):
            mover[own, axis] = np.interp(t[own], known, log.truth["position_m"].to_numpy()[v, :, axis])
        yaw[own] = np.interp(t[own], known, np.unwrap(log.truth["yaw_rad"].to_numpy()[v]))
    own_bearing = np.arctan2(-mover[:, 1], -mover[:, 0]) - yaw
    peer_bearing = np.arctan2(mover[:, 1], mover[:, 0])
    return (
        fixes["range_m"] - np.hypot(*mover.T),
        wrap_angle(fixes["own_bearing_rad"] - own_bearing),
        wrap_angle(fixes["peer_bearing_rad"] - peer_bearing),
    )


@pytest.mark.parametrize("gz", [False, True])
def test_a_made_data_set_becomes_a_mission_in_the_landmarks_frame(tmp_path: Path, gz: bool) -> None:
    folder = made(tmp_path / "set", gz=gz)
    assert is_mrclam(folder)
    assert not is_mrclam(tmp_path)
    log = read_mrclam(folder, seed=3)
    validate(log)
    assert log.vehicles == ("R1", "R2")
    assert log.duration_ns == 60 * 10**9
    assert log.truth is not None
    assert np.abs(log.truth["position_m"].to_numpy()[0]).max() == 0
    # At 20 s robot 2 is 2 m away, 0.8 rad around; robot 1's bow points to 0.5 rad.
    np.testing.assert_allclose(
        log.truth["position_m"].to_numpy()[1, 0], [2 * np.cos(0.3), 2 * np.sin(0.3)], atol=1e-6
    )
    ranges, own, peer = residuals(log)
    for values, bound in ((ranges, 1e-3), (own, 2e-3), (peer, 2e-3)):
        assert np.isfinite(values).all()
        assert np.abs(values).max() < bound
    velocity, rate = log.events["ground_velocity"], log.events["turn_rate"]
    np.testing.assert_allclose(velocity["forward_mps"][velocity["vehicle"] == 1], 0.08, rtol=1e-5)
    np.testing.assert_allclose(velocity["forward_mps"][velocity["vehicle"] == 0], 0.0)
    np.testing.assert_allclose(rate["yaw_rate_radps"][rate["vehicle"] == 1], 0.04, rtol=1e-5)
    assert log.events["landed"]["vehicle"].tolist() == [0]
    assert log.events["role_taken"]["landmark"].tolist() == [True, False]


def test_the_robot_that_stands_longest_is_the_landmark_and_is_named(tmp_path: Path) -> None:
    log = read_mrclam(made(tmp_path / "set"))
    assert log.notes == (
        "robot 1 is the landmark: it stands still for 60.0 s, the longest, from 20.0 s on; robot 2 never stands still: "
        "it cannot be the landmark",
    )
    assert read_mrclam(tmp_path / "set", landmark=1).notes == ()
    brief = made(tmp_path / "brief", stop_s=75.0)
    with pytest.raises(
        LogError, match=r"longer than settle_s = 10 s: robot 1 stands still for 5\.0 s only"
    ) as none:
        read_mrclam(brief)
    assert "\n" not in str(none.value)
    assert read_mrclam(brief, settle_s=2.0).vehicles == ("R1", "R2")


def test_the_schedule_thins_out_and_losses_are_drawn(tmp_path: Path) -> None:
    folder = made(tmp_path / "set")
    full = read_mrclam(folder, dropout_share=0.0, interval_s=0.1)
    assert len(full.events["acoustic_fix"]["t_ns"]) == pytest.approx(120, abs=2)  # every 0.5 s of 60 s
    slow = read_mrclam(folder, dropout_share=0.0, interval_s=5.0)
    assert len(slow.events["acoustic_fix"]["t_ns"]) == pytest.approx(12, abs=1)
    assert np.diff(slow.events["acoustic_fix"]["t_ns"]).min() > 4 * 10**9
    counts = [
        len(read_mrclam(folder, seed=s, dropout_share=0.3).events["acoustic_fix"]["t_ns"]) for s in range(50)
    ]
    assert np.mean(counts) == pytest.approx(0.7 * 60, rel=0.08)
    assert read_mrclam(folder, 5).difference(read_mrclam(folder, 5)) is None
    assert read_mrclam(folder, 5).difference(read_mrclam(folder, 6)) is not None


def test_priors_are_drawn_from_what_they_state(tmp_path: Path) -> None:
    folder = made(tmp_path / "set")
    errors = []
    for seed in range(50):
        log = read_mrclam(folder, seed)
        assert log.truth is not None
        fix, heading = log.events["fix"], log.events["heading"]
        truth = log.truth["position_m"].to_numpy()[1, 0]
        yaw = log.truth["yaw_rad"].to_numpy()[1, 0]
        errors += [fix["e_m"][1] - truth[0], fix["n_m"][1] - truth[1],
                   float(np.degrees(wrap_angle(heading["yaw_rad"][1] - yaw))) / 5]  # fmt: skip
        assert fix["e_m"][0] == fix["n_m"][0] == heading["yaw_rad"][0] == 0
    assert np.mean(np.square(errors)) == pytest.approx(1, abs=0.4)


def test_it_can_be_opened_as_any_mission_and_written_as_any_log(tmp_path: Path) -> None:
    folder = made(tmp_path / "set")
    stated = ["mrclam.dropout_share=0.0", "navigator.landmark.seed_unused=1"]
    plain = ["mrclam.fix_correlation_s=0", "mrclam.odometry_scale_sigma=0", "mrclam.gyro_bias_sigma_degps=0"]
    log = open_mission(str(folder), 2, None, [*stated, *plain])
    assert log.setup.tables()["mrclam"]["dropout_share"] == 0
    assert log.setup.navigator.own["landmark"] == {"seed_unused": 1, "fix_correlation_s": 0.0}
    assert log.setup.positioning == PositioningSigmas(0.2, 2.0, 2.0)
    assert log.setup.metrics.settle_s == 10
    write_log(log, tmp_path / "set.mcap")
    assert log.difference(load_log(tmp_path / "set.mcap")) is None
    with pytest.raises(UwcoopError, match="is a folder but no MRCLAM data set"):
        open_mission(tmp_path)
    with pytest.raises(UwcoopError, match=r"only navigator\.\*, log\.\* and"):
        open_mission(folder, None, None, ["duration_s=3"])


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"landmark": 2}, "robot 2 never stands still"),
        ({"landmark": 3}, "has no robot 3"),
        ({"landmark": 9}, "mrclam: landmark is 9: must be at most 5"),
        ({"duration_s": 100.0}, "stands still from 20.0 s to 80.0 s, the mission would last until 120.0 s"),
        ({"start_s": 5.0}, "must be within"),
        ({"movers": (3,)}, "robot 3 is the landmark or missing"),
        ({"no_such": 1}, "unknown key 'no_such'"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_mission_is_refused_in_one_line(
    tmp_path: Path, options: dict[str, Any], line: str
) -> None:
    folder = made(tmp_path / "set")
    with pytest.raises(LogError) as caught:
        read_mrclam(folder, **options)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("Robot2_Odometry.dat", "# head\n1.0 0.1\n", "line 2 is not 3 numbers"),
        ("Robot2_Odometry.dat", "1.0 0.1 x\n", "line 1 is not 3 numbers"),
        ("Robot2_Odometry.dat", "1.0 0.1 nan\n", "line 1 is not 3 numbers"),
        ("Robot2_Odometry.dat", "2.0 0.1 0\n1.0 0.1 0\n", "time goes back in line 2"),
        ("Robot2_Measurement.dat", None, "has no Robot2_Measurement.dat"),
        ("Barcodes.dat", "1 5\n", "Barcodes.dat has no subject 2"),
    ],
)
def test_damaged_files_are_named_with_their_line(
    tmp_path: Path, name: str, text: str | None, line: str
) -> None:
    folder = made(tmp_path / "set")
    if text is None:
        (folder / name).unlink()
    else:
        (folder / name).write_text(text)
    with pytest.raises(LogError, match=line.replace(".", r"\.")):
        read_mrclam(folder)


def test_the_real_data_set(reference: Path) -> None:
    folder = reference / "data" / "mrclam" / "MRCLAM_Dataset6"
    log = read_mrclam(folder, dropout_share=0.0)
    validate(log)
    assert log.vehicles == ("R1", "R3", "R4", "R5")
    assert log.duration_ns / 1e9 == pytest.approx(128, abs=0.5)
    ranges, own, _ = residuals(log)
    assert np.isfinite(ranges).all()
    # Cameras read ranges to a quarter of a metre and bearings to a degree; a wrong frame is metres and radians.
    assert np.median(np.abs(ranges)) < 0.25
    assert np.degrees(np.median(np.abs(own[np.isfinite(own)]))) < 1.5
    four = read_mrclam(folder, landmark=4, dropout_share=0.0)
    ranges, own, peer = residuals(four)
    assert four.duration_ns / 1e9 == pytest.approx(20.4, abs=0.2)
    assert np.isfinite(own).sum() > 5
    assert np.isfinite(peer).sum() > 5
    assert np.median(np.abs(ranges)) < 0.25
    assert np.degrees(np.nanmedian(np.abs(peer))) < 2
