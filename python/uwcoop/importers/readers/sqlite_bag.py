"""ROS 2 recordings in SQLite files (`.db3`)."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from uwcoop.errors import LogError
from uwcoop.importers.readers.ros_topics import LONGEST_MESSAGE_BYTES, RawTopic

__all__ = ["read_sqlite"]


def read_sqlite(path: Path) -> tuple[list[RawTopic], list[str]]:
    """The topics of a file, and notes.

    Raises:
        LogError: an SQLite database that is no ROS 2 bag.
    """
    notes: list[str] = []
    topics: list[RawTopic] = []
    # Read only, and as it is: a recorder that was cut off leaves a journal that nobody else may play back.
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as base:
        tables = {row[0] for row in _rows(base, "SELECT name FROM sqlite_master WHERE type = 'table'", path)}
        if not {"topics", "messages"} <= tables:
            raise LogError(
                f"{path} is an SQLite database and no ROS 2 bag: it has no tables topics and messages"
            )
        definitions: dict[str, tuple[str, str]] = {}
        if "message_definitions" in tables:
            query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            definitions = {row[0]: (row[1], row[2]) for row in _rows(base, query, path)}
        query = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        for number, name, msgtype, encoding in _rows(base, query, path):
            if encoding != "cdr":
                notes.append(f"{name}: its messages are {encoding!r}, not CDR: not read")
                continue
            how, text = definitions.get(msgtype, ("", ""))
            topic = RawTopic(name, msgtype, text if how.startswith("ros2") else "", how == "ros2idl")
            _take(base, number, topic, path, notes)
            topics.append(topic)
    return topics, notes


def _rows(base: sqlite3.Connection, query: str, path: Path) -> list[tuple[str, ...]]:
    try:
        return base.execute(query).fetchall()
    except sqlite3.DatabaseError as error:
        raise LogError(f"{path} cannot be read: {error}") from error


def _take(base: sqlite3.Connection, number: str, topic: RawTopic, path: Path, notes: list[str]) -> None:
    """The messages of a topic in the order of their rows; what cannot be read of a damaged file is noted."""
    query = (
        "SELECT timestamp, length(data), CASE WHEN length(data) <= ? THEN data END FROM messages "
        "WHERE topic_id = ? ORDER BY id"
    )
    try:
        for received_ns, length, data in base.execute(query, (LONGEST_MESSAGE_BYTES, number)):
            if data is None:
                topic.too_long += length is not None
            else:
                topic.take(received_ns, data)
    except sqlite3.DatabaseError as error:
        notes.append(
            f"{topic.name}: {path.name} is cut off or damaged ({error}): its first "
            f"{len(topic.messages):,} messages are read"
        )
