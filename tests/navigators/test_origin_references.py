"""The references of the origin state: an independent filter, equalities between them, who is conservative, snapshots."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import xarray as xr

import uwcoop
from uwcoop import scenario
from uwcoop.evaluation import metrics
from uwcoop.experiment.run import native_mission, replay_for, sample_times_ns
from uwcoop.missionlog import MissionLog
from uwcoop.navigators import NAVIGATORS, not_realisable
from uwcoop.world.simulate import simulate

OURS = ("local-only", "cekf", "cekf-received", "nekf", "interleaved", "covariance-intersection")
SHIP, AUV = 0, 1


@cache
def flown(name: str, navigators: tuple[str, ...], seed: int, *overrides: str) -> xr.Dataset:
    return uwcoop.run(name, navigators, seed=seed, overrides=overrides, clouds=False).tracks


def trace(tracks: xr.Dataset, navigator: str, vehicle: int) -> np.ndarray[Any, Any]:
    covariance = tracks["covariance_m2"].sel(navigator=navigator).values[vehicle]
    return np.trace(covariance, axis1=-2, axis2=-1)


# --- cekf against a filter written anew -----------------------------------------------------------------


def rows(log: MissionLog) -> list[tuple[int, int, int, str, dict[str, Any]]]:
    """(time, class, vehicle, kind, fields) of everything that happens, in order; slots launch before what is heard."""
    slots, o = log.slots, log.opportunities
    found = [
        (int(table["t_ns"][k]), 0, int(table["vehicle"][k]), kind, {c: table[c][k] for c in table})
        for kind, table in log.events.items()
        for k in range(len(table["t_ns"]))
    ]
    launches = zip(slots["tol_ns"].tolist(), slots["sender"].tolist(), strict=True)
    found += [(tol_ns, 2, sender, "slot", {}) for tol_ns, sender in launches]
    heard = np.flatnonzero(o["draws"][:, 0] < o["survive_probability"])
    found += [
        (int(o["toa_ns"][k]), 1, int(o["receiver"][k]), "heard", {c: o[c][k] for c in o}) for k in heard
    ]
    return sorted(found, key=lambda row: row[:3])


def rounded(depth_m: float) -> float:
    return round(max(depth_m, 0.0) * 10) / 10


def independent_cekf(log: MissionLog, end_s: float) -> list[tuple[float, np.ndarray[Any, Any]]]:
    """The AUV's position after each of its receptions: ship, AUV and the ship's last launch as one state of twelve."""
    x, P = np.zeros(12), np.zeros((12, 12))
    now, started, depth, heading, dvl = [0, 0], [False, False], [0.0, 0.0], [None, None], [False, False]
    sent_depth, out = 0.0, []

    def advance(v: int, t_ns: int) -> None:
        nonlocal x, P
        dt, s = (t_ns - now[v]) * 1e-9, 4 * v
        now[v] = t_ns
        q = 1e-2 if dvl[v] else 1e-4
        F, Q = np.eye(12), np.zeros((12, 12))
        for a in (0, 1):
            F[s + a, s + a + 2] = dt
            Q[s + a, s + a], Q[s + 2 + a, s + 2 + a] = q * dt**3 / 3, q * dt
            Q[s + a, s + a + 2] = Q[s + a + 2, s + a] = q * dt**2 / 2
        if started[v]:
            x, P = F @ x, F @ P @ F.T + Q

    def update(H: np.ndarray[Any, Any], residual: np.ndarray[Any, Any], R: np.ndarray[Any, Any]) -> None:
        nonlocal x, P
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        keep = np.eye(12) - K @ H
        x, P = x + K @ residual, keep @ P @ keep.T + K @ R @ K.T

    for t_ns, _, v, kind, fields in rows(log):
        if t_ns > end_s * 1e9:
            break
        s = 4 * v
        if kind == "heading":
            heading[v] = (fields["yaw_rad"], fields["sigma_rad"])
        elif kind == "depth":
            depth[v] = fields["depth_m"]
        elif kind == "fix":
            z, R = np.array([fields["e_m"], fields["n_m"]]), np.eye(2) * fields["cov_ee_m2"]
            if not started[v]:
                started[v], now[v] = True, t_ns
                x[s : s + 2] = z
                P[s : s + 4, s : s + 4] = np.diag([R[0, 0], R[1, 1], 1.0, 1.0])
                continue
            advance(v, t_ns)
            H = np.zeros((2, 12))
            H[0, s] = H[1, s + 1] = 1
            update(H, z - x[s : s + 2], R)
        elif kind == "ground_velocity" and heading[v] is not None:
            yaw, sigma = heading[v]
            advance(v, t_ns)
            dvl[v] = True
            c, w = np.cos(yaw), np.sin(yaw)
            z = np.array([[c, -w], [w, c]]) @ [fields["forward_mps"], fields["left_mps"]]
            across = np.array([-z[1], z[0]]) * sigma
            H = np.zeros((2, 12))
            H[0, s + 2] = H[1, s + 3] = 1
            update(H, z - x[s + 2 : s + 4], np.eye(2) * fields["sigma_mps"] ** 2 + np.outer(across, across))
        elif kind == "slot" and v == SHIP:
            advance(v, t_ns)
            sent_depth = rounded(depth[v])
            pick = np.eye(12)
            pick[8:12] = pick[0:4]
            x, P = pick @ x, pick @ P @ pick.T
        elif kind == "heard" and v == AUV:
            advance(v, t_ns)
            slant = (fields["toa_ns"] - fields["tol_ns"]) * 1e-9 * 1500.0
            flat = np.sqrt(slant**2 - (depth[v] - sent_depth) ** 2)
            between = x[4:6] - x[8:10]
            H = np.zeros((1, 12))
            H[0, 4:6] = between / np.linalg.norm(between)
            H[0, 8:10] = -H[0, 4:6]
            update(H, np.array([flat - np.linalg.norm(between)]), np.array([[(slant / flat) ** 2]]))
            out.append((t_ns / 1e9, x[4:6].copy()))
    return out


def test_cekf_equals_a_filter_written_anew() -> None:
    log = simulate(scenario.load("ship-and-auv", ["duration_s=320"]), seed=3)
    expected = independent_cekf(log, 300.0)
    assert len(expected) > 8
    tracks = uwcoop.run(log, ["cekf"], clouds=False).tracks
    for time_s, position in expected:
        at = int(np.argmin(np.abs(tracks.time.values - time_s)))
        np.testing.assert_allclose(tracks.position_m.values[0, AUV, at], position, atol=1e-8)


# --- equalities -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "overrides", "navigator", "reference", "atol_m"),
    [
        ("ship-and-auv", ("acoustics.losses=[]",), "deif", "cekf", 1e-6),
        ("ship-and-auv", ("acoustics.losses=[]",), "cekf-received", "cekf", 1e-6),
        ("ship-and-auv", (), "mdeif", "cekf-received", 1e-6),
        ("ship-and-auv", (), "deif-redundant", "deif", 1e-6),
    ],
)
def test_they_agree_where_they_must(
    name: str, overrides: tuple[str, ...], navigator: str, reference: str, atol_m: float
) -> None:
    tracks = flown(name, (navigator, reference), 2, "duration_s=1450", *overrides)
    heard = tracks.heard.values.all(axis=0)[AUV]
    assert heard.sum() > 40
    one, other = tracks.position_m.values[:, AUV][:, heard]
    assert np.abs(one - other).max() < atol_m
    ratio = trace(tracks, navigator, AUV)[heard] / trace(tracks, reference, AUV)[heard]
    np.testing.assert_allclose(ratio, 1.0, atol=1e-6)


def test_a_ship_that_uses_no_range_is_where_it_was_without_them() -> None:
    tracks = flown("ship-and-auv", OURS, 1, "duration_s=600")
    ship = tracks.position_m.values[:, SHIP]
    for k, name in enumerate(OURS):
        if name != "cekf":
            np.testing.assert_allclose(ship[k], ship[0], atol=1e-9, err_msg=name)
    assert np.abs(ship[OURS.index("cekf")] - ship[0]).max() > 1e-3


def test_who_is_told_less_claims_less() -> None:
    """Variances, not errors: of one mission they follow from the geometry alone."""
    tracks = flown("ship-and-auv", OURS, 1, "duration_s=1450")
    heard = tracks.heard.sel(navigator="cekf").values[AUV]
    best, alone = trace(tracks, "cekf", AUV)[heard], trace(tracks, "local-only", AUV)[heard]
    for name in ("interleaved", "covariance-intersection"):
        own = trace(tracks, name, AUV)[heard]
        assert (own >= best * (1 - 1e-9)).all(), name
        # What is linearised elsewhere is rotated elsewhere: a per cent at most.
        assert (own <= alone * 1.01).all(), name
    assert trace(tracks, "interleaved", AUV)[heard][-1] < 0.9 * alone[-1]
    assert (trace(tracks, "nekf", AUV)[heard] < alone)[5:].all()


def test_two_way_information_comes_back_to_nekf_alone() -> None:
    tracks = flown("four-vehicle-team", OURS, 0, "duration_s=1000")
    at = tracks.time.values > 900
    for vehicle in (1, 2, 3):
        best = trace(tracks, "cekf", vehicle)[at].mean()
        assert trace(tracks, "nekf", vehicle)[at].mean() < best
        for name in ("cekf-received", "interleaved", "covariance-intersection"):
            assert trace(tracks, name, vehicle)[at].mean() > best, name


@pytest.mark.long
def test_consistency_over_fifty_missions() -> None:
    names = ["cekf", "deif", "mdeif", "nekf", "interleaved", "covariance-intersection"]
    result = uwcoop.study("ship-and-auv", 50, names)
    low, high = metrics.anees_bounds(2, 50)
    anees = {
        n: np.mean([r["anees"] for r in result.rows if r["navigator"] == n and r["vehicle"] == "auv"])
        for n in names
    }
    for name in ("cekf", "deif", "mdeif"):
        assert low < anees[name] < high, anees
    for name in ("interleaved", "covariance-intersection"):
        assert anees[name] < high, anees
    team = uwcoop.study("four-vehicle-team", 50, ["cekf", "mdeif", "cekf-received", "nekf", "interleaved"])
    pooled = {n: v["anees"] for n, v in team.summary["variants"][0]["navigators"].items()}
    assert pooled["nekf"] > 1.5 * pooled["cekf"], pooled
    assert pooled["mdeif"] < 1.1 * pooled["cekf-received"], pooled
    low, high = metrics.anees_bounds(2, 50 * 4)
    assert low < pooled["cekf"] < high, pooled
    assert pooled["interleaved"] < high, pooled


# --- as any other navigator ---------------------------------------------------------------------------------


def test_resuming_from_a_snapshot_equals_the_uninterrupted_mission() -> None:
    log = simulate(scenario.load("four-vehicle-team", ["duration_s=150"]), seed=5)
    mission, samples = native_mission(log), sample_times_ns(log)
    for name in OURS:
        whole = replay_for(log, mission, name, None, 7, samples)
        whole.run()
        expected = whole.tracks()
        for cut_s in (0.0, 20.004, 77.7):
            first, second = (replay_for(log, mission, name, None, 7, samples) for _ in range(2))
            first.run(round(cut_s * 1e9))
            second.restore(first.snapshot())
            second.run()
            got = second.tracks()
            for key in ("mean_m", "covariance_m2", "rejected"):
                assert got[key].tobytes() == expected[key].tobytes(), (name, cut_s, key)


def test_tables_mark_who_is_told_what_no_vehicle_knows() -> None:
    assert not_realisable(["cekf", "cekf-received", "nekf", "my-own"]) == {"cekf", "cekf-received"}
    assert all(NAVIGATORS[name].listed_only for name in OURS)


def test_packets_of_beliefs_fit_small_frames_when_asked() -> None:
    overrides = ["duration_s=300", "acoustics.packet=32", "acoustics.modem=micromodem-32"]
    result = uwcoop.run("ship-and-auv", ["nekf"], overrides=overrides, clouds=False)
    assert result.summary["navigators"]["nekf"]["packet_bytes"]["max"] == 15
    # Decoding ends seconds after arrival: the range still counts where the vehicle was then.
    assert result.tracks.heard.values[0, AUV].sum() > 4
    error = metrics.errors(result.tracks).values[0, AUV]
    assert error[-1] < 5.0


@pytest.mark.parametrize(
    ("form", "most_m", "share"), [("32", 0.02, 0.03), ("64", 0.01, 0.01), ("256", 0.01, 0.01)]
)
@pytest.mark.parametrize("runs", [1, pytest.param(20, marks=pytest.mark.long)])
def test_what_rounding_costs(
    study_module: Callable[[str], ModuleType], form: str, most_m: float, share: float, runs: int
) -> None:
    """Against float64 packets of the same fields: little, and never surer than they are."""
    off_m, error_m, mean, least, _ = study_module("origin_state").rounding_cost(
        "ship-and-auv", form, range(runs)
    )
    assert off_m <= most_m
    assert error_m <= most_m
    assert mean <= 1 + share
    assert least >= 0.995
