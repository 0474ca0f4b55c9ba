"""The demo: one packaged mission through every navigator, by way of its log on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop.errors import MissingDependencyError
from uwcoop.experiment.mission import load_scenario
from uwcoop.experiment.navigator_choice import default_navigators
from uwcoop.experiment.run import run
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.report.atomic_files import atomic_folder
from uwcoop.report.run_folder import RUN_FILES, write_chart_picture, write_run_files
from uwcoop.scenario.setup import MissionSetup
from uwcoop.world.simulate import simulate

if TYPE_CHECKING:
    from uwcoop.experiment.run import RunResult

__all__ = ["SCENARIO", "run_demo", "steps"]

SCENARIO = "st-john-drift"


def steps() -> int:
    """How often `run_demo` says that it has done something."""
    scenario = load_scenario(SCENARIO)
    return 3 + len(default_navigators(MissionSetup.of(scenario), len(scenario.team)))


def run_demo(
    folder: Path, step: Callable[[str], None], note: Callable[[str], None]
) -> tuple[RunResult, list[str]]:
    """Simulate, write the log, read it back, replay it through every navigator, write everything.

    Args:
        folder: for `mission.mcap`, `chart.png` and what `write_run` writes; complete or not there.
        step: called with what has been done, `steps()` times.
        note: called with a line for each file that had to be left out.

    Returns:
        The run and the names of the files written.
    """
    with atomic_folder(folder, (*RUN_FILES, *_OWN)) as partial:
        return _run_demo(partial, step, note)


_OWN = ("mission.mcap", "chart.png")


def _run_demo(
    folder: Path, step: Callable[[str], None], note: Callable[[str], None]
) -> tuple[RunResult, list[str]]:
    mission_name, picture = _OWN
    write_log(simulate(SCENARIO), folder / mission_name)
    step("mission simulated and logged")
    result = run(load_log(folder / mission_name), progress=lambda name: step(f"replayed {name}"))
    written = [mission_name, *write_run_files(result, folder, note)]
    step("pictures and replay written")
    if result.log.chart is not None:
        try:
            write_chart_picture(result.log.chart, folder / picture)
        except MissingDependencyError as reason:
            note(f"{picture} is left out: {reason}")
        else:
            written.append(picture)
    step("done")
    return result, written
