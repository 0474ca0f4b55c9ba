"""Readers of recordings: a file format each, and nothing of navigation."""

from __future__ import annotations

from pathlib import Path

from uwcoop.errors import LogError
from uwcoop.importers.bounded import refuse_irregular, refused
from uwcoop.importers.channels import SourceFile
from uwcoop.importers.file_kind import file_kind
from uwcoop.importers.readers.rosbags import BAG_KINDS, is_bag_folder, read_bag
from uwcoop.importers.readers.table_file import TimeColumns, read_table

_TABLES = (".csv", ".tsv", ".gz")
__all__ = ["TimeColumns", "read_source", "recording_kind"]


def read_source(path: Path, times: TimeColumns) -> SourceFile:
    """Read a recording of any kind, told by its content.

    Args:
        path: a file, or the folder of a bag.
        times: of text tables, which columns hold times.

    Raises:
        LogError: it does not exist, or is no recording that is read; one line.
    """
    with refused(LogError, f"{path}"):
        if is_bag_folder(path):
            return read_bag(path)
        if path.is_dir():
            raise LogError(
                f"{path} is a folder without parts of a ROS 2 bag (.mcap, .db3): name the files in it"
            )
        refuse_irregular(path)
        kind = file_kind(path)
        if kind.key in BAG_KINDS:
            return read_bag(path)
        if (special := _special(path, kind.key)) is not None:
            return special
        if kind.key == "text":
            return read_table(path, times)
        raise LogError(
            f"{path} is {kind.name}, no recording that is read" + (f": {kind.advice}" if kind.advice else "")
        )


def recording_kind(path: Path) -> str:
    """What recording a file or folder is, as a sentence names it, by content and, of text, its ending; "" for none."""
    from uwcoop.importers.readers import imc, mavlink

    if path.is_dir():
        return "a ROS 2 bag" if is_bag_folder(path) else ""
    if not path.is_file():
        return ""
    kind = file_kind(path)
    if kind.key in BAG_KINDS:
        return {"sqlite": "a ROS 2 bag (SQLite)"}.get(kind.key, kind.name)
    if kind.key == "alog" or path.suffix == ".alog":
        return "a MOOS log"
    if mavlink.is_dataflash(path) or mavlink.is_telemetry(path):
        return "an ArduPilot or MAVLink log"
    if imc.is_imc(path):
        return "an IMC log"
    return "a text table" if kind.key == "text" and path.suffix in _TABLES else ""


def _special(path: Path, kind: str) -> SourceFile | None:
    """Formats that need a library of their own, or are told by more than their first bytes."""
    from uwcoop.importers.readers import imc, mavlink, moos

    if kind == "alog" or path.suffix == ".alog":
        return moos.read_alog(path)
    if mavlink.is_dataflash(path) or mavlink.is_telemetry(path):
        return mavlink.read_mavlink(path)
    if imc.is_imc(path):
        return imc.read_lsf(path)
    return None
