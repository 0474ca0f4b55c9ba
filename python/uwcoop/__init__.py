"""Cooperative localisation of underwater vehicles: simulate, replay and compare navigators.

The public names load on first use, so that `import uwcoop` stays fast and optional dependencies stay optional.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uwcoop import kernels, navigators
    from uwcoop.charts import Chart, load_chart
    from uwcoop.missionlog import MissionLog
    from uwcoop.missionlog.mcap import load_log
    from uwcoop.run import run
    from uwcoop.simulate import simulate
    from uwcoop.study import study

__version__: str

__all__ = [
    "Chart",
    "MissionLog",
    "kernels",
    "load_chart",
    "load_log",
    "navigators",
    "run",
    "simulate",
    "study",
]

_HOME = {
    "Chart": "uwcoop.charts",
    "MissionLog": "uwcoop.missionlog",
    "load_chart": "uwcoop.charts",
    "load_log": "uwcoop.missionlog.mcap",
    "run": "uwcoop.run",
    "simulate": "uwcoop.simulate",
    "study": "uwcoop.study",
}


class _Package(ModuleType):
    def __setattr__(self, name: str, value: Any) -> None:
        # Loading the module uwcoop.run would put it in the place of the function of the same name.
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("uwcoop")
    if name in {"kernels", "navigators"}:
        return import_module(f"uwcoop.{name}")
    raise AttributeError(f"module 'uwcoop' has no attribute {name!r}")
