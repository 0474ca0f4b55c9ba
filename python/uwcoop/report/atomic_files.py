"""Files and folders that appear complete or not at all.

What is being written has a name that ends in `.part` and tells whose it is: `.NAME.HOST-PID-TOKEN.part`. Whoever writes
to a folder first removes what processes that are gone have left there, and finishes what was decided but not done.

A folder of results is written as a whole under such a name. A folder that does not exist yet gets its name by one rename.
In a folder that exists, other files stay: the new folder is moved into it as `.swap.remove`, from which moment on it is
what counts; then the old results are removed, it becomes `.swap.move`, and its files move out of it. At no instant do old
and new ones lie side by side, and who finds a `.swap.*` finishes the job.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import platform
import re
import secrets
import shutil
import stat
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from uwcoop.report.interruption import check, deferred

__all__ = [
    "atomic_folder",
    "atomic_write",
    "check_file",
    "check_folder",
    "finish_swap",
    "lock_folder",
]

_HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
_PART = re.compile(r"\..*\.(?P<host>[0-9a-f]{8})-(?P<pid>\d+)-(?P<token>[0-9a-f]{8})\.part(\.[^.]*)?")
_REMOVE, _MOVE, _OLD_NAMES = ".swap.remove", ".swap.move", ".old-names.json"
_being_written: set[str] = set()
"""Tokens of this process."""


@contextmanager
def atomic_write(target: Path) -> Iterator[Path]:
    """A temporary path beside `target`, renamed to it when the block ends well and removed otherwise.

    The temporary name keeps the suffix, because writers tell the format by it. A link stays: what it points to is
    replaced.

    Raises:
        OSError: `target` is something that is not a file, or cannot be written.
    """
    target = Path(os.path.realpath(target))
    check_file(target)
    _sweep(target.parent)
    with _part_name(target.stem, target.suffix) as name:
        partial = target.with_name(name)
        try:
            yield partial
            _sync(partial)
            check()
            with deferred():
                partial.replace(target)
                _sync(target.parent)
        finally:
            partial.unlink(missing_ok=True)


@contextmanager
def atomic_folder(folder: Path, names: Collection[str]) -> Iterator[Path]:
    """A temporary folder whose files replace those of `folder` when the block ends well; removed otherwise.

    Args:
        folder: made if it does not exist, with its parents; a link stays.
        names: files that an earlier run may have left there. Those that are not written anew are removed; anything else
            in the folder stays.

    Raises:
        OSError: `folder` is a file, cannot be written, or one of the names is there and is no file.
    """
    folder = Path(os.path.realpath(folder))
    check_folder(folder, names)
    folder.parent.mkdir(parents=True, exist_ok=True)
    _sweep(folder.parent)
    if folder.is_dir():
        finish_swap(folder)
        _sweep(folder)
    with _part_name(folder.name) as name:
        partial = (folder if folder.is_dir() else folder.parent) / name
        try:
            partial.mkdir()
            yield partial
            for path in partial.iterdir():
                _sync(path)
            check()
            with deferred():
                _swap(partial, folder, names)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def _swap(partial: Path, folder: Path, names: Collection[str]) -> None:
    if not folder.is_dir():
        with suppress(OSError):  # another process has just made it
            partial.rename(folder)
            _sync(folder.parent)
            return
    new = {path.name for path in partial.iterdir()}
    (partial / _OLD_NAMES).write_text(json.dumps(sorted({*names, *new})), encoding="utf-8")
    _sync(partial / _OLD_NAMES)
    with lock_folder(folder, wait=True):
        finish_swap(folder)
        target = folder / _REMOVE
        (partial if partial.parent == folder else Path(shutil.move(partial, folder))).rename(target)
        _sync(folder)
        finish_swap(folder)


def finish_swap(folder: Path) -> None:
    """Finish what a process that was killed had decided: its results take the place of the old ones."""
    decided, moving = folder / _REMOVE, folder / _MOVE
    if decided.is_dir():
        for name in json.loads((decided / _OLD_NAMES).read_text(encoding="utf-8")):
            (folder / name).unlink(missing_ok=True)
        _sync(folder)
        decided.rename(moving)
    if moving.is_dir():
        for path in sorted(moving.iterdir()):
            if path.name != _OLD_NAMES:
                path.replace(folder / path.name)
        _sync(folder)
        shutil.rmtree(moving)


def check_file(path: Path) -> None:
    """Raise `OSError` for a path at which no file can be written, before the work for it is done."""
    with suppress(FileNotFoundError):
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, "is a folder, the output must be a file", str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "is not a regular file, the output must be one", str(path))
    parent = Path(os.path.realpath(path)).parent
    if not parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder to write to", str(parent))
    _check_writable(parent)


def check_folder(folder: Path, names: Collection[str] = ()) -> None:
    """Raise `OSError` for a folder in which these files cannot be written, before the work for them is done.

    It need not exist; nothing is made.
    """
    _refuse_file(folder)
    for name in names:
        with suppress(FileNotFoundError):
            if not stat.S_ISREG((folder / name).stat().st_mode):
                raise OSError(
                    errno.EINVAL, "is not a regular file, a result must replace it", str(folder / name)
                )
    at = Path(os.path.realpath(folder))
    while not at.exists():
        at = at.parent
    _refuse_file(at)
    _check_writable(at)


def _refuse_file(folder: Path) -> None:
    """Raise `NotADirectoryError` if something that is not a folder has this name; makes nothing."""
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "is a file, the output must be a folder", str(folder))


def _check_writable(folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "cannot be written to", str(folder))


@contextmanager
def lock_folder(folder: Path, *, wait: bool = False) -> Iterator[None]:
    """Keep other processes from the block for the same folder, which must exist; a killed process gives it free.

    Raises:
        BlockingIOError: another process is in it, and `wait` is false.
    """
    try:
        import fcntl
    except ImportError:  # Windows: no lock
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield
    finally:
        os.close(handle)


@contextmanager
def _part_name(stem: str, suffix: str = "") -> Iterator[str]:
    token = secrets.token_hex(4)
    _being_written.add(token)
    try:
        yield f".{stem}.{_HOST}-{os.getpid()}-{token}.part{suffix}"
    finally:
        _being_written.discard(token)


def _sweep(folder: Path) -> None:
    """Remove what processes of this machine that are gone were writing in a folder."""
    for path in folder.iterdir():
        found = _PART.fullmatch(path.name)
        if found is None or found["host"] != _HOST or _alive(int(found["pid"]), found["token"]):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _alive(pid: int, token: str) -> bool:
    if pid == os.getpid():
        return token in _being_written
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it is another user's
        return True
    return True


def _sync(path: Path) -> None:
    """Have a file or folder on the disk, so that a power cut after the rename finds it whole."""
    with suppress(PermissionError):  # a folder that can be written but not read
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno != errno.EINVAL:  # file systems without it
                raise
        finally:
            os.close(handle)
