"""Lines below a run's table: each names what does not fit, whose it is and where to look; an honest run has none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import uwcoop
from fake_mission import mission
from uwcoop.report.misfit_lines import misfit_lines


def fake(**diagnostics: np.ndarray[Any, Any]) -> Any:
    m = mission(duration_s=150, navigators=("mpf",))
    shape = m.tracks["ess"].shape
    for name, values in diagnostics.items():
        m.tracks[name] = (("navigator", "vehicle", "time"), np.broadcast_to(values, shape).copy())
    m.log.events["water_depth"] = {"vehicle": np.repeat(np.arange(3), 100)}
    return SimpleNamespace(recorded=m.tracks, log=m.log)


def per_vehicle(*values: float) -> np.ndarray[Any, Any]:
    return np.array(values)[None, :, None]


@pytest.mark.parametrize(
    ("name", "honest", "wrong", "says"),
    [
        (
            "depth_noise_factor",
            (1.0, 1.2, 1.4),
            (1.0, 3.04, 1.4),
            "the soundings of auv-2 (3.0 x) are noisier",
        ),
        ("alarms", (0.0, 2.0, 1.0), (0.0, 7.0, 1.0), "health monitor spread the cloud of auv-2 (7 alarms)"),
        ("gated_soundings", (0.0, 4.0, 5.0), (0.0, 20.0, 5.0), "soundings of auv-2 (20%) contradicted"),
    ],
)
def test_what_does_not_fit_is_named(
    name: str, honest: tuple[float, ...], wrong: tuple[float, ...], says: str
) -> None:
    assert misfit_lines(fake(**{name: per_vehicle(*honest)})) == []
    (line,) = misfit_lines(fake(**{name: per_vehicle(*wrong)}))
    assert line.startswith("mpf: ")
    assert says in line
    assert "auv-1" not in line


def test_ranges_are_judged_by_their_innovations_each_once() -> None:
    rng = np.random.default_rng(0)
    times = mission(duration_s=150, navigators=("mpf",)).tracks.sizes["time"]
    held = np.repeat(rng.normal(size=(1, 3, times // 5 + 1)), 5, axis=-1)[..., :times]
    assert misfit_lines(fake(range_innovation_m=held, range_innovation_sigma_m=np.ones(1))) == []
    held[:, 0] *= 3.0
    (line,) = misfit_lines(fake(range_innovation_m=held, range_innovation_sigma_m=np.ones(1)))
    assert "ranges to auv-1 (NIS" in line
    assert "acoustics.clock" in line


def test_a_current_beyond_its_prior_is_named() -> None:
    sigma = np.linspace(0.1, 0.02, mission(duration_s=150, navigators=("mpf",)).tracks.sizes["time"])
    given = {
        "sigma_current_east_mps": sigma,
        "sigma_current_north_mps": sigma,
        "current_north_mps": np.zeros(1),
    }
    assert misfit_lines(fake(**given, current_east_mps=per_vehicle(0.1, 0.2, 0.25))) == []
    (line,) = misfit_lines(fake(**given, current_east_mps=per_vehicle(0.1, 0.5, 0.25)))
    assert "the current of auv-2 (5.0 sigma of its prior)" in line


def test_values_that_are_not_known_are_no_misfit() -> None:
    unknown = per_vehicle(np.nan, np.nan, np.nan)
    assert misfit_lines(fake(depth_noise_factor=unknown, alarms=unknown, gated_soundings=unknown)) == []


def test_a_mission_shorter_than_the_settling_time_says_so() -> None:
    result = fake()
    result.recorded.attrs["settle_s"] = 150.0
    (line,) = misfit_lines(result)
    assert line.startswith("the mission lasts 150 s, not longer than metrics.settle_s, 150 s")


def test_a_noisy_sounder_is_named_and_an_honest_one_is_not() -> None:
    few = ["duration_s=400", "navigator.all.particles=400", "vehicles.count=2"]
    told = [*few, "sensors.water_depth.sigma_m=0.15", "navigator.all.sigma_depth_m=0.05"]
    wrong = uwcoop.run("flat-bay", ["mpf-terrain-only", "team"], seed=1, clouds=False, overrides=told)
    lines = misfit_lines(wrong)
    assert sum("noisier than their sensor states" in line for line in lines) == 2
    honest = uwcoop.run("flat-bay", ["mpf-terrain-only", "team"], seed=1, clouds=False, overrides=few)
    assert not any("noisier" in line for line in misfit_lines(honest))
