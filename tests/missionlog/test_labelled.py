"""Arrays that become a Dataset when somebody reads one: the same by name, and made once."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import uwcoop
from uwcoop.missionlog.labelled import Labelled

SHORT = ("duration_s=60", "navigator.all.particles=50")


@settings(deadline=None)
@given(arrays.arrays(np.float64, arrays.array_shapes(min_dims=3, max_dims=3, max_side=4)), st.integers(0, 2))
def test_it_reads_as_the_dataset_that_it_becomes(values: np.ndarray, axis: int) -> None:
    dims = ("a", "b", "c")
    own = Labelled(
        {"x": (dims, values, {"units": "m"}), "y": ("a", values[:, 0, 0])},
        {
            "a": [f"v{k}" for k in range(len(values))],
            "c": ("c", np.arange(values.shape[2]) + 1.0, {"units": "s"}),
        },
        {"settle_s": 5.0},
    )
    data = own.to_xarray()
    assert (data.attrs, dict(data.sizes)) == (own.attrs, own.sizes)
    assert set(data.data_vars) == set(own.data_vars)
    assert set(data.coords) == set(own.coords)
    for name in ("x", "y", "a", "c"):
        assert name in own
        assert name in data
        assert own[name].dims == data[name].dims
        np.testing.assert_array_equal(own[name].to_numpy(), data[name].to_numpy())
        assert dict(own[name].attrs) == data[name].attrs
    turned = own["x"].transpose("c", "a", "b")
    np.testing.assert_array_equal(turned.values, data["x"].transpose("c", "a", "b").values)
    part, want = own.isel(**{dims[axis]: 0}), data.isel({dims[axis]: 0})
    np.testing.assert_array_equal(part["x"].values, want["x"].values)
    assert part["x"].dims == want["x"].dims
    assert own.get("z") is None


def test_a_log_and_a_result_give_datasets_once_they_are_read() -> None:
    log = uwcoop.simulate("flat-bay", 1)
    assert isinstance(log.known_truth, Labelled)
    renamed = log.with_setup(log.setup)
    assert isinstance(log.truth, xr.Dataset)
    assert log.truth is log.truth
    assert log.known_truth is log.truth
    assert isinstance(renamed.known_truth, Labelled), "another log that shares it has not been read"
    xr.testing.assert_identical(renamed.truth, log.truth)
    for copied in (replace(log, name="b"), pickle.loads(pickle.dumps(log))):
        xr.testing.assert_identical(copied.truth, log.truth)
    assert replace(log, truth=None).truth is None
    result = uwcoop.run("flat-bay", ["mpf"], overrides=SHORT)
    assert isinstance(result.tracks, xr.Dataset)
    assert result.tracks is result.tracks
    assert result.tracks["position_m"].attrs["units"] == "m"
