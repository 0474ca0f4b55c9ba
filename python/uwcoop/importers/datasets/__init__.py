"""Recordings of ranges to beacons at known places, as missions that every navigator of ranges can replay.

A beacon becomes a vehicle that stands still and says so. A range becomes a signal that the vehicle hears for certain:
what the packet on it holds is up to the navigator, as in a simulated mission. With one beacon that is the geometry of
a single ship.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from uwcoop.errors import LogError, ScenarioError
from uwcoop.importers.bounded import refused
from uwcoop.importers.datasets.labyrinth import INPUT, read_labyrinth
from uwcoop.importers.datasets.plaza import read_plaza
from uwcoop.importers.datasets.pyfg import heard_on_the_way, in_seconds, read_pyfg
from uwcoop.importers.datasets.recording import (
    LabyrinthOptions,
    Options,
    PlazaOptions,
    PyfgOptions,
    mission_of,
)
from uwcoop.missionlog.validate import validate
from uwcoop.scenario.loading import table_of
from uwcoop.scenario.validation_message import one_line

if TYPE_CHECKING:
    from uwcoop.importers.datasets.recording import Recording
    from uwcoop.missionlog import MissionLog

__all__ = ["ENDINGS", "LabyrinthOptions", "PlazaOptions", "PyfgOptions", "open_recording"]

ENDINGS = (".pyfg", ".mat", INPUT)
"""Files that are recordings: factor graphs as PyFactorGraph writes them, the Plaza files of the CMU mower, and
the indoor UWB files of libRSF."""


def open_recording(path: str | Path, overrides: Iterable[str] = ()) -> MissionLog:
    """Read a recording as a mission.

    Args:
        path: a `.pyfg` factor graph in the plane, or `Plaza1_.mat` and its like, or `NAME_Input.txt` of libRSF.
        overrides: "recording.key=value" each, for the keys of `PyfgOptions`, `PlazaOptions` or
            `LabyrinthOptions`.

    Raises:
        LogError: a file whose content does not match its suffix.
        ScenarioError: an unknown key, or a value outside its bound; one line.
        MissingDependencyError: `.mat` without scipy.
    """
    path = Path(path)
    table = table_of(overrides, "recording")
    model, read = _kind(path)
    try:
        options: Options = model.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(one_line(error, table, "recording")) from None
    if not path.is_file():
        raise LogError(f"recording {path} cannot be read: there is no such file")
    with refused(LogError, f"recording {path}"):
        found = read(path)
        if isinstance(options, PyfgOptions) and options.range_delay_edges > 0:
            found = heard_on_the_way(found, options.range_delay_edges)
        if isinstance(options, PyfgOptions):
            found = in_seconds(found)
        log = mission_of(found, options)
        validate(log)
    return log


def _kind(path: Path) -> tuple[type[Options], Callable[[Path], Recording]]:
    """Options and reader of a file, by its ending."""
    if path.suffix == ".pyfg":
        return PyfgOptions, read_pyfg
    if path.name.endswith(INPUT):
        return LabyrinthOptions, read_labyrinth
    return PlazaOptions, read_plaza
