"""Fixtures shared by all tests; the one place that knows where reference data lives."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REFERENCE = Path(os.environ.get("UWCOOP_REFERENCE", Path(__file__).parents[1] / ".." / "shared")).resolve()


@pytest.fixture(scope="session")
def reference() -> Path:
    """Folder of reference data (golden cases, real recordings); a test that needs it skips where it is absent."""
    if not REFERENCE.is_dir():
        pytest.skip(f"reference data is absent: {REFERENCE} (set UWCOOP_REFERENCE)")
    return REFERENCE
