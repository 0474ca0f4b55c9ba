"""Scenario -> `MissionLog`: vehicles move, sensors measure, slots are scheduled; no navigator takes part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop import acoustics
from uwcoop import scenario as scenarios
from uwcoop.errors import ChartError, ScenarioError
from uwcoop.missionlog.labelled import Labelled
from uwcoop.missionlog.model import MissionLog
from uwcoop.scenario.chart import SYNTHETIC
from uwcoop.scenario.setup import MissionSetup
from uwcoop.world import sensors
from uwcoop.world.mission_area import mission_area
from uwcoop.world.places import coverage_notes, placed
from uwcoop.world.random_streams import TEAM, Purpose, stream
from uwcoop.world.tracks import read_tracks
from uwcoop.world.vehicles import team_motion

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from uwcoop.charts import Chart
    from uwcoop.charts.places import Area
    from uwcoop.charts.survey import SurveyPlan
    from uwcoop.frames import Origin
    from uwcoop.missionlog.model import Columns
    from uwcoop.scenario.chart import ChartSpec
    from uwcoop.scenario.models import Scenario
    from uwcoop.world.vehicles import Motion


def simulate(
    scenario: Scenario | str | Path, seed: int | None = None, chart: Chart | None = None
) -> MissionLog:
    """Simulate a mission.

    Args:
        scenario: a `Scenario`, the name of a packaged one, or the path of a scenario file.
        seed: of the mission, 0 or above; None takes the scenario's.
        chart: instead of what the scenario's `chart.source`, if any, gives. It is what vehicles sound and what
            navigators get; with `[chart.survey]` the former alone, with `[chart.seabed]` the latter.

    Returns:
        The log: events, slots, opportunities, and the truth apart. The same scenario, chart and seed give the
        same bits.

    Raises:
        ScenarioError: a scenario that cannot be simulated.
        ScheduleError: slots that do not fit the modem.
        ChartError: a chart that cannot be made or read.
    """
    if isinstance(scenario, str | Path):
        scenario = scenarios.load(scenario)
    seed = scenario.seed if seed is None else int(seed)
    if seed < 0:
        raise ScenarioError(f"seed is {seed}: must be at least 0")
    names = tuple(vehicle.name for vehicle in scenario.team)
    seabed, chart = _seabed_and_chart(scenario, chart, seed)
    place = placed(scenario, chart)
    world = place.scenario
    flown = (
        _alternating(world, seed)
        if world.exchange is not None
        else _scheduled(world, seabed, place.origin, seed)
    )
    return MissionLog(
        name=scenario.name,
        seed=seed,
        vehicles=names,
        duration_ns=round(scenario.duration_s) * 1_000_000_000,
        link=acoustics.link_of(scenario.acoustics),
        events=sensors.events_of(world, seabed, flown.motion, seed, flown.events),
        slots=flown.slots,
        opportunities=flown.opportunities,
        polls=acoustics.polls(scenario.acoustics, flown.slots, flown.motion, seed, names),
        chart=chart,
        origin=place.origin,
        setup=MissionSetup.of(scenario),
        truth=_truth(names, flown.motion),
        notes=(*place.notes, *flown.notes, *_water_notes(scenario, flown.motion)),
        team_key=scenario.acoustics.authentication.key,
    )


def setup_notes(scenario: Scenario) -> tuple[str, ...]:
    """What is assumed, dropped or converted whatever the seed: of recorded tracks and of the area. A study, which keeps
    no logs, prints these.

    Raises:
        ScenarioError, ChartError: as `simulate`.
    """
    if scenario.area is None and all(vehicle.track is None for vehicle in scenario.team):
        return ()
    chart = None if scenario.chart is None else open_chart(scenario.chart, partial(mission_area, scenario))
    place = placed(scenario, chart)
    records = read_tracks(place.scenario.team, chart, place.origin, round(scenario.duration_s))
    return (*place.notes, *(note for record in records.values() for note in record.notes))


@dataclass(frozen=True)
class _Flown:
    """A mission's course: every vehicle's motion, the slots, and which signals could arrive."""

    motion: Sequence[Motion]
    slots: Columns
    opportunities: Columns
    events: dict[str, Columns]
    notes: tuple[str, ...] = ()


def _scheduled(scenario: Scenario, seabed: Chart | None, origin: Origin, seed: int) -> _Flown:
    """Paths and slots that do not depend on each other."""
    names = tuple(vehicle.name for vehicle in scenario.team)
    slots = acoustics.schedule(scenario.acoustics, names, scenario.duration_s)
    records = read_tracks(scenario.team, seabed, origin, round(scenario.duration_s))
    motion = team_motion(scenario, seabed, seed, records)
    heard = acoustics.opportunities(scenario.acoustics, slots, motion, seed, names)
    notes = [note for record in records.values() for note in record.notes]
    notes += coverage_notes(scenario, seabed, motion)
    return _Flown(motion, slots, heard, {}, tuple(notes))


def _alternating(scenario: Scenario, seed: int) -> _Flown:
    """Vehicles that take turns as the landmark: legs, fixes and exchanges follow from each other."""
    from uwcoop.world.landmark.mission import fly

    course = fly(scenario, seed)
    return _Flown(course.motion, course.slots, course.opportunities, course.events)


def _water_notes(scenario: Scenario, motion: Sequence[Motion]) -> list[str]:
    note = acoustics.profile_note(scenario.acoustics, np.concatenate([moved.depth_m for moved in motion]))
    return [] if note is None else [note]


def _seabed_and_chart(
    scenario: Scenario, given: Chart | None, seed: int
) -> tuple[Chart | None, Chart | None]:
    """As `seabed_and_chart`, for scenarios that may have none; a chart that is given needs no table."""
    spec = scenario.chart
    if spec is None:
        return given, given
    return seabed_and_chart(
        spec, open_chart(spec, partial(mission_area, scenario)) if given is None else given, seed
    )


def seabed_and_chart(spec: ChartSpec, source: Chart, seed: int) -> tuple[Chart, Chart]:
    """What vehicles sound, and the chart that navigators get.

    Args:
        spec: says how they differ.
        source: what `open_chart(spec)` gives.
        seed: the mission's, which counts where each mission is to have draws of its own.

    Raises:
        ChartError: a survey that makes no chart, a chart that states no error to draw.
    """
    drawn = spec.survey or spec.seabed
    if drawn is None:
        return source, source
    # The mission's seed after a mark: no mission's draw is the one that all missions share.
    more = (seed + 1,) if drawn.each_mission else (0,)
    if spec.survey is not None:
        return source, _surveyed(source, spec.survey.plan(), drawn.seed, more)
    return _drawn_seabed(source, drawn.seed, more), source


@lru_cache(maxsize=4)
def _surveyed(seabed: Chart, plan: SurveyPlan, seed: int, more: tuple[int, ...]) -> Chart:
    from uwcoop.charts.survey import surveyed_chart

    return surveyed_chart(seabed, plan, seed, *more).chart


@lru_cache(maxsize=2)
def _drawn_seabed(chart: Chart, seed: int, more: tuple[int, ...]) -> Chart:
    from uwcoop.charts.seabed import drawn_seabed

    return drawn_seabed(chart, stream(seed, TEAM, Purpose.SEABED, *more))


def open_chart(spec: ChartSpec, area: Callable[[], Area | None] | None = None) -> Chart:
    """Make a scenario's synthetic chart or read its chart file.

    Args:
        spec: the chart.
        area: tells the mission's area, which alone is read of a grid that is too large to be read whole.

    Raises:
        ChartError: an unknown synthetic chart, or a file that cannot be read as a chart.
    """
    if spec.synthetic is not None:
        return open_source(spec.source, **spec.options())
    return open_source(spec.source, **spec.options(), mission_area=area)


def open_source(source: str | Sequence[str], **options: Any) -> Chart:
    """The chart of a source as scenarios write it: "synthetic:NAME", or a path, or several of soundings, with
    `load_chart`'s options.

    Raises:
        ChartError: an unknown synthetic chart, or a file that cannot be read as a chart.
    """
    if isinstance(source, str) and source.startswith(SYNTHETIC):
        if of_files := sorted(options.keys() - {"seed", "relief"}):
            raise ChartError(f"{of_files[0]} is for chart files: {source} is made, not read")
        return _synthetic(source.removeprefix(SYNTHETIC), tuple(options.items()))
    from uwcoop.charts import load_chart

    return load_chart(source, **options)


@lru_cache(maxsize=4)
def _synthetic(name: str, options: tuple[tuple[str, Any], ...]) -> Chart:
    # Charts are immutable, and a study simulates many missions over the same one.
    from uwcoop.charts import synthetic

    return synthetic(name, **dict(options))


def _truth(names: tuple[str, ...], motion: Sequence[Motion]) -> Labelled:
    by_axis, plain = ("vehicle", "time", "axis"), ("vehicle", "time")
    note = "velocity that the command does not know of: water current plus the vehicle's own drift"
    return Labelled(
        {
            "position_m": (by_axis, np.stack([m.position_m for m in motion]), {"units": "m"}),
            "depth_m": (plain, np.stack([m.depth_m for m in motion]), {"units": "m", "positive": "down"}),
            "yaw_rad": (plain, np.stack([m.yaw_rad for m in motion]), {"units": "rad"}),
            "current_mps": (
                by_axis, np.stack([m.current_mps for m in motion]), {"units": "m/s", "long_name": note}
            ),
        },
        coords={
            "vehicle": list(names),
            "time": ("time", motion[0].times_s, {"units": "s"}),
            "axis": ["east", "north"],
        },
    )  # fmt: skip
