"""Pose-graph kernels against the golden cases of an independent implementation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from uwcoop import kernels


@pytest.fixture
def golden(reference: Path) -> Path:
    return reference / "golden" / "origin"


def relative(found: object, expected: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.asarray(found) - expected) / np.linalg.norm(expected))


def graph(case: NDArray[np.float64], nodes: int, origins: list[int], step_s: float) -> dict[str, object]:
    times = np.arange(1.0, len(case["gps_z"]))
    return kernels.pose_graph(
        case["mu0"],
        case["P0"],
        float(case["q"]),
        times,
        case["gps_z"][1:],
        float(case["gps_sd"]),
        (np.arange(nodes) + 1.0) * step_s,
        origins,
    )


def test_equation_6(golden: Path) -> None:
    case = np.load(golden / "g1_eq6.npz")
    solved = kernels.origin_delta(case["Lc"], case["ec"], case["Ls"], case["es"])
    assert relative(solved["matrix"], case["dLam"]) < 1e-11
    assert relative(solved["vector"], case["deta"]) < 1e-11
    assert relative(solved["omega"], case["Omega"]) < 1e-11
    assert relative(solved["nu"], case["nu"]) < 1e-11
    assert 1e-6 < solved["health"] < 1


def test_equation_6_adds_up_to_the_whole_graph(golden: Path) -> None:
    case = np.load(golden / "g1_eq6.npz")
    solved = kernels.origin_delta(case["Lc"], case["ec"], case["Ls"], case["es"])
    matrix, vector = np.zeros((16, 16)), np.zeros(16)
    matrix[4:, 4:], vector[4:] = case["Lam2"], case["eta2"]
    matrix[:8, :8] += solved["matrix"]
    vector[:8] += solved["vector"]
    assert relative(matrix, case["Lam3"]) < 1e-11
    assert relative(vector, case["eta3"]) < 1e-11


def test_own_graph_gives_the_same_statistics(golden: Path) -> None:
    case = np.load(golden / "g1_eq6.npz")
    own = graph(case, 4, [0, 0, 0, 0], float(case["step"]))
    assert relative(own["matrix"], case["Lam3"]) < 1e-11
    assert relative(own["vector"], case["eta3"]) < 1e-11
    assert relative(own["packet_matrices"][3], case["Ls"]) < 1e-11
    assert relative(own["packet_vectors"][3], case["es"]) < 1e-11


def test_schur_marginalisation(golden: Path) -> None:
    case = np.load(golden / "g1_eq6.npz")
    keep = [0, 1, 2, 3, 12, 13, 14, 15]
    matrix, vector = kernels.schur_marginalize(case["Lam3"], case["eta3"], keep)
    assert relative(matrix, case["Ls"]) < 1e-11
    assert relative(vector, case["es"]) < 1e-11
    # One pose of two goes another way: fixed blocks.
    fixed = kernels.schur_marginalize(matrix, vector, [0, 1, 2, 3])
    backwards = kernels.schur_marginalize(matrix, vector, [3, 2, 1, 0])
    assert relative(backwards[0][::-1, ::-1], fixed[0]) < 1e-12
    assert relative(backwards[1][::-1], fixed[1]) < 1e-12


def test_lost_packets(golden: Path) -> None:
    case = np.load(golden / "g2_loss.npz")
    got = np.flatnonzero(case["received"])
    rebuilt = kernels.reconstruct_graph(
        list(got), [0] * len(got), case["packet_Lam"][got], case["packet_eta"][got]
    )
    assert rebuilt["ids"] == case["expect_ids"].tolist()
    assert set(rebuilt["methods"][2:]) == {"equation 6"}
    assert relative(rebuilt["matrix"], case["expect_Lam"]) < 1e-10
    assert relative(rebuilt["vector"], case["expect_eta"]) < 1e-10


def test_shifting_origin(golden: Path) -> None:
    case = np.load(golden / "g3_shift.npz")
    got = np.flatnonzero(case["received"])
    rebuilt = kernels.reconstruct_graph(
        list(got), case["origin"][got].tolist(), case["packet_Lam"][got], case["packet_eta"][got]
    )
    assert rebuilt["ids"] == case["expect_ids"].tolist()
    assert relative(rebuilt["matrix"], case["expect_Lam"]) < 1e-10
    assert relative(rebuilt["vector"], case["expect_eta"]) < 1e-10
    own = graph(case, 40, case["origin"].tolist(), float(case["step"]))
    assert relative(own["packet_matrices"], case["packet_Lam"]) < 1e-10


def test_delta_information(golden: Path) -> None:
    case = np.load(golden / "g4_deif.npz")
    own = graph(case, 6, [0] * 6, float(case["step"]))
    assert relative(own["prior_matrix"], case["Lam0"]) < 1e-12
    assert relative(own["prior_vector"], case["eta0"]) < 1e-12
    assert relative(own["delta_matrices"], case["dLam"]) < 1e-12
    assert relative(own["delta_vectors"], case["deta"]) < 1e-12
    assert relative(own["matrix"], case["expect_Lam"]) < 1e-12
    assert relative(own["vector"], case["expect_eta"]) < 1e-12


def test_filtered_error_model(golden: Path) -> None:
    case = np.load(golden / "g6_fem.npz")
    solved = kernels.filtered_error_delta(case["Lc"], case["ec"], case["Ls"], case["es"])
    assert relative(solved["transition"], case["G"]) < 1e-9
    assert relative(solved["noise"], case["W"]) < 1e-9
    assert relative(solved["matrix"], case["dLam"]) < 1e-9
    assert relative(solved["vector"], case["deta"]) < 1e-9
    assert relative(solved["transition"], case["Phi_exact"]) < 1e-9


def rounded(case: NDArray[np.float64], k: int, root0: NDArray[np.float64] | None) -> dict[str, object]:
    """Packet k of the case, encoded and decoded."""
    size = 4 if k == 0 else 8
    joint = np.linalg.inv(case["pL"][k][:size, :size])
    mean = joint @ case["pe"][k][:size]
    tie = {}
    if root0 is not None:
        first = np.linalg.inv(case["pL"][0][:4, :4])
        tie = {"origin_covariance": root0 @ root0.T, "transition": joint[:4, 4:] @ np.linalg.inv(first)}
    link = {"packet": "64", "sender": 0, "tol_ns": k}
    packet = kernels.encode_graph(mean[:4], joint[:4, :4], **tie, sequence=k, origin=0, depth_m=0.0, **link)
    return kernels.decode_graph(packet, **link)


def test_rounded_packets(golden: Path) -> None:
    case = np.load(golden / "g8_quant.npz")
    for k in range(4):
        found = rounded(case, k, None if k == 0 else case["Lq"][0])
        assert np.array_equal(np.round(found["mean"] * 1000), np.round(case["m"][k] * 1000))
        assert found["bits"] == case["bits"][k]
        covered = found["root"] @ found["root"].T
        assert np.linalg.eigvalsh(covered - case["P"][k]).min() > 0
        # Tighter than, or as tight as, the reference; the correlations are the reference's own.
        assert np.linalg.det(covered) <= np.linalg.det(case["Lq"][k] @ case["Lq"][k].T) * (1 + 1e-12)
        sigma, expected = np.sqrt(np.diag(covered)), case["Lq"][k] @ case["Lq"][k].T
        expected /= np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert np.allclose(covered / np.outer(sigma, sigma), expected, rtol=0, atol=1e-12)
        if k:
            # M is told in the scale of the covariance as sent; in the reference's scale it is the reference's.
            step = np.abs(case["M"][k]).max() / 64
            in_reference = np.linalg.solve(case["Lq"][k], found["root"] @ found["correlation"])
            assert np.allclose(in_reference, case["M"][k], rtol=0, atol=2 * step)
            assert np.linalg.norm(found["correlation"], 2) <= 1
