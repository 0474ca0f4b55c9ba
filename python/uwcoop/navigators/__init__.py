"""Navigators: the packaged ones by name, their options, and the protocol for one's own in Python."""

from uwcoop._native import Navigator
from uwcoop.navigators.options import DRIFT_PRESETS, DeadReckoningOptions, DmpfOptions, MpfOptions
from uwcoop.navigators.origin import DeifOptions, DeifRedundantOptions, MdeifOptions, OriginOptions
from uwcoop.navigators.protocol import Context, Custom, PythonEstimate, PythonNavigator
from uwcoop.navigators.registry import (
    NAVIGATORS,
    Spec,
    build,
    build_central,
    is_packaged,
    not_realisable,
    options_of,
    read_options,
    spec_of,
)
from uwcoop.navigators.team import TeamOptions

__all__ = [
    "DRIFT_PRESETS",
    "NAVIGATORS",
    "Context",
    "Custom",
    "DeadReckoningOptions",
    "DeifOptions",
    "DeifRedundantOptions",
    "DmpfOptions",
    "MdeifOptions",
    "MpfOptions",
    "Navigator",
    "OriginOptions",
    "PythonEstimate",
    "PythonNavigator",
    "Spec",
    "TeamOptions",
    "build",
    "build_central",
    "is_packaged",
    "not_realisable",
    "options_of",
    "read_options",
    "spec_of",
]
