"""Metrics against hand-computed values, SciPy, and the statistics of exact Gaussian errors."""

from __future__ import annotations

import csv
import io
import json
import math
from typing import Any

import numpy as np
import pytest
import xarray as xr
from rich.console import Console

from fake_mission import mission
from uwcoop.cli.terminal import show
from uwcoop.errors import TracksError
from uwcoop.evaluation import metrics
from uwcoop.report import result_tables as report

NO_PACKETS = {k: np.empty(0, np.int64) for k in ("navigator", "sender", "tol_ns", "bytes")}


def tracks(
    error: Any, covariance: Any = None, *, time: Any = None, settle_s: float = 2.0, **more: Any
) -> xr.Dataset:
    """One navigator, one vehicle; truth runs along a diagonal and the estimate is `error` (time, 2) off."""
    error = np.asarray(error, dtype=float)
    time = np.arange(len(error), dtype=float) if time is None else np.asarray(time, dtype=float)
    truth = np.stack([time, 100 - time], -1)
    if covariance is None:
        covariance = np.eye(2)
    covariance = np.broadcast_to(np.asarray(covariance, dtype=float), (len(time), 2, 2))
    nvt = ("navigator", "vehicle", "time")
    return xr.Dataset(
        {
            "position_m": ((*nvt, "axis"), (truth + error)[None, None]),
            "covariance_m2": ((*nvt, "axis", "axis_b"), covariance[None, None].copy()),
            "truth_position_m": ((*nvt[1:], "axis"), truth[None]),
            "packet_bytes": (nvt, np.zeros((1, 1, len(time)))),
            "rejected": (nvt, np.arange(len(time))[None, None]),
            "yaw_rad": (nvt, np.full((1, 1, len(time)), np.nan)),
            **more,
        },
        {"navigator": ["n"], "vehicle": ["v"], "time": time},
        {"mission": "hand", "seed": 7, "settle_s": settle_s},
    )


def vehicle(dataset: xr.Dataset) -> dict[str, Any]:
    summary = metrics.summarise(dataset, seconds={"n": 0.5}, packets=NO_PACKETS)
    json.dumps(summary, allow_nan=False)
    return dict(summary["navigators"]["n"]["vehicles"]["v"])


# ---------------------------------------------------------------------------------------------- one run


def test_errors_by_hand_settling_and_arrivals_left_out() -> None:
    # t = 0, 1, 2 settle (2 s is not "after 2 s"); 3.5 s is an arrival, not a grid instant.
    time = [0, 1, 2, 3, 3.5, 4, 5, 6]
    error = [[90, 0], [90, 0], [90, 0], [3, 4], [900, 0], [0, 1], [0, -2], [6, 8]]
    got = vehicle(tracks(error, np.diag([4.0, 1.0]), time=time))
    assert got["rmse_m"] == pytest.approx(math.sqrt((25 + 1 + 4 + 100) / 4))
    assert got["median_error_m"] == pytest.approx(3.5)
    assert got["p95_error_m"] == pytest.approx(np.quantile([5, 1, 2, 10], 0.95))
    assert got["final_error_m"] == pytest.approx(10)
    assert got["anees"] == pytest.approx(np.mean([9 / 4 + 16, 1, 4, 36 / 4 + 64]))
    assert got["rejected"] == 7
    assert [got[k] for k in ("state_anees_per_dof", "yaw_rmse_deg", "rmse_over_bound")] == [None] * 3
    assert "nees_not_finite" not in got


def test_summary_has_exactly_the_documented_keys() -> None:
    m = mission(duration_s=100)
    summary = metrics.summarise(m.tracks, seconds=m.seconds, packets=m.packets)
    assert list(summary) == ["mission", "seed", "navigators"]
    assert list(summary["navigators"]) == ["dead-reckoning", "dmpf", "mpf"]
    dmpf = summary["navigators"]["dmpf"]
    assert list(dmpf) == ["seconds", "speedup", "packet_bytes", "vehicles"]
    assert dmpf["seconds"] == 1.5
    assert dmpf["speedup"] == pytest.approx(100 / 1.5)
    assert dmpf["packet_bytes"] == {"mean": 14.0, "max": 14}
    assert summary["navigators"]["dead-reckoning"]["packet_bytes"] == {"mean": None, "max": None}
    assert list(dmpf["vehicles"]) == ["auv-1", "auv-2", "auv-3"]
    assert list(dmpf["vehicles"]["auv-1"]) == [
        "rmse_m", "median_error_m", "p95_error_m", "final_error_m", "anees", "state_anees_per_dof",
        "yaw_rmse_deg", "rejected", "unsent", "depth_noise_factor", "range_noise_factor",
        "rmse_over_bound", "rmse_over_linearised_bound",
    ]  # fmt: skip
    json.dumps(summary, allow_nan=False)


def test_a_broadcast_counts_once_and_silence_not_at_all() -> None:
    packets = {
        "navigator": np.array([0, 0, 0, 0]),
        "sender": np.array([1, 1, 2, 0]),
        "tol_ns": np.array([5, 5, 9, 12]),
        "bytes": np.array([10, 10, 40, 0]),
    }
    summary = metrics.summarise(tracks(np.ones((9, 2))), seconds={"n": 1.0}, packets=packets)
    assert summary["navigators"]["n"]["packet_bytes"] == {"mean": 25.0, "max": 40}


def test_missing_truth_is_null_and_a_failed_estimate_is_not() -> None:
    dataset = tracks(np.ones((9, 2)))
    dataset["truth_position_m"][:] = np.nan
    got = vehicle(dataset)
    assert [got[k] for k in ("rmse_m", "median_error_m", "p95_error_m", "final_error_m", "anees")] == [
        None
    ] * 5

    dataset = tracks(np.ones((9, 2)))
    dataset["position_m"][..., -1, 0] = np.nan
    row = metrics.rows(dataset, seconds={"n": 1.0}, packets=None)[0]
    assert row["final_error_m"] == math.inf
    assert row["rmse_m"] == math.inf
    assert row["median_error_m"] == pytest.approx(math.sqrt(2))
    assert vehicle(dataset)["final_error_m"] is None
    assert metrics.pool([row])["n"]["lost_share"] == 1.0


def test_truth_that_ends_early_gives_the_last_known_error() -> None:
    dataset = tracks([[k, 0] for k in range(9)])
    dataset["truth_position_m"][:, 6:] = np.nan
    assert vehicle(dataset)["final_error_m"] == pytest.approx(5)
    assert metrics.rows(dataset, seconds={"n": 1.0}, packets=None)[0]["instants"] == 3


def test_broken_covariances_are_counted_not_hidden() -> None:
    dataset = tracks(np.ones((9, 2)))
    dataset["covariance_m2"][0, 0, 4] = 0.0  # sure of itself and wrong
    dataset["covariance_m2"][0, 0, 5] = np.nan
    dataset["covariance_m2"][0, 0, 6] = [[1.0, 3.0], [3.0, 1.0]]  # a negative variance along one diagonal
    nees = metrics.nees(dataset).values[0, 0]
    assert nees[3] == pytest.approx(2)
    assert math.isinf(nees[4])
    assert np.isnan(nees[5:7]).all()
    got = vehicle(dataset)
    assert got["anees"] is None
    assert got["nees_not_finite"] == 3
    row = metrics.rows(dataset, seconds={"n": 1.0}, packets=None)[0]
    assert (row["anees"], row["instants"], row["nees_instants"]) == (math.inf, 6, 4)


def test_heading_and_state_consistency() -> None:
    count = 9
    pose = np.broadcast_to(np.diag([4.0, 1.0, 0.01]), (1, 1, count, 3, 3))
    dataset = tracks(
        np.tile([2.0, 0.0], (count, 1)),
        truth_yaw_rad=(("vehicle", "time"), np.full((1, count), math.pi - 0.05)),
        pose_covariance=(("navigator", "vehicle", "time", "pose", "pose_b"), pose),
    )
    dataset["yaw_rad"][:] = -math.pi + 0.05  # 0.1 rad off, across the cut
    got = vehicle(dataset)
    assert got["yaw_rmse_deg"] == pytest.approx(math.degrees(0.1))
    assert got["state_anees_per_dof"] == pytest.approx((1 + 0 + 0.1**2 / 0.01) / 3)


def test_error_over_the_bound() -> None:
    bound = np.array([[9.0, 9.0, 9.0, 1.0, 1.0, 7.0]])
    dataset = tracks(np.tile([3.0, 4.0], (6, 1)), bound_m=(("vehicle", "time"), bound))
    assert vehicle(dataset)["rmse_over_bound"] == pytest.approx(5 / math.sqrt((1 + 1 + 49) / 3))


# ---------------------------------------------------------------------------------------------- consistency


def test_normalised_square_against_a_solver_with_mixed_units() -> None:
    rng = np.random.default_rng(1)
    scale = np.array([1e3, 1.0, 1e-5])
    root = rng.standard_normal((500, 3, 3)) * scale[:, None]
    covariance = root @ np.swapaxes(root, 1, 2)
    error = rng.standard_normal((500, 3)) * scale
    want = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    well = np.linalg.cond(covariance / (scale * scale[:, None])) < 1e8
    assert well.sum() > 400
    np.testing.assert_allclose(metrics.normalised_square(error, covariance)[well], want[well], rtol=1e-6)


@pytest.mark.parametrize(
    ("error", "covariance", "want"),
    [
        ([2, 1], [[4, 0], [0, 1]], 2.0),
        ([1, 1], [[2, 1], [1, 2]], 2 / 3),
        ([1, 1], [[1, 1], [1, 1]], 1.0),  # singular, and the error lies in its range
        ([1, -1], [[1, 1], [1, 1]], math.inf),
        ([0, 3], [[0, 0], [0, 9]], 1.0),
        ([1e-3, 3], [[0, 0], [0, 9]], math.inf),
        ([0, 0], [[0, 0], [0, 0]], 0.0),
        ([1, 0], [[-1, 0], [0, 1]], math.nan),
        ([1, 0], [[math.inf, 0], [0, 1]], math.nan),
        ([math.inf, 0], [[1, 0], [0, 1]], math.inf),
        ([math.nan, 0], [[1, 0], [0, 1]], math.nan),
        ([1e-160, 0], [[1e-320, 0], [0, 1e-320]], 1.0),
    ],
)
def test_normalised_square_of_odd_covariances(error: Any, covariance: Any, want: float) -> None:
    got = metrics.normalised_square(np.array([error], float), np.array([covariance], float))
    np.testing.assert_allclose(got, [want], rtol=1e-3)


@pytest.mark.parametrize("degrees", [1, 2, 3, 6, 17, 100, 1234, 100_000])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_bounds_against_scipy(degrees: int, confidence: float) -> None:
    stats = pytest.importorskip("scipy.stats", reason="SciPy is the reference here")
    tail = (1 - confidence) / 2
    want = stats.chi2.ppf([tail, 1 - tail], degrees)
    np.testing.assert_allclose(metrics.anees_bounds(degrees, 1, confidence), want, rtol=1e-9)
    np.testing.assert_allclose(metrics.anees_bounds(1, degrees, confidence), want / degrees, rtol=1e-9)


@pytest.mark.parametrize("arguments", [(0, 5, 0.95), (2, 0, 0.95), (2, 5, 0.0), (2, 5, 1.0)])
def test_bounds_of_nothing_are_refused(arguments: tuple[int, int, float]) -> None:
    with pytest.raises(TracksError, match=r"samples|confidence"):
        metrics.anees_bounds(*arguments)


def test_exact_gaussian_errors_are_consistent_over_many_seeds() -> None:
    covariance = np.array([[9.0, -3.0], [-3.0, 2.0]])
    root = np.linalg.cholesky(covariance)
    low, high = metrics.anees_bounds(2, 200)
    inside, narrow, wide = 0, 0, 0
    for seed in range(100):
        error = np.random.default_rng(seed).standard_normal((203, 2)) @ root.T
        inside += low <= vehicle(tracks(error, covariance))["anees"] <= high
        narrow += vehicle(tracks(error, covariance / 1.5))["anees"] > high
        wide += vehicle(tracks(error, covariance * 1.5))["anees"] < low
    # Binomial(100, 0.95): 95 ± 2.2; five sigma.
    assert 84 <= inside <= 100
    assert min(narrow, wide) >= 95  # a factor 1.5 in variance does not pass for consistent


# ---------------------------------------------------------------------------------------------- a study


def row(**values: Any) -> dict[str, Any]:
    empty: dict[str, Any] = dict.fromkeys(metrics.row_columns())
    return {
        **empty,
        "run": 0,
        "navigator": "n",
        "instants": 100,
        "nees_instants": 100,
        "seconds": 1.0,
        **values,
    }


def test_pool_by_hand() -> None:
    table = [
        row(run=0, vehicle="a", rmse_m=1.0, final_error_m=1.0, anees=2.0, packet_bytes_max=9,
            yaw_rmse_deg=3.0),
        row(run=0, vehicle="b", rmse_m=2.0, final_error_m=2.0, anees=4.0, packet_bytes_max=12),
        row(run=1, vehicle="a", rmse_m=7.0, final_error_m=31.0, anees=9.0, instants=50, nees_instants=25,
            seconds=4.0, rmse_over_bound=1.2),
        row(run=1, vehicle="b", rmse_m=None, final_error_m=None, instants=0, nees_instants=0, seconds=4.0),
    ]  # fmt: skip
    got = metrics.pool(table)["n"]
    assert got["median_final_error_m"] == 2.0
    assert got["p95_final_error_m"] == pytest.approx(2 + 0.9 * 29)
    assert got["median_rmse_m"] == 2.0
    assert got["rmse_m"] == pytest.approx(math.sqrt((100 * 1 + 100 * 4 + 50 * 49) / 250))
    assert got["anees"] == pytest.approx((100 * 2 + 100 * 4 + 25 * 9) / 225)
    assert got["anees_median"] == 4.0
    assert got["lost_share"] == pytest.approx(1 / 3)
    assert got["yaw_rmse_deg"] == pytest.approx(3.0)
    assert got["rmse_over_bound"] == 1.2
    assert got["packet_bytes_max"] == 12
    assert got["seconds"] == 2.5
    assert got["state_anees_per_dof"] is None
    assert list(got) == [
        "median_rmse_m", "rmse_m", "median_final_error_m", "p95_final_error_m", "lost_share", "anees",
        "anees_median", "inside_share", "state_anees_per_dof", "yaw_rmse_deg", "depth_noise_factor", "range_noise_factor",
        "rmse_over_bound", "rmse_over_linearised_bound",
        "packet_bytes_max", "seconds",
    ]  # fmt: skip


def test_one_infinite_nees_takes_the_mean_and_not_the_median() -> None:
    got = metrics.pool([row(anees=math.inf), row(anees=2.0), row(anees=3.0)])["n"]
    assert (got["anees"], got["anees_median"]) == (None, 3.0)
    json.dumps(got, allow_nan=False)


def test_pool_equals_the_statistics_of_all_instants() -> None:
    runs = [mission(duration_s=120, seed=seed) for seed in range(3)]
    table = [
        r for k, m in enumerate(runs)
        for r in metrics.rows(m.tracks, seconds=m.seconds, packets=m.packets, run=k)
    ]  # fmt: skip
    assert len(table) == 3 * 3 * 3
    assert all(list(r) == list(metrics.row_columns()) for r in table)
    grid = (runs[0].tracks.time % 1 == 0) & (runs[0].tracks.time > 50)
    assert int(grid.sum()) == 70
    every = np.concatenate(
        [
            metrics.errors(m.tracks).sel(navigator="dmpf", time=np.arange(51.0, 121.0)).values.ravel()
            for m in runs
        ]
    )
    nees = np.concatenate(
        [
            metrics.nees(m.tracks).sel(navigator="dmpf", time=np.arange(51.0, 121.0)).values.ravel()
            for m in runs
        ]
    )
    got = metrics.pool(table)["dmpf"]
    assert got["rmse_m"] == pytest.approx(math.sqrt(np.mean(every**2)))
    assert got["anees"] == pytest.approx(nees.mean())


def test_rows_survive_a_csv_file() -> None:
    m = mission(duration_s=80)
    table = metrics.rows(m.tracks, seconds=m.seconds, packets=m.packets)
    table[0]["anees"] = math.inf
    file = io.StringIO()
    writer = csv.DictWriter(file, metrics.row_columns())
    writer.writeheader()
    writer.writerows(table)
    file.seek(0)
    back = [
        {key: metrics.row_columns()[key](text) if text else None for key, text in line.items()}
        for line in csv.DictReader(file)
    ]
    assert back == table


# ---------------------------------------------------------------------------------------------- tables


def rendered(table: Any, width: int = 80) -> str:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(table)
    return console.export_text()


def three_digits(value: float) -> str:
    return f"{value:.0f}" if value >= 99.95 else f"{value:.1f}" if value >= 9.995 else f"{value:.2f}"


def test_run_table_fits_eighty_columns_and_marks_inconsistency() -> None:
    m = mission(duration_s=150)
    m.tracks["covariance_m2"][1] /= 9
    m.tracks["covariance_m2"][2, 0, :150] = 0
    summary = metrics.summarise(m.tracks, seconds=m.seconds, packets=m.packets)
    text = rendered(report.summary_table(summary, settle_s=50, not_realisable={"mpf"}))
    assert "…" not in text
    for piece in (
        "after 50 s",
        "ANEES",
        "RMSE",
        "(m)",
        "14.0 / 14 B",
        "no packets",
        "not realisable",
        "auv-3",
    ):
        assert piece in text
    for navigator in summary["navigators"].values():
        for values in navigator["vehicles"].values():
            assert three_digits(values["rmse_m"]) in text
    assert text.count("▲") >= 4 + 1  # three of dmpf, one collapsed, and the caption
    assert "state" not in text  # nobody has a heading
    narrow = rendered(report.summary_table(summary, settle_s=50), width=68).splitlines()
    for name, values in summary["navigators"]["dmpf"]["vehicles"].items():
        assert any(name in line and three_digits(values["final_error_m"]) in line for line in narrow)


def test_no_digit_is_lost_on_a_narrow_terminal() -> None:
    m = mission(duration_s=150)
    summary = metrics.summarise(m.tracks, seconds=m.seconds, packets=m.packets)
    console = Console(width=40, file=io.StringIO(), record=True)
    show(report.summary_table(summary, settle_s=50), console)
    text = console.export_text()
    for navigator in summary["navigators"].values():
        for values in navigator["vehicles"].values():
            for key in ("rmse_m", "final_error_m", "anees"):
                assert three_digits(values[key]) in text


def test_a_ratio_below_the_bound_is_explained_and_silence_is_shown_where_there_is_some() -> None:
    m = mission(duration_s=150)
    m.tracks["bound_m"] = (("vehicle", "time"), np.full(m.tracks["received"].shape, 0.37))
    m.tracks["unsent"] = m.tracks["rejected"] * 0
    summary = metrics.summarise(m.tracks, seconds=m.seconds, packets=m.packets)
    text = rendered(report.summary_table(summary, settle_s=50))
    assert "below 1" not in text.replace("below 1 conservative", "")
    assert "sent" not in text
    for navigator in summary["navigators"].values():
        for values in navigator["vehicles"].values():
            values.update(rmse_over_bound=0.93, unsent=4)
    text = rendered(report.summary_table(summary, settle_s=50))
    assert "RMSE / bound below 1: the bound holds for the mean over many missions" in " ".join(text.split())
    assert "sent" in text


def test_tables_with_bounds_fit_eighty_columns() -> None:
    m = mission(duration_s=150)
    for name in ("bound_m", "linearised_bound_m"):
        m.tracks[name] = (("vehicle", "time"), np.full(m.tracks["received"].shape, 0.37))
    summary = metrics.summarise(m.tracks, seconds=m.seconds, packets=m.packets)
    text = rendered(report.summary_table(summary, settle_s=50))
    worst = row(
        navigator="mpf-terrain-only", rmse_m=1234.5, final_error_m=1040.0, anees=123.0, rmse_over_bound=23.4,
        rmse_over_linearised_bound=12.3, packet_bytes_max=32,
    )  # fmt: skip
    study = {"scenario": "bay", "runs": 50, "variants": [{"set": {}, "navigators": metrics.pool([worst])}]}
    for table in (text, rendered(report.study_table(study, settle_s=20, vehicles=3))):
        assert "…" not in table
        assert "bound" in table
        assert "/ lin." in table
    # Both ends of the line are there: the whole name, and the run time.
    assert any(
        line.split()[:1] + line.split()[-1:] == ["mpf-terrain-only", "1.00"] for line in table.splitlines()
    )


def test_study_table_states_variants_and_the_interval() -> None:
    pooled = metrics.pool([row(rmse_m=1234.5, final_error_m=40.0, anees=0.5)])
    study = {"scenario": "bay", "runs": 50, "variants": [{"set": {"a.b": 2}, "navigators": pooled}]}
    text = rendered(report.study_table(study, settle_s=20, vehicles=3))
    assert "…" not in text
    low, high = metrics.anees_bounds(2, 150)
    for piece in ("a.b = 2", "after 20 s", "▽ 0.50", "100", "1234", f"{low:.2f} to {high:.2f}", "30 m"):
        assert piece in " ".join(text.split())
    empty = metrics.pool([row()])
    study = {"scenario": "bay", "runs": 1, "variants": [{"set": {}, "navigators": empty}]}
    text = rendered(report.study_table(study, settle_s=20))
    assert "=" not in text
    assert "–" in text
