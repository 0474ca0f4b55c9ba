"""One's own filter: a bootstrap particle filter in NumPy, beside `mpf` on the same mission."""

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import uwcoop
from uwcoop.figures.errors import errors_figure
from uwcoop.navigators import Context, Custom


class Estimate(NamedTuple):
    mean_m: Any  # (2,) east, north
    covariance_m2: Any  # (2, 2)


class Bootstrap:
    uses = ("motion", "fix", "water_depth")

    def __init__(self, context: Context) -> None:
        self.chart, self.rng = context.chart, np.random.default_rng([context.seed, context.vehicle])
        self.t_ns, self.velocity_mps, self.points_m = 0, np.zeros(2), np.full((2000, 2), np.nan)

    def handle(self, event: uwcoop.Event) -> str:
        f, dt_s = event.fields, (event.t_ns - self.t_ns) * 1e-9
        self.points_m += dt_s * self.velocity_mps + 0.2 * np.sqrt(dt_s) * self.rng.standard_normal((2000, 2))
        self.t_ns = event.t_ns
        if event.kind == "motion":
            self.velocity_mps = np.array([f["velocity_e_mps"], f["velocity_n_mps"]])
        elif event.kind == "fix" and np.isnan(self.points_m).all():
            covariance = [[f["cov_ee_m2"], f["cov_en_m2"]], [f["cov_en_m2"], f["cov_nn_m2"]]]
            self.points_m = self.rng.multivariate_normal([f["e_m"], f["n_m"]], covariance, 2000)
        elif event.kind == "water_depth" and self.chart is not None and np.isfinite(self.points_m).all():
            off_m = np.nan_to_num(f["water_depth_m"] - self.chart.depth_at(self.points_m), nan=5.0)
            weight = np.exp(-0.5 * (off_m / 0.3) ** 2) + 1e-12  # 0.3 m: sounder, tide and chart together
            self.points_m = self.points_m[self.rng.choice(2000, 2000, p=weight / weight.sum())]
        return "fused"

    def transmit(self, tol_ns: int, capacity_bytes: int) -> bytes | None:
        return None  # silent

    def estimate(self, t_ns: int) -> Estimate:
        points_m = self.points_m + (t_ns - self.t_ns) * 1e-9 * self.velocity_mps
        return Estimate(points_m.mean(0), np.cov(points_m.T))


def main(folder: Path) -> None:
    result = uwcoop.run(
        "st-john", ["dead-reckoning", Custom("bootstrap", Bootstrap), "mpf"], seed=1, clouds=False
    )
    for name, outcome in result.summary["navigators"].items():
        for vehicle, merit in outcome["vehicles"].items():
            print(f"{name:14} {vehicle}  {merit['rmse_m']:5.2f} m rms   NEES {merit['anees']:6.2f} (ideal 2)")
    errors_figure(result.tracks, result.packets).savefig(folder / "own_filter.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
