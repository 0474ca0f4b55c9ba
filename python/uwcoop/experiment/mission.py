"""A mission as users name it: a log, or a scenario that is simulated first."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop import scenario as scenarios
from uwcoop.errors import LogError, ScenarioError
from uwcoop.experiment.counterfactual import CHANGEABLE, with_acoustics, with_capacity
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.unknown_covariance import FIX_SIGMA_M, with_stated_fixes
from uwcoop.missionlog.validate import validate
from uwcoop.scenario.secrets import redact

if TYPE_CHECKING:
    from uwcoop.charts import Chart
    from uwcoop.scenario.models import Scenario

__all__ = ["LOG_SUFFIX", "has_happened", "load_scenario", "open_mission"]

LOG_SUFFIX = ".mcap"


def open_mission(
    mission: MissionLog | Scenario | str | Path,
    seed: int | None = None,
    chart: Chart | str | Path | None = None,
    overrides: Sequence[str] = (),
) -> MissionLog:
    """A log as it is, from its file (`.mcap`), from a recording (`uwcoop.importers.datasets`), or simulated from a
    scenario or the name or path of one.

    Args:
        mission: see above.
        seed: of the simulation; a log has its own.
        chart: a scenario gets it instead of its own. A log's must be this one; a log without a chart gets it,
            around the log's own origin if it is read from a file.
        overrides: "dotted.key=value" each. A log has happened: `navigator.*` can be changed in it, `chart.*` says how
            to read the chart file that is given, `recording.*` how to read a recording, `log.fix_sigma_m` what a fix
            of covariance 0 (unknown) is taken as. `acoustics.loss…`, `acoustics.losses…`, `acoustics.modem…` and
            `log.capacity_bytes` make a counterfactual of it.

    Raises:
        ScenarioError, LogError, ChartError: one line that says what is wrong.
    """
    if isinstance(mission, MissionLog):
        validate(mission)
        return _changed(mission, chart, overrides)
    if isinstance(mission, str | Path) and Path(mission).suffix == LOG_SUFFIX:
        from uwcoop.missionlog.mcap import load_log

        return _changed(load_log(mission), chart, overrides)
    if isinstance(mission, str | Path):
        _refuse_recording(Path(mission))
    if isinstance(mission, str | Path) and Path(mission).is_dir():
        return _changed(*_recorded(Path(mission), 0 if seed is None else seed, overrides, chart))
    from uwcoop.importers.datasets import ENDINGS, open_recording

    if isinstance(mission, str | Path) and Path(mission).name.endswith(ENDINGS):
        reading, others = scenarios.split_overrides(overrides, "recording")
        return _changed(open_recording(mission, reading), chart, others)
    from uwcoop.world.simulate import simulate

    if isinstance(chart, str | Path):
        return simulate(load_scenario(mission, chart, overrides), seed)
    return simulate(load_scenario(mission, None, overrides), seed, chart)


def _refuse_recording(path: Path) -> None:
    """A recording of a real vehicle needs somebody to say what it is: that is `uwcoop import`."""
    from uwcoop.importers.readers import recording_kind

    if path.suffix in (".toml", ".json") or not path.is_file():
        return
    if what := recording_kind(path):
        raise LogError(
            f"{path} is {what}: `uwcoop import {path} -o mission.mcap` makes a mission of it, which can be run"
        )


def has_happened(mission: MissionLog | Scenario | str | Path) -> bool:
    """Whether `open_mission` takes this from a log or a recording, or else simulates it."""
    from uwcoop.importers.datasets import ENDINGS

    if isinstance(mission, str | Path):
        return Path(mission).name.endswith((LOG_SUFFIX, *ENDINGS)) or Path(mission).is_dir()
    return isinstance(mission, MissionLog)


def _recorded(
    folder: Path, seed: int, overrides: Sequence[str], chart: Chart | str | Path | None
) -> tuple[MissionLog, Chart | str | Path | None, Sequence[str]]:
    """A data set as a mission by the overrides `mrclam.*`; with the chart, and the overrides that are left."""
    from uwcoop.importers.datasets.mrclam import read_mrclam
    from uwcoop.importers.datasets.mrclam_files import is_mrclam

    if not is_mrclam(folder):
        from uwcoop.importers.readers import recording_kind

        what = recording_kind(folder)
        hint = f"; `uwcoop import {folder} -o mission.mcap` makes a mission of {what}" if what else ""
        raise LogError(f"{folder} is a folder but no MRCLAM data set: it has no Barcodes.dat{hint}")
    own, others = scenarios.split_overrides(overrides, "mrclam")
    return read_mrclam(folder, seed, **scenarios.table_of(own, "mrclam")), chart, others


def load_scenario(
    scenario: Scenario | str | Path, chart: str | Path | None = None, overrides: Sequence[str] = ()
) -> Scenario:
    """A scenario by name or path with overrides, and with a chart file in place of its own chart.

    Raises:
        ScenarioError: one line that says what is wrong.
    """
    # Before the other overrides, so that they can tell how to read the file: chart.crs=...
    own_chart = [] if chart is None else [f"chart={{source = {json.dumps(str(Path(chart).resolve()))}}}"]
    if isinstance(scenario, str | Path):
        return scenarios.load(scenario, [*own_chart, *overrides])
    if not own_chart and not overrides:
        return scenario
    return scenarios.parse(
        scenarios.apply_overrides(scenario.resolved(), [*own_chart, *overrides]), scenario.name
    )


def _changed(log: MissionLog, chart: Chart | str | Path | None, overrides: Sequence[str]) -> MissionLog:
    """The log with its chart checked or added, and with navigators' options changed."""
    options, others = scenarios.split_overrides(overrides, "navigator")
    of_log, others = scenarios.split_overrides(others, "log")
    reading, others = (
        scenarios.split_overrides(others, "chart") if isinstance(chart, str | Path) else ([], others)
    )
    acoustics, others = scenarios.split_overrides(others, "acoustics")
    if others:
        raise ScenarioError(
            f"override {redact(others[0])!r}: mission {log.name!r} is a log and has happened, "
            f"only navigator.*, log.* and, as what would have been, {', '.join(CHANGEABLE)} can be changed"
        )
    if chart is not None:
        log = _with_chart(log, chart, reading)
    told = scenarios.table_of(of_log, "log")
    if unknown := set(told) - {"fix_sigma_m", "capacity_bytes"}:
        raise ScenarioError(
            f"override 'log.{min(unknown)}': a log has the options log.fix_sigma_m and log.capacity_bytes only"
        )
    log = with_stated_fixes(log, told.get("fix_sigma_m", FIX_SIGMA_M))
    log = with_acoustics(log, acoustics)
    if "capacity_bytes" in told:
        log = with_capacity(log, told["capacity_bytes"])
    return log.with_setup(log.setup.with_overrides(options)) if options else log


def _with_chart(log: MissionLog, chart: Chart | str | Path, reading: Sequence[str]) -> MissionLog:
    if isinstance(chart, str | Path):
        from uwcoop.charts import load_chart

        spec = scenarios.chart_spec({"source": str(chart)}, reading)
        known = log.chart is None and log.origin.latitude_deg is not None
        chart = load_chart(chart, **spec.options(), origin=log.origin if known else None)
    if log.chart is None:
        return replace(log, chart=chart)
    if log.chart.sha256 != chart.sha256:
        raise LogError(
            f"mission {log.name!r} belongs to chart {log.chart.name!r} with SHA-256 {log.chart.sha256}, "
            f"not to {chart.name!r} with SHA-256 {chart.sha256}"
        )
    return log
