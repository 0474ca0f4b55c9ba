"""Scenario files: models with units in their names, defaults, loading and overrides."""

from uwcoop.scenario.loading import (
    alternatives,
    apply_overrides,
    apply_settings,
    chart_spec,
    load,
    packaged,
    packaged_text,
    parse,
)
from uwcoop.scenario.models import Scenario

__all__ = [
    "Scenario",
    "alternatives",
    "apply_overrides",
    "apply_settings",
    "chart_spec",
    "load",
    "packaged",
    "packaged_text",
    "parse",
]
