"""Data sets of other projects, told by their content."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop.importers.datasets import ENDINGS, open_recording
from uwcoop.importers.datasets.mrclam import read_mrclam
from uwcoop.importers.datasets.mrclam_files import is_mrclam

if TYPE_CHECKING:
    from uwcoop.missionlog import MissionLog

__all__ = ["is_dataset", "read_dataset"]


def is_dataset(path: Path) -> bool:
    """Whether a file or folder is one of the data sets that have a reader of their own."""
    if path.is_dir():
        return is_mrclam(path)
    return path.name.endswith(ENDINGS) and path.is_file()


def read_dataset(path: Path, overrides: Iterable[str] = ()) -> MissionLog | None:
    """The mission of a data set; None: it is none.

    Raises:
        LogError: a data set that is damaged.
    """
    if not is_dataset(path):
        return None
    if path.is_dir():
        return read_mrclam(path)
    return open_recording(path, overrides)
