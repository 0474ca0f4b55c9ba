"""ROS recordings: a file of any kind, or a folder with the parts of one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from uwcoop.errors import LogError
from uwcoop.importers.channels import SourceFile
from uwcoop.importers.file_kind import file_kind
from uwcoop.importers.readers.mcap_bag import read_mcap
from uwcoop.importers.readers.ros1_bag import read_ros1
from uwcoop.importers.readers.ros_topics import RawTopic, channels_of
from uwcoop.importers.readers.sqlite_bag import read_sqlite

__all__ = ["is_bag_folder", "read_bag"]

_READERS: dict[str, tuple[str, Callable[[Path], tuple[list[RawTopic], list[str]]]]] = {
    "mcap": ("ROS 2 bag (MCAP)", read_mcap),
    "sqlite": ("ROS 2 bag (SQLite)", read_sqlite),
    "ros1-bag": ("ROS 1 bag", read_ros1),
}
BAG_KINDS = frozenset(_READERS)
_ENDINGS = (".mcap", ".db3")


def is_bag_folder(path: Path) -> bool:
    """Whether a folder holds parts of a ROS 2 bag."""
    return path.is_dir() and bool(_parts(path))


def read_bag(path: Path) -> SourceFile:
    """Read a bag: `.mcap`, `.db3`, `.bag`, or a folder of the first two.

    Raises:
        LogError: it is none, or holds no message.
    """
    parts = _parts(path) if path.is_dir() else [path]
    kinds = {file_kind(part).key for part in parts}
    if len(kinds) != 1 or not kinds <= BAG_KINDS:
        raise LogError(f"{path} holds no ROS bag, or parts of different kinds")
    how, read = _READERS[kinds.pop()]
    topics: dict[tuple[str, str], RawTopic] = {}
    notes: list[str] = []
    for part in parts:
        found, said = read(part)
        notes += said
        for topic in found:
            first = topics.setdefault((topic.name, topic.msgtype), topic)
            if first is not topic:
                first.messages += topic.messages
                first.received_ns += topic.received_ns
                first.too_long += topic.too_long
    channels, omitted, said = channels_of(list(topics.values()), path.name, ros2=how != "ROS 1 bag")
    if not channels:
        raise LogError(f"{path}: {'; '.join(notes) or 'it holds no message that can be read'}")
    return SourceFile(path.name, how, tuple(channels), tuple(omitted), tuple(notes + said))


def _parts(folder: Path) -> list[Path]:
    """The files of a bag in the order in which they were written: names end in a number."""
    return sorted(
        (p for p in folder.iterdir() if p.suffix in _ENDINGS and p.is_file()),
        key=lambda p: (len(p.name), p.name),
    )
