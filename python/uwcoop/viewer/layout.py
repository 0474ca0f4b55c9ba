"""How the replay opens: a scene per navigator beside error, NEES and acoustic log, all of the mission."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation import metrics
from uwcoop.viewer import current
from uwcoop.viewer.earth import EARTH
from uwcoop.viewer.landmark import EVENTS, FIXES
from uwcoop.viewer.stage import TIMELINE, Stage, entity

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

STACKED_VEHICLES = 3
"""Up to so many vehicles have their plots above each other; more get a tab each."""


NEAR = 0.6
"""Missions with a landmark are looked at from nearer: their vehicles keep together."""


def blueprint(
    stage: Stage,
    tracks: xr.Dataset,
    packets: Mapping[str, NDArray[Any]],
    clouds: xr.Dataset | None,
    kept: Mapping[str, list[str]],
    *,
    events: bool = False,
    on_earth: bool = False,
) -> Any:
    """Layout of the recording.

    Args:
        kept: by navigator, further entities of which all up to the cursor is shown.
        events: with the text log of landings and roles.
        on_earth: with a map, whose tiles the viewer fetches when its tab is opened.
    """
    import rerun.blueprint as rrb

    shown = _most_telling(stage, clouds, packets)
    scenes = rrb.Tabs(
        *[
            _scene(stage, navigator, kept.get(navigator, []), NEAR if events else 1.0)
            for navigator in stage.navigators
        ],
        *([rrb.MapView(origin=EARTH, name="map of the Earth")] if on_earth else []),
        active_tab=shown,
        name="scene",
    )
    stacked = len(stage.vehicles) <= STACKED_VEHICLES
    error_m = metrics.errors(tracks).values[..., stage.at]
    nees = metrics.nees(tracks).values[..., stage.at]
    error_plots = [
        _plot(
            stage,
            entity("error_m", vehicle),
            f"{vehicle}: error (m)",
            (0.0, _error_top(error_m[:, j])),
            legend=j == 0 or not stacked,
        )
        for j, vehicle in enumerate(stage.vehicles)
    ]
    nees_plots = [
        _plot(
            stage,
            entity("nees", vehicle),
            f"{vehicle}: NEES (ideal mean 2)",
            (0.0, _nees_top(nees[:, j])),
            legend=False,
        )
        for j, vehicle in enumerate(stage.vehicles)
    ]
    further = [*_current_plots(stage, tracks), *_alarm_plots(stage, tracks)]
    right = [
        rrb.Vertical(*error_plots, name="error") if stacked else rrb.Tabs(*error_plots, name="error"),
        rrb.Tabs(*nees_plots, *further, name="NEES, current" if further else "NEES"),
    ]
    talking = [
        n
        for i, n in enumerate(stage.navigators)
        if ((packets["navigator"] == i) & (packets["bytes"] > 0)).any()
    ]
    if talking:
        texts = [_text(navigator) for navigator in talking]
        active = talking.index(shown) if shown in talking else len(talking) - 1
        right.append(rrb.Tabs(*texts, active_tab=active, name="acoustics"))
    if events:
        right.append(_event_text())
    shares = [len(error_plots) if stacked else 1.5, 1.3, 1.3, 1.0][: len(right)]
    return rrb.Blueprint(
        rrb.Horizontal(scenes, rrb.Vertical(*right, row_shares=shares), column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, playback_speed=10.0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )


def _scene(stage: Stage, navigator: str, kept: list[str], distance: float) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    root = f"/{stage.root}"
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0),
    )
    trails = [stage.entity(who, v, "trail") for who in ("truth", navigator) for v in stage.vehicles]
    west, east, south, north = stage.window
    bottom = -stage.exaggeration * stage.deepest_m
    # A little nearer than the middle: perspective makes the near half larger.
    centre = np.array([(west + east) / 2, (south + north) / 2 - 0.1 * stage.span_m, bottom])
    eye = centre + distance * stage.span_m * np.array([0.16, -0.8, 0.85])
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"+ {root}/{part}/**" for part in ("chart", "surface", "truth", FIXES)]
        + [f"+ {stage.entity(navigator)}/**"],
        name=navigator,
        background=rrb.Background(color=(24, 28, 34)),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rr.blueprint.Eye3DKind.Orbital, position=eye, look_target=centre, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={path: [trail] for path in [*trails, *kept]},
    )


def _current_plots(stage: Stage, tracks: xr.Dataset) -> list[Any]:
    if not current.is_estimated(tracks):
        return []
    top = current.range_mps(tracks)
    return [
        _plot(
            stage,
            entity(current.CURRENT, vehicle, axis),
            f"{vehicle}: current {axis} (m/s)",
            (-top, top),
            legend=True,
        )
        for vehicle in stage.vehicles
        for axis in current.AXES
    ]


def _alarm_plots(stage: Stage, tracks: xr.Dataset) -> list[Any]:
    if not current.has_alarms(tracks):
        return []
    top = 1.2 * float(np.nanmax(tracks[current.ALARMS].values))
    return [
        _plot(stage, entity(current.ALARMS, vehicle), f"{vehicle}: alarms so far", (0.0, top), legend=True)
        for vehicle in stage.vehicles
    ]


def _plot(stage: Stage, origin: str, name: str, span: tuple[float, float], *, legend: bool) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    start, end = float(stage.time_s[0]), float(stage.time_s[-1])
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        # Without a range, plots show half a minute around the cursor.
        axis_x=rrb.TimeAxis(
            view_range=rr.TimeRange(
                start=rr.TimeRangeBoundary.absolute(seconds=start),
                end=rr.TimeRangeBoundary.absolute(seconds=end),
            )
        ),
        axis_y=rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
    )


def _text(navigator: str) -> Any:
    import rerun.blueprint as rrb

    return rrb.TextLogView(
        origin=entity("acoustics", navigator),
        name=f"acoustics: {navigator}",
        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
    )


def _event_text() -> Any:
    import rerun.blueprint as rrb

    return rrb.TextLogView(
        origin=entity(EVENTS),
        name="landings and roles",
        columns=rrb.TextLogColumns(text_log_columns=["Body"]),
    )


def _error_top(error_m: NDArray[np.float64]) -> float:
    """Room for the best navigators: one that is lost leaves at the top (zooming out shows it)."""
    own = [e[np.isfinite(e)] for e in error_m if np.isfinite(e).any()]
    if not own:
        return 1.0
    best = min(float(np.quantile(e, 0.95)) for e in own)
    return _labelled_top(max(min(max(float(e.max()) for e in own), 10 * best), 0.1))


def _nees_top(nees: NDArray[np.float64]) -> float:
    finite = nees[np.isfinite(nees)]
    return _labelled_top(float(np.clip(1.1 * np.quantile(finite, 0.95), 10.0, 40.0)) if finite.size else 10.0)


def _labelled_top(wanted: float) -> float:
    """A nearby top under which the viewer, whose ticks are powers of ten, has room to label one."""
    decade = 10.0 ** np.floor(np.log10(wanted))
    tops = np.array([1.2, 2.0, 3.0, 4.0, 12.0])
    return float(decade * tops[np.argmin(np.abs(np.log(tops * decade / wanted)))])


def _most_telling(stage: Stage, clouds: xr.Dataset | None, packets: Mapping[str, NDArray[Any]]) -> str:
    """The last navigator that has particles and sends packets, else that has either, else the last."""
    talking = set(np.unique(packets["navigator"][packets["bytes"] > 0]))
    clouded = set()
    if clouds is not None:
        first = clouds["particles_m"].values[:, :, :, :1]
        clouded = {i for i in range(len(stage.navigators)) if np.isfinite(first[i]).any()}
    for candidates in (talking & clouded, clouded, talking):
        if candidates:
            return stage.navigators[max(candidates)]
    return stage.navigators[-1]
