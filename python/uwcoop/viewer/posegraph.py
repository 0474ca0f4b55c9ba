"""Pose graphs: nodes at launches that were heard, the chain between them, ranges, lost launches and the origin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwcoop.viewer.stage import Stage, rgb, time_column
from uwcoop.viewer.traffic import COLOURS, LOST

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Packets = Mapping[str, NDArray[Any]]

GRAPH = "graph_nodes"
"""The diagnostic that a navigator with a pose graph gives."""
AGE = "origin_age_s"
RANGE_COLOUR = (150, 150, 160)


class Link(NamedTuple):
    """The launches of one vehicle at another, by one navigator, in the order of launch."""

    navigator: int
    sender: int
    receiver: int
    launch_s: Floats
    arrival_s: Floats
    heard: NDArray[np.bool_]


def kept(stage: Stage, tracks: xr.Dataset, packets: Packets) -> dict[str, list[str]]:
    """By navigator, the entities of which the layout shows everything up to the cursor."""
    paths: dict[str, list[str]] = {}
    for link in _links(stage, tracks, packets):
        root = _path(stage, link)
        paths.setdefault(stage.navigators[link.navigator], []).extend(
            f"{root}/{part}" for part in ("nodes", "edges", "lost")
        )
    return paths


def send(recording: Any, stage: Stage, tracks: xr.Dataset, packets: Packets) -> None:
    """Log the graphs of all navigators that have one; a node is at the estimate of its sender at that time."""
    import rerun as rr

    origins: set[tuple[int, int]] = set()
    for link in _links(stage, tracks, packets):
        root = _path(stage, link)
        places = _where(stage, tracks, link.navigator, link.sender, link.launch_s)
        heard = link.heard & np.isfinite(places).all(1)
        colour = rgb(link.sender)
        _points(recording, f"{root}/nodes", link.arrival_s[heard], places[heard], colour, 3.5)
        lost = ~link.heard & np.isfinite(places).all(1)
        _points(recording, f"{root}/lost", link.arrival_s[lost], places[lost], COLOURS[LOST], 5.0)
        if heard.sum() > 1:
            chain = np.stack([places[heard][:-1], places[heard][1:]], axis=1)
            _strips(recording, f"{root}/edges", link.arrival_s[heard][1:], chain, colour, 1.0)
        ends = _where(stage, tracks, link.navigator, link.receiver, link.arrival_s)
        known = heard & np.isfinite(ends).all(1)
        if known.any():
            ranges = np.stack([places[known], ends[known]], axis=1)
            _strips(recording, f"{root}/ranges", link.arrival_s[known], ranges, RANGE_COLOUR, 0.8)
        if AGE in tracks and (link.navigator, link.sender) not in origins:
            origins.add((link.navigator, link.sender))
            _origin(recording, stage, tracks, link.navigator, link.sender, rr)


def _links(stage: Stage, tracks: xr.Dataset, packets: Packets) -> Iterator[Link]:
    if GRAPH not in tracks:
        return
    for i in range(len(stage.navigators)):
        if not np.isfinite(tracks[GRAPH].values[i]).any():
            continue
        own = np.flatnonzero(packets["navigator"] == i)
        pairs = zip(packets["sender"][own].tolist(), packets["receiver"][own].tolist(), strict=True)
        for sender, receiver in sorted(set(pairs)):
            at = own[(packets["sender"][own] == sender) & (packets["receiver"][own] == receiver)]
            at = at[np.argsort(packets["tol_ns"][at], kind="stable")]
            heard = packets["accepted"][at].astype(bool)
            # A vehicle that only acknowledges builds no graph of the sender.
            if heard.any():
                yield Link(
                    i, sender, receiver, packets["tol_ns"][at] / 1e9, packets["toa_ns"][at] / 1e9, heard
                )


def _path(stage: Stage, link: Link) -> str:
    name = f"{stage.vehicles[link.sender]}_at_{stage.vehicles[link.receiver]}"
    return stage.entity(stage.navigators[link.navigator], "graph", name)


def _where(
    stage: Stage, tracks: xr.Dataset, navigator: int, vehicle: int, seconds: Floats
) -> NDArray[np.float32]:
    """Where the navigator put a vehicle at these times, (N, 3) with z = -depth; NaN where it did not know."""
    position = tracks["position_m"].values[navigator, vehicle][stage.at]
    columns = [*position.T, -stage.depth_m[vehicle]]
    return np.stack([np.interp(seconds, stage.time_s, column) for column in columns], axis=-1).astype(
        np.float32
    )


def _points(
    recording: Any,
    path: str,
    at_s: Floats,
    places: NDArray[np.float32],
    colour: tuple[int, int, int],
    size: float,
) -> None:
    import rerun as rr

    if not len(places):
        return
    recording.log(
        path, rr.Points3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(size)), static=True
    )
    recording.send_columns(
        path,
        indexes=[time_column(at_s)],
        columns=rr.Points3D.columns(positions=places).partition([1] * len(places)),
    )


def _strips(
    recording: Any,
    path: str,
    at_s: Floats,
    ends: NDArray[np.float32],
    colour: tuple[int, int, int],
    width: float,
) -> None:
    import rerun as rr

    recording.log(
        path, rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(width)), static=True
    )
    recording.send_columns(
        path,
        indexes=[time_column(at_s)],
        columns=rr.LineStrips3D.columns(strips=list(ends)).partition([1] * len(ends)),
    )


def _origin(recording: Any, stage: Stage, tracks: xr.Dataset, navigator: int, sender: int, rr: Any) -> None:
    """A large point at the sender's node that is the agreed origin, moved when it shifts."""
    age_s = tracks[AGE].values[navigator, sender][stage.at]
    launch_s = stage.time_s - age_s
    known = np.flatnonzero(np.isfinite(launch_s))
    if not len(known):
        return
    shifted = known[np.append(True, np.abs(np.diff(launch_s[known])) > 0.5)]
    places = _where(stage, tracks, navigator, sender, launch_s[shifted])
    fine = np.isfinite(places).all(1)
    path = stage.entity(stage.navigators[navigator], "graph", f"{stage.vehicles[sender]}_origin")
    recording.log(
        path,
        rr.Points3D.from_fields(
            colors=[(255, 255, 255)], radii=rr.Radius.ui_points(8.0), labels=["origin"], show_labels=True
        ),
        static=True,
    )
    recording.send_columns(
        path,
        indexes=[time_column(stage.time_s[shifted][fine])],
        columns=rr.Points3D.columns(positions=places[fine]).partition([1] * int(fine.sum())),
    )
