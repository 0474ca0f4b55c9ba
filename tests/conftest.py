"""Fixtures shared by all tests; the one place that knows where reference data lives."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

Case = dict[str, np.ndarray[Any, Any]]

REFERENCE = Path(os.environ.get("UWCOOP_REFERENCE", Path(__file__).parents[1] / ".." / "shared")).resolve()


@pytest.fixture(scope="session")
def reference() -> Path:
    """Folder of reference data (golden cases, real recordings); a test that needs it skips where it is absent."""
    if not REFERENCE.is_dir():
        pytest.skip(f"reference data is absent: {REFERENCE} (set UWCOOP_REFERENCE)")
    return REFERENCE


@pytest.fixture(scope="session")
def golden_cases(reference: Path) -> Callable[[str], Callable[[str], Case]]:
    """A folder of golden cases as a reader of its files by name."""

    def folder(method: str) -> Callable[[str], Case]:
        def read(name: str) -> Case:
            with np.load(reference / "golden" / method / f"{name}.npz") as archive:
                return {key: archive[key] for key in archive.files}

        return read

    return folder
