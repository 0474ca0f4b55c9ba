"""Monte Carlo: the same missions for every navigator and variant, on all cores, resumable."""

from __future__ import annotations

import hashlib
import itertools
import json
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop import acoustics
from uwcoop import scenario as scenarios
from uwcoop.errors import ScenarioError, StudyError, UwcoopError
from uwcoop.evaluation import metrics
from uwcoop.evaluation.error_series import (
    ErrorSeries,
    error_series_of,
    gather,
    read_error_series,
    write_error_series,
)
from uwcoop.evaluation.metrics import summary_text
from uwcoop.experiment.navigator_choice import default_navigators
from uwcoop.experiment.run import run
from uwcoop.experiment.study_store import Row, StudyStore, text_of
from uwcoop.navigators import Custom, options_of
from uwcoop.scenario.setup import MissionSetup
from uwcoop.world.simulate import open_chart, simulate

if TYPE_CHECKING:
    import xarray as xr

    from uwcoop.charts import Chart
    from uwcoop.missionlog import MissionLog
    from uwcoop.scenario.chart import ChartSpec
    from uwcoop.scenario.models import Scenario

__all__ = ["StudyResult", "study"]


@dataclass(frozen=True)
class StudyResult:
    """What a study gives."""

    rows: list[Row]
    """One for each variant, run, navigator and vehicle: the varied keys, then `metrics.row_columns`."""
    summary: dict[str, Any]
    """What `summary.json` holds."""
    settle_s: float
    """Errors count from here on, s."""
    vehicles: int | None
    """Size of the team; None where variants differ in it."""
    errors: xr.Dataset | None = None
    """Every run's error over time, as `uwcoop.evaluation.error_series` describes it, if it was to be kept."""


@dataclass(frozen=True)
class _Variant:
    settings: dict[str, Any]
    scenario: Scenario

    @property
    def texts(self) -> tuple[str, ...]:
        return tuple(text_of(value) for value in self.settings.values())

    @property
    def label(self) -> str:
        return _label(self.settings, self.texts)


def study(
    scenario: Scenario | str | Path,
    runs: int,
    navigators: Iterable[str | Custom] | None = None,
    vary: Mapping[str, Sequence[Any]] | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
    processes: int | None = None,
    overrides: Sequence[str] = (),
    first_seed: int = 0,
    keep_errors: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> StudyResult:
    """Runs navigators over many missions: run k has the seed `first_seed + k`, whatever the variant.

    Variants that differ only in `navigator.*` or `metrics.*` fly the same mission; all are compared on the
    same seeds. The results, run times aside, are the same for any number of processes.

    Args:
        scenario: a scenario, or the name or path of one.
        runs: missions for each variant.
        navigators: names of `uwcoop.navigators.NAVIGATORS` or `Custom` ones that pickle; None: those
            that the scenario lists, or all for terrain that fit the modem.
        vary: values by dotted scenario key; every combination of them is a variant. Keys of a `Scenario` are
            set on its resolved form: a preset's values stay when the preset changes.
        out: folder for `runs.csv`, `study.json` and `summary.json`.
        resume: skip the missions whose rows `out` holds. Runs and values of `vary` may be added.
        processes: at most so many at a time; None: as many as there are cores. 1 works in this process.
        overrides: "dotted.key=value" each, for all variants.
        first_seed: seed of the first run.
        keep_errors: keep every run's error over time, in the result and as `errors.nc` in `out`. Of a study
            that is resumed, what was flown without it is not flown again.
        progress: called with the missions done and the missions in all, those skipped included.

    Raises:
        UwcoopError: one line that says what is wrong; finished missions stay in `out`.
    """
    if runs < 1 or first_seed < 0:
        raise ScenarioError(f"runs is {runs} and first_seed {first_seed}: must be at least 1 and 0")
    variants = list(_variants(scenario, overrides, vary or {}))
    chosen = _fit_everywhere(variants) if navigators is None else list(navigators)
    for variant in variants:
        acoustics.schedule(variant.scenario.acoustics, [v.name for v in variant.scenario.team], 0.0)
    ledger = StudyStore(
        None if out is None else Path(out),
        list(vary or {}),
        {
            "uwcoop": version("uwcoop"),
            "scenario": variants[0].scenario.name,
            "navigators": [_name(n) for n in chosen],
        },
        {variant.texts: _digest(variant.scenario, chosen) for variant in variants},
        resume=resume,
    )
    pending = _pending(ledger, variants, chosen, range(first_seed, first_seed + runs))
    done, total = len(variants) * runs - sum(len(p) for p in pending.values()), len(variants) * runs
    if progress:
        progress(done, total)
    kept = _kept_before(ledger, list(vary or {}), Path(out)) if keep_errors and out is not None else {}
    try:
        for seed, flown in _flights(pending, variants, chosen, processes, keep_errors):
            ledger.add([
                {**dict(zip(variants[k].settings, variants[k].texts, strict=True)), **row,
                 "run": seed - first_seed}
                for k, rows, _ in flown
                for row in rows
            ])  # fmt: skip
            kept |= {(variants[k].label, seed): series for k, _, series in flown if series is not None}
            done += len(flown)
            if progress:
                progress(done, total)
    finally:
        if out is not None:
            write_error_series(kept, Path(out))
    seeds = range(first_seed, first_seed + runs)
    errors = gather(kept, [variant.label for variant in variants], seeds)
    return replace(_result(ledger, variants, runs, first_seed), errors=errors)


def _fit_everywhere(variants: Sequence[_Variant]) -> list[str | Custom]:
    """The packaged navigators that take part in every variant."""
    fits = [default_navigators(MissionSetup.of(v.scenario), len(v.scenario.team)) for v in variants]
    return [name for name in fits[0] if all(name in f for f in fits)]


def _variants(
    scenario: Scenario | str | Path, overrides: Sequence[str], vary: Mapping[str, Sequence[Any]]
) -> Iterator[_Variant]:
    for values in itertools.product(*vary.values()):
        settings = dict(zip(vary, values, strict=True))
        if isinstance(scenario, str | Path):
            yield _Variant(settings, scenarios.load(scenario, overrides, settings))
        else:
            table = scenarios.apply_overrides(scenario.resolved(), overrides)
            yield _Variant(
                settings, scenarios.parse(scenarios.apply_settings(table, settings), scenario.name)
            )


def _name(navigator: str | Custom) -> str:
    return navigator if isinstance(navigator, str) else navigator.name


def _digest(scenario: Scenario, navigators: Sequence[str | Custom]) -> str:
    """SHA-256 of what a variant's rows depend on: scenario, the navigators' options, files that are read."""
    setup = MissionSetup.of(scenario)
    options = {n: options_of(n, setup).model_dump() for n in navigators if isinstance(n, str)}
    chart = scenario.chart
    paths = [chart.source] if chart is not None and chart.synthetic is None else []
    paths += [vehicle.track.file for vehicle in scenario.team if vehicle.track is not None]
    # A file that is missing is refused, with a better message, by who reads it.
    files = [hashlib.sha256(Path(p).read_bytes()).hexdigest() for p in paths if Path(p).is_file()]
    content = json.dumps([setup.tables(), options, files], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def _pending(
    ledger: StudyStore, variants: Sequence[_Variant], navigators: Sequence[str | Custom], seeds: Iterable[int]
) -> dict[int, list[int]]:
    """By seed, the variants that are still to be run; what was cut off while it was written counts as such."""
    counts = ledger.missions()
    pending: dict[int, list[int]] = {}
    partial = set()
    for seed in seeds:
        for k, variant in enumerate(variants):
            have = counts.get((variant.texts, seed), 0)
            if have != len(navigators) * len(variant.scenario.team):
                pending.setdefault(seed, []).append(k)
                partial |= {(variant.texts, seed)} if have else set()
    ledger.drop(partial)
    return pending


def _label(keys: Iterable[str], texts: Iterable[str]) -> str:
    return ", ".join(f"{key} = {text}" for key, text in zip(keys, texts, strict=True))


def _kept_before(ledger: StudyStore, keys: Sequence[str], folder: Path) -> ErrorSeries:
    """Errors over time in the folder, of missions whose rows it holds too."""
    flown = {(_label(keys, texts), seed) for texts, seed in ledger.missions()}
    return {mission: series for mission, series in read_error_series(folder).items() if mission in flown}


_Flown = list[tuple[int, list[Row], "xr.Dataset | None"]]
"""Variant, rows, and the error over time if it is kept."""


def _flights(
    pending: Mapping[int, Sequence[int]],
    variants: Sequence[_Variant],
    navigators: Sequence[str | Custom],
    processes: int | None,
    keep_errors: bool,
) -> Iterator[tuple[int, _Flown]]:
    """Every pending seed with its variants' rows, in the order in which they finish."""
    fly = partial(_fly, keep_errors=True) if keep_errors else _fly
    jobs = {seed: [(k, variants[k].scenario) for k in which] for seed, which in pending.items()}
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
        workers, multiprocessing.get_context("spawn"), initializer=_leave_interrupts
    )
    try:
        futures: dict[Future[_Flown], int] = {
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


def _leave_interrupts() -> None:
    # Ctrl-C reaches every process of the terminal; the one that writes the rows decides what happens.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _with_seed(error: UwcoopError, seed: int) -> UwcoopError:
    error.args = (f"{error} (seed {seed})",)
    return error


def _fly(
    seed: int,
    job: Sequence[tuple[int, Scenario]],
    navigators: Sequence[str | Custom],
    keep_errors: bool = False,
) -> _Flown:
    """One seed in every variant; worlds that are the same are simulated once."""
    logs: dict[str, MissionLog] = {}
    flown: _Flown = []
    for k, scenario in job:
        world = scenario.world_text()
        if world not in logs:
            logs[world] = simulate(scenario, seed, None if scenario.chart is None else _chart(scenario.chart))
        log = replace(logs[world], setup=MissionSetup.of(scenario))
        result = run(log, navigators, clouds=False)
        rows = metrics.rows(result.tracks, seconds=result.seconds, packets=result.packets)
        flown.append((k, rows, error_series_of(result.tracks) if keep_errors else None))
    return flown


@lru_cache(maxsize=4)
def _chart(spec: ChartSpec) -> Chart:
    # Once in each process: gridding soundings takes longer than a mission.
    return open_chart(spec)


def _result(ledger: StudyStore, variants: Sequence[_Variant], runs: int, first_seed: int) -> StudyResult:
    rows: list[Row] = []
    summaries = []
    for variant in variants:
        own = [row for row in ledger.of(variant.texts) if 0 <= row["seed"] - first_seed < runs]
        own = [{**row, **variant.settings, "run": row["seed"] - first_seed} for row in own]
        own.sort(key=lambda row: row["seed"])
        summaries.append({"set": variant.settings, "navigators": metrics.pool(own)})
        rows += own
    summary = {"scenario": variants[0].scenario.name, "runs": runs, "variants": summaries}
    ledger.finish(summary_text(summary))
    teams = {len(variant.scenario.team) for variant in variants}
    settle_s = variants[0].scenario.metrics.settle_s
    return StudyResult(rows, summary, settle_s, teams.pop() if len(teams) == 1 else None)
