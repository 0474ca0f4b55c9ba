"""Kernels against an independent implementation's inputs and outputs, at its tolerances (1e-9 absolute)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from uwcoop import kernels

Case = dict[str, np.ndarray[Any, Any]]


@pytest.fixture
def golden(golden_cases: Any) -> Any:
    return golden_cases("dmpf")


def grid(case: Case) -> tuple[Any, float, float, float]:
    return case["grid"], float(case["e0"]), float(case["n0"]), float(case["res"])


def near(actual: Any, expected: Any) -> None:
    assert_allclose(actual, expected, rtol=0, atol=1e-9, equal_nan=True)


def test_depths_and_gradients(golden: Any) -> None:
    case = golden("map")
    near(kernels.bilinear_depth(*grid(case), case["query"]), case["depth"])
    near(kernels.bilinear_gradient(*grid(case), case["query"]), case["grad"])


@pytest.mark.parametrize("name", ["predict_k2", "predict_k4"])
def test_time_update(golden: Any, name: str) -> None:
    case = golden(name)
    position, kalman, covariance = case["pos0"], case["kf0"], case["P0"]
    for t, control in enumerate(case["U"]):
        # The golden control is a displacement per second; both agree on metres per second.
        position, kalman, covariance = kernels.propagate(
            position,
            kalman,
            covariance,
            control,
            float(case["dt"]),
            case["Qpf"],
            case["Qkf"],
            case["noise"][t],
        )
        near(position, case["pos"][t])
        near(kalman, case["kf"][t])
        near(covariance, case["P"][t])


def test_terrain_likelihood_and_offset(golden: Any) -> None:
    case = golden("terrain")
    near(
        kernels.terrain_log_likelihood(
            *grid(case), case["pos"], case["seg"], case["dz"], float(case["sigma"]), -12.5
        ),
        case["loglik"],
    )
    depths = kernels.bilinear_depth(*grid(case), case["pos"])
    log_likelihood, offset, variance = kernels.offset_update(
        float(case["off_z"]), depths, case["off_b0"], case["off_Pb0"],
        float(case["off_sigma"]), float(case["off_qb"]), 0.0, 1.0, np.inf,
    )  # fmt: skip
    near(log_likelihood, case["off_loglik"])
    near(offset, case["off_b"])
    near(variance, case["off_Pb"])


def test_range_likelihoods(golden: Any) -> None:
    case = golden("range")
    belief = (case["pos"], case["m"], case["P"], float(case["R"]), float(case["sigR"]))
    samples = case["m"] + case["noise"] @ np.linalg.cholesky(case["P"]).T
    eq17 = kernels.range_log_likelihood(*belief, "eq17", samples)
    assert_allclose(np.exp(-eq17), np.exp(-case["ll_eq17"]), rtol=1e-10)
    near(kernels.range_log_likelihood(*belief, "gaussian"), case["ll_gauss"])


def test_a_mixture_of_two_modes(golden: Any) -> None:
    case = golden("range")
    count = len(case["pos"])
    shares, means, covariances = kernels.fit_mixture(
        np.full(count, 1 / count), case["pos"], int(case["gmm_k"]), int(case["gmm_iters"])
    )
    order, expected = np.argsort(means[:, 0]), np.argsort(case["gmm_mu"][:, 0])
    near(shares[order], case["gmm_pi"][expected])
    near(means[order], case["gmm_mu"][expected])
    assert_allclose(covariances[order], case["gmm_S"][expected], rtol=1e-11)


def test_weights_moments_entropy_and_resampling(golden: Any) -> None:
    case = golden("resample")
    weights = kernels.normalize(case["logw"])
    near(weights, case["w"])
    assert kernels.effective_sample_size(weights) == pytest.approx(float(case["ess"]), abs=1e-9)
    mean, covariance = kernels.moments(weights, case["pos"])
    near(mean, case["mean"])
    near(covariance, case["cov"])
    kalman_mean, spread = kernels.moments(weights, case["kf"])
    near(kalman_mean, case["kf_mean"])
    near(spread + case["Pkf"], case["kf_cov"])
    sigma = float(case["ent_sigma"])
    prior = kernels.kernel_entropy(np.full(len(weights), 1 / len(weights)), case["pos"], sigma)
    posterior = kernels.kernel_entropy(weights, case["pos"], sigma)
    near([prior, posterior, prior - posterior], [case["H_prior"], case["H_post"], case["MI"]])
    ancestors, counts = kernels.residual_resample(weights, case["u"])
    assert_array_equal(ancestors, case["parent"])
    assert_array_equal(counts, case["count"])
    near(
        kernels.roughen(
            case["pos"][ancestors], ancestors, counts, float(case["rough_var"]), case["rough_noise"]
        ),
        case["rough_pos"],
    )
    joint = np.column_stack([case["pos"], case["lw_b"], case["kf"]])
    moved = kernels.liu_west(joint, float(case["lw_h"]), case["lw_noise"])
    near(moved, np.column_stack([case["lw_pos"], case["lw_bout"], case["lw_kf"]]))


def test_a_whole_mission_of_three_vehicles(golden: Any) -> None:
    """Algorithm 1 composed of kernels, with the reference's draws: weights, estimates and resampling instants."""
    case = golden("mission_faithful")
    vehicles, instants = case["U"].shape[:2]
    count, window = case["inj_init_u"].shape[1], int(case["ell"])
    team = [_Vehicle(case, v, count) for v in range(vehicles)]
    for t in range(1, instants + 1):
        for v, vehicle in enumerate(team):
            vehicle.predict(case["U"][v, t - 1], case["inj_pred"][t - 1, v])
            vehicle.terrain(case, case["Z"][v, : t + 1], window)
        if t % 3 == 0:
            sender = (t // 3 - 1) % vehicles
            mean, covariance = team[sender].moments()
            samples = mean + case["inj_cloud"][t - 1] @ np.linalg.cholesky(covariance).T
            for v, vehicle in enumerate(team):
                if v != sender:
                    vehicle.range(mean, covariance, case["R"][t, sender, v], samples)
        for v, vehicle in enumerate(team):
            mean, covariance = vehicle.moments()
            near(mean, case["out_est"][v, t - 1])
            near(covariance, case["out_cov"][v, t - 1])
            assert vehicle.ess() == pytest.approx(case["out_neff"][v, t - 1], abs=1e-7)
            resampled = vehicle.resample(case["inj_res_u"][t - 1, v], case["inj_rough"][t - 1, v, :, :2])
            assert resampled == bool(case["out_resampled"][v, t - 1])
    for v, vehicle in enumerate(team):
        near(vehicle.position, case["out_final_pos"][v])
        near(vehicle.kalman, case["out_final_kf"][v])
        near(vehicle.weights, case["out_final_w"][v])
        near(vehicle.covariance, case["out_final_Pkf"][v])


class _Vehicle:
    def __init__(self, case: Case, v: int, count: int) -> None:
        u0, u1 = case["inj_init_u"][v].T
        disc = 10 * np.sqrt(u0) * np.array([np.cos(2 * np.pi * u1), np.sin(2 * np.pi * u1)])
        self.position = case["fix"][v] + disc.T
        self.kalman = np.zeros((count, 2))
        self.covariance = 0.0025 * np.eye(2)
        self.log_weights = np.full(count, -np.log(count))
        self.weights = np.full(count, 1 / count)
        self.track = [np.zeros(2)]

    def predict(self, control: Any, normals: Any) -> None:
        self.track.append(self.track[-1] + control + self.weights @ self.kalman)
        self.position, self.kalman, self.covariance = kernels.propagate(
            self.position, self.kalman, self.covariance, control, 1.0,
            0.05**2 * np.eye(2), 0.01**2 * np.eye(2), normals,
        )  # fmt: skip

    def terrain(self, case: Case, depths: Any, window: int) -> None:
        track, depths = np.array(self.track[-window - 1 :]), depths[-window - 1 :]
        self._weigh(
            kernels.terrain_log_likelihood(
                *grid(case), self.position, track - track[-1], np.diff(depths), float(case["sigma"]), -12.5
            )
        )

    def range(self, mean: Any, covariance: Any, measured_m: float, samples: Any) -> None:
        self._weigh(
            kernels.range_log_likelihood(
                self.position, mean, covariance, float(measured_m), 1.0, "eq17", samples
            )
        )

    def _weigh(self, log_likelihood: Any) -> None:
        self.weights = kernels.normalize(self.log_weights + log_likelihood)
        self.log_weights = np.log(np.maximum(self.weights, 1e-300))

    def moments(self) -> tuple[Any, Any]:
        return kernels.moments(self.weights, self.position)

    def ess(self) -> float:
        return float(kernels.effective_sample_size(self.weights))

    def resample(self, uniforms: Any, normals: Any) -> bool:
        if self.ess() > 2 * len(self.weights) / 3:
            return False
        ancestors, counts = kernels.residual_resample(self.weights, uniforms)
        self.position = kernels.roughen(self.position[ancestors], ancestors, counts, 2.0, normals)
        self.kalman = self.kalman[ancestors]
        self.weights = np.full(len(ancestors), 1 / len(ancestors))
        self.log_weights = np.log(self.weights)
        return True
