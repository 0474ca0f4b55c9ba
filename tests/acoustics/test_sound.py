"""Sound speed in sea water, and ranges that come by a longer way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uwcoop import acoustics
from uwcoop.acoustics.channel import _World, travel_time_s
from uwcoop.errors import ScenarioError
from uwcoop.scenario.acoustics import Acoustics
from uwcoop.world.vehicles import Motion


def table(**keys: Any) -> Acoustics:
    base = {"modem": "unlimited", "slot_s": 1.0, "max_range_m": 900.0, "range_sigma_m": 0.0}
    return Acoustics.model_validate(base | keys)


def still(point: tuple[float, float], depth: float = 0.0, steps: int = 20) -> Motion:
    zero = np.zeros(steps + 1)
    position = np.tile(np.array(point, dtype=float), (steps + 1, 1))
    return Motion(position, zero + depth, zero, position * 0, zero, position * 0)


def ranges(settings: Acoustics, motion: list[Motion], seed: int = 0) -> Any:
    slots = acoustics.schedule(settings, ["V1", "V2"], motion[0].end_s)
    table_ = acoustics.opportunities(settings, slots, motion, seed)
    return settings.sound_speed_mps * (table_["toa_ns"] - table_["tol_ns"]) / 1e9


def test_mackenzies_check_value() -> None:
    assert acoustics.mackenzie_mps(25.0, 35.0, 1000.0) == pytest.approx(1550.744, abs=5e-4)


def test_mackenzie_agrees_with_an_independent_equation_at_the_surface() -> None:
    # Medwin (1975), to about 0.2 m/s near the surface.
    t, s = np.meshgrid(np.linspace(4, 30, 7), np.linspace(30, 38, 5))
    medwin = 1449.2 + 4.6 * t - 0.055 * t**2 + 0.00029 * t**3 + (1.34 - 0.010 * t) * (s - 35)
    np.testing.assert_allclose(acoustics.mackenzie_mps(t, s, 0.0), medwin, atol=0.7)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((1.9, 35, 0), r"temperature 1.9 °C is outside Mackenzie's 2 to 30 °C"),
        ((30.1, 35, 0), r"temperature 30.1 °C is outside"),
        ((20, 0.5, 0), r"salinity 0.5 psu is outside Mackenzie's 25 to 40 psu"),
        ((20, 35, -1), r"depth -1 m is outside Mackenzie's 0 to 8000 m"),
        ((20, 35, [0, 9000]), r"depth 9000 m is outside"),
        ((float("nan"), 35, 0), r"temperature nan °C is outside"),
    ],
)
def test_outside_of_its_range_mackenzie_is_refused(arguments: Any, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        acoustics.mackenzie_mps(*arguments)


def test_warm_water_makes_believed_ranges_too_short() -> None:
    sea = {"model": "mackenzie", "temperature_c": 29.0, "salinity_psu": 32.0}
    truth = float(acoustics.mackenzie_mps(29.0, 32.0, 100.0))  # half way between 0 and 200 m
    measured = ranges(table(sound_speed=sea), [still((0, 0)), still((480, 0), depth=200.0)])
    np.testing.assert_allclose(measured, 520.0 * 1500.0 / truth, atol=1e-5)
    assert truth > 1535
    shallow = table(sound_speed=sea, sound_speed_error_mps=-2.0)
    assert acoustics.true_sound_speed_mps(shallow, 0) == pytest.approx(
        float(acoustics.mackenzie_mps(29, 32, 0)) - 2
    )
    knows = table(sound_speed=sea, sound_speed_mps=truth)
    np.testing.assert_allclose(ranges(knows, [still((0, 0)), still((480, 0), depth=200.0)]), 520.0, atol=1e-5)


def test_travel_times_take_a_speed_for_each_signal() -> None:
    speed = np.array([1450.0, 1550.0])
    travel = travel_time_s(still((0, 0)), still((300, 400)), np.array([1.0, 2.0]), speed)
    np.testing.assert_allclose(travel, 500 / speed)


@pytest.mark.parametrize(
    ("distribution", "mean", "at_least"),
    [({"distribution": "exponential", "mean": 30.0}, 30.0, 0.0),
     ({"distribution": "uniform", "low": 10.0, "high": 50.0}, 30.0, 10.0)],
)  # fmt: skip
def test_outliers_are_late_and_as_many_and_as_long_as_stated(
    distribution: dict[str, Any], mean: float, at_least: float
) -> None:
    motion = [still((0, 0), steps=60_000), still((600, 0), steps=60_000)]
    settings = table(range_outlier_share=0.1, range_outlier_m=distribution)
    late = ranges(settings, motion) - 600.0
    assert late.size > 59_000
    outlier = late > 1e-4
    assert late.min() > -1e-4
    assert outlier.mean() == pytest.approx(0.1, rel=0.05)
    assert late[outlier].mean() == pytest.approx(mean, rel=0.03)
    assert late[outlier].min() >= at_least - 1e-3
    assert abs(np.corrcoef(outlier[:-1], outlier[1:])[0, 1]) < 0.02


def test_outliers_leave_the_noise_and_the_other_ranges_as_they_were() -> None:
    motion = [still((0, 0), steps=2000), still((600, 0), steps=2000)]
    clean = ranges(table(range_sigma_m=1.0), motion)
    few, many = (ranges(table(range_sigma_m=1.0, range_outlier_share=p), motion) - clean for p in (0.1, 0.3))
    assert (few[few == 0].size, many[many == 0].size) == (
        pytest.approx(1800, abs=60),
        pytest.approx(1400, abs=90),
    )
    assert (many[few > 0] == few[few > 0]).all()  # the first outliers stay, more come


def test_outliers_that_hold_stay_for_both_directions_of_a_pair() -> None:
    motion = [still((0, 0), steps=6000), still((600, 0), steps=6000)]
    settings = table(range_outlier_share=0.3, range_outlier_hold_s=60.0)
    world = _World(settings, motion, 0, ("V1", "V2"))
    at = np.arange(0.0, 6000.0, 5.0)
    there, back = world.timing_error_s(0, 1, at), world.timing_error_s(1, 0, at)
    noise = world.timing_error_s(0, 1, at) - there
    assert not noise.any()
    quiet = _World(table(), motion, 0, ("V1", "V2"))
    late = [way - quiet.timing_error_s(*pair, at) for way, pair in ((there, (0, 1)), (back, (1, 0)))]
    np.testing.assert_allclose(late[0], late[1], atol=1e-12)
    changes = np.flatnonzero(np.abs(np.diff(late[0])) > 1e-12)
    assert changes.size > 10
    assert np.all(np.diff(changes) % 12 == 0), "a stay lasts as long as it is said to"
    assert (late[0] > 1e-12).mean() == pytest.approx(0.3, abs=0.12)
