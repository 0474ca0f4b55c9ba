"""What a worker of a study does: it flies missions of a plan, whoever asks for them and wherever it is."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import version
from typing import TYPE_CHECKING

from uwcoop.errors import StudyError, UwcoopError
from uwcoop.evaluation import metrics
from uwcoop.evaluation.error_series import error_series_of
from uwcoop.experiment.navigator_choice import check_plan_fits
from uwcoop.experiment.run import run
from uwcoop.experiment.study_store import Row
from uwcoop.navigators import Custom
from uwcoop.scenario.setup import MissionSetup
from uwcoop.world.mission_area import mission_area
from uwcoop.world.simulate import open_chart, simulate

if TYPE_CHECKING:
    import xarray as xr

    from uwcoop.charts import Chart
    from uwcoop.charts.places import Area
    from uwcoop.missionlog import MissionLog
    from uwcoop.scenario.chart import ChartSpec
    from uwcoop.scenario.models import Scenario

__all__ = ["Batch", "Flown", "FlownSeed", "Plan", "Unit", "fly_batch", "fly_checked", "units_of"]

FlownSeed = list[tuple[int, list[Row], "xr.Dataset | None"]]
"""Variant, rows, and the error over time if it is kept."""


@dataclass(frozen=True)
class Plan:
    """What all tasks of a study share; it is sent once to each worker."""

    variants: tuple[Scenario, ...]
    navigators: tuple[str | Custom, ...]
    keep_errors: bool = False
    charts: Mapping[tuple[ChartSpec, Area | None], Chart] = field(default_factory=dict)
    """Charts that were read from files, which a worker need not see. A synthetic one is made where it is needed."""
    program: str = ""
    """Version of the program that made the plan."""

    @staticmethod
    def of(
        variants: Sequence[Scenario],
        navigators: Sequence[str | Custom],
        *,
        keep_errors: bool,
        flown: set[int],
    ) -> Plan:
        """The plan with the charts of those variants that are flown, each read once.

        Raises:
            ChartError: a file that cannot be read as a chart.
        """
        charts = {}
        for k in sorted(flown):
            key = _chart_key(variants[k])
            if key is not None and key[0].synthetic is None and key not in charts:
                charts[key] = _opened(*key)
        return Plan(tuple(variants), tuple(navigators), keep_errors, charts, version("uwcoop"))


@dataclass(frozen=True)
class Unit:
    """The least that is flown at a time: one seed in variants that share their world."""

    seed: int
    variants: tuple[int, ...]


Batch = tuple[Unit, ...]


@dataclass(frozen=True)
class Flown:
    """What became of a unit."""

    unit: Unit
    results: FlownSeed
    seconds: float
    """Wall-clock time."""
    error: UwcoopError | None = None
    """Why there are no results; the rest of the batch was not flown."""


def units_of(pending: Mapping[int, Sequence[int]], variants: Sequence[Scenario]) -> list[Unit]:
    """The units of all pending missions, seed by seed: a world that variants share is simulated once."""
    worlds = {k: variants[k].world_text() for k in sorted({k for which in pending.values() for k in which})}
    units = []
    for seed, which in pending.items():
        sharing: dict[str, list[int]] = {}
        for k in which:
            sharing.setdefault(worlds[k], []).append(k)
        units += [Unit(seed, tuple(together)) for together in sharing.values()]
    return units


def fly_batch(plan: Plan, batch: Batch) -> list[Flown]:
    """Fly the units of a batch, up to the first that cannot be flown."""
    return list(_fly_each(plan, batch))


def fly_checked(plan: Plan, batch: Batch) -> list[Flown]:
    """As `fly_batch`, on a machine that may have another version of the program.

    Raises:
        StudyError: it has.
    """
    if (here := version("uwcoop")) != plan.program:
        raise StudyError(
            f"a worker has uwcoop {here}, the study is of uwcoop {plan.program}: install the same"
        )
    return fly_batch(plan, batch)


def _fly_each(plan: Plan, batch: Batch) -> Iterator[Flown]:
    for unit in batch:
        start = time.perf_counter()
        try:
            results = fly(plan, unit)
        except UwcoopError as error:
            yield Flown(unit, [], time.perf_counter() - start, error)
            return
        yield Flown(unit, results, time.perf_counter() - start)


def fly(plan: Plan, unit: Unit) -> FlownSeed:
    """One seed in variants that share their world, which is simulated once."""
    log: MissionLog | None = None
    flown: FlownSeed = []
    for k in unit.variants:
        scenario = plan.variants[k]
        if log is None:
            log = simulate(scenario, unit.seed, _chart_of(plan, scenario))
        own = log.with_setup(MissionSetup.of(scenario))
        check_plan_fits((n for n in plan.navigators if isinstance(n, str)), own)
        result = run(own, plan.navigators, clouds=False)
        rows = metrics.rows(result.recorded, seconds=result.seconds, packets=result.packets)
        flown.append((k, rows, error_series_of(result.tracks) if plan.keep_errors else None))
    return flown


def _chart_key(scenario: Scenario) -> tuple[ChartSpec, Area | None] | None:
    spec = scenario.chart
    if spec is None:
        return None
    return spec, None if spec.synthetic is not None else mission_area(scenario)


def _chart_of(plan: Plan, scenario: Scenario) -> Chart | None:
    key = _chart_key(scenario)
    if key is None:
        return None
    sent = plan.charts.get(key)
    return _opened(*key) if sent is None else sent


@lru_cache(maxsize=4)
def _opened(spec: ChartSpec, area: Area | None) -> Chart:
    # Once in each process: gridding soundings takes longer than a mission.
    return open_chart(spec, lambda: area)
