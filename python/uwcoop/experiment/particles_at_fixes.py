"""A navigator's particles immediately before and after each fix: what a reconstruction did to them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from uwcoop.errors import TracksError
from uwcoop.evaluation.pose_tracks import true_yaw_rad
from uwcoop.experiment.run import native_mission, replay_for
from uwcoop.missionlog import MissionLog

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


def around_fixes(log: MissionLog, navigator: str, seed: int | None = None) -> xr.Dataset:
    """Replays a mission and keeps the mover's particles around each of its fixes with the landmark.

    Returns:
        dims (fix, side, particle, axis), `side` before and after: `particles_m` of the vehicle that measured,
        `reconstructions` (fix, side) counted so far, `truth_m` and `measured_m` (fix, axis) - the position that range
        and the landmark's bearing give from the true landmark - and `t_s`, `vehicle` (fix).

    Raises:
        TracksError: no fixes, or a navigator without particles or without reconstructions.
    """
    fixes = log.events.get("acoustic_fix")
    if fixes is None or not len(fixes["t_ns"]) or log.truth is None:
        raise TracksError("the mission has no mutual positioning, or no truth to compare with")
    times = np.unique(np.concatenate([fixes["t_ns"] - 1, fixes["t_ns"]]))
    replay = replay_for(
        log, native_mission(log), navigator, None, log.seed if seed is None else seed, times, 1
    )
    replay.run()
    record = replay.tracks()
    counted = record["diagnostics"].get("reconstructions")
    clouds = {(int(t), int(v)): positions for t, v, positions, _ in record["clouds"]}
    if counted is None or not clouds:
        raise TracksError(f"{navigator} has no particles that it could reconstruct")
    most = max(len(cloud) for cloud in clouds.values())
    count = len(fixes["t_ns"])
    particles = np.full((count, 2, most, 2), np.nan, np.float32)
    sums = np.zeros((count, 2))
    for k, (t_ns, v) in enumerate(zip(fixes["t_ns"].tolist(), fixes["vehicle"].tolist(), strict=True)):
        for side, at in enumerate((t_ns - 1, t_ns)):
            sums[k, side] = np.nan_to_num(counted[v, np.searchsorted(times, at)])
            cloud = clouds.get((at, v))
            if cloud is not None:
                particles[k, side, : len(cloud)] = cloud
    return xr.Dataset(
        {
            "particles_m": (("fix", "side", "particle", "axis"), particles, {"units": "m"}),
            "reconstructions": (("fix", "side"), sums),
            "truth_m": (
                ("fix", "axis"),
                _true_positions(log, fixes["vehicle"], fixes["t_ns"]),
                {"units": "m"},
            ),
            "measured_m": (("fix", "axis"), _measured(log), {"units": "m"}),
            "t_s": ("fix", fixes["t_ns"] / 1e9, {"units": "s"}),
            "vehicle": ("fix", fixes["vehicle"]),
        },
        coords={"side": ["before", "after"], "axis": ["east", "north"]},
    )


def _true_positions(log: MissionLog, vehicle: NDArray[np.int64], t_ns: NDArray[np.int64]) -> Floats:
    assert log.truth is not None
    known, position = log.truth["time"].to_numpy(), log.truth["position_m"].to_numpy()
    out = np.empty((len(vehicle), 2))
    for v in np.unique(vehicle):
        own = vehicle == v
        out[own] = np.column_stack([np.interp(t_ns[own] / 1e9, known, axis) for axis in position[v].T])
    return out


def _measured(log: MissionLog) -> Floats:
    assert log.truth is not None
    fixes = log.events["acoustic_fix"]
    known, t_s = log.truth["time"].to_numpy(), fixes["t_ns"] / 1e9
    yaw = true_yaw_rad(known, log.truth["yaw_rad"].to_numpy(), t_s)[fixes["peer"], np.arange(len(t_s))]
    angle = yaw + fixes["peer_bearing_rad"]
    away = fixes["range_m"][:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(_true_positions(log, fixes["peer"], fixes["t_ns"]) + away)
