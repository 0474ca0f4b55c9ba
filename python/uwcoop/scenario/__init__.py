"""Scenario files: models with units in their names, defaults, loading and overrides."""

from uwcoop.scenario.loading import apply_overrides, load, packaged, parse
from uwcoop.scenario.models import Scenario

__all__ = ["Scenario", "apply_overrides", "load", "packaged", "parse"]
