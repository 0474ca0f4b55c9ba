"""The paths in a run's `tracks.nc`: one for each navigator and vehicle, and the true ones."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.importers.bounded import READ_LIMIT_BYTES, refuse_array, refuse_irregular, refused
from uwcoop.scenario.base import nearest

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

__all__ = ["TRACKS", "TRUTH", "Route", "Routes", "read_routes"]

TRACKS = "tracks.nc"
TRUTH = "truth"
"""Stands in a navigator's place for the true path."""


@dataclass(frozen=True)
class Route:
    """Where one navigator believed one vehicle to be (or where it was), at the instants at which that is known, (N,)."""

    navigator: str
    vehicle: str
    time_s: Floats
    position_m: Floats
    """(N, 2) east, north of the local origin."""
    depth_m: Floats
    latitude_deg: Floats | None
    longitude_deg: Floats | None
    covariance_m2: Floats | None
    """(N, 2, 2); None for the truth."""
    yaw_rad: Floats | None
    """None where it is not known."""

    @property
    def name(self) -> str:
        """For people: "team V1"."""
        return f"{self.navigator} {self.vehicle}"

    @property
    def whole_seconds(self) -> NDArray[np.bool_]:
        """(N,) instants of the 1 Hz grid."""
        return np.asarray(np.abs(self.time_s - np.round(self.time_s)) < 1e-9)


@dataclass(frozen=True)
class Routes:
    """All routes of a run."""

    mission: str
    note: str
    """In what the mission is not as it happened; else empty."""
    epoch: datetime | None
    """UTC of time 0; None: not known."""
    routes: tuple[Route, ...]

    def utc(self, time_s: float) -> str | None:
        """UTC of an instant, ISO 8601 with milliseconds; None where the epoch is not known."""
        if self.epoch is None:
            return None
        at = self.epoch + timedelta(seconds=round(time_s, 6))
        return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def read_routes(folder: Path, navigators: Collection[str] = ()) -> Routes:
    """The routes in a folder that `uwcoop run -o` wrote, of these navigators (none named: of all) and the truth.

    Raises:
        TracksError: no tracks there, damaged ones, or an unknown navigator.
    """
    path = folder / TRACKS
    if not path.is_file():
        raise TracksError(f"no {TRACKS} in {folder}: `uwcoop run MISSION -o {folder}` writes one")
    import xarray as xr

    with refused(TracksError, f"tracks {path}"):
        refuse_irregular(path)
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as opened:
            # A header can state any size: HDF5 fills in what a file does not hold.
            refuse_array("their table", [opened.nbytes], 1, max(READ_LIMIT_BYTES, 1000 * path.stat().st_size))
            tracks = opened.load()
        return _routes(tracks, navigators)


def _routes(tracks: xr.Dataset, wanted: Collection[str]) -> Routes:
    names = [str(name) for name in tracks["navigator"].values]
    for name in wanted:
        if name not in names:
            raise TracksError(f"navigator {name!r} is not in them: {nearest(name, names)}")
    routes = []
    for j, vehicle in enumerate(str(v) for v in tracks["vehicle"].values):
        routes.append(_route(tracks, TRUTH, vehicle, j, None))
        routes += [
            _route(tracks, name, vehicle, j, i)
            for i, name in enumerate(names)
            if not wanted or name in wanted
        ]
    epoch = tracks.attrs.get("epoch")
    return Routes(
        mission=str(tracks.attrs["mission"]),
        note=str(tracks.attrs.get("counterfactual", "")),
        epoch=None if epoch is None else datetime.fromisoformat(str(epoch)),
        routes=tuple(route for route in routes if route.time_s.size),
    )


def _route(tracks: xr.Dataset, navigator: str, vehicle: str, j: int, i: int | None) -> Route:
    prefix = "truth_" if i is None else ""
    place = (j,) if i is None else (i, j)
    position = np.asarray(tracks[f"{prefix}position_m"].values[place], np.float64)
    known = np.isfinite(position).all(1)

    def own(name: str) -> Floats | None:
        if name not in tracks.variables:
            return None
        return np.asarray(tracks[name].values[place], np.float64)[known]

    yaw = own(f"{prefix}yaw_rad")
    depth = tracks["depth_m"].values[j] if "depth_m" in tracks else np.zeros(len(position))
    return Route(
        navigator,
        vehicle,
        np.asarray(tracks["time"].values, np.float64)[known],
        position[known],
        np.asarray(depth, np.float64)[known],
        own(f"{prefix}latitude"),
        own(f"{prefix}longitude"),
        None if i is None else own("covariance_m2"),
        yaw if yaw is not None and np.isfinite(yaw).any() else None,
    )
