"""Where the batches of a study are flown: in this process, or in processes of this machine that stay warm."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.context import BaseContext
from typing import Protocol

from uwcoop.acoustics.authentication import KeyFileWarning
from uwcoop.errors import StudyError
from uwcoop.experiment.study_flights import Batch, Flown, Plan, fly_batch
from uwcoop.report.interruption import ignored_in_children

__all__ = ["Executor", "Here", "cores", "local_processes"]

_RESTARTS = 3
"""How often the processes are started anew when one of them was killed."""


class Executor(Protocol):
    """Flies batches of a plan. One that is at work is had from a context, which ends with its workers."""

    @property
    def slots(self) -> int:
        """Batches that are flown at the same time, as far as is known now."""

    def submit(self, batch: Batch) -> None:
        """Have a batch flown; more of them than slots may wait."""

    def next_flown(self) -> list[Flown]:
        """Wait for a batch that was submitted to end, in the order of ending; each is given once.

        Raises:
            StudyError: workers are gone, and trying again does not help.
        """


class Here:
    """In this process, batch after batch."""

    slots = 1

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._waiting: list[Batch] = []

    def submit(self, batch: Batch) -> None:
        """See `Executor`."""
        self._waiting.append(batch)

    def next_flown(self) -> list[Flown]:
        """See `Executor`."""
        return fly_batch(self._plan, self._waiting.pop(0))


@contextmanager
def local_processes(plan: Plan, count: int) -> Iterator[Executor]:
    """Processes of this machine. On Linux they are forked from a server that has imported the package once.

    All are ended when the block is left, also by an exception.
    """
    ours = set(multiprocessing.active_children())
    at_work = _LocalProcesses(plan, count)
    try:
        yield at_work
    except BaseException:
        at_work.abandon()
        for child in set(multiprocessing.active_children()) - ours:
            child.terminate()
        raise
    finally:
        at_work.close()


class _LocalProcesses:
    def __init__(self, plan: Plan, count: int) -> None:
        self.slots = count
        self._plan = plan
        self._pool = self._started()
        self._flying: dict[Future[list[Flown]], Batch] = {}
        self._restarts = 0
        self._ended_since_start = 0

    def submit(self, batch: Batch) -> None:
        """See `Executor`."""
        with ignored_in_children():
            try:
                self._flying[self._pool.submit(_fly_own, batch)] = batch
            except BrokenProcessPool:
                # It is flown by the next pool, which `next_flown` starts when it finds this future broken.
                broken: Future[list[Flown]] = Future()
                broken.set_exception(BrokenProcessPool())
                self._flying[broken] = batch

    def next_flown(self) -> list[Flown]:
        """See `Executor`."""
        while True:
            done, _ = wait(self._flying, return_when=FIRST_COMPLETED)
            future = next(iter(done))
            try:
                flown = future.result()
            except BrokenProcessPool as error:
                self._start_again(error)
                continue
            del self._flying[future]
            self._ended_since_start += 1
            return flown

    def abandon(self) -> None:
        """Nothing further is begun."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """All processes have ended."""
        self._pool.shutdown(cancel_futures=True)

    def _started(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.slots, _context(), initializer=_begin, initargs=(self._plan,))

    def _start_again(self, error: BrokenProcessPool) -> None:
        """New processes for what was being flown when one was killed; finished batches stay as they are."""
        if self._ended_since_start == 0 or self._restarts == _RESTARTS:
            raise StudyError(
                "a worker process did not start or was killed: a script that calls study() needs "
                '`if __name__ == "__main__":` around its work; for want of memory use fewer processes'
            ) from error
        self._restarts += 1
        self._ended_since_start = 0
        self._pool.shutdown(cancel_futures=True)
        lost = {f: batch for f, batch in self._flying.items() if f.cancelled() or f.exception() is not None}
        self._flying = {f: batch for f, batch in self._flying.items() if f not in lost}
        self._pool = self._started()
        for batch in lost.values():
            self.submit(batch)


def _context() -> BaseContext:
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    return context


_plan: Plan | None = None
"""Of a worker process."""


def _begin(plan: Plan) -> None:
    """A worker keeps the plan, leaves SIGINT to its parent, and ends with it: else it would wait for work for ever."""
    global _plan
    _plan = plan
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    warnings.simplefilter("ignore", KeyFileWarning)  # the parent warns once
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _fly_own(batch: Batch) -> list[Flown]:
    assert _plan is not None
    return fly_batch(_plan, batch)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
