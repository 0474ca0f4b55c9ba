"""Where the vehicles were, from channels that are named as truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.importers.mapping.position import positions_m

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.importers.mapping.binding import Binding
    from uwcoop.importers.mapping.series import Series
    from uwcoop.importers.mapping.vehicle_data import Known

    Floats = NDArray[np.float64]

__all__ = ["truth_of"]

_LONGEST_GAP_S = 30.0


def truth_of(
    names: Sequence[str],
    read: Mapping[str, Sequence[tuple[Binding, Series]]],
    known: Sequence[Known],
    zero_ns: int,
    duration_ns: int,
    said: list[str],
) -> xr.Dataset | None:
    """(vehicle, time, axis) positions on the instants of all; NaN outside of a channel's span and in long gaps."""
    paths: dict[int, tuple[NDArray[np.int64], Floats]] = {}
    for own in known:
        for binding, series in read[own.name]:
            if binding.role != "truth":
                continue
            found = series.thinned("truth", binding.settings.max_rate_hz)
            at, t_ns = positions_m(binding, found, own), found.t_ns - zero_ns
            inside = (t_ns >= 0) & (t_ns <= duration_ns)
            if inside.any():
                paths[own.index] = t_ns[inside], at[inside]
                said.append(
                    f"{own.name} truth: {inside.sum():,} of {found.total:,} rows of {binding.channel.name}"
                )
    if not paths:
        return None
    import xarray as xr

    # An instant within each long gap, at which the truth is unknown: nobody draws a line over it.
    gaps = {index: np.flatnonzero(np.diff(own) > _LONGEST_GAP_S * 1e9) for index, (own, _) in paths.items()}
    middles = [(paths[index][0][k] + paths[index][0][k + 1]) // 2 for index, k in gaps.items()]
    t_ns = np.unique(np.concatenate([*(own for own, _ in paths.values()), *middles]))
    position = np.full((len(names), len(t_ns), 2), np.nan)
    for index, (own_ns, at) in paths.items():
        for axis in range(2):
            position[index, :, axis] = np.interp(t_ns, own_ns, at[:, axis], left=np.nan, right=np.nan)
        for k in gaps[index]:
            position[index, (t_ns > own_ns[k]) & (t_ns < own_ns[k + 1])] = np.nan
    return xr.Dataset(
        {"position_m": (("vehicle", "time", "axis"), position, {"units": "m"})},
        coords={
            "vehicle": list(names), "time": ("time", t_ns / 1e9, {"units": "s"}), "axis": ["east", "north"],
        },
    )  # fmt: skip
