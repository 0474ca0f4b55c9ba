"""A study's folder: `runs.csv`, appended as missions finish, and `study.json`, which says whose rows they are.

What is made of all rows goes away when rows are added, so that no summary of fewer missions stands beside them."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from uwcoop.errors import StudyError
from uwcoop.evaluation.metrics import row_columns
from uwcoop.report.atomic_files import atomic_write, check_folder
from uwcoop.report.interruption import deferred

__all__ = ["STUDY_FILES", "Row", "StudyStore", "text_of"]

OF_ALL_ROWS = (
    "summary.json", "runs.parquet", "report.html", "boxes.png", "bytes.png", "errors_over_time.png", "information.png",
)  # fmt: skip
"""Files of a study's folder that are made of all its rows, when they are complete."""
STUDY_FILES = ("runs.csv", "study.json", *OF_ALL_ROWS)
Row = dict[str, Any]
"""Varied keys as text, then the columns of `metrics.row_columns`."""


def text_of(value: Any) -> str:
    """A varied key's value as it stands in the CSV: a text as it is, anything else as JSON."""
    return value if isinstance(value, str) else json.dumps(value, default=str)


class StudyStore:
    """Rows of a study in memory and, with a folder, on disk.

    `study.json` holds what the rows depend on: the program's version, navigators, varied keys, and a digest
    for each variant. A folder is only continued when all of it is the same; variants and runs may be added.

    Args:
        folder: None keeps the rows in memory only. Nothing is written before the first `add`.
        keys: dotted keys that are varied.
        identity: what all rows depend on, for JSON.
        digests: by variant (texts of its values in the order of `keys`), what its rows depend on.
        resume: continue a folder that holds rows; without it such a folder is refused.

    Raises:
        StudyError: rows of another study, damaged rows, or rows without `resume`.
    """

    def __init__(
        self,
        folder: Path | None,
        keys: Sequence[str],
        identity: Mapping[str, Any],
        digests: Mapping[tuple[str, ...], str],
        *,
        resume: bool,
    ) -> None:
        self.rows: list[Row] = []
        self._folder = folder
        self.keys = tuple(keys)
        """What is varied."""
        self._about = {**identity, "vary": list(keys)}
        self._digests = {json.dumps(variant): digest for variant, digest in digests.items()}
        self._columns = (*self.keys, *row_columns())
        self._started = False
        if folder is None:
            return
        check_folder(folder, STUDY_FILES)
        if self._csv.exists():
            if not resume:
                raise StudyError(f"{self._csv} holds a study: continue it (--resume) or take another folder")
            self._refuse_another_study()
            self.rows = self._read()

    def missions(self) -> dict[tuple[tuple[str, ...], int], int]:
        """How many rows there are of each (variant, seed)."""
        counts: dict[tuple[tuple[str, ...], int], int] = {}
        for row in self.rows:
            mission = self._variant(row), int(row["seed"])
            counts[mission] = counts.get(mission, 0) + 1
        return counts

    def of(self, variant: tuple[str, ...]) -> list[Row]:
        """The rows of one variant."""
        return [row for row in self.rows if self._variant(row) == variant]

    def drop(self, missions: set[tuple[tuple[str, ...], int]]) -> None:
        """Forget missions whose rows are not all there: a run that was interrupted while it wrote."""
        self.rows = [row for row in self.rows if (self._variant(row), row["seed"]) not in missions]

    def add(self, rows: Sequence[Row]) -> None:
        """Append a mission's rows; on disk in one write."""
        self.rows.extend(rows)
        if self._folder is None:
            return
        if not self._started:
            self._start()
            return
        with deferred(), self._csv.open("a", encoding="utf-8", newline="") as file:
            file.write(self._text(rows))
            file.flush()
            os.fsync(file.fileno())

    def finish(self, summary: str) -> None:
        """Sort the rows on disk by variant and run, so that the order of finishing leaves no trace, and write
        `summary.json`."""
        if self._folder is None:
            return
        order = {tuple(json.loads(variant)): k for k, variant in enumerate(self._digests)}
        self.rows.sort(key=lambda row: (order.get(self._variant(row), len(order)), row["seed"]))
        self._start()
        with atomic_write(self._folder / "summary.json") as partial:
            partial.write_text(summary + "\n", encoding="utf-8")

    @property
    def _csv(self) -> Path:
        return Path(self._folder or ".") / "runs.csv"

    @property
    def _json(self) -> Path:
        return Path(self._folder or ".") / "study.json"

    def _variant(self, row: Row) -> tuple[str, ...]:
        return tuple(row[key] for key in self.keys)

    def _start(self) -> None:
        """Write both files with all that there is so far, whole."""
        folder = self._json.parent
        folder.mkdir(parents=True, exist_ok=True)
        for name in OF_ALL_ROWS:  # they are about the rows of before
            (folder / name).unlink(missing_ok=True)
        with atomic_write(self._json) as partial:
            about = {**self._about, "variants": self._digests}
            partial.write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
        with atomic_write(self._csv) as partial:
            header = io.StringIO()
            csv.writer(header, lineterminator="\n").writerow(self._columns)
            partial.write_text(header.getvalue() + self._text(self.rows), encoding="utf-8", newline="")
        self._started = True

    def _text(self, rows: Sequence[Row]) -> str:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        # repr keeps every bit of a float; None becomes an empty cell.
        writer.writerows([[row[column] for column in self._columns] for row in rows])
        return text.getvalue()

    def _refuse_another_study(self) -> None:
        try:
            about = json.loads(self._json.read_text(encoding="utf-8"))
            known = dict(about.pop("variants"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise StudyError(f"{self._csv} cannot be continued: {self._json} cannot be read") from error
        for key, mine in self._about.items():
            if about.get(key) != mine:
                raise StudyError(
                    f"{self._csv} is of another study: its {key} is {about.get(key)}, not {mine}"
                )
        for variant, digest in self._digests.items():
            if known.get(variant, digest) != digest:
                said = ", ".join(f"{k}={v}" for k, v in zip(self.keys, json.loads(variant), strict=True))
                raise StudyError(
                    f"{self._csv} is of another study: scenario, options or input files have changed"
                    + (f" for {said}" if said else "")
                )
        self._digests = {**self._digests, **{k: v for k, v in known.items() if k not in self._digests}}

    def _read(self) -> list[Row]:
        text = self._csv.read_text(encoding="utf-8")
        lines = text[
            : text.rfind("\n") + 1
        ]  # a line without its end was being written when the run was cut off
        reader = csv.reader(io.StringIO(lines))
        header = next(reader, [])
        if tuple(header) != self._columns:
            raise StudyError(f"{self._csv} has other columns than this study's {', '.join(self._columns)}")
        rows = []
        for cells in reader:
            try:
                rows.append(self._row(cells))
            except ValueError as error:
                raise StudyError(f"{self._csv} line {reader.line_num} is damaged: {error}") from error
        return rows

    def _row(self, cells: list[str]) -> Row:
        row: Row = dict(zip(self._columns, cells, strict=True))
        for column, kind in row_columns().items():
            row[column] = kind(row[column]) if row[column] or kind is str else None
        return row
