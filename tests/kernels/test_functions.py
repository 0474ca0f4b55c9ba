"""Kernels as pure functions: properties against independent libraries, and refusals that name what is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import RegularGridInterpolator

from uwcoop import _native, kernels
from uwcoop.errors import NavigatorError

finite = st.floats(-1e3, 1e3, allow_nan=False, width=32)
shapes = st.tuples(st.integers(2, 12), st.integers(2, 12))


@settings(max_examples=60, deadline=None)
@given(
    shapes.flatmap(lambda shape: arrays(np.float64, shape, elements=finite)),
    st.floats(0.25, 5.0),
    arrays(np.float64, (40, 2), elements=st.floats(-0.2, 1.2)),
)
def test_depths_are_scipys(grid: Any, cell_m: float, where: Any) -> None:
    rows, cols = grid.shape
    east0, north0 = 3500.0, -1200.0
    extent = np.array([(cols - 1) * cell_m, (rows - 1) * cell_m])
    points = np.array([east0, north0]) + where * extent
    axes = (north0 + cell_m * np.arange(rows), east0 + cell_m * np.arange(cols))
    expected = RegularGridInterpolator(axes, grid, bounds_error=False)(points[:, ::-1])
    got = kernels.bilinear_depth(grid, east0, north0, cell_m, points)
    # On the very edge rounding decides; elsewhere both agree on what is on the chart.
    inside = np.all((where > 1e-9) & (where < 1 - 1e-9), axis=1)
    outside = np.any((where < -1e-9) | (where > 1 + 1e-9), axis=1)
    np.testing.assert_allclose(got[inside], expected[inside], rtol=0, atol=1e-9 * (1 + np.abs(grid).max()))
    assert np.isnan(got[outside]).all()
    chart = _native.Chart(grid.astype(np.float32), east0, north0, cell_m, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(
        chart.depth_at(points)[inside], expected[inside], rtol=0, atol=3e-4 * (1 + np.abs(grid).max())
    )


@settings(max_examples=100, deadline=None)
@given(
    st.floats(-3e4, 3e4), st.floats(-3e4, 3e4), st.floats(0.05, 500), st.floats(0.05, 500),
    st.floats(-0.999, 0.999), st.floats(0, 51.1), st.integers(0, 255), st.integers(0, 15), st.integers(0, 10**15),
)  # fmt: skip
def test_a_packet_never_claims_more_than_was_known(
    e: float,
    n: float,
    sigma_e: float,
    sigma_n: float,
    rho: float,
    depth: float,
    sequence: int,
    sender: int,
    tol: int,
) -> None:
    true = np.array([[sigma_e**2, rho * sigma_e * sigma_n], [rho * sigma_e * sigma_n, sigma_n**2]])
    packet = kernels.encode_belief(
        np.array([e, n]),
        true,
        depth_m=depth,
        sequence=sequence,
        heard=5,
        sender=sender,
        tol_ns=tol,
        packet="rounded",
    )
    assert len(packet) == 15
    said = kernels.decode_belief(packet, sender, tol)
    np.testing.assert_allclose(said["mean_m"], [e, n], atol=1 / 32 + 1e-9)
    slack = said["covariance_m2"] - true
    assert np.linalg.eigvalsh(slack)[0] >= -1e-9 * np.trace(true)
    assert (said["sequence"], said["heard"]) == (sequence, 5)
    assert said["depth_m"] == pytest.approx(depth, abs=0.05 + 1e-9)


def test_a_packet_of_another_slot_or_sender_is_refused() -> None:
    packet = kernels.encode_belief(
        np.zeros(2), np.eye(2), depth_m=1.0, sequence=1, heard=0, sender=2, tol_ns=9, packet="f64"
    )
    assert len(packet) == 47
    for bytes_, sender, tol in (
        (packet, 1, 9), (packet, 2, 10), (packet[:-1], 2, 9), (b"", 2, 9), (bytes([packet[0] ^ 1]) + packet[1:], 2, 9)
    ):  # fmt: skip
        with pytest.raises(NavigatorError):
            kernels.decode_belief(bytes_, sender, tol)


@settings(max_examples=60, deadline=None)
@given(
    arrays(np.float64, st.integers(2, 80), elements=st.floats(-1e300, 700, allow_nan=False)),
    st.integers(0, 2**32 - 1),
)
def test_resampling_keeps_what_is_due(log_weights: Any, seed: int) -> None:
    weights = kernels.normalize(log_weights)
    assert weights.sum() == pytest.approx(1, abs=1e-12)
    uniforms = np.random.default_rng(seed).random(len(weights))
    ancestors, counts = kernels.residual_resample(weights, uniforms)
    assert np.all(counts >= np.floor(len(weights) * weights))
    assert counts.sum() == len(weights)
    assert np.all(np.diff(ancestors) >= 0)
    np.testing.assert_array_equal(np.bincount(ancestors, minlength=len(weights)), counts)


@pytest.mark.parametrize("count", [1, 37, 1024, 2600])
def test_pattern_depths_meet_single_lookups_and_need_no_memory(count: int) -> None:
    rng = np.random.default_rng(4)
    chart = _native.Chart(rng.normal(20, 3, (60, 80)).astype(np.float32), -100.0, 50.0, 2.5, 0.0, 0.0, 0.0)
    positions, offsets = rng.uniform((-70, 80), (65, 165), (count, 2)), rng.uniform(-20, 20, (19, 2))
    out = np.full((19, count), np.nan, np.float32)
    found = kernels.pattern_depths(chart, positions, offsets, out)
    assert found is out
    for row, offset in zip(out, offsets, strict=True):
        np.testing.assert_allclose(row, chart.depth_at(positions + offset), atol=3e-4)
    np.testing.assert_array_equal(kernels.pattern_depths(chart, np.asfortranarray(positions), offsets), out)
    with pytest.raises(ValueError, match="out has shape"):
        kernels.pattern_depths(chart, positions, offsets, np.zeros((18, count), np.float32))
    with pytest.raises(ValueError, match="C-contiguous"):
        kernels.pattern_depths(chart, positions, offsets, np.zeros((38, count), np.float32)[::2])
    if count > 1:
        with pytest.raises(ValueError, match="C-contiguous"):
            kernels.pattern_depths(chart, positions, offsets, np.asfortranarray(out))
    with pytest.raises(ValueError, match="leave the chart"):
        kernels.pattern_depths(chart, positions + 200, offsets)


def test_bad_arguments_name_the_quantity() -> None:
    two = np.zeros((5, 2))
    for call, words in (
        (lambda: kernels.bilinear_depth(np.zeros((1, 5)), 0, 0, 1, two), "grid has shape"),
        (lambda: kernels.bilinear_depth(np.zeros((5, 5)), 0, 0, -1.0, two), "cell_m is -1"),
        (lambda: kernels.bilinear_depth(np.zeros((5, 5)), 0, 0, 1, np.zeros((5, 3))), "points_m has shape"),
        (lambda: kernels.normalize(np.full(3, -np.inf)), "no log-weight is finite"),
        (lambda: kernels.residual_resample(np.array([0.5, 0.6]), np.zeros(2)), "weights sum to"),
        (lambda: kernels.range_log_likelihood(two, [0, 0], np.eye(2), 5.0, 1.0, "eq17"), "needs samples"),
        (lambda: kernels.range_log_likelihood(two, [0, 0], np.eye(2), 5.0, 1.0, "magic"), "method is"),
        (lambda: kernels.liu_west(np.zeros((4, 9)), 0.1, np.zeros((4, 9))), "9 columns"),
    ):
        with pytest.raises(ValueError, match=words):
            call()


def test_events_are_checked_where_they_are_made() -> None:
    for kind, fields, words in (
        ("water_depth", {"water_depth_m": float("nan"), "sigma_m": 0.1}, "water_depth_m is NaN"),
        ("water_depth", {"water_depth_m": -3.0, "sigma_m": 0.1}, "water_depth_m is -3"),
        ("depth", {"depth_m": 1.0, "sigma_m": -0.1}, "sigma_m is -0.1"),
        ("fix", {"e_m": 0, "n_m": 0, "cov_ee_m2": 1, "cov_en_m2": 2, "cov_nn_m2": 1}, "fix covariance"),
        ("motion", {"velocity_e_mps": 1.0}, "velocity_n_mps is missing"),
        ("mofion", {}, "unknown"),
    ):
        with pytest.raises(ValueError, match=words):
            _native.Event(0, 0, kind, **fields)
