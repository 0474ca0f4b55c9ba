"""What a study gives when all its missions are flown: pooled figures, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uwcoop.evaluation import metrics
from uwcoop.evaluation.intervals import intervals, paired
from uwcoop.evaluation.sensitivity import sensitivity
from uwcoop.experiment.study_store import Row, StudyStore

if TYPE_CHECKING:
    import xarray as xr

    from uwcoop.experiment.named_worlds import World
    from uwcoop.experiment.study_variants import Variant

__all__ = ["Asked", "StudyResult", "result_of"]


@dataclass(frozen=True)
class Asked:
    """What was asked for, as far as a report tells it."""

    scenario: str | None
    """Name or path; None: an object."""
    overrides: tuple[str, ...]
    variants: tuple[Variant, ...]
    worlds: tuple[World, ...]
    runs: int
    first_seed: int
    flown_by: str
    """Where the missions were flown: this machine's processes, or a cluster."""


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
    files: tuple[str, ...] = ()
    """Written to the study's folder."""
    notes: tuple[str, ...] = ()
    """What was left out, and why; one line each."""


def result_of(store: StudyStore, asked: Asked) -> StudyResult:
    """Pool the rows of each variant that was asked for; the store holds a summary of the same."""
    rows: list[Row] = []
    summaries = []
    for variant in asked.variants:
        own = [row for row in store.of(variant.texts) if 0 <= row["seed"] - asked.first_seed < asked.runs]
        own = [{**row, **variant.settings, "run": row["seed"] - asked.first_seed} for row in own]
        own.sort(key=lambda row: row["seed"])
        summaries.append(
            {
                "set": variant.settings,
                "navigators": metrics.pool(own),
                "intervals": intervals(own),
                "paired": paired(own),
            }
        )
        rows += own
    summary: dict[str, Any] = {
        "scenario": asked.variants[0].scenario.name,
        "runs": asked.runs,
        "variants": summaries,
    }
    if follows := sensitivity(rows, list(asked.variants[0].settings)):
        summary["sensitivity"] = follows
    teams = {len(variant.scenario.team) for variant in asked.variants}
    settle_s = asked.variants[0].scenario.metrics.settle_s
    return StudyResult(rows, summary, settle_s, teams.pop() if len(teams) == 1 else None)
