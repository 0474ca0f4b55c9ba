"""What a user means by a mission: a log, or a scenario that is simulated first."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop import scenario as scenarios
from uwcoop.errors import LogError, ScenarioError
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.validate import validate

if TYPE_CHECKING:
    from uwcoop.charts import Chart
    from uwcoop.scenario.models import Scenario

__all__ = ["LOG_SUFFIX", "load_scenario", "open_mission"]

LOG_SUFFIX = ".mcap"


def open_mission(
    mission: MissionLog | Scenario | str | Path,
    seed: int | None = None,
    chart: Chart | str | Path | None = None,
    overrides: Sequence[str] = (),
) -> MissionLog:
    """A log as it is, from its file (`.mcap`), or simulated from a scenario or the name or path of one.

    Args:
        mission: see above.
        seed: of the simulation; a log has its own.
        chart: a log's must be this one; a scenario gets it instead of its own.
        overrides: "dotted.key=value" each. A log has happened: only `navigator.*` can be changed in it.

    Raises:
        ScenarioError, LogError, ChartError: one line that says what is wrong.
    """
    if isinstance(mission, MissionLog):
        validate(mission)
        return _told(_with_chart(mission, _loaded(chart)), overrides)
    if isinstance(mission, str | Path) and Path(mission).suffix == LOG_SUFFIX:
        from uwcoop.missionlog.mcap import load_log

        return _told(load_log(mission, chart=_loaded(chart)), overrides)
    from uwcoop.simulate import simulate

    if isinstance(chart, str | Path):
        return simulate(load_scenario(mission, chart, overrides), seed)
    return simulate(load_scenario(mission, None, overrides), seed, chart)


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


def _loaded(chart: Chart | str | Path | None) -> Chart | None:
    if not isinstance(chart, str | Path):
        return chart
    from uwcoop.charts import load_chart

    return load_chart(chart)


def _with_chart(log: MissionLog, chart: Chart | None) -> MissionLog:
    if chart is None:
        return log
    if log.chart is not None and log.chart.sha256 != chart.sha256:
        raise LogError(f"the log's chart is {log.chart.sha256}, the chart given is {chart.sha256}")
    return replace(log, chart=chart)


def _told(log: MissionLog, overrides: Sequence[str]) -> MissionLog:
    for override in overrides:
        if override.split(".")[0].strip() != "navigator":
            raise ScenarioError(
                f"override {override!r}: mission {log.name!r} is a log and has happened, "
                "only navigator.* can be changed"
            )
    if not overrides:
        return log
    return replace(log, scenario=scenarios.apply_overrides(log.scenario, overrides))
