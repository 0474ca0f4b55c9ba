"""Scores of a mission whose truth is not known, fixes that are held out, truth from elsewhere, what would have been."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.errors import LogError, ScenarioError
from uwcoop.experiment.counterfactual import with_acoustics, without_vehicles
from uwcoop.experiment.given_truth import with_truth
from uwcoop.experiment.held_out import Request, parse_request, withhold
from uwcoop.frames import LocalFrame, Origin
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.mcap import write_log
from uwcoop.missionlog.model import event_columns
from uwcoop.world.simulate import simulate

SIGMA_M = 2.0
SURFACED_S = (60.0, 120.0, 180.0, 240.0)
LOSS = 'acoustics.losses=[{model="independent", probability=0.6}]'
EPOCH_NS = 1_780_000_000_000_000_000


def positions(log: MissionLog, vehicle: int, t_s: np.ndarray) -> np.ndarray:
    assert log.truth is not None
    truth, time = log.truth.position_m.values[vehicle], log.truth.time.values
    return np.stack([np.interp(t_s, time, truth[:, axis]) for axis in (0, 1)], -1)


@pytest.fixture(scope="module")
def log() -> MissionLog:
    """A team that surfaces four times for three seconds, with fixes of 2 m."""
    log = simulate(scenario.load("st-john-drift", ("duration_s=300", "navigator.all.particles=300")), seed=5)
    rng = np.random.default_rng(8)
    t_s = np.array([at + k for at in SURFACED_S for k in range(3)])
    tables = [log.events["fix"]]
    for vehicle in range(len(log.vehicles)):
        place = positions(log, vehicle, t_s) + rng.normal(0, SIGMA_M, (len(t_s), 2))
        square = np.full(len(t_s), SIGMA_M**2)
        tables.append(
            event_columns(
                "fix", t_ns=(t_s * 1e9).astype(np.int64), vehicle=np.full(len(t_s), vehicle), e_m=place[:, 0],
                n_m=place[:, 1], cov_ee_m2=square, cov_en_m2=0 * square, cov_nn_m2=square,
            )
        )  # fmt: skip
    fixes = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    order = np.lexsort((fixes["vehicle"], fixes["t_ns"]))
    fixes = {name: column[order] for name, column in fixes.items()}
    origin = Origin(18.32, -64.76, "EPSG:32620")
    return replace(log, events={**log.events, "fix": fixes}, origin=origin, epoch_ns=EPOCH_NS)


def test_withheld_fixes_score_as_the_truth_does(log: MissionLog) -> None:
    blind = replace(log, truth=None)
    result = uwcoop.run(blind, ["team"], hold_out="fix", clouds=False)
    known = uwcoop.run(log, ["team"], hold_out="fix", clouds=False)
    np.testing.assert_array_equal(result.tracks.position_m.values, known.tracks.position_m.values)
    for j, vehicle in enumerate(log.vehicles):
        score = result.summary["navigators"]["team"]["held_out"][vehicle]
        assert score["fixes"] == 12
        assert score["sigma_m"] == pytest.approx(np.sqrt(2) * SIGMA_M)
        at = np.searchsorted(
            known.tracks.time.values, np.array([t + k for t in SURFACED_S for k in range(3)]) - 1e-9
        )
        error = known.tracks.position_m.values[0, j, at] - positions(log, j, known.tracks.time.values[at])
        wanted = np.sqrt((error**2).sum(-1).mean() + 2 * SIGMA_M**2)
        assert 0.6 * wanted < score["rms_m"] < 1.5 * wanted
        assert 0.5 < score["nees"] < 6


def test_half_of_the_groups_is_withheld_whole_and_the_first_group_never(log: MissionLog) -> None:
    left, held = withhold(log, parse_request("fix:0.5"))
    for vehicle in range(len(log.vehicles)):
        times = held["t_ns"][held["vehicle"] == vehicle] / 1e9
        assert len(times) == 6
        groups = {int(t // 60) for t in times}
        assert len(groups) == 2
        rest = left.events["fix"]
        kept = rest["t_ns"][rest["vehicle"] == vehicle]
        assert kept.min() == 0
        assert len(kept) + 6 == (log.events["fix"]["vehicle"] == vehicle).sum()
    assert "held out" in left.notes[-1]
    _, of_one = withhold(log, Request(vehicles=("V2",)))
    assert set(of_one["vehicle"]) == {1}


@pytest.mark.parametrize(
    ("request_text", "says"),
    [
        ("fixes", "must be fix, fix:SHARE or fix:SHARE@VEHICLE,…"),
        ("fix:0", "the share '0' must be above 0 and at most 1"),
        ("fix:2", "at most 1"),
        ("fix@V9", "'V9'"),
    ],
)
def test_a_request_that_cannot_be_is_one_line(log: MissionLog, request_text: str, says: str) -> None:
    with pytest.raises(LogError) as refused:
        withhold(log, parse_request(request_text))
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_nothing_to_withhold_is_said() -> None:
    log = simulate(scenario.load("flat-bay", ("duration_s=30",)), seed=1)
    with pytest.raises(LogError, match="has no fixes to hold out"):
        withhold(log, Request())


def test_innovations_of_an_honest_navigator_fit_chi_square(log: MissionLog) -> None:
    """NIS of 60 vehicles: the mean by degree of freedom of each kind is near 1."""
    sums: dict[str, list[float]] = {"fix": [], "sounding": [], "range": []}
    for seed in range(6):
        result = uwcoop.run(replace(log, truth=None), ["team"], seed=seed, clouds=False)
        for vehicle in result.summary["navigators"]["team"]["consistency"].values():
            for kind, values in sums.items():
                values.append(vehicle[kind]["nis_per_dof"])
    assert 0.4 < np.mean(sums["fix"]) < 1.8
    assert 0.6 < np.mean(sums["sounding"]) < 1.3
    assert 0.5 < np.mean(sums["range"]) < 1.5


def test_a_chart_that_is_worse_than_stated_shows_in_the_soundings(log: MissionLog) -> None:
    table = log.events["water_depth"]
    noise = np.random.default_rng(1).normal(0, 1.5, len(table["t_ns"]))
    noisy = {**table, "water_depth_m": table["water_depth_m"] + noise}
    spoilt = replace(log, truth=None, events={**log.events, "water_depth": noisy})
    result = uwcoop.run(spoilt, ["dmpf", "mpf-terrain-only"], clouds=False)
    fits = [v["sounding"] for v in result.summary["navigators"]["mpf-terrain-only"]["consistency"].values()]
    assert all(fit["nis_per_dof"] > 3 and fit["beyond_95_share"] > 0.3 for fit in fits)


def test_truth_from_a_table_scores_as_the_log_s_own(log: MissionLog, tmp_path: Path) -> None:
    assert log.truth is not None
    t_s = np.arange(0, 301.0)
    rows = ["time,vehicle,latitude,longitude"]
    frame = LocalFrame(log.origin)
    for vehicle, name in enumerate(log.vehicles):
        place = positions(log, vehicle, t_s)
        latitude, longitude = frame.to_geographic(place).T
        rows += [
            f"{EPOCH_NS / 1e9 + t:.3f},{name},{a:.9f},{b:.9f}"
            for t, a, b in zip(t_s, latitude, longitude, strict=True)
        ]
    file = tmp_path / "truth.csv"
    file.write_text("\n".join(rows) + "\n")
    given = with_truth(replace(log, truth=None), [str(file)])
    own = uwcoop.run(log, ["mpf"], clouds=False).summary["navigators"]["mpf"]["vehicles"]
    theirs = uwcoop.run(given, ["mpf"], clouds=False).summary["navigators"]["mpf"]["vehicles"]
    for name in log.vehicles:
        assert theirs[name]["rmse_m"] == pytest.approx(own[name]["rmse_m"], abs=0.02)
    assert sum("truth of" in note for note in given.notes) == 3


def test_truth_from_a_topic_of_the_log(log: MissionLog, tmp_path: Path) -> None:
    path = tmp_path / "m.mcap"
    write_log(log, path)
    blind = replace(log, truth=None)
    with pytest.raises(LogError, match="positions are in") as refused:
        with_truth(blind, ["V1=/nowhere"], path)
    topics = [
        word.strip(",") for word in str(refused.value).split() if "truth" in word and word.startswith("/")
    ]
    mine = next(topic for topic in topics if "V1" in topic)
    given = with_truth(blind, [f"V1={mine}"], path)
    assert given.truth is not None
    at = given.truth.time.values
    np.testing.assert_allclose(given.truth.position_m.values[0], positions(log, 0, at), atol=0.02)
    assert np.isnan(given.truth.position_m.values[1]).all()


def test_long_gaps_of_a_truth_stay_unknown(log: MissionLog, tmp_path: Path) -> None:
    rows = ["time,east,north"] + [f"{t},{t},{2 * t}" for t in (*range(0, 50), *range(200, 250))]
    (tmp_path / "t.csv").write_text("\n".join(rows) + "\n")
    given = with_truth(replace(log, truth=None), [f"V3={tmp_path / 't.csv'}"])
    assert given.truth is not None
    known = np.isfinite(given.truth.position_m.values[2, :, 0])
    at = given.truth.time.values
    assert not known[(at > 49) & (at < 200)].any()
    assert known[at <= 49].all()


def test_without_a_vehicle_the_rest_is_as_if_it_had_not_been(log: MissionLog) -> None:
    fewer = without_vehicles(log, ["V2"])
    assert fewer.vehicles == ("V1", "V3")
    assert set(fewer.opportunities["sender"]) <= {0, 1}
    lone = uwcoop.run(fewer, ["mpf-terrain-only"], clouds=False)
    whole = uwcoop.run(log, ["mpf-terrain-only"], clouds=False)
    same = whole.tracks.sel(vehicle="V1", time=lone.tracks.time)
    # Nobody is heard by this navigator: the first vehicle's bits are those of the whole team.
    np.testing.assert_array_equal(lone.tracks.position_m.values[0, 0], same.position_m.values[0])
    result = uwcoop.run(log, ["mpf"], without=["V2"], clouds=False)
    assert result.summary["counterfactual"] == ["without V2"]
    with pytest.raises(LogError, match="no vehicle left"):
        without_vehicles(log, list(log.vehicles))
    with pytest.raises(LogError, match="V7"):
        without_vehicles(log, ["V7"])


def test_more_loss_means_fewer_packets_and_only_those_that_came(log: MissionLog, tmp_path: Path) -> None:
    path = tmp_path / "m.mcap"
    write_log(log, path)
    whole = uwcoop.run(path, ["team"], clouds=False)
    fewer = uwcoop.run(path, ["team"], overrides=[LOSS], clouds=False)
    heard = {name: int(np.sum(r.packets["accepted"])) for name, r in (("whole", whole), ("fewer", fewer))}
    assert 0.25 * heard["whole"] < heard["fewer"] < 0.6 * heard["whole"]
    assert fewer.summary["counterfactual"] == [LOSS]
    with pytest.raises(ScenarioError, match="is a log and has happened"):
        with_acoustics(log, ["acoustics.slot_s=9"])
    smaller = uwcoop.run(path, ["mpf"], overrides=["log.capacity_bytes=16"], clouds=False)
    assert smaller.log.slots["capacity_bytes"].max() == 16
    with pytest.raises(LogError, match="at least 1"):
        uwcoop.run(path, ["mpf"], overrides=["log.capacity_bytes=0"], clouds=False)
