"""Recordings of any kind as a mission: `uwcoop import`, and the same from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop.errors import LogError
from uwcoop.importers.bounded import refused
from uwcoop.importers.datasets.detect import read_dataset
from uwcoop.importers.import_config import ImportConfig, load_config
from uwcoop.importers.readers import read_source

if TYPE_CHECKING:
    from uwcoop.importers.channels import SourceFile
    from uwcoop.missionlog import MissionLog

__all__ = ["import_recordings", "read_sources"]


def read_sources(files: Sequence[str | Path], config: ImportConfig) -> list[SourceFile]:
    """The channels of all files.

    Raises:
        LogError: one that is missing, damaged or of no kind that is read.
    """
    return [read_source(Path(file), config.csv) for file in files]


def import_recordings(
    files: Sequence[str | Path],
    config: str | Path | None = None,
    *,
    overrides: Mapping[str, Any] | None = None,
    truth: Sequence[str] = (),
) -> MissionLog:
    """The mission that recordings hold.

    Args:
        files: ROS 1 and ROS 2 bags, text tables, ArduPilot and MAVLink logs, MOOS and IMC logs; or one data set of
            `uwcoop.importers.datasets`.
        config: an `import.toml`; None: what the types and names of channels settle.
        overrides: keys of it, over the file.
        truth: "[VEHICLE=]FILE" or a topic of the recordings each, as `uwcoop run --truth` takes them.

    Raises:
        LogError, ScenarioError: one line that says what is wrong or missing, and what there is.
    """
    if not files:
        raise LogError("no file to import")
    if len(files) == 1 and config is None and not overrides and not truth:
        found = read_dataset(Path(files[0]))
        if found is not None:
            return found
    from uwcoop.importers.mapping.mission import mission_of

    topics, tables = _sorted(truth)
    told = load_config(config, overrides)
    if topics:
        told = told.model_copy(
            update={"sensors": told.sensors.model_copy(update={"truth": _truth_sensor(topics)})}
        )
    try:
        sources = read_sources(files, told)
        with refused(LogError, ", ".join(source.name for source in sources)):
            log = mission_of(sources, told)
    except LogError as error:  # names in a damaged file may hold anything
        raise LogError(" ".join(str(error).split())) from error
    if topics and log.truth is None:
        raise LogError(f"truth: no vehicle has the topic {topics[0]}")
    if tables:
        from uwcoop.experiment.given_truth import with_truth

        log = with_truth(replace(log, truth=None), tables, None)
    return log


def _sorted(truth: Sequence[str]) -> tuple[list[str], list[str]]:
    """Topics and files: a name with a slash at its beginning that is no file is a topic."""
    topics = [t for t in truth if t.startswith("/") and not Path(t).exists()]
    return topics, [t for t in truth if t not in topics]


def _truth_sensor(topics: Sequence[str]) -> Any:
    from uwcoop.importers.import_config import PositionSensor

    return PositionSensor(topic=tuple(topics))
