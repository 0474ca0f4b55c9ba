"""The mission log in memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sample_log import sample_chart, sample_log
from uwcoop.errors import LogError
from uwcoop.missionlog import (
    event_columns,
)


def test_a_log_differs_from_another_by_a_single_bit() -> None:
    log = sample_log(seconds=5)
    assert log.difference(sample_log(seconds=5)) is None
    other = sample_log(seconds=5)
    depth = other.events["depth"]["depth_m"]
    depth[3] = np.nextafter(depth[3], 9.0)
    assert (log.difference(other) or "").startswith("depth.depth_m[3]: ")
    assert log.difference(sample_log(seconds=5, chart=sample_chart(seed=9))) is not None
    del other.events["fix"]
    assert "tables" in (log.difference(other) or "")


def test_zero_and_minus_zero_differ_and_a_nan_equals_itself() -> None:
    log, other = sample_log(seconds=5), sample_log(seconds=5)
    for one in (log, other):
        one.events["acoustic_fix"]["range_m"][0] = np.nan
    log.events["depth"]["depth_m"][0], other.events["depth"]["depth_m"][0] = 0.0, -0.0
    assert log.difference(other) == "depth.depth_m[0]: np.float64(0.0) != np.float64(-0.0)"


def test_events_are_sorted_and_equal_ones_keep_their_order() -> None:
    table = event_columns(
        "depth", t_ns=[5, 3, 5, 5], vehicle=[1, 0, 0, 1], depth_m=[1.0, 2.0, 3.0, 4.0], sigma_m=np.zeros(4)
    )
    assert table["depth_m"].tolist() == [2.0, 3.0, 1.0, 4.0]
    assert {name: column.dtype.str[1:] for name, column in table.items()} == {
        "t_ns": "i8", "vehicle": "i8", "depth_m": "f8", "sigma_m": "f8",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"t_ns": [1], "vehicle": [0], "depth_m": [1.0]}, "no column 'sigma_m'"),
        ({"t_ns": [1], "vehicle": [0], "depth_m": [1.0], "sigma_m": [0.0], "x": [1]}, "unknown column 'x'"),
        ({"t_ns": [1], "vehicle": [0], "depth_m": [1.0, 2.0], "sigma_m": [0.0]}, "has shape (2,), not (1,)"),
        ({"t_ns": [1.5], "vehicle": [0], "depth_m": [1.0], "sigma_m": [0.0]}, "cannot be converted"),
    ],
)
def test_a_table_that_does_not_fit_its_kind_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(LogError, match="column") as refusal:
        event_columns("depth", **values)
    assert message in str(refusal.value)
    with pytest.raises(LogError, match="event kind 'sonar' is unknown"):
        event_columns("sonar", t_ns=[], vehicle=[])
