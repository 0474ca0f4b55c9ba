"""The team's Cramér-Rao bound against an implementation of its own in NumPy, and beside what navigators reach."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import uwcoop
from uwcoop.evaluation import metrics
from uwcoop.evaluation.cramer_rao import BOUNDS, bound_covariance_m2, bound_m, bounds_of
from uwcoop.experiment.run import sample_times_ns
from uwcoop.missionlog import MissionLog
from uwcoop.navigators import DRIFT_PRESETS, MpfOptions, options_of
from uwcoop.scenario import load
from uwcoop.world.simulate import simulate

Floats = NDArray[np.float64]
SHORT = ["duration_s=120"]


def whole_seconds(log: MissionLog) -> NDArray[np.int64]:
    return np.arange(0, log.duration_ns + 1, 1_000_000_000, dtype=np.int64)


def slope(log: MissionLog, at: Floats) -> Floats:
    """Gradient of the bilinear surface, by differences inside the cell."""
    assert log.chart is not None
    h = 1e-4 * log.chart.cell_m
    ahead = [log.chart.depth_at((at + h * axis)[None])[0] for axis in np.eye(2)]
    behind = [log.chart.depth_at((at - h * axis)[None])[0] for axis in np.eye(2)]
    return (np.array(ahead) - behind) / (2 * h)


def in_information_form(
    log: MissionLog, options: dict[str, Any], seconds: int, current: float, offset: float
) -> Floats:
    """The recursion of Tichavský et al. as they print it, J = (Q + F J⁻¹ Fᵀ)⁻¹ + Σ HᵀR⁻¹H, over full matrices.

    Currents and tides of two vehicles correlate by `current` and `offset`.
    """
    assert log.chart is not None
    assert log.truth is not None
    V = len(log.vehicles)
    where = log.truth["position_m"].to_numpy()
    time = log.truth["time"].to_numpy()
    drift = {k: options[k] for k in options if k.startswith("sigma_")}
    prior = np.array([
        25.0, 25.0, options["sigma_offset0_m"] ** 2, *[drift["sigma_current0_mps"] ** 2] * 2
    ])  # fmt: skip
    fix = log.events["fix"]
    prior[:2] = fix["cov_ee_m2"][0], fix["cov_nn_m2"][0]
    walk = np.array([
        *[drift["sigma_position_m_per_sqrt_s"] ** 2] * 2, 0.0, *[drift["sigma_current_mps_per_sqrt_s"] ** 2] * 2
    ])  # fmt: skip
    together = np.kron(np.ones((V, V)) - np.eye(V), np.diag([0, 0, offset, current, current])) + np.eye(5 * V)
    J = np.linalg.inv(together * np.tile(prior, V))

    def stepped(J: Floats, dt: float, extra: Floats) -> Floats:
        F = np.eye(5 * V)
        for v in range(V):
            F[5 * v, 5 * v + 3] = F[5 * v + 1, 5 * v + 4] = dt
        Q = together * np.tile(walk * dt, V) + np.diag(extra)
        return np.linalg.inv(Q + F @ np.linalg.inv(J) @ F.T)

    def told(H: Floats, variance: float) -> Floats:
        return np.outer(H, H) / variance

    offset_walk = np.tile([0, 0, options["sigma_offset_m_per_sounding"] ** 2, 0, 0], V)
    o = log.opportunities
    arrived = np.flatnonzero(o["draws"][:, 0] < o["survive_probability"])
    moments = [(int(o["toa_ns"][k]), k) for k in arrived]
    moments += [(1_000_000_000 * s, -1) for s in range(seconds + 1)]
    found, now = [], 0.0
    sensed = log.events["water_depth"]
    for t_ns, k in sorted(moments):
        t = t_ns / 1e9
        if t > now:
            J, now = stepped(J, t - now, np.zeros(5 * V)), t
        if k < 0:
            J = np.linalg.inv(np.diag(offset_walk) + np.linalg.inv(J))
            for v in range(V):
                assert np.any((sensed["t_ns"] == t_ns) & (sensed["vehicle"] == v))
                H = np.zeros(5 * V)
                H[5 * v : 5 * v + 3] = *slope(log, where[v, round(t)]), 1.0
                J = J + told(H, 0.05**2)
            P = np.linalg.inv(J)
            found.append([[P[5 * v, 5 * v], P[5 * v, 5 * v + 1], P[5 * v + 1, 5 * v + 1]] for v in range(V)])
            continue
        s, r, tol = int(o["sender"][k]), int(o["receiver"][k]), o["tol_ns"][k] / 1e9
        ends = [[np.interp(u, time, where[w, :, a]) for a in range(2)] for w, u in ((s, tol), (r, t))]
        unit = np.subtract(ends[1], ends[0])
        unit = unit / np.hypot(*unit)
        H = np.zeros(5 * V)
        H[5 * r : 5 * r + 2] = unit
        H[5 * s : 5 * s + 2] = -unit
        H[5 * s + 3 : 5 * s + 5] = unit * (t - tol)
        J = J + told(H, 1.0)
    return np.array(found).transpose(1, 0, 2)


@pytest.mark.parametrize(("difference", "offset_difference_m"), [(1.0, None), (0.1, 0.05), (0.5, 0.4)])
def test_the_core_agrees_with_the_information_form(
    difference: float, offset_difference_m: float | None
) -> None:
    told = [f"navigator.team.current_difference={difference}"]
    told += [f"navigator.team.offset_difference_m={offset_difference_m}"] if offset_difference_m else []
    alone = [] if offset_difference_m else ["navigator.team={}"]
    log = simulate(load("st-john-drift", ["duration_s=60", *alone, *told]), 3)
    chosen = options_of("mpf", log.setup)
    assert isinstance(chosen, MpfOptions)
    # A chart whose error is not correlated: the offset walks by 0.002 m.
    options = {**chosen.model_dump(), **DRIFT_PRESETS[chosen.drift], "sigma_offset_m_per_sounding": 0.002}
    options |= chosen.model_dump(exclude_none=True)
    current = 1 - difference**2 / 2 if difference < 1 else 0.0
    offset = 1 - offset_difference_m**2 / 2 if offset_difference_m else 0.0
    want = in_information_form(log, options, 60, current, offset)
    got = bound_covariance_m2(log, whole_seconds(log))
    assert got is not None
    assert got.shape == (3, 61, 3)
    # Off the nodes the gradient jumps from cell to cell; the differences above stay in one.
    np.testing.assert_allclose(got, want, rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(got[..., 0] + got[..., 2]), bound_m(log, whole_seconds(log)))


def test_what_more_there_is_to_know_shows() -> None:
    log = simulate(load("flat-bay", SHORT), 1)
    at = whole_seconds(log)
    rms = {
        (terrain, ranges): math.sqrt(np.mean(np.square(bound_m(log, at, terrain=terrain, ranges=ranges)[:, 50:])))
        for terrain in (False, True)
        for ranges in (False, True)
    }  # fmt: skip
    assert rms[True, True] < rms[True, False] < rms[False, False]
    assert rms[True, True] < rms[False, True] < rms[False, False]
    spread = bound_m(log, at, linearised=True)
    assert spread is not None
    assert math.sqrt(np.mean(spread[:, 50:] ** 2)) > rms[True, True]
    lossless = replace(
        log, opportunities=log.opportunities | {"draws": np.zeros_like(log.opportunities["draws"])}
    )
    every = bound_m(lossless, at)
    assert every is not None
    assert math.sqrt(np.mean(every[:, 50:] ** 2)) < rms[True, True]


def test_no_chart_or_no_truth_no_bound() -> None:
    log = simulate(load("st-john-drift", ["duration_s=30"]), 0)
    for without in (replace(log, chart=None), replace(log, truth=None)):
        assert bound_m(without, whole_seconds(log)) is None
        assert bounds_of(without, whole_seconds(log)) == {}


def test_a_run_carries_its_bounds_into_tracks_and_summary() -> None:
    result = uwcoop.run("st-john-drift", ["mpf-terrain-only"], seed=2, overrides=SHORT, clouds=False)
    for name in BOUNDS:
        assert result.tracks[name].dims == ("vehicle", "time")
        assert result.tracks[name].attrs["units"] == "m"
        assert np.isfinite(result.tracks[name].values).all()
    np.testing.assert_array_equal(result.tracks["bound_m"], bound_m(result.log, sample_times_ns(result.log)))
    values = result.summary["navigators"]["mpf-terrain-only"]["vehicles"]["V1"]
    own = result.tracks.sel(vehicle="V1", time=np.arange(51.0, 121.0))
    rms = math.sqrt(float((own["bound_m"] ** 2).mean()))
    assert values["rmse_over_bound"] == pytest.approx(values["rmse_m"] / rms)
    assert values["rmse_over_linearised_bound"] < values["rmse_over_bound"]


def ratio(runs: int) -> tuple[float, float]:
    """Root mean square of the error over that of the bound, of mpf's and of dead reckoning's estimates."""
    errors: dict[str, list[float]] = {"mpf": [], "dead-reckoning": []}
    bounds = []
    for seed in range(runs):
        result = uwcoop.run(
            "st-john-drift", list(errors), seed=seed, overrides=["duration_s=300", "navigator.all.particles=1500"],
            clouds=False,
        )  # fmt: skip
        late = result.tracks["time"].values > 50
        bounds.append(float((result.tracks["bound_m"].values[:, late] ** 2).mean()))
        for name, own in errors.items():
            own.append(float((metrics.errors(result.tracks).sel(navigator=name).values[:, late] ** 2).mean()))
    return tuple(math.sqrt(np.median(own) / np.median(bounds)) for own in errors.values())  # type: ignore[return-value]


def test_a_navigator_is_not_better_than_the_bound() -> None:
    mpf, dead = ratio(4)
    assert 0.9 < mpf < 5
    assert dead > mpf


@pytest.mark.long
def test_no_navigator_is_better_than_the_bound_over_many_missions() -> None:
    mpf, dead = ratio(50)
    assert 1.0 <= mpf < 2.5
    assert dead > 3
