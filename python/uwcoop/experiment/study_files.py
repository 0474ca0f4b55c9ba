"""The files of a study that are made of all its rows, when they are complete."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop.errors import MissingDependencyError
from uwcoop.evaluation import metrics
from uwcoop.experiment.study_replay import replay_command
from uwcoop.report.atomic_files import atomic_write
from uwcoop.report.rows_parquet import write_rows
from uwcoop.report.study_report import study_report

if TYPE_CHECKING:
    from uwcoop.experiment.study_results import Asked, StudyResult
    from uwcoop.experiment.study_store import StudyStore

__all__ = ["write_results"]


def write_results(
    result: StudyResult, asked: Asked, store: StudyStore, folder: Path
) -> tuple[list[str], list[str]]:
    """Write `runs.csv` in order, `summary.json`, `runs.parquet` and `report.html`; their names, and a note for each that
    is left out."""
    store.finish(metrics.summary_text(result.summary))
    columns = {**dict.fromkeys(asked.variants[0].settings, str), **metrics.row_columns()}

    def report(path: Path) -> None:
        text = study_report(result, asked, lambda k, name, seed: _command_of(asked, k, name, seed))
        with atomic_write(path) as partial:
            partial.write_text(text, encoding="utf-8")

    writers: dict[str, Callable[[Path], None]] = {
        "runs.parquet": lambda path: write_rows(store.rows, columns, path),
        "report.html": report,
    }
    files, notes = ["summary.json", "runs.csv", "study.json"], []
    for name, write in writers.items():
        try:
            write(folder / name)
        except MissingDependencyError as reason:
            notes.append(f"{name} is left out: {reason}")
        else:
            files.append(name)
    return files, notes


def _command_of(asked: Asked, variant: int, navigator: str, seed: int) -> str:
    """The command that flies one mission of the study again."""
    changes = asked.variants[variant].changes
    return replay_command(asked.scenario, asked.overrides, changes, navigator, seed)
