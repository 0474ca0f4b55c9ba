"""What an entry of the registry of metrics says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from uwcoop.evaluation.pooling import Pooling
    from uwcoop.evaluation.vehicle_run import VehicleRun

__all__ = ["Column", "Metric", "Pooled"]


@dataclass(frozen=True)
class Column:
    """A column of the terminal's tables."""

    heading: str
    form: Literal["three digits", "whole", "percent"] = "three digits"
    """three digits: significant ones, none dropped before the point."""
    always: bool = False
    """Shown even where it applies to nobody."""
    only_if_any: bool = False
    """Left out where every value is zero."""
    marks_consistency: bool = False
    """A NEES whose ideal is 2: values that mean an overconfident or conservative navigator are marked."""


@dataclass(frozen=True)
class Pooled:
    """One number that a study makes of a metric, over all runs and vehicles of a navigator."""

    key: str
    """In the study's `summary.json`."""
    pooling: Pooling
    text: str
    column: Column | None = None
    """In the study's table; None: not shown there."""


@dataclass(frozen=True)
class Metric:
    """What is measured of each run, navigator and vehicle: a column of `runs.csv`, and where it is shown."""

    unit: str
    text: str
    measure: Callable[[VehicleRun], float | None]
    type: type[int] | type[float] = float
    """Of a value; None is allowed beside it."""
    in_summary: bool = True
    """Whether a run's `summary.json` holds it for each vehicle."""
    column: Column | None = None
    """In the run's table; None: not shown there."""
    pooled: tuple[Pooled, ...] = ()
