"""Range tests: read, fitted monotonically or by a logistic curve, and used as a loss."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.acoustics import (
    ReceptionTable,
    fit_logistic,
    fit_monotone,
    logistic_share,
    monotone_share,
    read_reception,
    survive_probability,
)
from uwcoop.errors import ScenarioError
from uwcoop.scenario.acoustics import Acoustics


def test_the_monotone_fit_pools_what_rises_by_its_weights() -> None:
    table = ReceptionTable.of([0, 100, 200, 300, 400], [0.9, 1.0, 0.5, 0.2, 0.4], [10, 30, 10, 5, 15])
    np.testing.assert_allclose(fit_monotone(table), [0.975, 0.975, 0.5, 0.35, 0.35])
    np.testing.assert_allclose(monotone_share(table, [150, 250, 900]), [0.7375, 0.425, 0.35])
    falling = ReceptionTable.of([300, 0, 100], [0.1, 1.0, 0.6])
    np.testing.assert_allclose(falling.distance_m, [0, 100, 300])
    np.testing.assert_allclose(fit_monotone(falling), [1.0, 0.6, 0.1])
    np.testing.assert_allclose(fit_monotone(ReceptionTable.of([0, 1, 2], [0, 0.5, 1])), [0.5] * 3)


@pytest.mark.parametrize("seed", range(5))
def test_the_monotone_fit_is_the_closest_of_all_that_never_rise(seed: int) -> None:
    optimize = pytest.importorskip("scipy.optimize")
    rng = np.random.default_rng(seed)
    share, weight = rng.random(12), rng.uniform(1, 20, 12)
    fitted = fit_monotone(ReceptionTable.of(np.arange(12), share, weight))
    assert (np.diff(fitted) <= 1e-12).all()
    best = optimize.isotonic_regression(share, weights=weight, increasing=False).x
    np.testing.assert_allclose(fitted, best, atol=1e-12)


def test_the_logistic_fit_finds_the_curve_that_made_the_shares() -> None:
    d = np.array([0, 60, 120, 180, 240, 300, 500.0])
    fitted = fit_logistic(ReceptionTable.of(d, logistic_share(170.0, 32.0, d)))
    assert fitted == (pytest.approx(170.0, abs=1e-4), pytest.approx(32.0, abs=1e-4))
    rng = np.random.default_rng(0)
    sent = np.full(d.size, 20_000)
    counted = rng.binomial(sent, logistic_share(170.0, 32.0, d)) / sent
    half, width = fit_logistic(ReceptionTable.of(d, counted, sent))
    assert half == pytest.approx(170, abs=1)
    assert width == pytest.approx(32, abs=1)
    np.testing.assert_allclose(logistic_share(half, width, half), 0.5)


def test_the_logistic_fit_has_the_largest_likelihood() -> None:
    optimize = pytest.importorskip("scipy.optimize")
    d, share = np.array([0, 100, 200, 300.0]), np.array([1.0, 0.7, 0.8, 0.05])
    sent = np.array([50, 20, 30, 100.0])

    def minus_likelihood(x: np.ndarray) -> float:
        p = np.clip(logistic_share(x[0], x[1], d), 1e-12, 1 - 1e-12)
        return float(-(sent * (share * np.log(p) + (1 - share) * np.log(1 - p))).sum())

    half, width = fit_logistic(ReceptionTable.of(d, share, sent))
    best = optimize.minimize(minus_likelihood, [200.0, 40.0], method="Nelder-Mead", tol=1e-10).x
    np.testing.assert_allclose([half, width], best, rtol=1e-4)


def test_shares_that_jump_give_a_steep_curve_between_the_rows() -> None:
    half, width = fit_logistic(ReceptionTable.of([0, 100, 200, 300], [1, 1, 0, 0]))
    assert 100 < half < 200
    assert 0 < width < 20
    np.testing.assert_allclose(logistic_share(half, width, [0, 100, 200, 300]), [1, 1, 0, 0], atol=0.05)


COUNTS = "d,got,sent\n0,10,10\n100,9,10\n100,7,10\n200,1,20\n300,0,0\n"


@pytest.mark.parametrize("name", ["test.csv", "test.csv.gz"])
def test_a_file_of_counts_is_summed_by_distance(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    if name.endswith(".gz"):
        with gzip.open(file, "wt") as handle:
            handle.write(COUNTS)
    else:
        file.write_text(COUNTS)
    table = read_reception(file, distance="d", received="got", sent="sent")
    np.testing.assert_allclose(table.distance_m, [0, 100, 200])
    np.testing.assert_allclose(table.share, [1.0, 0.8, 0.05])
    np.testing.assert_allclose(table.weight, [10, 20, 20])


def test_a_file_of_shares_counts_rows_alike(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("distance_m,share\n0,1\n50,0.5\n50,0.7\n")
    table = read_reception(tmp_path / "a.csv")
    np.testing.assert_allclose(table.share, [1.0, 0.6])
    np.testing.assert_allclose(table.weight, [1, 2])


BROKEN = [
    ("d,share\n0,1\n", "has no column 'distance_m': it has d, share"),
    ("", "a.csv is empty: it holds no rows"),
    ("distance_m,share\n0,x\n", "column 'share' holds 'x' in line 2 of a.csv: not a number"),
    ("distance_m,share\n0,\n", "share is empty in line 2: must be a finite number"),
    ("distance_m,share\n0\n", "share is empty in line 2: must be a finite number"),
    ("distance_m,share\n", "reception table has 0 distances, 0 shares and 0 weights: must be as many"),
    ("distance_m,share\n0,1\n5,1.5\n", "reception table row 2: share 1.5 must be within 0 to 1"),
]


@pytest.mark.parametrize(("text", "says"), BROKEN)
def test_a_broken_file_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ScenarioError) as caught:
        read_reception(tmp_path / "a.csv")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    for keys in ({"received": "share"}, {"share": "share", "received": "a", "sent": "b"}):
        with pytest.raises(ScenarioError, match="needs a column of shares, or those of signals received and"):
            read_reception(tmp_path / "a.csv", **keys)


def test_a_scenario_reads_its_file_once_and_keeps_the_numbers(tmp_path: Path) -> None:
    (tmp_path / "range.csv").write_text(COUNTS)
    (tmp_path / "mine.toml").write_text(
        """
        name = "mine"
        duration_s = 60
        chart = {source = "synthetic:st-john"}
        vehicles = {count = 2}
        [acoustics]
        modem = "unlimited"
        slot_s = 5.0
        max_range_m = 1000.0
        [[acoustics.losses]]
        model = "distance"
        file = "range.csv"
        columns = {distance = "d", received = "got", sent = "sent"}
        """
    )
    loaded = scenario.load(tmp_path / "mine.toml")
    resolved = loaded.resolved()
    assert resolved["acoustics"]["losses"][0]["table"] == [[0.0, 1.0], [100.0, 0.8], [200.0, 0.05]]
    assert resolved["acoustics"]["losses"][0]["weights"] == [10.0, 20.0, 20.0]
    (tmp_path / "range.csv").unlink()
    assert scenario.parse(resolved) == loaded  # a log does not need the file


def test_a_real_range_test_gives_a_curve_that_falls(reference: Path) -> None:
    file = reference / "data" / "reception" / "range_test.csv"
    table = read_reception(file, distance="dist.m", received="detected", sent="emitted")
    np.testing.assert_array_equal(table.distance_m, [0, 60, 120, 180, 240, 300])
    np.testing.assert_array_equal(table.weight, [1008] + 5 * [2016])
    fitted = fit_monotone(table)
    assert (np.diff(fitted) <= 0).all()
    np.testing.assert_allclose(fitted, table.share, atol=0.01)  # the counts hardly rise anywhere
    half, width = fit_logistic(table)
    assert 165 < half < 195
    assert 20 < width < 40
    # The real curve drops faster and ends in a longer tail than a logistic one.
    np.testing.assert_allclose(logistic_share(half, width, table.distance_m), table.share, atol=0.15)
    loss = {
        "model": "distance", "file": str(file),
        "columns": {"distance": "dist.m", "received": "detected", "sent": "emitted"},
    }  # fmt: skip
    near = Acoustics.model_validate({"modem": "unlimited", "slot_s": 1, "max_range_m": 180.0, "loss": loss})
    assert survive_probability(near) == pytest.approx(table.share[3])
