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
    split_overrides,
    table_of,
)
from uwcoop.scenario.models import Scenario
from uwcoop.scenario.setup import MissionSetup

__all__ = [
    "MissionSetup",
    "Scenario",
    "alternatives",
    "apply_overrides",
    "apply_settings",
    "chart_spec",
    "load",
    "packaged",
    "packaged_text",
    "parse",
    "split_overrides",
    "table_of",
]
