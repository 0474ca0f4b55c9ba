"""The 3-D scene: seabed, surface, true and estimated vehicles, trails, clouds and covariance ellipses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.figures.map import ellipse, hillshade
from uwcoop.figures.style import DEPTH_COLOURS
from uwcoop.viewer.stage import Stage, rgb, time_column

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.charts import Chart

MESH_VERTICES = 45_000
"""At about 40 bytes for each vertex with its two triangles, the seabed stays below 2 MB."""

CLOUD_BYTES = 4_000_000
ELLIPSE_BYTES = 1_500_000
TRAIL_STEP_S = 2
TRUTH_COLOUR = (235, 235, 235)
TRUTH_TRAIL_COLOUR = (30, 30, 30)


def send(
    recording: Any, stage: Stage, tracks: xr.Dataset, chart: Chart | None, clouds: xr.Dataset | None
) -> None:
    """Log the whole scene."""
    import rerun as rr

    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if stage.exaggeration != 1:
        recording.log(stage.root, rr.Transform3D(scale=[1, 1, stage.exaggeration]), static=True)
    seabed(recording, stage, chart)
    truth = stage.positions(stage.truth_m)
    for j, vehicle in enumerate(stage.vehicles):
        _true_vehicle(recording, stage, vehicle, truth[j], stage.yaw_rad[j])
    for i, navigator in enumerate(stage.navigators):
        estimate = stage.positions(tracks["position_m"].values[i][:, stage.at])
        for j, vehicle in enumerate(stage.vehicles):
            covariance = tracks["covariance_m2"].values[i, j, stage.at]
            _believed_vehicle(recording, stage, navigator, j, estimate[j])
            _ellipses(recording, stage, stage.entity(navigator, vehicle, "body", "ellipse_95"), j, covariance)
            if clouds is not None:
                _clouds(recording, stage, clouds, i, j, estimate[j])


# ---------------------------------------------------------------------------------------------- seabed


def seabed(recording: Any, stage: Stage, chart: Chart | None) -> None:
    """The chart in the window, and the border of the surface."""
    import rerun as rr

    if chart is not None:
        vertices, triangles, colours = seabed_mesh(chart, stage.window)
        if len(triangles):
            recording.log(
                stage.entity("chart"),
                rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, vertex_colors=colours),
                static=True,
            )
    west, east, south, north = stage.window
    border = [[west, south, 0], [east, south, 0], [east, north, 0], [west, north, 0], [west, south, 0]]
    recording.log(
        stage.entity("surface"),
        rr.LineStrips3D([border], colors=[(90, 120, 150)], radii=rr.Radius.ui_points(0.8)),
        static=True,
    )


def seabed_mesh(
    chart: Chart, window: tuple[float, float, float, float]
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.uint8]]:
    """Vertices (N, 3) with z = -depth, triangles (M, 3), colours (N, 3) of the chart in the window.

    Nodes are thinned evenly to at most about `MESH_VERTICES`; a triangle with a corner in a hole is left
    out. Depth is colour, with hillshade baked in, because the viewer lights all meshes from its camera.
    """
    j0, j1 = (round((x - chart.east0_m) / chart.cell_m) for x in window[:2])
    i0, i1 = (round((y - chart.north0_m) / chart.cell_m) for y in window[2:])
    thin = max(1, math.ceil(math.sqrt((i1 - i0 + 1) * (j1 - j0 + 1) / MESH_VERTICES)))
    rows, columns = np.arange(i0, i1 + 1, thin), np.arange(j0, j1 + 1, thin)
    depth = np.asarray(chart.depth_m, dtype=np.float64)[np.ix_(rows, columns)]
    if min(depth.shape) < 2:
        return np.empty((0, 3), np.float32), np.empty((0, 3), np.uint32), np.empty((0, 3), np.uint8)
    east, north = np.meshgrid(chart.east0_m + chart.cell_m * columns, chart.north0_m + chart.cell_m * rows)
    number = np.arange(depth.size).reshape(depth.shape)
    sw, se, nw, ne = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    corners = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((sw, se, ne), (sw, ne, nw))])
    corners = corners[np.isfinite(depth.ravel()[corners]).all(1)]
    used, triangles = np.unique(corners, return_inverse=True)
    vertices = np.stack([east.ravel(), north.ravel(), -depth.ravel()], -1)[used]
    shade = 0.55 + 0.45 * hillshade(depth, chart.cell_m * thin)
    colours = (_depth_colours(depth, chart) * shade[..., None]).reshape(-1, 3)[used]
    return vertices.astype(np.float32), triangles.reshape(-1, 3).astype(np.uint32), colours.astype(np.uint8)


def _depth_colours(depth: NDArray[np.float64], chart: Chart) -> NDArray[np.float64]:
    shallow, deep = chart.depth_range_m
    level = np.nan_to_num((depth - shallow) / max(deep - shallow, 1e-9))
    stops = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in DEPTH_COLOURS], dtype=np.float64)
    at = np.linspace(0, 1, len(stops))
    return np.stack([np.interp(level, at, stops[:, k]) for k in range(3)], -1)


# ---------------------------------------------------------------------------------------------- vehicles


def _true_vehicle(
    recording: Any, stage: Stage, vehicle: str, path: NDArray[np.float32], yaw_rad: NDArray[np.float64]
) -> None:
    import rerun as rr

    known = np.isfinite(path).all(1)
    if not known.any():
        return
    yaw = np.nan_to_num(yaw_rad[known])
    turn = np.stack([np.zeros_like(yaw), np.zeros_like(yaw), np.sin(yaw / 2), np.cos(yaw / 2)], -1)
    body = stage.entity("truth", vehicle, "body")
    recording.send_columns(
        body,
        indexes=[time_column(stage.time_s[known])],
        columns=rr.Transform3D.columns(translation=path[known], quaternion=turn),
    )
    recording.log(
        f"{body}/arrow",
        rr.Arrows3D(
            vectors=[[0.035 * stage.span_m, 0, 0]], radii=rr.Radius.ui_points(2.5), colors=[TRUTH_COLOUR]
        ),
        static=True,
    )
    recording.log(
        stage.entity("truth", vehicle, "course"),
        rr.LineStrips3D([path[known]], colors=[(150, 160, 170)], radii=rr.Radius.ui_points(0.5)),
        static=True,
    )
    _trail(recording, stage, stage.entity("truth", vehicle, "trail"), path, TRUTH_TRAIL_COLOUR, 1.2)


def _believed_vehicle(
    recording: Any, stage: Stage, navigator: str, vehicle: int, path: NDArray[np.float32]
) -> None:
    import rerun as rr

    known = np.isfinite(path).all(1)
    if not known.any():
        return
    name, colour = stage.vehicles[vehicle], rgb(vehicle)
    body = stage.entity(navigator, name, "body")
    recording.send_columns(
        body,
        indexes=[time_column(stage.time_s[known])],
        columns=rr.Transform3D.columns(translation=path[known]),
    )
    recording.log(
        f"{body}/position",
        rr.Points3D([[0, 0, 0]], colors=[colour], radii=rr.Radius.ui_points(6)),
        static=True,
    )
    # A label takes its point's colour, and coloured letters on the viewer's grey plate cannot be read.
    recording.log(
        f"{body}/name",
        rr.Points3D(
            [[0, 0, 0]],
            colors=[(255, 255, 255)],
            radii=rr.Radius.ui_points(0.5),
            labels=[name],
            show_labels=True,
        ),
        static=True,
    )
    _trail(recording, stage, stage.entity(navigator, name, "trail"), path, colour, 1.8)


def _trail(
    recording: Any,
    stage: Stage,
    entity: str,
    path: NDArray[np.float32],
    colour: tuple[int, int, int],
    width: float,
) -> None:
    """Short strips, one per `TRAIL_STEP_S`; the layout shows all up to the cursor, so the trail grows."""
    import rerun as rr

    ends = np.arange(TRAIL_STEP_S, len(path), TRAIL_STEP_S)
    strips = [path[k - TRAIL_STEP_S : k + 1] for k in ends]
    kept = [n for n, strip in enumerate(strips) if np.isfinite(strip).all()]
    if not kept:
        return
    recording.log(
        entity, rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(width)), static=True
    )
    recording.send_columns(
        entity,
        indexes=[time_column(stage.time_s[ends[kept]])],
        columns=rr.LineStrips3D.columns(strips=[strips[n] for n in kept]),
    )


# ---------------------------------------------------------------------------------------------- uncertainty


def _ellipses(
    recording: Any, stage: Stage, entity: str, vehicle: int, covariance: NDArray[np.float64]
) -> None:
    """95 % ellipses around the body, thinned in time; none where the covariance is not one."""
    import rerun as rr

    rings = len(stage.navigators) * len(stage.vehicles) * len(stage.time_s)
    step = max(1, math.ceil(rings * 21 * 12 / ELLIPSE_BYTES))
    at = np.arange(0, len(stage.time_s), step)
    outlines = [ellipse(np.zeros(2), covariance[k])[::2] for k in at]
    drawn = [np.pad(o, ((0, 0), (0, 1))).astype(np.float32) for o in outlines if np.isfinite(o).all()]
    if not drawn:
        return
    recording.log(
        entity,
        rr.LineStrips3D.from_fields(colors=[rgb(vehicle)], radii=rr.Radius.ui_points(1.2)),
        static=True,
    )
    recording.send_columns(
        entity,
        indexes=[time_column(stage.time_s[at])],
        columns=rr.LineStrips3D.columns(strips=drawn).partition(
            [int(np.isfinite(o).all()) for o in outlines]
        ),
    )


def _clouds(
    recording: Any, stage: Stage, clouds: xr.Dataset, i: int, j: int, estimate: NDArray[np.float32]
) -> None:
    """Particles relative to the body; evenly thinned when all clouds together would pass `CLOUD_BYTES`."""
    import rerun as rr

    particles = clouds["particles_m"].values
    navigators, vehicles, times, count = particles.shape[:4]
    thin = max(1, math.ceil(navigators * vehicles * times * count * 12 / CLOUD_BYTES))
    at_s = np.asarray(clouds["cloud_time"].values, dtype=np.float64)
    centre = np.clip(np.searchsorted(stage.time_s, at_s + 1e-9, side="right") - 1, 0, len(estimate) - 1)
    relative = particles[i, j, :, ::thin] - estimate[centre, None, :2]
    known = np.isfinite(relative).all(-1)
    if not known.any():
        return
    flat = np.pad(relative[known], ((0, 0), (0, 1))).astype(np.float32)
    entity = stage.entity(stage.navigators[i], stage.vehicles[j], "body", "cloud")
    light = tuple(int(0.55 * c + 0.45 * 255) for c in rgb(j))
    recording.log(
        entity, rr.Points3D.from_fields(colors=[light], radii=rr.Radius.ui_points(1.4)), static=True
    )
    recording.send_columns(
        entity,
        indexes=[time_column(at_s)],
        columns=rr.Points3D.columns(positions=flat).partition(known.sum(1)),
    )
