"""The missions of a study on all cores: one task for each seed, in every variant."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

from uwcoop.acoustics.authentication import KeyFileWarning
from uwcoop.errors import StudyError, UwcoopError
from uwcoop.evaluation import metrics
from uwcoop.evaluation.error_series import error_series_of
from uwcoop.experiment.navigator_choice import check_plan_fits
from uwcoop.experiment.run import run
from uwcoop.experiment.study_store import Row
from uwcoop.navigators import Custom
from uwcoop.report.interruption import ignored_in_children
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

__all__ = ["FlownSeed", "flights"]

FlownSeed = list[tuple[int, list[Row], "xr.Dataset | None"]]
"""Variant, rows, and the error over time if it is kept."""


def flights(
    pending: Mapping[int, Sequence[int]],
    variants: Sequence[Scenario],
    navigators: Sequence[str | Custom],
    processes: int | None,
    keep_errors: bool,
) -> Iterator[tuple[int, FlownSeed]]:
    """Every pending seed with its variants' rows, in the order in which they finish.

    Args:
        pending: by seed, indices of the variants to fly.
        variants: the scenario of each variant.
        navigators: who flies.
        processes: at most so many at a time; None: all cores.
        keep_errors: also keep the error over time of each mission.

    Raises:
        UwcoopError: what a mission raises, with its seed; workers are ended.
        StudyError: a worker process that died.
    """
    fly = partial(_fly, keep_errors=True) if keep_errors else _fly
    jobs = {seed: [(k, variants[k]) for k in which] for seed, which in pending.items()}
    workers = min(processes or _cores(), len(jobs))
    if workers <= 1:
        for seed, job in jobs.items():
            try:
                yield seed, fly(seed, job, navigators)
            except UwcoopError as error:
                raise _with_seed(error, seed) from error
        return
    ours = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=_end_with_parent
    )
    try:
        with ignored_in_children():
            futures: dict[Future[FlownSeed], int] = {
                executor.submit(fly, seed, job, navigators): seed for seed, job in jobs.items()
            }
        for future in as_completed(futures):
            try:
                yield futures[future], future.result()
            except UwcoopError as error:
                raise _with_seed(error, futures[future]) from error
            except BrokenProcessPool as error:
                raise StudyError(
                    "a worker process did not start or was killed: a script that calls study() needs "
                    '`if __name__ == "__main__":` around its work; for want of memory use fewer processes'
                ) from error
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - ours:
            child.terminate()
        raise
    finally:
        executor.shutdown(cancel_futures=True)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _end_with_parent() -> None:
    """A worker whose parent is killed would wait for work for ever."""
    warnings.simplefilter("ignore", KeyFileWarning)  # the parent warns once
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _with_seed(error: UwcoopError, seed: int) -> UwcoopError:
    error.args = (f"{error} (seed {seed})",)
    return error


def _fly(
    seed: int,
    job: Sequence[tuple[int, Scenario]],
    navigators: Sequence[str | Custom],
    keep_errors: bool = False,
) -> FlownSeed:
    """One seed in every variant; worlds that are the same are simulated once."""
    logs: dict[str, MissionLog] = {}
    flown: FlownSeed = []
    for k, scenario in job:
        world = scenario.world_text()
        if world not in logs:
            logs[world] = simulate(scenario, seed, _chart_of(scenario))
        log = replace(logs[world], setup=MissionSetup.of(scenario))
        check_plan_fits((n for n in navigators if isinstance(n, str)), log)
        result = run(log, navigators, clouds=False)
        rows = metrics.rows(result.tracks, seconds=result.seconds, packets=result.packets)
        flown.append((k, rows, error_series_of(result.tracks) if keep_errors else None))
    return flown


def _chart_of(scenario: Scenario) -> Chart | None:
    spec = scenario.chart
    if spec is None:
        return None
    return _chart(spec, None if spec.synthetic is not None else mission_area(scenario))


@lru_cache(maxsize=4)
def _chart(spec: ChartSpec, area: Area | None) -> Chart:
    # Once in each process: gridding soundings takes longer than a mission.
    return open_chart(spec, lambda: area)
