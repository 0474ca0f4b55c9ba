"""Shared by all parts of a replay: names, instants, depths, colours, and the scale of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.figures.style import OKABE_ITO
from uwcoop.missionlog.depths import depths_m

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.missionlog import MissionLog

    Floats = NDArray[np.float64]

TIMELINE = "mission_time"


@dataclass(frozen=True)
class Stage:
    """The frame of one replay.

    Attributes: `time_s` (T,) the 1 Hz grid and `at` (T,) its indices in the tracks; `truth_m` (V, T, 2) and
    `yaw_rad` (V, T), NaN if unknown; `depth_m` (V, T); `window` west, east, south, north of what is worth
    showing of the chart; `deepest_m` of the chart, of the vehicles without one.
    """

    navigators: tuple[str, ...]
    vehicles: tuple[str, ...]
    time_s: Floats
    at: NDArray[np.intp]
    truth_m: Floats
    yaw_rad: Floats
    depth_m: Floats
    window: tuple[float, float, float, float]
    deepest_m: float
    exaggeration: int

    @classmethod
    def of(cls, tracks: xr.Dataset, chart: Chart | None, log: MissionLog) -> Stage:
        """Read the names, instants and truth of a mission and fit the scene around its paths."""
        time = np.asarray(tracks["time"].values, dtype=np.float64)
        at = np.flatnonzero(np.abs(time - np.round(time)) < 1e-9)
        truth = np.asarray(tracks["truth_position_m"].values, dtype=np.float64)[:, at]
        window = _window(tracks, chart)
        side = max(window[1] - window[0], window[3] - window[2])
        depth = depths_m(log, time[at])
        deepest_m = float(depth.max()) if chart is None else chart.depth_range_m[1]
        return cls(
            navigators=tuple(str(n) for n in tracks["navigator"].values),
            vehicles=tuple(str(v) for v in tracks["vehicle"].values),
            time_s=time[at],
            at=at,
            truth_m=truth,
            yaw_rad=_yaw(truth, time[at], log),
            depth_m=depth,
            window=window,
            deepest_m=deepest_m,
            exaggeration=exaggeration(side, deepest_m),
        )

    @property
    def root(self) -> str:
        """The scene's entity; its name states the vertical exaggeration."""
        return "scene" if self.exaggeration == 1 else f"scene_depth_x{self.exaggeration}"

    @property
    def span_m(self) -> float:
        """Longer side of the window."""
        return max(self.window[1] - self.window[0], self.window[3] - self.window[2])

    def entity(self, *parts: str) -> str:
        """Path of an entity in the scene; names are escaped."""
        return entity(self.root, *parts)

    def positions(self, position_m: Floats) -> NDArray[np.float32]:
        """(V, T, 2) east, north on the grid to (V, T, 3) with z = -depth."""
        return np.concatenate([position_m, -self.depth_m[..., None]], axis=-1).astype(np.float32)


def entity(*parts: str) -> str:
    """Entity path of these names."""
    import rerun as rr

    return str(rr.new_entity_path(list(parts)))


def time_column(seconds: Floats) -> Any:
    """Index column of the mission's timeline."""
    import rerun as rr

    return rr.TimeColumn(TIMELINE, duration=np.round(seconds * 1e9).astype("timedelta64[ns]"))


def rgb(index: int) -> tuple[int, int, int]:
    """Okabe-Ito colour of a vehicle or navigator; black, unseen on a dark ground, becomes grey."""
    colour = OKABE_ITO[index % len(OKABE_ITO)].lstrip("#")
    red, green, blue = (int(colour[k : k + 2], 16) for k in (0, 2, 4))
    return (red, green, blue) if red + green + blue else (200, 200, 200)


def _window(tracks: xr.Dataset, chart: Chart | None) -> tuple[float, float, float, float]:
    """The paths' box with a third of its size around it, as far as there is chart."""
    points = tracks["truth_position_m"].values.reshape(-1, 2)
    points = points[np.isfinite(points).all(1)]
    if chart is None:
        return _open_window(points)
    west, south, east, north = chart.extent
    if not len(points):
        return west, east, south, north
    low, high = points.min(0), points.max(0)
    pad = 0.33 * float((high - low).max()) + 20 * chart.cell_m
    window = (
        max(west, low[0] - pad),
        min(east, high[0] + pad),
        max(south, low[1] - pad),
        min(north, high[1] + pad),
    )
    if window[1] - window[0] < 2 * chart.cell_m or window[3] - window[2] < 2 * chart.cell_m:
        return west, east, south, north
    return tuple(float(x) for x in window)  # type: ignore[return-value]


def _open_window(points: Floats) -> tuple[float, float, float, float]:
    low, high = (points.min(0), points.max(0)) if len(points) else (np.zeros(2), np.zeros(2))
    pad = 0.1 * float((high - low).max()) + 20.0
    return float(low[0] - pad), float(high[0] + pad), float(low[1] - pad), float(high[1] + pad)


def exaggeration(side_m: float, deepest_m: float) -> int:
    """The factor of 1, 2, 5, ... that draws the deepest water at most a sixth of the scene's side deep."""
    wanted = side_m / (6 * max(deepest_m, 1e-3))
    return max((k for k in (1, 2, 5, 10, 20, 50) if k <= wanted), default=1)


def _yaw(truth: Floats, time_s: Floats, log: MissionLog) -> Floats:
    if log.truth is not None and "yaw_rad" in log.truth:
        known = log.truth["yaw_rad"].values
        index = np.clip(np.searchsorted(log.truth["time"].values, time_s), 0, known.shape[1] - 1)
        return np.asarray(known[:, index], dtype=np.float64)
    step = np.gradient(truth, axis=1)
    return np.where(np.isfinite(step).all(-1), np.arctan2(step[..., 1], step[..., 0]), np.nan)


def series(
    recording: Any,
    path: str,
    name: str,
    colour: tuple[int, int, int],
    seconds: Floats,
    values: Floats,
    *,
    width: float = 1.5,
) -> None:
    """Log a line over time; what is infinite or unknown is left out of it, and a line without a value is not logged."""
    import rerun as rr

    finite = np.isfinite(values)
    if not finite.any():
        return
    recording.log(path, rr.SeriesLines(colors=[colour], names=[name], widths=[width]), static=True)
    recording.send_columns(
        path, indexes=[time_column(seconds[finite])], columns=rr.Scalars.columns(scalars=values[finite])
    )
