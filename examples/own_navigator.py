"""A navigator of one's own beside `mpf` in one run: a Kalman filter that linearises the chart over its own spread.

State: east, north, current east, current north. A sounding is predicted from the charted depths at the mean and at four
points around it. Their differences give the slope, and what does not fit that slope is added to the sounding's noise
(statistical linearisation). The filter sends nothing and uses no ranges.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import uwcoop
from uwcoop.navigators import Context, Custom

Floats = NDArray[np.float64]
POSITION_M_PER_SQRT_S = 0.05
CURRENT_MPS_PER_SQRT_S = 0.01
TIDE_SIGMA_M = 0.3  # the soundings' common error; this filter has no state for it
GATE_SIGMAS = 4.0


@dataclass
class Estimate:
    mean_m: Floats  # (2,) east, north
    covariance_m2: Floats  # (2, 2)


class TerrainKalman:
    takes_ranges = False
    uses = ("motion", "fix", "water_depth")

    def __init__(self, context: Context) -> None:
        if context.chart is None:
            raise ValueError("terrain-kalman needs a chart: the mission has none")
        self.chart = context.chart
        self.t_ns = 0
        self.velocity_mps = np.zeros(2)  # commanded, through the water
        self.x = np.full(4, np.nan)
        self.P = np.diag([0.0, 0.0, 0.1**2, 0.1**2])

    def handle(self, event: uwcoop.Event) -> str:
        self.x, self.P = self._predicted(event.t_ns)
        self.t_ns = event.t_ns
        fields = event.fields
        if event.kind == "motion":
            self.velocity_mps = np.array([fields["velocity_e_mps"], fields["velocity_n_mps"]])
            return "fused"
        if event.kind == "fix":
            return self._fix(fields)
        if event.kind == "water_depth":
            return self._sounding(fields["water_depth_m"], fields["sigma_m"])
        return "noted"

    def transmit(self, tol_ns: int, capacity_bytes: int) -> bytes | None:
        return None

    def estimate(self, t_ns: int) -> Estimate:
        x, P = self._predicted(t_ns)
        return Estimate(x[:2], P[:2, :2])

    def _predicted(self, t_ns: int) -> tuple[Floats, Floats]:
        dt_s = (t_ns - self.t_ns) * 1e-9
        F = np.eye(4) + dt_s * np.eye(4, k=2)
        rates = np.array([POSITION_M_PER_SQRT_S] * 2 + [CURRENT_MPS_PER_SQRT_S] * 2)
        moved = np.concatenate([self.velocity_mps * dt_s, np.zeros(2)])
        return F @ self.x + moved, F @ self.P @ F.T + dt_s * np.diag(rates**2)

    def _fix(self, fields: dict[str, Any]) -> str:
        z = np.array([fields["e_m"], fields["n_m"]])
        R = np.array([[fields["cov_ee_m2"], fields["cov_en_m2"]], [fields["cov_en_m2"], fields["cov_nn_m2"]]])
        if np.isnan(self.x[0]):
            self.x, self.P[:2, :2] = np.concatenate([z, np.zeros(2)]), R
            return "fused"
        return self._update(z - self.x[:2], np.eye(2, 4), R)

    def _sounding(self, water_depth_m: float, sigma_m: float) -> str:
        if np.isnan(self.x[0]):
            return "noted"
        L = np.linalg.cholesky(self.P[:2, :2])
        spread = np.sqrt(3) * np.concatenate([np.zeros((1, 2)), L.T, -L.T])
        charted_m = self.chart.depth_at(self.x[:2] + spread)
        if not np.isfinite(charted_m).all():
            return "noted"  # off the chart or over a hole
        weights = np.array([1 / 3, 1 / 6, 1 / 6, 1 / 6, 1 / 6])
        mean_m = weights @ charted_m
        d = (charted_m[1:3] - charted_m[3:5]) / (2 * np.sqrt(3))
        unexplained_m2 = max(0.0, weights @ (charted_m - mean_m) ** 2 - d @ d)
        H = np.concatenate([np.linalg.solve(L.T, d), np.zeros(2)]).reshape(1, 4)
        sigma_map_m = self.chart.sigma_at(self.x[None, :2])[0]
        variance_m2 = sigma_m**2 + TIDE_SIGMA_M**2 + sigma_map_m**2 + unexplained_m2
        return self._update(np.array([water_depth_m - mean_m]), H, np.array([[variance_m2]]))

    def _update(self, innovation: Floats, H: Floats, R: Floats) -> str:
        S = H @ self.P @ H.T + R
        if innovation @ np.linalg.solve(S, innovation) > GATE_SIGMAS**2 * len(innovation):
            return "gated"
        K = np.linalg.solve(S, H @ self.P).T
        keep = np.eye(4) - K @ H
        self.x = self.x + K @ innovation
        self.P = keep @ self.P @ keep.T + K @ R @ K.T  # Joseph's form keeps it positive definite
        return "fused"


def main() -> None:
    navigators: list[str | Custom] = ["dead-reckoning", Custom("terrain-kalman", TerrainKalman), "mpf"]
    result = uwcoop.run("st-john", navigators, seed=1)
    for name, navigator in result.summary["navigators"].items():
        for vehicle, merit in navigator["vehicles"].items():
            print(f"{name:15} {vehicle} {merit['rmse_m']:7.2f} m rms   NEES {merit['anees']:7.2f} (ideal 2)")


if __name__ == "__main__":
    main()
