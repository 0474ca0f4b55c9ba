"""SIGINT and SIGTERM: an exception where one can be raised, remembered where a library swallows it.

An exception that a signal's handler raises inside a callback of a C library is printed and dropped, and the program goes
on as if nothing had been. So the signal is also remembered, and `check` raises it again: before a result is put in its
place, and when a command ends.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["Interrupted", "caught", "check", "deferred", "forget", "ignored_in_children"]

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """A signal asked the program to end."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number
        """Of the signal."""


class _Received:
    number: int | None = None
    deferrals: int = 0


_received = _Received()


def _handle(number: int, _frame: FrameType | None) -> None:
    _received.number = number
    if _received.deferrals == 0:
        raise Interrupted(number)


def check() -> None:
    """Raise `Interrupted` if a signal has come since `caught` began, whatever became of its exception."""
    if _received.number is not None and _received.deferrals == 0:
        raise Interrupted(_received.number)


def forget() -> None:
    """The signal that has come was meant to end a part only, and has."""
    _received.number = None


@contextmanager
def caught() -> Iterator[None]:
    """In the block, SIGINT and SIGTERM raise `Interrupted`, at the latest when it ends; ignored ones stay so.

    Outside of the main thread, which alone gets signals, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before: dict[int, Any] = {s: signal.getsignal(s) for s in _SIGNALS}
    print_dropped = sys.unraisablehook

    def dropped(unraisable: Any) -> None:
        # `check` raises it again: nothing to print.
        if not isinstance(unraisable.exc_value, Interrupted):
            print_dropped(unraisable)

    _received.number = None
    sys.unraisablehook = dropped
    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, _handle)
        yield
        check()
    finally:
        _received.number = None
        sys.unraisablehook = print_dropped
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)


@contextmanager
def deferred() -> Iterator[None]:
    """A block that is not cut off in the middle: a signal is raised when it has ended well."""
    _received.deferrals += 1
    try:
        yield
    finally:
        _received.deferrals -= 1
    check()


@contextmanager
def ignored_in_children() -> Iterator[None]:
    """Processes that are started in the block ignore SIGINT from their first instruction.

    Ctrl-C reaches every process of a terminal; this one decides what happens to its workers.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)
