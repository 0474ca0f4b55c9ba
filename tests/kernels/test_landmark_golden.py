"""Kernels of the alternating landmark method against an independent implementation's inputs and outputs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from uwcoop import kernels

Case = dict[str, np.ndarray[Any, Any]]
# Table 4 of the paper and its outlier thresholds.
SIGMA = (0.66, math.radians(6.0), math.radians(1.0))
THRESHOLD = (3.0, 3.0, 3.0)
CIRCULAR = [False, False, True, False, True, True]


@pytest.fixture
def golden(golden_cases: Any) -> Any:
    return golden_cases("landmark")


def near(actual: Any, expected: Any, atol: float = 1e-9) -> None:
    assert_allclose(actual, expected, rtol=0, atol=atol)


def near_poses(actual: Any, expected: Any, angles: tuple[int, ...] = (2, 5)) -> None:
    """Rows of poses; angles modulo a turn."""
    difference = np.asarray(actual) - np.asarray(expected)
    for column in angles:
        difference[:, column] = (difference[:, column] + np.pi) % (2 * np.pi) - np.pi
    near(difference, np.zeros_like(difference))


def test_prediction(golden: Any) -> None:
    case = golden("01_predict")
    particles = case["P0"]
    for t in range(len(case["vhat"])):
        normals = np.column_stack([case["eps_v"][t], case["eps_w"][t]])
        particles = kernels.landmark_predict(
            particles, case["vhat"][t], float(case["what"][t]), float(case["dt"]),
            float(case["sigma_v"][t]), float(case["sigma_w"]), normals,
        )  # fmt: skip
        if t == 0:
            near_poses(particles, case["P_after1"])
    near_poses(particles, case["P_after50"])


@pytest.mark.parametrize("gate", ["joint", "separate", "none", "mixture"])
def test_offsets_and_likelihood(golden: Any, gate: str) -> None:
    case = golden("02_likelihood")
    for k, measured in enumerate(case["Z"]):
        offsets = kernels.landmark_offsets(case["P"], case["Mt"], measured)
        present = ~np.isnan(measured)
        near(offsets[present], case["offsets"][k][present])
        assert np.isnan(offsets[~present]).all()
        ml, lm, most = kernels.landmark_log_likelihood(offsets, SIGMA, THRESHOLD, gate)
        for log, name in ((ml, "LML"), (lm, "LLM"), (ml + lm, "L")):
            expected = case[f"{name}_{gate}"][k]
            assert_allclose(np.exp(log), expected, rtol=1e-9, atol=1e-9 * expected.max())
        assert math.exp(most) == pytest.approx(float(case[f"Lmax_{gate}"][k]), rel=1e-12)


def test_directions_a_turn_further_are_the_same(golden: Any) -> None:
    case = golden("02_likelihood")
    first, turned = (kernels.landmark_offsets(case["P"], case["Mt"], case["Z"][k]) for k in (0, 11))
    near(first, turned)


def test_systematic_resampling(golden: Any) -> None:
    case = golden("03_resample")
    for u0, expected in zip(case["u0"], case["idx"], strict=True):
        assert_array_equal(kernels.systematic_resample(case["w"], float(u0), 100), expected)
    assert_array_equal(kernels.systematic_resample(case["w_onehot"], 0.3, 50), case["idx_onehot"])
    assert any(
        np.array_equal(kernels.systematic_resample(case["w"], float(u0), 37), case["idx_m37"])
        for u0 in (*case["u0"], 0.5)
    )


@pytest.mark.parametrize("reading", ["linear", "log"])
def test_monitor(golden: Any, reading: str) -> None:
    case = golden("04_monitor")
    mean, most = np.log(case["Lbar"]), np.log(case["Lmax"])
    low, fire = kernels.landmark_monitor(mean, most, float(case["k"]), int(case["a"]), reading)
    assert_array_equal(low, case[f"low_{reading}"])
    assert_array_equal(fire, case[f"fire_{reading}"])
    new = [
        kernels.landmark_new_particles(int(case["n"]), float(case["r"]), a, b)
        for a, b in zip(mean, most, strict=True)
    ]
    assert_array_equal(new, case["n_new"])


def test_an_observation_with_reconstruction(golden: Any) -> None:
    case = golden("05_observe_keep")
    offsets = kernels.landmark_offsets(case["P"], case["Mt"], case["z"])
    ml, lm, most = kernels.landmark_log_likelihood(offsets, SIGMA, THRESHOLD, "joint")
    assert_allclose(np.exp(ml + lm), case["L"], rtol=1e-9)
    mean = math.log(np.exp(ml + lm).mean())
    lows = np.append(np.where(case["prior_low"], 0.0, most), mean)
    _, fire = kernels.landmark_monitor(lows, np.full(len(lows), most), 0.6, 2, "linear")
    assert bool(fire[-1])
    new = kernels.landmark_new_particles(len(ml), 0.5, mean, most)
    assert new == int(case["n_new"])
    particles, replaced, ancestors = kernels.landmark_reconstruct(
        case["P"], case["Mt"], ml + lm, case["z"], SIGMA, new, case["eps_rec"], float(case["u0"])
    )
    assert_array_equal(replaced, np.sort(case["replaced"]))
    assert_array_equal(ancestors, case["idx"])
    near_poses(particles, case["P_out"])


def test_polar_form(golden: Any) -> None:
    case = golden("08_gmm")
    polar = kernels.landmark_polar(case["P"])
    near_poses(polar, case["polar"], (2, 4, 5))
    near_poses(kernels.landmark_from_polar(polar), case["back"])


@pytest.mark.parametrize("modes", [1, 2, 3])
def test_mixtures_reach_the_optimum(golden: Any, modes: int) -> None:
    case = golden("08_gmm")
    count = len(case["polar"])
    fitted = kernels.fit_gaussian_mixture(
        np.full(count, 1 / count), case["polar"], CIRCULAR, modes,
        iterations=3000, tolerance=1e-14, first=tuple(case[f"{name}{modes}"] for name in ("w", "mu", "S")),
    )  # fmt: skip
    order, expected = np.argsort(fitted["means"][:, 3]), np.argsort(case[f"mu{modes}"][:, 3])
    near(fitted["weights"][order], case[f"w{modes}"][expected], 1e-5)
    difference = fitted["means"][order] - case[f"mu{modes}"][expected]
    difference[:, CIRCULAR] = (difference[:, CIRCULAR] + np.pi) % (2 * np.pi) - np.pi
    near(difference, np.zeros_like(difference), 1e-5)
    near(fitted["covariances"][order], case[f"S{modes}"][expected], 1e-5)
    for name, key in (("log_likelihood", "ll"), ("bic", "bic"), ("aic", "aic")):
        assert fitted[name] == pytest.approx(float(case[f"{key}{modes}"]), abs=1e-3)
    assert fitted["points"] == count
    # From k-means++ it is at least as likely: three modes on two clusters have more than one optimum.
    best = kernels.fit_gaussian_mixture(
        np.full(count, 1 / count), case["polar"], CIRCULAR, modes, starts=20, iterations=1000, tolerance=1e-12
    )
    assert best["log_likelihood"] > float(case[f"ll{modes}"]) - 1e-3


def test_bic_takes_the_two_clusters(golden: Any) -> None:
    case = golden("08_gmm")
    count = len(case["polar"])
    best = kernels.fit_gaussian_mixture(
        np.full(count, 1 / count), case["polar"], CIRCULAR, 4, choose_by="bic"
    )
    assert len(best["weights"]) == 2


@pytest.mark.parametrize("t", range(5))
def test_packets_of_format_1(golden: Any, t: int) -> None:
    case = golden("09_packet")
    packet = kernels.encode_exchange(
        case[f"in_w_{t}"], case[f"in_mu_{t}"], case[f"in_S_{t}"],
        packet_bytes=len(case[f"bytes_{t}"]), packet_format=1, sequence=5, sender=0, tol_ns=0,
    )  # fmt: skip
    assert packet == case[f"bytes_{t}"].tobytes()
    got = kernels.decode_exchange(packet, packet_format=1, landmark_m=case["prior_L"], sender=0, tol_ns=0)
    near(got["weights"], case[f"w_{t}"])
    near_poses(got["means"], case[f"mu_{t}"], (2, 4, 5))
    near(got["covariances"], case[f"S_{t}"])
    particles = kernels.expand_exchange(got["weights"], got["means"], got["covariances"], case["eps"])
    near_poses(particles, case[f"P_{t}"])
    assert got["sequence"] == (None if t == 0 else 5)
