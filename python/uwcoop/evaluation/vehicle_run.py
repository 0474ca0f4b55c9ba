"""One vehicle in one run of one navigator: what a metric is measured on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation.per_instant import (
    distances_m,
    grid_instants,
    names_of,
    nees_values,
    settled_instants,
    values_of,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog.labelled import Arrays

    Floats = NDArray[np.float64]
    Packets = Mapping[str, NDArray[Any]]

__all__ = ["VehicleRun", "vehicle_runs"]


@dataclass(frozen=True)
class VehicleRun:
    """One vehicle in one run of one navigator: what a metric is measured on."""

    tracks: Arrays
    packets: Packets | None
    """Of the run, as `RunResult.packets`; None: `packet_bytes` of the tracks counts."""
    seconds: float
    """The navigator's run time."""
    navigator: int
    vehicle: int
    settled: NDArray[np.bool_]
    """(time,) instants of the 1 Hz grid after `settle_s`."""
    error_m: Floats
    """At the settled instants with truth."""
    nees: Floats
    """At the same instants; NaN where undefined, infinite where the covariance rules the error out."""
    grid_error_m: Floats
    """At all instants of the 1 Hz grid; NaN where truth is unknown."""

    def values(self, name: str) -> Floats:
        """A variable of this navigator and vehicle, (time, ...)."""
        return np.asarray(values_of(self.tracks, name)[self.navigator, self.vehicle])


def vehicle_runs(
    tracks: Arrays, seconds: Mapping[str, float], packets: Packets | None
) -> Iterator[tuple[str, str, VehicleRun]]:
    """Navigator, vehicle and what is measured, for each of both."""
    settled, grid = settled_instants(tracks), grid_instants(tracks)
    error_m, square = distances_m(tracks), nees_values(tracks)
    for i, navigator in enumerate(names_of(tracks, "navigator")):
        for j, vehicle in enumerate(names_of(tracks, "vehicle")):
            known = settled & ~np.isnan(error_m[i, j])
            yield (
                navigator,
                vehicle,
                VehicleRun(
                    tracks, packets, float(seconds[navigator]), i, j, settled,
                    error_m[i, j, known], square[i, j, known], error_m[i, j, grid],
                ),
            )  # fmt: skip
