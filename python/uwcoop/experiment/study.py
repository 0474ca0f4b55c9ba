"""Monte Carlo: the same missions for every navigator and variant, on all cores, resumable."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop import acoustics
from uwcoop.acoustics.authentication import check_key
from uwcoop.errors import ScenarioError, StudyError
from uwcoop.evaluation.error_series import (
    ErrorSeries,
    gather,
    read_error_series,
    write_error_series,
)
from uwcoop.experiment.named_worlds import worlds_of
from uwcoop.experiment.study_files import write_results
from uwcoop.experiment.study_flights import FlownSeed
from uwcoop.experiment.study_results import Asked, StudyResult, result_of
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
    from uwcoop.experiment.named_worlds import World
    from uwcoop.scenario.models import Scenario

__all__ = ["StudyResult", "study"]


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
    samples: Sequence[Mapping[str, Any]] = (),
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
        out: folder for `runs.csv`, `runs.parquet`, `study.json`, `summary.json` and `report.html`.
        resume: skip the missions whose rows `out` holds. Runs and values of `vary` may be added.
        processes: at most so many at a time; None: as many as there are cores. 1 works in this process.
        scheduler: address of a Dask scheduler ("tcp://host:8786") whose workers fly instead; the extra `cluster`.
        overrides: "dotted.key=value" each, for all variants.
        first_seed: seed of the first run.
        keep_errors: keep every run's error over time, in the result and as `errors.nc` in `out`. Of a study
            that is resumed, what was flown without it is not flown again.
        worlds: every variant is flown in each of these worlds; a packaged list ("faults"), a file of worlds, or
            the worlds themselves. The varied key is "world".
        samples: values of further keys that are varied together, as `uwcoop.experiment.sweeps.latin_hypercube` draws
            them: every variant is flown with each sample.
        progress: called with the missions done and the missions in all, those skipped included.

    Raises:
        UwcoopError: one line that says what is wrong; finished missions stay in `out`.
    """
    if runs < 1 or first_seed < 0:
        raise ScenarioError(f"runs is {runs} and first_seed {first_seed}: must be at least 1 and 0")
    if scheduler is not None and processes is not None:
        raise StudyError(
            "scheduler and processes are both given: the cluster's workers fly, or this machine's"
        )
    varied = _varied(vary or {}, samples)
    _refuse_secrets(overrides, varied)
    listed = worlds_of(worlds) if isinstance(worlds, str | Path) else list(worlds)
    variants = list(variants_of(scenario, overrides, vary or {}, listed, samples))
    chosen = fit_everywhere(variants) if navigators is None else list(navigators)
    for variant in variants:
        acoustics.schedule(variant.scenario.acoustics, [v.name for v in variant.scenario.team], 0.0)
        check_key(variant.scenario.acoustics.authentication)
    asked = Asked(
        scenario=str(scenario) if isinstance(scenario, str | Path) else None,
        overrides=tuple(overrides),
        variants=tuple(variants),
        worlds=tuple(listed),
        runs=runs,
        first_seed=first_seed,
        flown_by="processes of one machine" if scheduler is None else "a Dask cluster",
    )
    with _sole_writer(None if out is None else Path(out)) as folder:
        store = StudyStore(
            folder,
            [*varied, *([WORLD] if listed else [])],
            {
                "uwcoop": version("uwcoop"),
                "scenario": variants[0].scenario.name,
                "navigators": [name_of(n) for n in chosen],
            },
            {variant.texts: digest(variant.scenario, chosen) for variant in variants},
            resume=resume,
        )
        where = {"processes": processes, "scheduler": scheduler, "keep_errors": keep_errors}
        kept = _flown(store, asked, chosen, folder, progress, where)
        seeds = range(first_seed, first_seed + runs)
        errors = gather(kept, [variant.label for variant in variants], seeds)
        result = replace(result_of(store, asked), errors=errors)
        if folder is None:
            return result
        files, notes = write_results(result, asked, store, folder)
        return replace(result, files=tuple(files), notes=tuple(notes))


def _flown(
    store: StudyStore,
    asked: Asked,
    navigators: Sequence[str | Custom],
    folder: Path | None,
    progress: Callable[[int, int], None] | None,
    where: Mapping[str, Any],
) -> ErrorSeries:
    """Fly what the store does not hold yet, and add it as it comes; the errors over time that are kept."""
    variants = asked.variants
    kept = _kept_before(store, folder) if where["keep_errors"] and folder is not None else {}
    pending = _pending(store, variants, navigators, range(asked.first_seed, asked.first_seed + asked.runs))
    total = len(variants) * asked.runs
    done = total - sum(len(p) for p in pending.values())
    if progress:
        progress(done, total)
    try:
        for seed, flown in flights(pending, [variant.scenario for variant in variants], navigators, **where):
            store.add(_labelled(flown, variants, seed, asked.first_seed))
            kept |= {(variants[k].label, seed): series for k, _, series in flown if series is not None}
            done += len(flown)
            if progress:
                progress(done, total)
    finally:
        if folder is not None:
            with deferred():  # what was flown is kept, also when a signal ends the study
                write_error_series(kept, folder)
    return kept


def _varied(vary: Mapping[str, Sequence[Any]], samples: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Every key that is varied, with its values.

    Raises:
        StudyError: samples of different keys, or of a key that is varied by itself too.
    """
    drawn = list(samples[0]) if samples else []
    for sample in samples:
        if list(sample) != drawn:
            raise StudyError(f"samples are of different keys: {', '.join(drawn)} and {', '.join(sample)}")
    if both := [key for key in drawn if key in vary]:
        raise StudyError(f"{both[0]} is varied twice: by its values, and in the samples")
    return {**{key: list(values) for key, values in vary.items()}} | {
        key: [sample[key] for sample in samples] for key in drawn
    }


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


def _kept_before(store: StudyStore, folder: Path) -> ErrorSeries:
    """Errors over time in the folder, of missions whose rows it holds too."""
    flown = {(label_of(store.keys, texts), seed) for texts, seed in store.missions()}
    return {mission: series for mission, series in read_error_series(folder).items() if mission in flown}
