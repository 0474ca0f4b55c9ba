"""Pictures and replay of landmark missions; offsets from beliefs that are the truth, of which one knows what they are."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from uwcoop import scenario
from uwcoop.errors import TracksError
from uwcoop.experiment.particles_at_fixes import around_fixes
from uwcoop.experiment.run import run
from uwcoop.figures.landmark import landmark_spans, measured_positions, trajectories_figure, velocities_figure
from uwcoop.figures.landmark_fixes import fix_offsets, offsets_figure, reconstruction_figure
from uwcoop.figures.landmark_study import bytes_figure, cost_figure
from uwcoop.missionlog.model import MissionLog
from uwcoop.report.run_folder import write_run
from uwcoop.world.simulate import simulate

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def log() -> MissionLog:
    return simulate("seafloor-survey", 2)


def believed_truth(log: MissionLog, turn_rad: float = 0.0) -> xr.Dataset:
    """Tracks of a navigator that is right, and of one whose yaw is off."""
    assert log.truth is not None
    t = np.arange(0, 1071.0)
    known = log.truth["time"].to_numpy()
    position = np.stack(
        [np.column_stack([np.interp(t, known, a) for a in p.T]) for p in log.truth["position_m"].to_numpy()]
    )
    yaw = np.stack([np.interp(t, known, np.unwrap(y)) for y in log.truth["yaw_rad"].to_numpy()])
    each = ("navigator", "vehicle", "time")
    return xr.Dataset(
        {
            "position_m": ((*each, "axis"), np.stack([position, position])),
            "covariance_m2": ((*each, "axis", "axis_b"), np.tile(np.eye(2), (2, 2, t.size, 1, 1))),
            "truth_position_m": (("vehicle", "time", "axis"), position),
            "yaw_rad": (each, np.stack([yaw, yaw + turn_rad])),
            "truth_yaw_rad": (("vehicle", "time"), yaw),
            "heard": (each, np.zeros((2, 2, t.size), dtype=bool)),
        },
        coords={"navigator": ["right", "turned"], "vehicle": list(log.vehicles), "time": t},
        attrs={"mission": log.name, "seed": log.seed, "settle_s": 100.0},
    )


def test_offsets_of_a_navigator_that_is_right_are_the_noise_and_of_a_turned_one_its_turn(
    log: MissionLog,
) -> None:
    tracks = believed_truth(log, np.radians(20))
    right, turned = (fix_offsets(log, tracks, i) for i in (0, 1))
    count = len(log.events["acoustic_fix"]["t_ns"])
    for name, sigma in (
        ("range_m", 0.66),
        ("own_bearing_rad", np.radians(6)),
        ("peer_bearing_rad", np.radians(1)),
    ):
        values = right[name][np.isfinite(right[name])]
        assert values.std() == pytest.approx(sigma, rel=5 / np.sqrt(2 * count)), name
        assert abs(values.mean()) < 5 * sigma / np.sqrt(count), name
    np.testing.assert_allclose(right["range_m"], turned["range_m"])
    for name in ("own_bearing_rad", "peer_bearing_rad"):
        difference = np.degrees((turned[name] - right[name] + np.pi) % (2 * np.pi) - np.pi)
        np.testing.assert_allclose(difference[np.isfinite(difference)], 20, atol=1e-6)


def test_measured_positions_lie_around_the_truth(log: MissionLog) -> None:
    measured = measured_positions(log, believed_truth(log), 0)
    fixes = log.events["acoustic_fix"]
    assert log.truth is not None
    known = log.truth["time"].to_numpy()
    for name, bearing, bound in (("peer", "peer_bearing_rad", 1.0), ("own", "own_bearing_rad", 2.0)):
        there = np.isfinite(fixes["range_m"]) & np.isfinite(fixes[bearing])
        truth = np.array(
            [[np.interp(t / 1e9, known, log.truth["position_m"].to_numpy()[v, :, a]) for a in (0, 1)]
             for t, v in zip(fixes["t_ns"][there], fixes["vehicle"][there], strict=True)]
        )  # fmt: skip
        assert measured[name].shape == truth.shape
        assert np.median(np.hypot(*(measured[name] - truth).T)) < bound


def test_spans_say_who_was_the_landmark(log: MissionLog) -> None:
    spans = landmark_spans(log)
    assert [s.vehicle for s in spans] == [0, 1, 0, 1]
    assert spans[0].start_s == 0
    assert spans[-1].end_s == 1070
    assert all(a.end_s == b.start_s for a, b in pairwise(spans))
    with pytest.raises(TracksError, match="no vehicle takes the landmark's role"):
        landmark_spans(MissionLog("none", 0, ("a",), 10**9, log.link))


def labels(figure: Any) -> str:
    texts = [t.get_text() for legend in figure.legends for t in legend.get_texts()]
    axes = [f"{a.get_xlabel()} {a.get_ylabel()} {a.get_title()}" for a in figure.axes]
    return " | ".join([*texts, *axes])


def test_each_picture_names_what_it_shows(log: MissionLog, tmp_path: Path) -> None:
    tracks = believed_truth(log, 0.3)
    for figure, words in (
        (
            trajectories_figure(log, tracks, None),
            ["east (m)", "north (m)", "measured by the landmark", "TT", "turned"],
        ),
        (velocities_figure(log), ["speed (m/s)", "time (s)", "landmark (numbers: exchanges)"]),
        (offsets_figure(log, tracks), ["offset (m)", "offset (deg)", "±2σ", "exchange of roles", "right"]),
    ):
        for word in words:
            assert word in labels(figure), word
        figure.savefig(tmp_path / "figure.png")
    assert "likelihood" not in labels(offsets_figure(log, tracks))


KIDNAPPED = ("duration_s=460", "navigator.landmark-paper.particles=500")


def test_a_reconstruction_is_found_and_drawn() -> None:
    log = simulate(scenario.load("seafloor-survey-kidnap", KIDNAPPED), 1)
    around = around_fixes(log, "landmark-paper")
    counts = around["reconstructions"].values
    when = around["t_s"].values[np.flatnonzero(counts[:, 1] > counts[:, 0])]
    assert when.size
    assert (when > 400).all()  # not before the vehicle was turned
    k = int(np.flatnonzero(counts[:, 1] > counts[:, 0])[0])
    spread = np.nanstd(around["particles_m"].values[k], axis=1).max(axis=1)
    assert spread[1] > 1.3 * spread[0]  # new particles lie where the fix puts the mover
    assert ", reconstruction" in labels(reconstruction_figure(log, around, "landmark-paper"))
    with pytest.raises(TracksError, match="has no particles that it could reconstruct"):
        around_fixes(log, "landmark-ekf")


@pytest.mark.long
def test_a_run_with_figures_writes_them_all(tmp_path: Path) -> None:
    result = run("seafloor-survey-kidnap", ["landmark-paper", "landmark"], seed=1, overrides=KIDNAPPED)
    notes: list[str] = []
    written = write_run(result, tmp_path, notes.append, figures=True)
    expected = {"trajectories.png", "velocities.png", "offsets.png", "reconstruction.png", "map.png"}
    assert expected <= set(written), notes
    assert "likelihood" in labels(offsets_figure(result.log, result.tracks))


def test_the_replay_shows_rays_roles_and_events(tmp_path: Path) -> None:
    rerun = pytest.importorskip("rerun")
    from uwcoop.viewer import write_replay

    result = run("seafloor-survey", ["landmark"], seed=0, overrides=["duration_s=400"])
    target = tmp_path / "replay.rrd"
    write_replay(target, result.tracks, result.packets, result.clouds, None, result.log)
    from rerun.chunk import RrdReader

    entities = {str(chunk.entity_path) for chunk in RrdReader(target).stream()}
    for wanted in (
        "fixes/TD/landmark_sees",
        "fixes/TD/mover_sees",
        "truth/TT/landmark",
        "events",
        "packets/TD_to_TT",
    ):
        assert any(wanted in entity for entity in entities), (wanted, sorted(entities))
    assert rerun


def test_study_pictures_take_their_rows(tmp_path: Path) -> None:
    cost = [
        {"particles": n, "mission_s": n / 1e3, "compression_s": n / 1e6, "rate": 1e6 / n} for n in (300, 3000)
    ]
    size = [{"bytes": b, "rmse_m": 0.2, "yaw_deg": 0.6, "anees": 1.1} for b in (8, 32)]
    for figure, word in (
        (cost_figure(cost), "CPU time (s)"),
        (bytes_figure(size), "exchange packet (bytes)"),
    ):
        assert word in labels(figure)
        figure.savefig(tmp_path / "figure.png")
