"""Recordings whose ranges, gyro or sigmas are wrong in a way that lasts: `mdeif` with what a recording tells it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import uwcoop
from uwcoop.errors import UwcoopError
from uwcoop.importers.datasets.recording import NAVIGATORS, PlazaOptions, Recording, mission_of

BEACONS = {"L0": (0.0, 0.0), "L1": (200.0, 0.0), "L2": (100.0, 180.0)}
COUNT = 600
WHITE = {
    "sigma_range_bias_share": 0.0, "sigma_range_drift_share": 0.0, "late_share": 0.0, "noise_scale_max": 1.0,
}  # fmt: skip
SIGMA_M = 1.0


def driven(
    seed: int, *, bias_m: float = 0.0, gyro_radps: float = 0.0, noise_m: float = SIGMA_M, lost: int = 0
) -> Recording:
    """A vehicle on a lying eight among three beacons, with a step and a range a second."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0, 4 * np.pi, COUNT + 1)
    place = np.column_stack([100 + 70 * np.sin(phase / 2), 70 + 40 * np.sin(phase)])
    moved = np.diff(place, axis=0)
    course = np.unwrap(np.arctan2(moved[:, 1], moved[:, 0]))
    yaw = np.append(course, course[-1])
    length = np.hypot(*moved.T)
    heard = np.arange(1, COUNT)
    names = [list(BEACONS)[k % len(BEACONS)] for k in heard]
    away = np.array([np.hypot(*(place[k] - BEACONS[name])) for k, name in zip(heard, names, strict=True)])
    late = np.zeros(len(heard))
    late[rng.choice(len(heard), lost, replace=False)] = rng.exponential(5 * SIGMA_M, lost) + 3 * SIGMA_M
    return Recording(
        name="eight",
        vehicle="robot",
        beacons=BEACONS,
        start=(float(place[0, 0]), float(place[0, 1]), float(yaw[0])),
        odometry_s=np.arange(1.0, COUNT + 1),
        displacement_m=np.column_stack([length * (1 + 0.02 * rng.standard_normal(COUNT)), np.zeros(COUNT)]),
        yaw_change_rad=np.diff(yaw) + gyro_radps + 1e-3 * rng.standard_normal(COUNT),
        range_s=heard + 0.3,
        range_beacon=names,
        range_m=np.maximum(away + bias_m + late + noise_m * rng.standard_normal(len(heard)), 1.0),
        truth_s=np.arange(COUNT + 1.0),
        truth=np.column_stack([place, yaw]),
    )


def found(recording: Recording, **options: Any) -> tuple[dict[str, Any], dict[str, float]]:
    """Score of `mdeif` for the robot, and the last of its diagnostics."""
    base = {
        "sigma_range_m": SIGMA_M, "gate_sigmas": 6.0, "sigma_odometry_m": 0.01, "sigma_odometry_share": 0.02,
        "sigma_start_yaw_rad": 0.05,
    }  # fmt: skip
    log = mission_of(recording, PlazaOptions(**{**base, **options}))
    result = uwcoop.run(log, ["mdeif"], clouds=False)
    names = ("range_error_m", "range_noise_scale", "motion_noise_scale", "gyro_bias_radps")
    last = {name: float(result.tracks[name].sel(navigator="mdeif", vehicle="robot")[-1]) for name in names}
    return result.summary["navigators"]["mdeif"]["vehicles"]["robot"], last


@pytest.mark.parametrize("bias_m", [-2.5, 2.5])
def test_a_range_bias_is_found(bias_m: float) -> None:
    recording = driven(1, bias_m=bias_m)
    told, last = found(recording, sigma_range_bias_share=2.0)
    white, none = found(recording, **WHITE)
    assert told["rmse_m"] < 0.6 * white["rmse_m"]
    assert told["anees"] < 4 < white["anees"]
    assert last["range_error_m"] == pytest.approx(abs(bias_m), abs=1.0)
    assert none["range_error_m"] == 0


@settings(max_examples=8, deadline=None)
@given(bias=st.floats(-2, 2), seed=st.integers(0, 1000), turn=st.sampled_from([0.0, 1.6, 3.1]))
def test_whatever_the_bias_and_the_heading_the_covariance_tells_the_error(
    bias: float, seed: int, turn: float
) -> None:
    """Defaults; the heading is not known. The interval is of one run, whose instants are correlated."""
    told, _ = found(driven(seed, bias_m=bias * SIGMA_M), sigma_start_yaw_rad=3.2, start_yaw_rad=turn)
    assert told["anees"] < 6
    assert told["rmse_m"] < 4 * SIGMA_M


def test_a_gyro_bias_is_found() -> None:
    recording = driven(2, gyro_radps=2e-3)
    told, last = found(recording, sigma_gyro_bias_radps=2e-3)
    blind, none = found(recording)
    assert told["rmse_m"] < 0.7 * blind["rmse_m"]
    assert told["anees"] < 4
    # Estimated as what must be added to the yaw changes.
    assert last["gyro_bias_radps"] == pytest.approx(-2e-3, abs=6e-4)
    assert none["gyro_bias_radps"] == 0


def test_noise_grows_to_what_ranges_show_and_no_further() -> None:
    loud, last = found(driven(3, noise_m=3 * SIGMA_M), **{**WHITE, "noise_scale_max": 5.0})
    stated, off = found(driven(3, noise_m=3 * SIGMA_M), **WHITE)
    assert 1.8 < last["range_noise_scale"] < 4.5
    assert loud["anees"] < 0.7 * stated["anees"]
    assert off["range_noise_scale"] == off["motion_noise_scale"] == 1
    bounded, most = found(driven(3, noise_m=3 * SIGMA_M), **{**WHITE, "noise_scale_max": 1.5})
    assert most["range_noise_scale"] <= 1.5
    assert bounded["anees"] is not None
    _, quiet = found(driven(3), **{**WHITE, "noise_scale_max": 5.0})
    assert quiet["range_noise_scale"] < 1.4


def test_late_ranges_do_not_pull() -> None:
    recording = driven(4, lost=90)
    told, _ = found(recording, **{**WHITE, "late_share": 0.15})
    blind, _ = found(recording, **WHITE)
    assert told["rmse_m"] < 0.8 * blind["rmse_m"]


@pytest.mark.parametrize(
    "navigator", [name for name in NAVIGATORS if name != "mdeif"] + ["deif", "cekf-received"]
)
def test_who_cannot_find_a_heading_says_so(navigator: str) -> None:
    log = mission_of(driven(5), PlazaOptions())
    assert log.setup.navigators == ("mdeif",)
    with pytest.raises(UwcoopError, match=r"mdeif alone can find a heading.* is 3\.2, outside at most 0\.35"):
        uwcoop.run(log, [navigator], clouds=False)
