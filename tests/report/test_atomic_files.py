"""Files and folders appear complete or not at all, whatever happens in between."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from uwcoop.report import atomic_files
from uwcoop.report.atomic_files import (
    atomic_folder,
    atomic_write,
    check_file,
    check_folder,
    finish_swap,
    lock_folder,
)
from uwcoop.report.interruption import Interrupted, caught, deferred

NAMES = ("a.txt", "b.txt", "c.txt")


def content(folder: Path) -> dict[str, str]:
    return {p.name: p.read_text() for p in sorted(folder.iterdir())}


def written(folder: Path, **files: str) -> None:
    with atomic_folder(folder, NAMES) as partial:
        for name, text in files.items():
            (partial / f"{name}.txt").write_text(text)


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def interrupted() -> None:
        with atomic_write(target) as partial:
            partial.write_text("half")
            assert partial.suffix == ".txt"
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert content(tmp_path) == {"a.txt": "old"}
    with atomic_write(target) as partial:
        partial.write_text("new")
    assert content(tmp_path) == {"a.txt": "new"}


def test_a_link_stays_and_what_is_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "there" / "real.txt")
    with atomic_write(tmp_path / "link.txt") as partial:
        partial.write_text("new")
    assert (tmp_path / "link.txt").is_symlink()
    assert content(tmp_path / "there") == {"real.txt": "new"}
    os.mkfifo(tmp_path / "fifo")
    for path, words in (
        (tmp_path / "fifo", "not a regular file"),
        (tmp_path / "there", "is a folder"),
        (tmp_path / "absent" / "x", "no such folder"),
        (Path("/dev/null"), "not a regular file"),
    ):
        with pytest.raises(OSError, match=words):
            check_file(path)
    (tmp_path / "out").mkdir()
    os.mkfifo(tmp_path / "out" / "b.txt")
    with pytest.raises(OSError, match="not a regular file"):
        check_folder(tmp_path / "out", NAMES)
    with pytest.raises(NotADirectoryError, match="is a file"):
        check_folder(tmp_path / "there" / "real.txt" / "below")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is closed to the superuser")
def test_what_cannot_be_written_is_said_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "closed").mkdir(mode=0o500)
    for check, path in ((check_file, "closed/x"), (check_folder, "closed/x/y")):
        with pytest.raises(PermissionError, match="cannot be written to"):
            check(tmp_path / path)


def test_results_replace_all_of_an_earlier_run_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    written(out, a="1", b="1")
    assert content(out) == {"a.txt": "1", "b.txt": "1"}
    (out / "notes.md").write_text("mine")
    written(out, a="2", c="2")
    assert content(out) == {"a.txt": "2", "c.txt": "2", "notes.md": "mine"}
    (tmp_path / "link").symlink_to(out)
    written(tmp_path / "link", b="3")
    assert (tmp_path / "link").is_symlink()
    assert content(out) == {"b.txt": "3", "notes.md": "mine"}
    with pytest.raises(FileNotFoundError), atomic_folder(out, NAMES) as partial:
        (partial / "a.txt").write_text((partial / "absent").read_text())
    assert content(out) == {"b.txt": "3", "notes.md": "mine"}
    assert [p.name for p in out.parent.iterdir()] == ["out"]


def test_stopped_at_any_step_old_and_new_are_never_side_by_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = ("unlink", "replace", "rename")

    class Killed(BaseException):
        pass

    def stop_after(patch: pytest.MonkeyPatch, step: str, out: Path, left: list[None]) -> None:
        whole = getattr(Path, step)

        def stopped(self: Path, *args: object, **more: object) -> object:
            if out in self.parents:
                if not left:
                    raise Killed
                left.pop()
            return whole(self, *args, **more)

        patch.setattr(Path, step, stopped)

    ends = set()
    for stop in range(20):
        out = tmp_path / str(stop)
        written(out, a="old", b="old")
        left = [None] * stop
        with monkeypatch.context() as patch, suppress(Killed):
            for step in steps:
                stop_after(patch, step, out, left)
            patch.setattr(
                atomic_files.shutil, "rmtree", lambda *_, **__: None
            )  # nor does a killed process tidy up
            written(out, a="new", c="new")
        assert len({p.read_text() for p in out.glob("*.txt")}) <= 1, "mixed"
        finish_swap(out)
        atomic_files._sweep(out)
        now = content(out)
        assert now in ({"a.txt": "old", "b.txt": "old"}, {"a.txt": "new", "c.txt": "new"})
        ends.add(now["a.txt"])
    assert ends == {"old", "new"}


def test_what_a_killed_process_left_is_swept_and_what_a_living_one_writes_is_not(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys, pathlib\n"
        "from uwcoop.report.atomic_files import atomic_folder, atomic_write\n"
        "home = pathlib.Path(sys.argv[1])\n"
        "with atomic_folder(home / 'out', ()) as folder, atomic_write(home / 'a.txt') as file:\n"
        "    file.write_text('half')\n"
        "    (folder / 'b.txt').write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    for name in (".mine.part", ".a.0123abcd.part.txt"):
        (tmp_path / name).write_text("not of this program's making")
    ended = subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=False, timeout=60)
    assert ended.returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob(".*.part*"))) == 4
    with atomic_write(tmp_path / "living.txt") as living:
        living.write_text("x")
        with atomic_write(tmp_path / "a.txt") as partial:
            partial.write_text("new")
        assert living.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        ".a.0123abcd.part.txt",
        ".mine.part",
        "a.txt",
        "living.txt",
    ]


def test_a_folder_has_one_writer(tmp_path: Path) -> None:
    with lock_folder(tmp_path), pytest.raises(BlockingIOError), lock_folder(tmp_path):
        pass
    with lock_folder(tmp_path, wait=True):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_raised_even_if_its_exception_is_swallowed(
    number: signal.Signals, tmp_path: Path
) -> None:
    def swallowed() -> None:
        with suppress(KeyboardInterrupt):  # as a callback of a C library does
            os.kill(os.getpid(), number)

    before, target, done = signal.getsignal(number), tmp_path / "a.txt", list[bool]()
    with pytest.raises(Interrupted) as raised, caught():
        swallowed()
    assert raised.value.number == number

    def write() -> None:
        with caught(), atomic_write(target) as partial:
            partial.write_text("x")
            swallowed()

    with pytest.raises(Interrupted):
        write()
    assert not list(tmp_path.iterdir())

    def finish() -> None:
        with caught():
            with deferred():
                os.kill(os.getpid(), number)
                done.append(True)
            done.append(False)

    with pytest.raises(Interrupted):
        finish()
    assert done == [True]
    assert signal.getsignal(number) is before
