"""Fixtures shared by all tests; the one place that knows where reference data lives."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

Case = dict[str, np.ndarray[Any, Any]]

REFERENCE = Path(os.environ.get("UWCOOP_REFERENCE", Path(__file__).parents[1] / ".." / "shared")).resolve()


@pytest.fixture(scope="session")
def reference() -> Path:
    """Folder of reference data (golden cases, real recordings), which others own and the project does not hold: a test
    that needs it skips where there is none, and fails where it is incomplete."""
    if not REFERENCE.is_dir():
        pytest.skip(f"reference data, not part of the project, is absent: {REFERENCE} (set UWCOOP_REFERENCE)")
    return REFERENCE


@pytest.fixture(scope="session")
def hooks() -> Any:
    """The module that makes the documentation's tables."""
    spec = importlib.util.spec_from_file_location(
        "docs_hooks", Path(__file__).parents[1] / "docs" / "hooks.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def golden_cases(reference: Path) -> Callable[[str], Callable[[str], Case]]:
    """A folder of golden cases as a reader of its files by name."""

    def folder(method: str) -> Callable[[str], Case]:
        def read(name: str) -> Case:
            with np.load(reference / "golden" / method / f"{name}.npz") as archive:
                return {key: archive[key] for key in archive.files}

        return read

    return folder


@pytest.fixture(scope="session")
def study_module() -> Callable[[str], ModuleType]:
    """A module of `studies/`, which is no package, by its name."""

    def load(name: str) -> ModuleType:
        path = Path(__file__).parents[1] / "studies" / f"{name}.py"
        spec = importlib.util.spec_from_file_location(f"studies_{name}", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        spec.loader.exec_module(module)
        return module

    return load
