"""What replays recorded, as labelled arrays: tracks, packets, particle clouds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop import _native
from uwcoop.evaluation.cramer_rao import BOUNDS, bounds_of
from uwcoop.evaluation.pose_tracks import pose_variables
from uwcoop.experiment.diagnostics import attributes_of
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.labelled import Labelled

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

__all__ = ["clouds_of", "packets_of", "sent_by", "tracks_of"]


def tracks_of(log: MissionLog, names: Sequence[str], records: Sequence[dict[str, Any]]) -> Labelled:
    t_ns = records[0]["t_ns"]
    each = ("navigator", "vehicle", "time")
    covariance = np.stack([r["covariance_m2"] for r in records])
    sent, heard = np.zeros(covariance.shape[:3], np.int64), np.zeros(covariance.shape[:3], bool)
    gained = np.full(covariance.shape[:3], np.nan)
    for k, record in enumerate(records):
        at = np.minimum(np.searchsorted(t_ns, record["sent"]["tol_ns"]), len(t_ns) - 1)
        np.add.at(sent[k], (record["sent"]["sender"], at), record["sent"]["bytes"])
        at = np.minimum(np.searchsorted(t_ns, record["polls"]["t_ns"]), len(t_ns) - 1)
        np.add.at(sent[k], (record["polls"]["sender"], at), record["polls"]["bytes"])
        packets = record["packets"]
        used = packets["accepted"] & (packets["toa_ns"] <= t_ns[-1])
        at_arrival = (k, packets["receiver"][used], np.searchsorted(t_ns, packets["toa_ns"][used]))
        heard[at_arrival] = True
        gained[at_arrival] = packets["information_nat"][used]
    optional: dict[str, Any] = {}
    if np.isfinite(gained).any():
        nat = {
            "units": "nat",
            "long_name": "mutual information of the position and the range that arrived now",
        }
        optional["mutual_information"] = (each, gained, nat)
    for bound, values in bounds_of(log, t_ns).items():
        optional[bound] = (("vehicle", "time"), values, {"units": "m", "long_name": BOUNDS[bound]})
    received = np.zeros(covariance.shape[1:3], bool)
    for table in (log.opportunities, log.receptions):
        if table:
            inside = table["toa_ns"] <= t_ns[-1]
            received[table["receiver"][inside], np.searchsorted(t_ns, table["toa_ns"][inside])] = True

    def stack(key: str) -> NDArray[Any]:
        return np.stack([r[key] for r in records])

    metres = {"units": "m"}
    return Labelled(
        {
            "position_m": ((*each, "axis"), stack("mean_m"), metres),
            "covariance_m2": ((*each, "axis", "axis_b"), _square(covariance), {"units": "m2"}),
            "truth_position_m": (("vehicle", "time", "axis"), _truth(log, t_ns), metres),
            "yaw_rad": (each, stack("yaw_rad"), {"units": "rad"}),
            "ess": (each, stack("ess"), {"units": "1", "long_name": "effective sample size"}),
            "packet_bytes": (each, sent, {"units": "byte", "long_name": "bytes sent, polls included"}),
            "rejected": (each, stack("rejected").astype(np.int64), {"long_name": "gated or rejected so far"}),
            "unsent": (
                each,
                stack("unsent").astype(np.int64),
                {"long_name": "slots left silent so far: what there was to say did not fit"},
            ),
            "acquiring": (each, stack("acquiring"), {"long_name": "searching for its position"}),
            "off_chart": (each, stack("off_chart"), {"long_name": "no chart to go by: dead reckoning"}),
            "heard": (each, heard, {"long_name": "a packet that arrived now was used"}),
            "received": (("vehicle", "time"), received, {"long_name": "a signal could be heard now"}),
            **optional,
            **pose_variables(log, records, t_ns),
            **_diagnostics(records),
        },
        coords={
            "navigator": list(names),
            "vehicle": list(log.vehicles),
            "time": ("time", t_ns / 1e9, {"units": "s"}),
            "axis": ["east", "north"],
            "axis_b": ["east", "north"],
        },
        attrs={"mission": log.name, "seed": log.seed, "settle_s": log.setup.metrics.settle_s},
    )


def _diagnostics(records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The navigators' diagnostics, a variable each; NaN for a navigator without it."""
    shape = records[0]["ess"].shape
    stated = {
        name: np.stack([r["diagnostics"].get(name, np.full(shape, np.nan)) for r in records])
        for name in sorted({name for r in records for name in r["diagnostics"]})
    }
    dims = ("navigator", "vehicle", "time")
    return {name: (dims, values, attributes_of(name)) for name, values in stated.items()}


def sent_by(mission: _native.Mission, record: dict[str, Any]) -> dict[str, float]:
    """Bytes and air time of everything that a team launched, polls included."""
    sizes, counts = np.unique(record["sent"]["bytes"], return_counts=True)
    answers_s = sum(n * mission.air_time_s(int(size)) for size, n in zip(sizes, counts.tolist(), strict=True))
    polls = record["polls"]
    return {
        "bytes": int(record["sent"]["bytes"].sum() + polls["bytes"].sum()),
        "air_time_s": float(answers_s + polls["air_time_ns"].sum() / 1e9),
        "polls": len(polls["bytes"]),
    }


def _square(upper: NDArray[np.float64]) -> NDArray[np.float64]:
    """[ee, en, nn] → 2 × 2."""
    return upper[..., [0, 1, 1, 2]].reshape(*upper.shape[:-1], 2, 2)


def _truth(log: MissionLog, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """True positions at the record's instants, piecewise linear as vehicles move; NaN where unknown."""
    out = np.full((len(log.vehicles), len(t_ns), 2), np.nan)
    truth = log.known_truth
    if truth is None:
        return out
    known_s = truth["time"].to_numpy()
    position = truth["position_m"].to_numpy()
    for v in range(len(log.vehicles)):
        for axis in range(2):
            out[v, :, axis] = np.interp(t_ns / 1e9, known_s, position[v, :, axis], left=np.nan, right=np.nan)
    return out


def packets_of(records: Sequence[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    columns = {key: np.concatenate([r["packets"][key] for r in records]) for key in records[0]["packets"]}
    counts = [len(r["packets"]["sender"]) for r in records]
    return {"navigator": np.repeat(np.arange(len(records)), counts), **columns}


def clouds_of(log: MissionLog, names: Sequence[str], records: Sequence[dict[str, Any]]) -> xr.Dataset | None:
    times = np.unique([t_ns for r in records for t_ns, *_ in r["clouds"]]).astype(np.int64)
    most = max((len(w) for r in records for *_, w in r["clouds"]), default=0)
    if not len(times):
        return None
    import xarray as xr

    shape = (len(names), len(log.vehicles), len(times), most)
    particles = np.full((*shape, 2), np.nan, np.float32)
    weight = np.full(shape, np.nan, np.float32)
    for k, record in enumerate(records):
        for t_ns, vehicle, positions, weights in record["clouds"]:
            at = np.searchsorted(times, t_ns)
            particles[k, vehicle, at, : len(weights)] = positions
            weight[k, vehicle, at, : len(weights)] = weights
    dims = ("navigator", "vehicle", "cloud_time", "particle")
    return xr.Dataset(
        {"particles_m": ((*dims, "axis"), particles, {"units": "m"}), "weight": (dims, weight)},
        coords={
            "navigator": list(names),
            "vehicle": list(log.vehicles),
            "cloud_time": ("cloud_time", times / 1e9, {"units": "s"}),
            "axis": ["east", "north"],
        },
    )
