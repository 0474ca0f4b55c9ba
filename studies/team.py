"""What `team` is worth: paired studies on the packaged scenarios, one line for each navigator.

python studies/team.py [--runs N] [--only NAME,...]
"""

from __future__ import annotations

import argparse
from typing import Any

import uwcoop

NAVIGATORS = ["team", "mpf", "mpf-terrain-only", "dead-reckoning"]
STUDIES: dict[str, tuple[str, list[str], dict[str, list[Any]]]] = {
    "rich": ("st-john-drift", [], {}),
    "flat": ("flat-bay", [], {}),
    "poor": ("poor-bay", [], {}),
    "surveyed": ("surveyed-bay", ['drift.preset="dvl"', 'navigator.all.drift="dvl"',
                                  "navigator.team.current_difference=1.0"], {}),
    "mixed": ("mixed-team", [], {}),
    "loss": ("flat-bay", [], {"acoustics.loss.probability": [0.0, 0.2, 0.4, 0.6, 0.9, 1.0]}),
    "vehicles": ("flat-bay", [], {"vehicles.count": [2, 3, 5]}),
    "currents": ("flat-bay", [], {"navigator.team.current_difference": [1.0, 0.3, 0.1]}),
    "particles": ("flat-bay", [], {"navigator.team.particles": [600, 1000, 1500]}),
    "groups": ("flat-bay", ["vehicles.count=5"], {"navigator.team.group_size": [1, 2, 4]}),
}  # fmt: skip
"""By name: scenario, its overrides, what varies."""


def line(settings: dict[str, Any], name: str, found: dict[str, Any]) -> str:
    """One navigator's figures."""
    shown = " ".join(f"{key.rsplit('.', 1)[-1]}={value}" for key, value in settings.items())
    ratio = found["rmse_over_bound"]
    bound = "-" if ratio is None else f"{ratio:.2f}"
    return (
        f"{shown:24s} {name:18s} final {found['median_final_error_m']:7.2f} / {found['p95_final_error_m']:7.2f} m"
        f"  RMSE {found['median_rmse_m']:6.2f} m  over bound {bound}  NEES {found['anees_median']:5.2f} / "
        f"{found['anees']:7.2f}  lost {100 * found['lost_share']:.1f} %"
    )


def main() -> None:
    """Runs the studies that were asked for."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=20)
    arguments.add_argument("--only", default=",".join(STUDIES))
    chosen = arguments.parse_args()
    for key in chosen.only.split(","):
        scenario, overrides, vary = STUDIES[key]
        navigators = NAVIGATORS if not vary else ["team", "mpf-terrain-only"]
        result = uwcoop.study(
            scenario, runs=chosen.runs, navigators=navigators, overrides=overrides, vary=vary
        )
        print(f"\n{key}: {scenario}, {chosen.runs} runs {' '.join(overrides)}")
        for variant in result.summary["variants"]:
            for name, found in variant["navigators"].items():
                print(line(variant["set"], name, found))


if __name__ == "__main__":
    main()
