"""Monte Carlo: the same missions for every navigator and variant, on all cores, resumable."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop import acoustics
from uwcoop.acoustics.authentication import check_key
from uwcoop.errors import ScenarioError, StudyError
from uwcoop.evaluation import metrics
from uwcoop.evaluation.error_series import (
    ErrorSeries,
    gather,
    read_error_series,
    write_error_series,
)
from uwcoop.evaluation.metrics import summary_text
from uwcoop.experiment.named_worlds import worlds_of
from uwcoop.experiment.study_flights import FlownSeed
from uwcoop.experiment.study_store import STUDY_FILES, Row, StudyStore
from uwcoop.experiment.study_variants import (
    WORLD,
    Variant,
    digest,
    fit_everywhere,
    label_of,
    name_of,
    variants_of,
)
from uwcoop.experiment.study_workers import flights
from uwcoop.navigators import Custom
from uwcoop.report.atomic_files import check_folder, lock_folder
from uwcoop.report.interruption import deferred
from uwcoop.scenario.secrets import holds_secret, redact, sets_secret

if TYPE_CHECKING:
    import xarray as xr

    from uwcoop.experiment.named_worlds import World
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


def study(
    scenario: Scenario | str | Path,
    runs: int,
    navigators: Iterable[str | Custom] | None = None,
    vary: Mapping[str, Sequence[Any]] | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
    processes: int | None = None,
    scheduler: str | None = None,
    overrides: Sequence[str] = (),
    first_seed: int = 0,
    keep_errors: bool = False,
    worlds: str | Path | Sequence[World] = (),
    progress: Callable[[int, int], None] | None = None,
) -> StudyResult:
    """Runs navigators over many missions: run k has the seed `first_seed + k`, whatever the variant.

    Variants that differ only in `navigator.*` or `metrics.*` fly the same mission; all are compared on the
    same seeds. The results, run times aside, are the same for any number of processes, and on a cluster of machines
    that are alike.

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
        scheduler: address of a Dask scheduler ("tcp://host:8786") whose workers fly instead; the extra `cluster`.
        overrides: "dotted.key=value" each, for all variants.
        first_seed: seed of the first run.
        keep_errors: keep every run's error over time, in the result and as `errors.nc` in `out`. Of a study
            that is resumed, what was flown without it is not flown again.
        worlds: every variant is flown in each of these worlds; a packaged list ("faults"), a file of worlds, or
            the worlds themselves. The varied key is "world".
        progress: called with the missions done and the missions in all, those skipped included.

    Raises:
        UwcoopError: one line that says what is wrong; finished missions stay in `out`.
    """
    if runs < 1 or first_seed < 0:
        raise ScenarioError(f"runs is {runs} and first_seed {first_seed}: must be at least 1 and 0")
    if scheduler is not None and processes is not None:
        raise StudyError("scheduler and processes are both given: the cluster's workers fly, or this machine's")
    _refuse_secrets(overrides, vary or {})
    listed = worlds_of(worlds) if isinstance(worlds, str | Path) else list(worlds)
    variants = list(variants_of(scenario, overrides, vary or {}, listed))
    keys = [*(vary or {}), *([WORLD] if listed else [])]
    chosen = fit_everywhere(variants) if navigators is None else list(navigators)
    for variant in variants:
        acoustics.schedule(variant.scenario.acoustics, [v.name for v in variant.scenario.team], 0.0)
        check_key(variant.scenario.acoustics.authentication)
    with _sole_writer(None if out is None else Path(out)) as folder:
        store = StudyStore(
            folder,
            keys,
            {
                "uwcoop": version("uwcoop"),
                "scenario": variants[0].scenario.name,
                "navigators": [name_of(n) for n in chosen],
            },
            {variant.texts: digest(variant.scenario, chosen) for variant in variants},
            resume=resume,
        )
        seeds = range(first_seed, first_seed + runs)
        kept = _kept_before(store, keys, folder) if keep_errors and folder is not None else {}
        pending = _pending(store, variants, chosen, seeds)
        flown_in = [variant.scenario for variant in variants]
        done, total = len(variants) * runs - sum(len(p) for p in pending.values()), len(variants) * runs
        if progress:
            progress(done, total)
        try:
            for seed, flown in flights(
                pending, flown_in, chosen, processes=processes, scheduler=scheduler, keep_errors=keep_errors
            ):
                store.add(_labelled(flown, variants, seed, first_seed))
                kept |= {(variants[k].label, seed): series for k, _, series in flown if series is not None}
                done += len(flown)
                if progress:
                    progress(done, total)
        finally:
            if folder is not None:
                with deferred():  # what was flown is kept, also when a signal ends the study
                    write_error_series(kept, folder)
        errors = gather(kept, [variant.label for variant in variants], seeds)
        return replace(_result(store, variants, runs, first_seed), errors=errors)


@contextmanager
def _sole_writer(folder: Path | None) -> Iterator[Path | None]:
    """The folder, made if need be, while no other study writes to it; it is not left behind empty.

    Raises:
        StudyError: another process is at it.
    """
    if folder is None:
        yield None
        return
    check_folder(folder, STUDY_FILES)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with lock_folder(folder):
            yield folder
    except BlockingIOError:
        raise StudyError(
            f"{folder} is being written by another study: wait, or take another folder"
        ) from None
    finally:
        with suppress(OSError):
            folder.rmdir()


def _labelled(flown: FlownSeed, variants: Sequence[Variant], seed: int, first_seed: int) -> list[Row]:
    """A seed's rows with the values of the varied keys and the run's number."""
    return [
        {
            **dict(zip(variants[k].settings, variants[k].texts, strict=True)),
            **row,
            "run": seed - first_seed,
        }
        for k, rows, _ in flown
        for row in rows
    ]


def _refuse_secrets(overrides: Sequence[str], vary: Mapping[str, Sequence[Any]]) -> None:
    """A study keeps what is varied in its files; a key has a place of its own.

    Raises:
        StudyError: a secret among the settings; the line does not repeat it.
    """
    varied = [key for key, values in vary.items() for value in values if holds_secret(key, value)]
    varied += [text.partition("=")[0].strip() for text in overrides if sets_secret(text)]
    if varied:
        raise StudyError(
            f"{redact(varied[0])} sets a secret, which a study would keep: name its place instead, "
            "acoustics.authentication.key_env or key_file"
        )


def _pending(
    store: StudyStore, variants: Sequence[Variant], navigators: Sequence[str | Custom], seeds: Iterable[int]
) -> dict[int, list[int]]:
    """By seed, the variants that are still to be run; what was cut off while it was written counts as such."""
    counts = store.missions()
    pending: dict[int, list[int]] = {}
    partial = set()
    for seed in seeds:
        for k, variant in enumerate(variants):
            have = counts.get((variant.texts, seed), 0)
            if have != len(navigators) * len(variant.scenario.team):
                pending.setdefault(seed, []).append(k)
                partial |= {(variant.texts, seed)} if have else set()
    store.drop(partial)
    return pending


def _kept_before(store: StudyStore, keys: Sequence[str], folder: Path) -> ErrorSeries:
    """Errors over time in the folder, of missions whose rows it holds too."""
    flown = {(label_of(keys, texts), seed) for texts, seed in store.missions()}
    return {mission: series for mission, series in read_error_series(folder).items() if mission in flown}


def _result(store: StudyStore, variants: Sequence[Variant], runs: int, first_seed: int) -> StudyResult:
    rows: list[Row] = []
    summaries = []
    for variant in variants:
        own = [row for row in store.of(variant.texts) if 0 <= row["seed"] - first_seed < runs]
        own = [{**row, **variant.settings, "run": row["seed"] - first_seed} for row in own]
        own.sort(key=lambda row: row["seed"])
        summaries.append({"set": variant.settings, "navigators": metrics.pool(own)})
        rows += own
    summary = {"scenario": variants[0].scenario.name, "runs": runs, "variants": summaries}
    store.finish(summary_text(summary))
    teams = {len(variant.scenario.team) for variant in variants}
    settle_s = variants[0].scenario.metrics.settle_s
    return StudyResult(rows, summary, settle_s, teams.pop() if len(teams) == 1 else None)
