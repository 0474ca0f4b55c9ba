"""Cooperative localisation of underwater vehicles: simulate, replay and compare navigators.

The public names load on first use, so that `import uwcoop` stays fast and optional dependencies stay optional.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uwcoop import kernels, navigators
    from uwcoop._native import Authenticator, Event
    from uwcoop.charts import Chart, load_chart
    from uwcoop.experiment.run import run
    from uwcoop.experiment.study import study
    from uwcoop.frames import LocalFrame, Origin
    from uwcoop.missionlog import MissionLog
    from uwcoop.missionlog.mcap import load_log
    from uwcoop.world.simulate import simulate

__version__: str

__all__ = [
    "Authenticator",
    "Chart",
    "Event",
    "LocalFrame",
    "MissionLog",
    "Origin",
    "kernels",
    "load_chart",
    "load_log",
    "navigators",
    "run",
    "simulate",
    "study",
]

_HOME = {
    "Authenticator": "uwcoop._native",
    "Chart": "uwcoop.charts",
    "Event": "uwcoop._native",
    "LocalFrame": "uwcoop.frames",
    "MissionLog": "uwcoop.missionlog",
    "Origin": "uwcoop.frames",
    "load_chart": "uwcoop.charts",
    "load_log": "uwcoop.missionlog.mcap",
    "run": "uwcoop.experiment.run",
    "simulate": "uwcoop.world.simulate",
    "study": "uwcoop.experiment.study",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("uwcoop")
    if name in {"kernels", "navigators"}:
        return import_module(f"uwcoop.{name}")
    raise AttributeError(f"module 'uwcoop' has no attribute {name!r}")
