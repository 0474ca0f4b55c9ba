"""The chart itself: lookups against a reference and SciPy, identity, bytes, and what it refuses."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from uwcoop.charts import Chart, bilinear_depth
from uwcoop.errors import ChartError
from uwcoop.frames import Origin

GRID = np.arange(12, dtype=float).reshape(3, 4) + 1


def a_chart(**changes: Any) -> Chart:
    settings: dict[str, Any] = {"depth_m": GRID, "east0_m": -2.0, "north0_m": 10.0, "cell_m": 2.0}
    return Chart(**(settings | changes))


def test_lookup_meets_the_reference_on_edges_nodes_and_beside_holes(reference: Path) -> None:
    golden = np.load(reference / "golden/dmpf/map.npz")
    assert np.isnan(golden["depth"]).any()
    place = float(golden["e0"]), float(golden["n0"]), float(golden["res"])
    exact = bilinear_depth(golden["grid"], *place, golden["query"])
    np.testing.assert_allclose(exact, golden["depth"], atol=1e-9)
    chart = Chart(golden["grid"], *place)
    # The chart keeps float32: half a unit in the last place of 18 m is 1e-6 m.
    np.testing.assert_allclose(chart.depth_at(golden["query"]), golden["depth"], atol=2e-6)
    np.testing.assert_allclose(chart.gradient(golden["query"]), golden["grad"], atol=4e-6)


@given(
    grid=arrays(
        np.float32, st.tuples(st.integers(2, 6), st.integers(2, 6)), elements=st.floats(0, 100, width=32)
    ),
    seed=st.integers(0, 2**32 - 1),
    cell=st.floats(0.1, 50),
    corner=st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)),
)
@settings(max_examples=60, deadline=None)
def test_lookup_equals_scipy(grid: Any, seed: int, cell: float, corner: tuple[float, float]) -> None:
    from scipy.interpolate import RegularGridInterpolator

    chart = Chart(grid, *corner, cell)
    west, south, east, north = chart.extent
    points = np.random.default_rng(seed).uniform(
        (west - cell, south - cell), (east + cell, north + cell), (50, 2)
    )
    scipy = RegularGridInterpolator(
        (chart.north_m, chart.east_m), grid.astype(float), bounds_error=False, fill_value=np.nan
    )
    np.testing.assert_allclose(chart.depth_at(points), scipy(points[:, ::-1]), atol=1e-6)


def test_lookup_holds_on_all_edges_and_is_nan_a_hair_beyond() -> None:
    chart = a_chart()
    assert chart.extent == (-2.0, 10.0, 4.0, 14.0)
    np.testing.assert_array_equal(chart.depth_at([[-2, 10], [4, 10], [-2, 14], [4, 14]]), [1, 4, 9, 12])
    beyond = [[-2.000001, 12], [4.000001, 12], [0, 9.999999], [0, 14.000001], [np.nan, 12], [np.inf, 12]]
    assert np.isnan(chart.depth_at(beyond)).all()


def test_a_hole_spreads_to_the_four_cells_around_it_and_no_farther() -> None:
    depth = np.ones((5, 5))
    depth[2, 2] = np.nan
    chart = Chart(depth, 0, 0, 1)
    assert np.isnan(chart.depth_at([[1.01, 1.01], [2.9, 2.9], [2, 2]])).all()
    assert np.isnan(chart.gradient([[1.5, 1.5]])).all()
    np.testing.assert_array_equal(chart.depth_at([[0.99, 2.0], [3.01, 2.0], [3, 3]]), 1)
    assert chart.hole_share == 1 / 25


def test_gradient_is_the_slope_of_the_lookup() -> None:
    rng = np.random.default_rng(3)
    chart = Chart(rng.uniform(1, 9, (6, 7)), 5, 7, 3)
    points = np.column_stack([rng.uniform(5.1, 22.9, 40), rng.uniform(7.1, 21.9, 40)])
    step = 1e-5
    same_cell = (np.floor((points - (5, 7) - step) / 3) == np.floor((points - (5, 7) + step) / 3)).all(axis=1)
    for axis, shift in enumerate(([step, 0], [0, step])):
        numeric = (chart.depth_at(points + shift) - chart.depth_at(points - shift)) / (2 * step)
        np.testing.assert_allclose(chart.gradient(points)[same_cell, axis], numeric[same_cell], atol=1e-6)


def test_points_must_be_pairs() -> None:
    with pytest.raises(ValueError, match=r"shape \(3,\) must be \(N, 2\)"):
        a_chart().depth_at([1.0, 2.0, 3.0])
    assert a_chart().depth_at(np.zeros((0, 2))).shape == (0,)


def test_a_chart_cannot_be_changed_nor_changes_with_its_source() -> None:
    source = GRID.astype(np.float32)
    chart = a_chart(depth_m=source)
    source[0, 0] = 99
    assert chart.depth_m[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        chart.depth_m[0, 0] = 99
    with pytest.raises(FrozenInstanceError):
        chart.cell_m = 3.0  # type: ignore[misc]


def test_identity_is_of_content_not_of_name() -> None:
    chart = a_chart()
    assert replace(chart, name="other", notes=("x",), origin=Origin(1.0, 2.0)) == chart
    assert hash(replace(chart, name="other")) == hash(chart)
    deeper = GRID.copy()
    deeper[1, 1] += 1e-6
    per_node = np.full(GRID.shape, 0.5)
    others = [
        a_chart(depth_m=deeper), a_chart(east0_m=-2.1), a_chart(cell_m=2.5), a_chart(sigma_map_m=0.5),
        a_chart(sigma_map_m=per_node), a_chart(correlation_length_m=10.0),
        a_chart(depth_m=GRID.reshape(4, 3)),
    ]  # fmt: skip
    assert len({c.sha256 for c in [chart, *others]}) == 1 + len(others)
    assert chart != 3


def test_hash_does_not_see_how_a_hole_or_a_zero_is_written() -> None:
    one = np.array([[1, 2], [3, np.nan]], dtype=np.float32)
    other = one.copy()
    other.view(np.uint32)[1, 1] |= 1  # another bit pattern that is NaN too
    assert np.isnan(other[1, 1])
    assert Chart(one, 0.0, 0, 1).sha256 == Chart(other, -0.0, 0, 1).sha256


def test_hash_is_the_same_on_every_machine_and_in_every_version() -> None:
    assert a_chart().sha256 == "72823c0f08b8a573ffc20a9406d7add14938baad7bc60aab7c36489e8bbe52d7"


@given(
    grid=arrays(
        np.float32,
        st.tuples(st.integers(2, 9), st.integers(2, 9)),
        elements=st.one_of(st.floats(-(2.0**60), 2.0**60, width=32), st.just(np.nan)),
    ).filter(lambda g: np.isfinite(g).any()),
    per_node=st.booleans(),
)
@settings(max_examples=50, deadline=None)
def test_bytes_give_back_every_bit(grid: Any, per_node: bool) -> None:
    sigma = np.abs(np.nan_to_num(grid)) if per_node else 0.25
    chart = Chart(grid, -1.5, 2.25, 0.1, sigma, 10.0, Origin(1.2, 103.8, "EPSG:32648"), "náme", ("a", "b"))
    back = Chart.from_bytes(chart.to_bytes())
    assert back == chart
    np.testing.assert_array_equal(back.depth_m.view(np.uint32), chart.depth_m.view(np.uint32))
    assert (back.origin, back.name, back.notes) == (chart.origin, chart.name, chart.notes)
    assert back.cell_m == chart.cell_m
    assert back.to_bytes() == chart.to_bytes()


def test_damaged_bytes_are_refused() -> None:
    packed = a_chart().to_bytes()
    for damaged in (b"", b"chart", packed[: len(packed) // 2], packed[:60] + b"xxxx" + packed[64:]):
        with pytest.raises(ChartError, match=r"packed chart of .* bytes cannot be read"):
            Chart.from_bytes(damaged)


def repacked(**members: bytes) -> bytes:
    """A packed chart with other members, deflated."""
    with zipfile.ZipFile(io.BytesIO(a_chart().to_bytes())) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in (held | members).items():
            archive.writestr(name, content)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"depth": bytes(100_000_000)}, "depth holds more than 48 bytes"),
        ({"chart.json": b" " * 50_000_000}, "chart.json holds more than 1,048,576 bytes"),
        (
            {"chart.json": b'{"shape": [100000, 100000]}'},
            "its grid of 100000 x 100000 holds more than 64 MiB",
        ),
        ({"chart.json": b'{"shape": [-3, -4]}'}, "must be at least 0"),
    ],
)
def test_a_packed_chart_that_inflates_without_end_costs_no_memory(
    members: dict[str, bytes], message: str
) -> None:
    packed = repacked(**members)
    tracemalloc.start()
    try:
        with pytest.raises(ChartError, match=message):
            Chart.from_bytes(packed)
        assert tracemalloc.get_traced_memory()[1] < 8e6
    finally:
        tracemalloc.stop()


def test_sigma_of_the_chart_is_looked_up_like_depth() -> None:
    assert a_chart(sigma_map_m=0.4).sigma_at([[0, 11], [99, 11]]) == pytest.approx([0.4, np.nan], nan_ok=True)
    per_node = a_chart(sigma_map_m=GRID / 10)
    assert per_node.sigma_at([[-1, 11]]) == pytest.approx(a_chart().depth_at([[-1, 11]]) / 10)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depth_m": np.ones((1, 5))}, r"shape \(1, 5\) is smaller than 2 x 2"),
        ({"depth_m": np.ones(5)}, r"shape \(5,\) is smaller than 2 x 2"),
        ({"depth_m": np.full((3, 3), np.nan)}, "holds no depth: all are holes"),
        ({"depth_m": np.full((3, 3), np.inf)}, "infinite"),
        ({"cell_m": 0.0}, "cell 0.0 m must be finite and above 0 m"),
        ({"cell_m": -1.0}, "cell -1.0 m"),
        ({"cell_m": np.nan}, "cell nan m"),
        ({"east0_m": np.inf}, "east0_m inf must be finite"),
        ({"north0_m": np.nan}, "north0_m nan must be finite"),
        ({"sigma_map_m": -0.1}, "sigma_map_m must be finite and at least 0"),
        ({"sigma_map_m": np.ones((2, 2))}, r"sigma_map_m of shape \(2, 2\) does not match"),
        ({"correlation_length_m": -3.0}, "correlation_length_m -3.0"),
    ],
)
def test_what_cannot_be_a_chart_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ChartError, match=message) as caught:
        a_chart(**changes)
    assert "\n" not in str(caught.value)


# ---------------------------------------------------------------------------------------------- precision


@given(
    arrays(np.float64, (3, 4), elements=st.floats(-12_000, 12_000) | st.just(np.nan)).filter(
        lambda grid: bool(np.isfinite(grid).any())
    )
)
def test_depths_of_any_precision_are_kept_to_rounding(grid: Any) -> None:
    kept = Chart(grid, 0.0, 0.0, 5.0).depth_m
    assert kept.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(kept), np.isnan(grid))
    known = np.isfinite(grid)
    # Half a unit in the last place of float32; the least normal number bounds what is tiny.
    assert np.all(np.abs(kept[known] - grid[known]) <= 2.0**-24 * np.abs(grid[known]) + 2.0**-149)
    assert Chart(kept, 0.0, 0.0, 5.0) == Chart(grid, 0.0, 0.0, 5.0)
    assert Chart(grid.tolist(), 0.0, 0.0, 5.0) == Chart(grid, 0.0, 0.0, 5.0)


def test_the_documented_rounding_is_what_happens() -> None:
    for depth_m, bound_m in ((100.0, 4e-6), (11_000.0, 5e-4)):
        near = depth_m + np.linspace(0, 0.01, 1001)
        kept = Chart(near.reshape(1, -1).repeat(2, axis=0), 0.0, 0.0, 5.0).depth_m[0]
        assert np.abs(kept - near).max() <= bound_m


@pytest.mark.parametrize(
    ("depths", "line"),
    [
        ([[1.0, 2.0], [3.0, 1e39]], "chart depth holds 1e[+]39 m: float32 holds up to 3.403e[+]38 m"),
        ([["1", "2"], ["3", "4"]], "chart depth is of type <U1: it must be real numbers, metres"),
        (np.ones((2, 2), complex), "chart depth is of type complex128"),
        (np.ones((2, 2), bool), "chart depth is of type bool"),
        ([[1.0, 2.0], [3.0, np.inf]], "chart depth holds infinite values"),
    ],
)
def test_what_rounding_does_not_explain_is_refused(depths: Any, line: str) -> None:
    with pytest.raises(ChartError, match=line):
        Chart(depths, 0.0, 0.0, 5.0)


def test_sigmas_for_each_node_are_held_to_the_same() -> None:
    sigma = np.full((2, 2), 0.1)
    kept = Chart(np.ones((2, 2)), 0.0, 0.0, 5.0, sigma_map_m=sigma).sigma_map_m
    assert isinstance(kept, np.ndarray)
    assert kept.dtype == np.float32
    with pytest.raises(ChartError, match=r"chart sigma_map_m holds 1e[+]40 m"):
        Chart(np.ones((2, 2)), 0.0, 0.0, 5.0, sigma_map_m=sigma * 1e41)
