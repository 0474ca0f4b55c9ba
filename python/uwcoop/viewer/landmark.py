"""Missions with a landmark in the replay: measurement rays, the current landmark, and events over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.viewer.stage import Stage, entity, rgb, time_column

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

RAY_S = 2.5
"""How long a measurement is shown."""
BY_LANDMARK, BY_MOVER = (80, 220, 160), (250, 250, 250)
FIXES = "fixes"
"""Entity of the rays, below the scene."""
EVENTS = "events"
"""Entity of the text log of landings and roles."""


def send(recording: Any, stage: Stage, log: MissionLog) -> None:
    """Log rays, landmark marks and events; nothing for a mission without a landmark."""
    if "role_taken" not in log.events:
        return
    _seabed(recording, stage)
    _rays(recording, stage, log)
    _marks(recording, stage, log)
    _events(recording, stage, log)


def _seabed(recording: Any, stage: Stage) -> None:
    """The edge of the seabed that the vehicles land on."""
    import rerun as rr

    west, east, south, north = stage.window
    depth = -stage.deepest_m
    edge = [[west, south, depth], [east, south, depth], [east, north, depth], [west, north, depth]]
    recording.log(
        stage.entity(FIXES, "seabed"),
        rr.LineStrips3D([[*edge, edge[0]]], colors=[(120, 110, 90)], radii=rr.Radius.ui_points(1.0)),
        static=True,
    )


def _rays(recording: Any, stage: Stage, log: MissionLog) -> None:
    """From the true landmark along its bearing, and from the true mover along its own, as long as the measured range."""
    fixes = log.events.get("acoustic_fix")
    if fixes is None:
        return
    t_s = fixes["t_ns"] / 1e9
    for v in range(len(stage.vehicles)):
        own = fixes["vehicle"] == v
        if not own.any():
            continue
        for name, who, bearing, colour in (
            ("landmark_sees", fixes["peer"], fixes["peer_bearing_rad"], BY_LANDMARK),
            ("mover_sees", fixes["vehicle"], fixes["own_bearing_rad"], BY_MOVER),
        ):
            start, yaw = _where(stage, who[own], t_s[own])
            end_depth, _ = _where(
                stage, (fixes["vehicle"] if name == "landmark_sees" else fixes["peer"])[own], t_s[own]
            )
            angle = yaw + bearing[own]
            reach = fixes["range_m"][own]
            end = start + np.column_stack(
                [reach * np.cos(angle), reach * np.sin(angle), np.zeros(len(reach))]
            )
            end[:, 2] = end_depth[:, 2]
            path = stage.entity(FIXES, stage.vehicles[v], name)
            _shown(recording, path, t_s[own], np.stack([start, end], axis=1).astype(np.float32), colour)


def _shown(
    recording: Any,
    path: str,
    t_s: NDArray[np.float64],
    ends: NDArray[np.float32],
    colour: tuple[int, int, int],
) -> None:
    """A line for `RAY_S` at each time, at most until the next."""
    import rerun as rr

    known = np.isfinite(ends).all(axis=(1, 2))
    if not known.any():
        return
    t_s, ends = t_s[known], ends[known]
    gone = np.minimum(t_s + RAY_S, np.append(t_s[1:], np.inf) - 1e-3)
    recording.log(
        path, rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(1.4)), static=True
    )
    recording.send_columns(
        path,
        indexes=[time_column(np.stack([t_s, gone], axis=1).ravel())],
        columns=rr.LineStrips3D.columns(strips=list(ends)).partition([1, 0] * len(t_s)),
    )


def _marks(recording: Any, stage: Stage, log: MissionLog) -> None:
    """A ring around each vehicle while it is the landmark."""
    import rerun as rr

    table = log.events["role_taken"]
    turn = np.linspace(0, 2 * math.pi, 33)
    for v, name in enumerate(stage.vehicles):
        mine = table["vehicle"] == v
        if not (mine & table["landmark"]).any():
            continue
        t_s, taken = table["t_ns"][mine] / 1e9, table["landmark"][mine]
        position, _ = _where(stage, np.full(len(t_s), v), t_s)
        radius = 0.025 * stage.span_m
        ring = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(33)])
        path = stage.entity("truth", name, "landmark")
        recording.log(
            path, rr.LineStrips3D.from_fields(colors=[rgb(v)], radii=rr.Radius.ui_points(3)), static=True
        )
        recording.send_columns(
            path,
            indexes=[time_column(t_s)],
            columns=rr.LineStrips3D.columns(
                strips=[(position[k] + ring).astype(np.float32) for k in np.flatnonzero(taken)]
            ).partition(taken.astype(int)),
        )


def _events(recording: Any, stage: Stage, log: MissionLog) -> None:
    """Landings, liftings and roles as text."""
    import rerun as rr

    lines: list[tuple[int, str]] = []
    for kind, says in (("landed", "lands"), ("lifted_off", "lifts off")):
        table = log.events.get(kind)
        if table is not None:
            rows = zip(table["t_ns"].tolist(), table["vehicle"].tolist(), strict=True)
            lines += [(t_ns, f"{stage.vehicles[v]} {says}") for t_ns, v in rows]
    table = log.events["role_taken"]
    for t_ns, v, landmark in zip(
        table["t_ns"].tolist(), table["vehicle"].tolist(), table["landmark"], strict=True
    ):
        lines.append((t_ns, f"{stage.vehicles[v]} {'is the landmark' if landmark else 'moves'}"))
    lines.sort(key=lambda line: line[0])
    recording.send_columns(
        entity(EVENTS),
        indexes=[time_column(np.array([t_ns for t_ns, _ in lines]) / 1e9)],
        columns=rr.TextLog.columns(text=[text for _, text in lines], level=["INFO"] * len(lines)),
    )


def _where(
    stage: Stage, vehicle: NDArray[np.int64], t_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """True position (K, 3), z = -depth, and yaw (K,) of vehicles at times."""
    position, yaw = np.full((len(t_s), 3), np.nan), np.full(len(t_s), np.nan)
    for v in np.unique(vehicle):
        own = vehicle == v
        columns = [*stage.truth_m[v].T, -stage.depth_m[v]]
        position[own] = np.column_stack([np.interp(t_s[own], stage.time_s, column) for column in columns])
        yaw[own] = np.interp(t_s[own], stage.time_s, np.unwrap(np.nan_to_num(stage.yaw_rad[v])))
    return position, yaw
