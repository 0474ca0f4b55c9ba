"""The error over time of every run of a study, compact enough to keep: what `errors.nc` holds.

A mission's error series has a value for each whole second, so that the runs of a study can be averaged instant by
instant. All error series of a study make one Dataset, dims (variant, run, navigator, vehicle, time):

- `error_m`, float32, m: distance from truth. NaN where truth is unknown, where a variant has no such vehicle
  or is over, and in missions that are not stored (`stored` is false); infinite where the estimate has failed.
- `arrivals`, uint8: signals that could be heard in the second that ends now.
- `heard`, uint8: those of them whose packet was used.
- `mutual_information`, float32, nat: mutual information of those ranges and the position; only with
  `diagnostics.entropy = "at_reception"`, NaN where nothing was heard.
- `stored (variant, run)`; coordinates `variant` (its settings as text, empty where nothing is varied) and
  `seed (run)`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.evaluation import metrics
from uwcoop.importers.bounded import READ_LIMIT_BYTES, refuse_array, refuse_irregular, refused
from uwcoop.report.atomic_files import atomic_write

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

__all__ = ["FILE", "ErrorSeries", "error_series_of", "gather", "read_error_series", "write_error_series"]

FILE = "errors.nc"

ErrorSeries = dict[tuple[str, int], "xr.Dataset"]
"""A mission's error series by variant and seed."""

_EACH = ("navigator", "vehicle", "time")
_EMPTY = {"error_m": np.nan, "mutual_information": np.nan, "arrivals": 0, "heard": 0}
_ATTRIBUTES = {
    "error_m": {"units": "m", "long_name": "distance from truth"},
    "arrivals": {"units": "1", "long_name": "signals that could be heard in the second that ends now"},
    "heard": {"units": "1", "long_name": "packets used in the second that ends now"},
    "mutual_information": {
        "units": "nat",
        "long_name": "mutual information of position and the ranges of this second",
    },
}


def error_series_of(tracks: xr.Dataset) -> xr.Dataset:
    """A mission's error series, dims (navigator, vehicle, time at 1 Hz), from its tracks."""
    import xarray as xr

    time = tracks["time"].values
    grid = np.flatnonzero(np.abs(time - np.round(time)) < 1e-9)
    # Instants of a second: those after the whole second before it, itself included.
    edges = np.searchsorted(time, time[grid] + 1e-9, side="right")
    first = np.concatenate([[0], edges[:-1]])

    def binned(values: NDArray[np.float64]) -> NDArray[np.float64]:
        total = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
        return np.asarray(total[..., edges] - total[..., first])

    heard = binned(tracks["heard"].values.astype(np.float64))
    arrivals = np.broadcast_to(binned(tracks["received"].values.astype(np.float64)), heard.shape)
    values: dict[str, NDArray[np.generic]] = {
        "error_m": metrics.errors(tracks).values[..., grid].astype(np.float32),
        "arrivals": arrivals.astype(np.uint8),
        "heard": heard.astype(np.uint8),
    }
    if "mutual_information" in tracks:
        gained = tracks["mutual_information"].values
        known = binned(np.isfinite(gained).astype(np.float64)) > 0
        sums = binned(np.where(np.isfinite(gained), gained, 0.0))
        values["mutual_information"] = np.where(known, sums, np.nan).astype(np.float32)
    return xr.Dataset(
        {name: (_EACH, array, _ATTRIBUTES[name]) for name, array in values.items()},
        coords={
            "navigator": tracks["navigator"].values,
            "vehicle": tracks["vehicle"].values,
            "time": ("time", time[grid], {"units": "s"}),
        },
        attrs={"settle_s": float(tracks.attrs["settle_s"])},
    )


def gather(error_series: ErrorSeries, variants: Sequence[str], seeds: Sequence[int]) -> xr.Dataset | None:
    """The error series of these variants and seeds as one Dataset; None if there are none of them."""
    own = {(v, s): error_series[v, s] for v in variants for s in seeds if (v, s) in error_series}
    if not own:
        return None
    import xarray as xr

    every = list(own.values())
    names = {dim: _union(series[dim].values.tolist() for series in every) for dim in ("navigator", "vehicle")}
    time = max((series["time"].values for series in every), key=len)
    shape = (len(variants), len(seeds), *(len(n) for n in names.values()), len(time))
    values = {
        name: np.full(shape, empty, next(t[name].dtype for t in every if name in t))
        for name, empty in _EMPTY.items()
        if any(name in series for series in every)
    }
    for (variant, seed), series in own.items():
        at = np.ix_(*([names[dim].index(n) for n in series[dim].values.tolist()] for dim in names))
        mission = (variants.index(variant), seeds.index(seed))
        for name, array in values.items():
            if name in series:
                array[mission][..., : series.sizes["time"]][at] = series[name].values
    stored = [[(variant, seed) in own for seed in seeds] for variant in variants]
    return xr.Dataset(
        {
            **{n: (("variant", "run", *_EACH), array, _ATTRIBUTES[n]) for n, array in values.items()},
            "stored": (("variant", "run"), np.array(stored)),
        },
        coords={
            "variant": list(variants),
            "seed": ("run", np.array(seeds, np.int64)),
            **names,
            "time": ("time", time, {"units": "s"}),
        },
        attrs={"settle_s": every[0].attrs["settle_s"]},
    )


def write_error_series(error_series: ErrorSeries, folder: Path) -> None:
    """Write `errors.nc` with all error series; nothing if there are none."""
    everything = gather(
        error_series, _union([v] for v, _ in error_series), sorted({s for _, s in error_series})
    )
    if everything is None:
        return
    packed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding = {str(name): packed for name in everything.data_vars if name != "stored"}
    with atomic_write(folder / FILE) as partial:
        everything.to_netcdf(partial, engine="h5netcdf", encoding=encoding)


def read_error_series(folder: Path) -> ErrorSeries:
    """The error series that `errors.nc` in `folder` holds; none if there is no such file.

    Raises:
        TracksError: a file that `write_error_series` has not written.
    """
    path = folder / FILE
    if not path.exists():
        return {}
    import xarray as xr

    with refused(TracksError, f"a study's errors {path}"):
        refuse_irregular(path)
        with xr.open_dataset(path, engine="h5netcdf") as opened:
            # A header can state any size: HDF5 fills in what a file does not hold.
            refuse_array("their table", [opened.nbytes], 1, max(READ_LIMIT_BYTES, 1000 * path.stat().st_size))
            everything = opened.load()
        stored = everything["stored"].values.astype(bool)
        return {
            (str(everything["variant"].values[v]), int(everything["seed"].values[r])): everything.isel(
                variant=v, run=r
            ).drop_vars(["stored", "variant", "seed"])
            for v, r in np.argwhere(stored)
        }


def _union(lists: Iterable[Sequence[str]]) -> list[str]:
    return list(dict.fromkeys(str(name) for names in lists for name in names))
