"""Late arrivals against numerical integration, an independent implementation's inputs and outputs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from uwcoop import kernels


def test_late_arrivals(golden_cases: Any) -> None:
    case = golden_cases("ranges")("late")
    count = len(case["innovation_m"])
    assert count == 400
    found = np.array(
        [
            kernels.late_range(
                case["innovation_m"][i : i + 1],
                case["variance_m2"][i : i + 1],
                case["gain_m2"][i : i + 1],
                float(case["late_share"][i]),
                float(case["lateness_m"][i]),
                float(case["floor_per_m"][i]),
            )
            for i in range(count)
        ]
    )[:, :, 0].T
    assert_allclose(found[0], case["log_z"], rtol=0, atol=1e-6)
    assert_allclose(found[1], case["posterior_mean_m"], rtol=0, atol=1e-5)
    assert_allclose(found[2], case["posterior_variance_m2"], rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"late_share": 1.5}, "late_share is 1.5, outside 0 to 1"),
        ({"lateness_m": 0.0}, "lateness_m is 0, outside above 0"),
        ({"floor_per_m": -1.0}, "floor_per_m is -1, outside 0 or more"),
        ({"variance_m2": np.zeros(3)}, "variance_m2 is 0, outside above 0"),
        ({"gain_m2": np.ones(2)}, "gain_m2 has 2 entries where 3 are expected"),
    ],
)
def test_bad_input_is_named(change: dict[str, Any], message: str) -> None:
    good: dict[str, Any] = {
        "innovation_m": np.zeros(3), "variance_m2": np.ones(3), "gain_m2": np.ones(3),
        "late_share": 0.1, "lateness_m": 20.0, "floor_per_m": 1e-6,
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        kernels.late_range(**(good | change))
