"""What a node did, written down before it is done, and checkpoints: a node that is killed goes on where it was.

A folder holds `journal-000001.jsonl` and so on, one line for each event that was handed to the navigator and each slot
that was used, and `checkpoint`, a state with the place in the journal that it holds for. To resume is to take the
checkpoint and to do again what the journal has after it, without sending. A slot's line is on the disk (fsync) before its
packet is made, so that no counter goes back and no packet is sent twice, by kill or by power loss. What power loss takes
of the last lines are sensor events since the last slot or checkpoint.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

from uwcoop.errors import LogError
from uwcoop.onboard.messages import Message, MessageError, encode
from uwcoop.onboard.messages import decode as decode_messages
from uwcoop.report.atomic_files import atomic_write

__all__ = ["Journal", "journal_files", "read_lines"]

ROTATE_BYTES = 32 * 2**20
"""A new file is begun when one is longer."""


class Journal:
    """The journal and checkpoint of one node in one folder; one process at a time."""

    def __init__(self, folder: Path, digest: str, rotate_bytes: int = ROTATE_BYTES) -> None:
        """Open or begin a journal.

        Args:
            folder: made if it does not exist.
            digest: of what the state depends on (`VehicleNavigator.digest`).
            rotate_bytes: length at which a new file is begun.

        Raises:
            LogError: another node is using the folder, or the journal is of another mission, vehicle or navigator.
        """
        self.folder, self.digest, self.rotate_bytes = folder, digest, rotate_bytes
        self.notes: list[str] = []
        """What was cut off at the end of a damaged journal."""
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            raise LogError(f"state folder {folder} is in use by another node") from None
        try:
            self._open()
        except BaseException:
            os.close(self._lock)
            raise

    def append(self, line: Message, *, sync: bool = False) -> None:
        """Write a line; with `sync` it is on the disk when this returns."""
        if self._size >= self.rotate_bytes:
            self.sync()
            os.close(self._file)
            self._begin(self._number + 1)
        self._write(line)
        if sync:
            self.sync()

    def sync(self) -> None:
        """What was written is on the disk."""
        os.fsync(self._file)

    def checkpoint(self, state: bytes, about: Message) -> None:
        """Keep a state that holds for all lines so far, and what else the node is to know when it resumes; the file is
        whole, the old one or the new one."""
        self.sync()
        head = {
            "file": self._number,
            "offset": self._size,
            "about": about,
            "sha256": hashlib.sha256(state).hexdigest(),
        }
        with atomic_write(self.folder / "checkpoint") as partial:
            partial.write_bytes(json.dumps(head).encode() + b"\n" + state)

    def resume(self) -> tuple[bytes | None, Message, Iterator[Message]]:
        """The last checkpoint's state, None without one, what was kept beside it, and the journal's lines after it.

        Raises:
            LogError: a checkpoint that is damaged or ahead of its journal.
        """
        path = self.folder / "checkpoint"
        if not path.exists():
            return None, {}, read_lines(self.folder)
        head, _, state = path.read_bytes().partition(b"\n")
        try:
            about = json.loads(head)
            number, offset, digest = int(about["file"]), int(about["offset"]), about["sha256"]
            kept = dict(about["about"])
        except (ValueError, KeyError, TypeError):
            raise LogError(f"checkpoint {path} is damaged: its first line is no header") from None
        if hashlib.sha256(state).hexdigest() != digest:
            raise LogError(f"checkpoint {path} is damaged: SHA-256 of its state is not {digest}")
        if (number, offset) > (self._number, self._size):
            raise LogError(f"checkpoint {path} is ahead of its journal: lines of the journal are missing")
        return state, kept, read_lines(self.folder, number, offset)

    def close(self) -> None:
        """End; the folder is free."""
        os.fsync(self._file)
        os.close(self._file)
        os.close(self._lock)

    def _open(self) -> None:
        for path in journal_files(self.folder):
            _check_head(path, self.digest)
        if files := journal_files(self.folder):
            self._cut_torn_end(files[-1])
            self._number = _number(files[-1])
            self._file = os.open(files[-1], os.O_WRONLY | os.O_APPEND)
            self._size = os.fstat(self._file).st_size
        else:
            self._begin(1)

    def _begin(self, number: int) -> None:
        path = self.folder / f"journal-{number:06}.jsonl"
        self._number, self._size = number, 0
        self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o644)
        self._write({"type": "journal", "format": 1, "digest": self.digest})
        self.sync()
        os.fsync(self._lock)

    def _write(self, line: Message) -> None:
        data = encode(line)
        if (written := os.write(self._file, data)) != len(data):
            raise LogError(
                f"journal in {self.folder}: {written} of {len(data)} bytes written, the disk is full"
            )
        self._size += len(data)

    def _cut_torn_end(self, path: Path) -> None:
        content = path.read_bytes()
        whole = 0
        for line in content.splitlines(keepends=True):
            if not _is_whole(line):
                break
            whole += len(line)
        if whole < len(content):
            self.notes.append(f"{path.name}: {len(content) - whole} bytes of unfinished lines were cut off")
            os.truncate(path, whole)


def journal_files(folder: Path) -> list[Path]:
    """The journal's files in order."""
    return sorted(folder.glob("journal-[0-9][0-9][0-9][0-9][0-9][0-9].jsonl"))


def read_lines(folder: Path, number: int = 0, offset: int = 0) -> Iterator[Message]:
    """The journal's lines after a place in it, heads left out; one line at a time is in memory.

    Raises:
        LogError: a line that is damaged.
    """
    for path in journal_files(folder):
        if _number(path) < number:
            continue
        with path.open("rb") as file:
            if _number(path) == number:
                file.seek(offset)
            for line in file:
                if not line.endswith(b"\n"):
                    return  # a node is writing it
                try:
                    (message,) = decode_messages(line)
                except (MessageError, ValueError) as error:
                    raise LogError(f"journal {path}: {error}") from None
                if message["type"] != "journal":
                    yield message


def _number(path: Path) -> int:
    return int(path.stem.removeprefix("journal-"))


def _is_whole(line: bytes) -> bool:
    try:
        return line.endswith(b"\n") and len(decode_messages(line)) == 1
    except MessageError:
        return False


def _check_head(path: Path, digest: str) -> None:
    with path.open("rb") as file:
        line = file.readline()
    if not _is_whole(line) and path == journal_files(path.parent)[-1] and path.stat().st_size == len(line):
        path.unlink()  # killed while it was begun: it holds nothing
        return
    found = json.loads(line).get("digest") if _is_whole(line) else None
    if found != digest:
        raise LogError(
            f"journal {path} belongs to another scenario, vehicle, navigator, seed or chart: "
            "use another state folder"
        )
