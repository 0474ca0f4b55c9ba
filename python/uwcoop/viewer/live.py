"""What nodes say, drawn as they say it: the replay's scene with trails that grow, sigma over time, and alarms."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import MissingDependencyError, UwcoopError
from uwcoop.figures.map import ellipse
from uwcoop.viewer import scene
from uwcoop.viewer.stage import TIMELINE, Stage, entity, exaggeration, rgb

if TYPE_CHECKING:
    from uwcoop.charts import Chart
    from uwcoop.onboard.messages import Message

__all__ = ["VIEWER_PORT", "LiveView", "spawn_viewer"]

VIEWER_PORT = 9876
_SOURCE = "nodes"
TRAIL_S = 900
"""For so long back trails are shown."""
SIGMA_S = 300
_JUMP_M = 50.0


class LiveView:
    """A Rerun recording that is written while the nodes run."""

    def __init__(
        self, recording: Any, names: Sequence[str], depth_m: Sequence[float], chart: Chart | None
    ) -> None:
        """Send the scene and its layout.

        Args:
            recording: a `rerun.RecordingStream` that goes to a viewer or a file.
            names: of the vehicles.
            depth_m: (V,) at which each is drawn: a node does not say its depth.
            chart: the seabed; None without one.
        """
        self._recording, self._names = recording, tuple(names)
        self._stage = _stage(self._names, depth_m, chart)
        self._depth_m = np.asarray(depth_m, dtype=np.float64)
        self._last: dict[int, tuple[float, list[float]]] = {}
        import rerun as rr

        recording.send_blueprint(_layout(self._stage))
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if self._stage.exaggeration != 1:
            recording.log(
                self._stage.root, rr.Transform3D(scale=[1, 1, self._stage.exaggeration]), static=True
            )
        scene.seabed(recording, self._stage, chart)
        for k, name in enumerate(self._names):
            recording.log(
                entity("sigma_m", name),
                rr.SeriesLines(colors=[rgb(k)], names=[name], widths=[1.5]),
                static=True,
            )

    def take(self, source: str, message: Message) -> None:
        """Draw a message of a vehicle; what is of nobody, or of an earlier time than drawn, is left out."""
        if source not in self._names:
            return
        vehicle = self._names.index(source)
        if message["type"] == "estimate" and message["mean_m"][0] is not None:
            self._estimate(vehicle, message)
        elif message["type"] == "diagnostic":
            self._alarm(source, message)

    def _estimate(self, vehicle: int, message: Message) -> None:
        import rerun as rr

        t_s = message["t_ns"] / 1e9
        last = self._last.get(vehicle)
        if last is not None and t_s <= last[0]:
            return
        place = [*message["mean_m"], -float(self._depth_m[vehicle])]
        self._last[vehicle] = t_s, place
        name, colour, recording = self._names[vehicle], rgb(vehicle), self._recording
        recording.set_time(TIMELINE, duration=t_s)
        body = self._stage.entity(_SOURCE, name, "body")
        recording.log(body, rr.Transform3D(translation=place))
        recording.log(
            f"{body}/position", rr.Points3D([[0, 0, 0]], colors=[colour], radii=rr.Radius.ui_points(6))
        )
        recording.log(
            f"{body}/name",
            rr.Points3D(
                [[0, 0, 0]],
                colors=[(255, 255, 255)],
                radii=rr.Radius.ui_points(0.5),
                labels=[name],
                show_labels=True,
            ),
        )
        self._uncertainty(vehicle, body, message["covariance_m2"])
        if last is not None and np.hypot(place[0] - last[1][0], place[1] - last[1][1]) < _JUMP_M:
            strip = rr.LineStrips3D([[last[1], place]], colors=[colour], radii=rr.Radius.ui_points(1.8))
            recording.log(self._stage.entity(_SOURCE, name, "trail"), strip)

    def _uncertainty(self, vehicle: int, body: str, covariance_m2: list[float | None]) -> None:
        import rerun as rr

        if None in covariance_m2:
            return
        covariance = np.reshape(np.array(covariance_m2, dtype=np.float64), (2, 2))
        sigma_m = float(np.sqrt(max(np.trace(covariance), 0.0)))
        self._recording.log(entity("sigma_m", self._names[vehicle]), rr.Scalars(sigma_m))
        outline = ellipse(np.zeros(2), covariance)
        if np.isfinite(outline).all():
            ring = np.pad(outline[::2], ((0, 0), (0, 1)))
            lines = rr.LineStrips3D([ring], colors=[rgb(vehicle)], radii=rr.Radius.ui_points(1.2))
            self._recording.log(f"{body}/ellipse_95", lines)

    def _alarm(self, source: str, message: Message) -> None:
        import rerun as rr

        self._recording.set_time(TIMELINE, duration=message["t_ns"] / 1e9)
        level = rr.TextLogLevel.WARN if message["raised"] else rr.TextLogLevel.INFO
        text = f"{source}: {message['alarm']}: {message['text']}"
        self._recording.log("alarms", rr.TextLog(text, level=level))


def spawn_viewer(
    names: Sequence[str], depth_m: Sequence[float], chart: Chart | None, url: str | None
) -> LiveView:
    """A live view in a viewer: a new one on this machine, or the one at `url`.

    The new viewer listens on 127.0.0.1 only; Rerun's own default is every address.

    Raises:
        MissingDependencyError: without rerun.
        UwcoopError: an address that is none.
    """
    try:
        import rerun as rr
    except ImportError as missing:
        raise MissingDependencyError("rerun-sdk", "viz") from missing
    if url is None:
        url = f"rerun+http://127.0.0.1:{VIEWER_PORT}/proxy"
        command = [
            sys.executable,
            "-m",
            "rerun",
            "--bind",
            "127.0.0.1",
            "--port",
            str(VIEWER_PORT),
            "--expect-data-soon",
        ]
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    recording = rr.RecordingStream("uwcoop-watch")
    try:
        recording.connect_grpc(url)
    except (ValueError, RuntimeError) as error:
        raise UwcoopError(f"viewer {url!r} cannot be reached: {error}") from None
    return LiveView(recording, names, depth_m, chart)


def _stage(names: tuple[str, ...], depth_m: Sequence[float], chart: Chart | None) -> Stage:
    if chart is None:
        window, deepest_m = (-500.0, 500.0, -500.0, 500.0), max([1.0, *depth_m])
    else:
        west, south, east, north = chart.extent
        window, deepest_m = (west, east, south, north), chart.depth_range_m[1]
    side_m = max(window[1] - window[0], window[3] - window[2])
    nothing = np.empty((len(names), 0))
    return Stage(
        navigators=(_SOURCE,),
        vehicles=names,
        time_s=np.empty(0),
        at=np.empty(0, dtype=np.intp),
        truth_m=np.empty((len(names), 0, 2)),
        yaw_rad=nothing,
        depth_m=nothing,
        window=window,
        deepest_m=deepest_m,
        exaggeration=exaggeration(side_m, deepest_m),
    )


def _layout(stage: Stage) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    span_m = stage.span_m
    west, east, south, north = stage.window
    centre = np.array([(west + east) / 2, (south + north) / 2 - 0.1 * span_m, 0.0])
    eye = centre + span_m * np.array([0.16, -0.8, 0.85])
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-float(TRAIL_S)),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0),
    )
    trails = [stage.entity(_SOURCE, name, "trail") for name in stage.vehicles]
    view = rrb.Spatial3DView(
        origin="/",
        name="nodes",
        background=rrb.Background(color=(24, 28, 34)),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rr.blueprint.Eye3DKind.Orbital, position=eye, look_target=centre, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={name: [trail] for name in trails},
    )
    sigma = rrb.TimeSeriesView(
        origin="/sigma_m",
        name="sigma (m)",
        axis_x=rrb.TimeAxis(
            view_range=rr.TimeRange(
                start=rr.TimeRangeBoundary.cursor_relative(seconds=-float(SIGMA_S)),
                end=rr.TimeRangeBoundary.cursor_relative(seconds=10.0),
            )
        ),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
    )
    alarms = rrb.TextLogView(origin="/alarms", name="alarms")
    return rrb.Blueprint(
        rrb.Horizontal(view, rrb.Vertical(sigma, alarms), column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )
