"""Packets in flight, and the acoustic event log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.viewer.stage import Stage, entity, time_column

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

ARRIVED, REFUSED, LOST = "received", "refused", "lost"
"""Refused: it arrived and the navigator did not accept it."""

COLOURS = {ARRIVED: (120, 230, 130), REFUSED: (240, 228, 66), LOST: (255, 70, 40)}
LEVELS = {ARRIVED: "INFO", REFUSED: "WARN", LOST: "WARN"}


def send(recording: Any, stage: Stage, packets: Mapping[str, NDArray[Any]], log: MissionLog) -> None:
    """Log each navigator's packets as lines and as text; a navigator that is silent has neither."""
    for i, navigator in enumerate(stage.navigators):
        chosen = np.flatnonzero((packets["navigator"] == i) & (packets["bytes"] > 0))
        if not len(chosen):
            continue
        own = {key: np.asarray(column)[chosen] for key, column in packets.items()}
        fate = np.select(
            [~own["received"].astype(bool), ~own["accepted"].astype(bool)], [LOST, REFUSED], ARRIVED
        )
        launch_s = own["tol_ns"] / 1e9
        air_s = log.link.preamble_s + own["frames"] * log.link.frame_s
        decoded_s = np.maximum(own["toa_ns"] / 1e9 + air_s, launch_s)
        pairs = sorted(set(zip(own["sender"].tolist(), own["receiver"].tolist(), strict=True)))
        for sender, receiver in pairs:
            at = np.flatnonzero((own["sender"] == sender) & (own["receiver"] == receiver))
            ends = np.stack(
                [_where(stage, sender, launch_s[at]), _where(stage, receiver, own["toa_ns"][at] / 1e9)],
                axis=1,
            )
            path = stage.entity(
                navigator, "packets", f"{stage.vehicles[sender]}_to_{stage.vehicles[receiver]}"
            )
            _flights(recording, path, launch_s[at], decoded_s[at], ends, fate[at])
        _event_log(recording, stage, entity("acoustics", navigator), own, decoded_s, fate)


def _flights(
    recording: Any,
    path: str,
    launch_s: NDArray[np.float64],
    decoded_s: NDArray[np.float64],
    ends: NDArray[np.float32],
    fate: NDArray[np.str_],
) -> None:
    """A line from launch until decoding ends, then an empty row that takes it away."""
    import rerun as rr

    known = np.isfinite(ends).all((1, 2))
    if not known.any():
        return
    launch_s, decoded_s, ends, fate = launch_s[known], decoded_s[known], ends[known], fate[known]
    order = np.argsort(launch_s, kind="stable")
    # The next launch on this path ends the line too, were the air time longer than the slot.
    following = np.append(launch_s[order][1:], np.inf)
    gone = np.minimum(decoded_s[order], following)
    times = np.stack([launch_s[order], gone], axis=1).ravel()
    recording.log(path, rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(1.6)), static=True)
    recording.send_columns(
        path,
        indexes=[time_column(times)],
        columns=rr.LineStrips3D.columns(
            strips=list(ends[order]), colors=[COLOURS[str(f)] for f in fate[order]]
        ).partition([1, 0] * len(order)),
    )


def _event_log(
    recording: Any,
    stage: Stage,
    path: str,
    own: Mapping[str, NDArray[Any]],
    decoded_s: NDArray[np.float64],
    fate: NDArray[np.str_],
) -> None:
    import rerun as rr

    order = np.argsort(decoded_s, kind="stable")
    lines = []
    for k in order:
        sender, receiver = (stage.vehicles[int(own[end][k])] for end in ("sender", "receiver"))
        frames = int(own["frames"][k])
        lines.append(
            f"{sender} → {receiver}: {int(own['bytes'][k])} bytes in {frames} "
            f"frame{'s' if frames != 1 else ''}, "
            f"travelled {(own['toa_ns'][k] - own['tol_ns'][k]) / 1e6:.1f} ms, {fate[k]}"
        )
    recording.send_columns(
        path,
        indexes=[time_column(decoded_s[order])],
        columns=rr.TextLog.columns(
            text=lines,
            level=[LEVELS[str(f)] for f in fate[order]],
            color=[COLOURS[str(f)] for f in fate[order]],
        ),
    )


def _where(stage: Stage, vehicle: int, seconds: NDArray[np.float64]) -> NDArray[np.float32]:
    """True position (N, 3) with z = -depth at these times; NaN where truth is unknown."""
    columns = [*stage.truth_m[vehicle].T, -stage.depth_m[vehicle]]
    return np.stack([np.interp(seconds, stage.time_s, column) for column in columns], axis=-1).astype(
        np.float32
    )
