"""How reception falls with distance: range tests as tables, and curves that fall as sound does.

A range test counts, at some distances, how many of the signals sent were received. Its shares scatter; no
channel gets better with distance, so what is fitted never rises. Recipe:

    table = read_reception("range_test.csv", distance="dist.m", received="detected", sent="emitted")
    share = monotone_share(table, distance_m)                 # or
    half_m, width_m = fit_logistic(table)
    share = logistic_share(half_m, width_m, distance_m)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import ScenarioError, TableError
from uwcoop.importers.text_table import open_table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

NEWTON_STEPS = 100
STEEPEST = 0.02
"""Least width of a logistic fit as a share of the smallest distance between rows: shares that jump from 1 to 0
between two rows ask for a width of nothing."""


@dataclass(frozen=True)
class ReceptionTable:
    """Share of signals received at each distance."""

    distance_m: Array
    """(K,) ascending, no two the same, 0 or above."""
    share: Array
    """(K,) 0 to 1."""
    weight: Array
    """(K,) above 0: how many signals were sent."""

    @classmethod
    def of(cls, distance_m: ArrayLike, share: ArrayLike, weight: ArrayLike | None = None) -> ReceptionTable:
        """From rows in any order; rows of the same distance are put together by their weights.

        Raises:
            ScenarioError: no rows, or a value that cannot be.
        """
        distance, shares = (np.asarray(a, dtype=np.float64).ravel() for a in (distance_m, share))
        weights = np.ones_like(distance) if weight is None else np.asarray(weight, dtype=np.float64).ravel()
        if not distance.size == shares.size == weights.size or distance.size == 0:
            raise ScenarioError(
                f"reception table has {distance.size} distances, {shares.size} shares and {weights.size} "
                "weights: must be as many, at least 1"
            )
        for quantity, values, wrong, bound in [
            ("distance_m", distance, ~((distance >= 0) & np.isfinite(distance)), "finite and at least 0"),
            ("share", shares, ~((shares >= 0) & (shares <= 1)), "within 0 to 1"),
            ("weight", weights, ~((weights > 0) & np.isfinite(weights)), "finite and above 0"),
        ]:
            if wrong.any():
                row = int(np.argmax(wrong))
                raise ScenarioError(
                    f"reception table row {row + 1}: {quantity} {values[row]:g} must be {bound}"
                )
        at, row_of = np.unique(distance, return_inverse=True)
        total = np.asarray(np.bincount(row_of, weights), dtype=np.float64)
        return cls(at, np.bincount(row_of, weights * shares) / total, total)


def read_reception(
    file: str | Path,
    *,
    distance: str = "distance_m",
    share: str | None = None,
    received: str | None = None,
    sent: str | None = None,
) -> ReceptionTable:
    """A range test from a text table with a header line, as `uwcoop.importers.text_table` reads it.

    Args:
        file: the file.
        distance: name of the column of distances, metres.
        share: name of the column of shares; None, without the other two: "share".
        received: instead of shares, name of the column of signals received ...
        sent: ... and of signals sent, which are the weights. Rows with none sent are left out.

    Raises:
        ScenarioError: a file, column or cell that cannot be used; one line.
    """
    where = f"range test {file}"
    if (received is None) != (sent is None) or (share is not None and sent is not None):
        raise ScenarioError(f"{where}: needs a column of shares, or those of signals received and sent")
    names = [distance, received, sent] if received and sent else [distance, share or "share"]
    try:
        table = open_table(file)
        rows = table.read({name: table.place(name) for name in names})
    except OSError as error:
        raise ScenarioError(f"{where} cannot be read: {error.strerror}") from error
    except TableError as error:
        raise ScenarioError(f"{where}: {error}") from error
    for name, values in rows.numbers.items():
        if np.isnan(values).any():
            line = int(rows.line[np.isnan(values)][0])
            raise ScenarioError(f"{where}: {name} is empty in line {line}: must be a finite number")
    columns = [rows.numbers[name] for name in names]
    try:
        if sent is None:
            return ReceptionTable.of(columns[0], columns[1])
        # Summed before they are divided: an hour may count a signal that the hour before sent.
        at, row_of = np.unique(columns[0], return_inverse=True)
        count, of = np.bincount(row_of, columns[1]), np.bincount(row_of, columns[2])
        used = of != 0
        return ReceptionTable.of(at[used], count[used] / of[used], of[used])
    except ScenarioError as error:
        raise ScenarioError(f"{where}: {error}") from None


def fit_monotone(table: ReceptionTable) -> Array:
    """Shares (K,) that never rise with distance, closest to the table's in weighted least squares.

    Pools adjacent violators (Ayer et al. 1955): for shares with the numbers sent as weights this is the
    maximum of the binomial likelihood too.
    """
    blocks: list[tuple[float, float, int]] = []  # share, weight, rows
    for share, weight in zip(table.share.tolist(), table.weight.tolist(), strict=True):
        block = (share, weight, 1)
        while blocks and blocks[-1][0] < block[0]:
            above, heavy, rows = blocks.pop()
            both = heavy + block[1]
            block = ((above * heavy + block[0] * block[1]) / both, both, rows + block[2])
        blocks.append(block)
    return np.repeat([b[0] for b in blocks], [b[2] for b in blocks])


def monotone_share(table: ReceptionTable, distance_m: ArrayLike) -> Array:
    """Share received at any distances: `fit_monotone`, straight between rows, constant before and beyond them."""
    return np.interp(np.asarray(distance_m, dtype=np.float64), table.distance_m, fit_monotone(table))


def fit_logistic(table: ReceptionTable) -> tuple[float, float]:
    """Half range and width, metres, of 1 / (1 + exp((d - half) / width)): largest binomial likelihood.

    Raises:
        ScenarioError: fewer than two distances, or shares that do not fall with distance.
    """
    d, share, weight = table.distance_m, table.share, table.weight
    if d.size < 2:
        raise ScenarioError("logistic fit to 1 distance: needs at least 2")
    scale = float(d[-1] - d[0])
    z = (d - d[0]) / scale
    design = np.column_stack([np.ones_like(z), z])
    steepest = scale / (STEEPEST * float(np.diff(d).min()))
    if (
        np.sum(weight * (share - np.average(share, weights=weight)) * (z - np.average(z, weights=weight)))
        >= 0
    ):
        raise ScenarioError("logistic fit to shares that do not fall with distance")
    theta = np.zeros(2)  # log odds at the first distance, and their change until the last
    for _ in range(NEWTON_STEPS):
        p = 1 / (1 + np.exp(-np.clip(design @ theta, -500, 500)))
        gradient = design.T @ (weight * (share - p))
        curvature = design.T @ (design * (weight * np.maximum(p * (1 - p), 1e-12))[:, None])
        step = np.linalg.solve(curvature, gradient)
        step *= min(1.0, 2.0 / np.abs(step).max()) if step.any() else 0.0
        theta += step
        if theta[1] < -steepest or np.abs(step).max() < 1e-12:
            break
    slope = max(theta[1], -steepest)
    return float(d[0] - scale * theta[0] / theta[1]), float(-scale / slope)


def logistic_share(half_m: float, width_m: float, distance_m: ArrayLike) -> Array:
    """1 / (1 + exp((d - half) / width)) at any distances."""
    odds = (np.asarray(distance_m, dtype=np.float64) - half_m) / width_m
    return np.asarray(1 / (1 + np.exp(np.clip(odds, -500, 500))))


def table_of(rows: Sequence[Sequence[float]], weights: Sequence[float] = ()) -> ReceptionTable:
    """From rows of (distance_m, share) as scenario files hold them; without weights all rows count alike."""
    columns = np.array(rows, dtype=np.float64).reshape(-1, 2).T
    return ReceptionTable.of(columns[0], columns[1], weights or None)
