"""Ranges that are noisier than told: `team` finds it, says so, and stays consistent."""

from __future__ import annotations

import numpy as np

import uwcoop
from uwcoop.evaluation import metrics
from uwcoop.report.result_tables import _counts

PARTICLES = "navigator.team.particles=1000"


def test_the_noise_of_ranges_is_found_and_told_in_the_run_and_honest_ranges_are_left_as_they_are() -> None:
    noisy = uwcoop.run(
        "flat-bay", ["team"], seed=0, clouds=False, overrides=[PARTICLES, "acoustics.range_sigma_m=3.0"]
    )
    vehicles = noisy.summary["navigators"]["team"]["vehicles"].values()
    factors = np.array([vehicle["range_noise_factor"] for vehicle in vehicles])
    # 3 to within what some 120 ranges of each vehicle say.
    assert np.all((factors > 2.0) & (factors < 4.0)), factors
    assert np.mean([vehicle["anees"] for vehicle in vehicles]) <= 4.0
    honest = uwcoop.run("flat-bay", ["team"], seed=0, clouds=False, overrides=[PARTICLES])
    assert np.all(honest.tracks.range_noise_factor.values[..., -1] == 1.0)
    column = metrics.METRICS["range_noise_factor"].column
    assert column is not None
    assert [_counts(value, column) for value in (None, 1.0, 1.4, 3.0)] == [False, False, False, True]
