"""A seeded stand-in for what a run gives: tracks, packets, clouds, chart and log of known statistics.

Estimates are truth plus Gauss-Markov errors whose covariance is stated truthfully, so consistency is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import xarray as xr

from uwcoop.charts import Chart, synthetic
from uwcoop.missionlog import Link, MissionLog

SIGMA_M = {"dead-reckoning": 25.0, "dmpf": 3.0, "mpf": 1.0, "terrain-only": 6.0, "ranging-only": 60.0}
PACKET_BYTES = {"dmpf": 14, "mpf": 16, "ranging-only": 14}
LINK = Link("fake-32", frame_bytes=8, max_frames=4, frame_s=0.4, preamble_s=0.2, sound_speed_mps=1500.0)


@dataclass
class Mission:
    tracks: xr.Dataset
    packets: dict[str, np.ndarray[Any, Any]]
    clouds: xr.Dataset
    chart: Chart
    log: MissionLog
    seconds: dict[str, float]


def mission(
    *,
    navigators: tuple[str, ...] = ("dead-reckoning", "dmpf", "mpf"),
    vehicles: int = 3,
    duration_s: int = 300,
    seed: int = 1,
    loss: float = 0.2,
    slot_s: float = 3.25,
    particles: int = 200,
    chart: Chart | None = None,
    holes: bool = True,
) -> Mission:
    chart = chart or _chart(holes)
    names = tuple(f"auv-{k + 1}" for k in range(vehicles))
    rng = np.random.default_rng(seed)
    coarse = np.arange(duration_s + 1, dtype=float)
    paths = np.stack([_lawn_mower(rng, coarse) for _ in names])
    packets = _packets(rng, navigators, vehicles, duration_s, slot_s, loss, coarse, paths)
    time = np.unique(np.concatenate([coarse, packets["toa_ns"] / 1e9]))
    truth = np.stack([np.stack([np.interp(time, coarse, p[:, a]) for a in (0, 1)], -1) for p in paths])
    tracks = _tracks(rng, navigators, names, time, truth, packets, seed)
    clouds = _clouds(rng, tracks, particles)
    depth_m = 2.0 + np.arange(vehicles)[:, None] + np.zeros((vehicles, len(coarse)))
    heading = np.gradient(paths, axis=1)
    log = MissionLog(
        "fake-bay", seed, names, duration_s * 10**9, LINK, chart=chart,
        truth=xr.Dataset(
            {
                "position_m": (("vehicle", "time", "axis"), paths),
                "depth_m": (("vehicle", "time"), depth_m),
                "yaw_rad": (("vehicle", "time"), np.arctan2(heading[..., 1], heading[..., 0])),
            },
            {"vehicle": list(names), "time": coarse, "axis": ["east", "north"]},
        ),
    )  # fmt: skip
    return Mission(tracks, packets, clouds, chart, log, {n: 0.5 + k for k, n in enumerate(navigators)})


@cache
def _chart(holes: bool) -> Chart:
    whole = synthetic("st-john", seed=3)
    depth = np.array(whole.depth_m)
    if holes:
        depth[600:760, 80:200] = np.nan
    return Chart(depth, whole.east0_m, whole.north0_m, whole.cell_m, name="fake bay")


def _lawn_mower(rng: np.random.Generator, time: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    corner, leg, gap, speed = rng.uniform(150, 400, 2), rng.uniform(250, 400), 60.0, 1.5
    turns = [corner]
    for k in range(40):
        side = leg if k % 2 == 0 else 0.0
        turns += [corner + np.array([side, gap * n]) for n in (k, k + 1)]
    corners = np.array(turns)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    path = np.stack([np.interp(speed * time, along, corners[:, a]) for a in (0, 1)], -1)
    angle = rng.integers(4) * np.pi / 2
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (path - 500) @ turn.T + 500


def _packets(rng, navigators, vehicles, duration_s, slot_s, loss, coarse, paths):  # type: ignore[no-untyped-def]
    columns: dict[str, list[Any]] = {
        k: [] for k in ("navigator", "sender", "receiver", "tol_ns", "toa_ns", "bytes", "frames", "received",
                        "accepted")
    }  # fmt: skip
    for slot, tol in enumerate(np.arange(1.0, duration_s - 5.0, slot_s)):
        sender = slot % vehicles
        for receiver in range(vehicles):
            if receiver == sender:
                continue
            at = [
                np.array([np.interp(tol, coarse, paths[v, :, a]) for a in (0, 1)]) for v in (sender, receiver)
            ]
            toa_ns = round((tol + np.linalg.norm(at[0] - at[1]) / LINK.sound_speed_mps) * 1e9)
            survives = bool(rng.random() > loss)
            for i, name in enumerate(navigators):
                size = PACKET_BYTES.get(name, 0)
                row = (i, sender, receiver, round(tol * 1e9), toa_ns, size, -(-size // LINK.frame_bytes),
                       survives and size > 0, survives and size > 0 and slot % 17 != 5)  # fmt: skip
                for key, value in zip(columns, row, strict=True):
                    columns[key].append(value)
    kinds = {"received": bool, "accepted": bool}
    return {k: np.array(v, dtype=kinds.get(k, np.int64)) for k, v in columns.items()}


def _tracks(rng, navigators, names, time, truth, packets, seed):  # type: ignore[no-untyped-def]
    shape = (len(navigators), len(names), len(time))
    position, covariance = np.empty((*shape, 2)), np.empty((*shape, 2, 2))
    for i, navigator in enumerate(navigators):
        sigma = SIGMA_M[navigator]
        growth = np.minimum(1.0, 0.1 + time / time[-1]) if sigma > 20 else np.maximum(1.0, 4 - time / 10)
        for j in range(len(names)):
            correlation = np.array([[1.0, 0.6], [0.6, 0.8]])
            root = np.linalg.cholesky(correlation)
            noise = _gauss_markov(rng, time, 30.0)
            position[i, j] = truth[j] + sigma * growth[:, None] * (noise @ root.T)
            covariance[i, j] = (sigma * growth)[:, None, None] ** 2 * correlation
    heard, received = np.zeros(shape, bool), np.zeros(shape[1:], bool)
    sent = np.zeros(shape, np.int64)
    at = np.searchsorted(time, packets["toa_ns"] / 1e9)
    received[packets["receiver"], at] = True
    heard[packets["navigator"], packets["receiver"], at] = packets["accepted"]
    at = np.minimum(np.searchsorted(time, packets["tol_ns"] / 1e9), len(time) - 1)
    sent[packets["navigator"], packets["sender"], at] = packets["bytes"]
    off_chart = np.zeros(shape, bool)
    off_chart[min(1, shape[0] - 1), 0] = (time > 0.5 * time[-1]) & (time < 0.6 * time[-1])
    nvt = ("navigator", "vehicle", "time")
    return xr.Dataset(
        {
            "position_m": ((*nvt, "axis"), position),
            "covariance_m2": ((*nvt, "axis", "axis_b"), covariance),
            "yaw_rad": (nvt, np.full(shape, np.nan)),
            "ess": (nvt, np.full(shape, np.nan)),
            "packet_bytes": (nvt, sent),
            "rejected": (nvt, np.cumsum(heard & (np.arange(shape[2]) % 50 == 0), axis=2)),
            "off_chart": (nvt, off_chart),
            "heard": (nvt, heard),
            "received": (nvt[1:], received),
            "truth_position_m": ((*nvt[1:], "axis"), truth),
        },
        {
            "navigator": list(navigators),
            "vehicle": list(names),
            "time": time,
            "axis": ["east", "north"],
            "axis_b": ["east", "north"],
        },
        {"mission": "fake-bay", "seed": seed, "settle_s": 50.0},
    )


def _gauss_markov(rng, time, constant_s):  # type: ignore[no-untyped-def]
    """Unit-variance stationary noise, (time, 2)."""
    noise = rng.standard_normal((len(time), 2))
    for k in range(1, len(time)):
        keep = np.exp(-(time[k] - time[k - 1]) / constant_s)
        noise[k] = keep * noise[k - 1] + np.sqrt(1 - keep**2) * noise[k]
    return noise


def _clouds(rng, tracks, particles):  # type: ignore[no-untyped-def]
    at = np.arange(0, int(tracks.time.values[-1]) + 1, 10)
    index = np.searchsorted(tracks.time.values, at)
    mean = tracks.position_m.values[:, :, index]
    root = np.linalg.cholesky(tracks.covariance_m2.values[:, :, index])
    normals = rng.standard_normal((*mean.shape[:3], particles, 2))
    cloud = (mean[..., None, :] + np.einsum("nvtij,nvtpj->nvtpi", root, normals)).astype(np.float32)
    weight = np.full(cloud.shape[:-1], 1 / particles, np.float32)
    without = np.array([str(n) == "dead-reckoning" for n in tracks.navigator.values])
    cloud[without], weight[without] = np.nan, np.nan
    dims = ("navigator", "vehicle", "cloud_time", "particle")
    return xr.Dataset(
        {"particles_m": ((*dims, "axis"), cloud), "weight": (dims, weight)},
        {
            "navigator": tracks.navigator.values,
            "vehicle": tracks.vehicle.values,
            "cloud_time": at.astype(float),
            "axis": ["east", "north"],
        },
    )
