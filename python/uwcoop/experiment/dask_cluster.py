"""A study's batches on the workers of a Dask cluster.

The plan, with the charts in it, is a task of its own: Dask sends it once to each worker and makes it anew where the
worker that held it is gone. A batch whose worker dies is flown again by another one, as often as the scheduler's
`distributed.scheduler.allowed-failures` says (3).
"""

from __future__ import annotations

import logging
import pickle
import queue
import re
import warnings
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any

from uwcoop.errors import MissingDependencyError, StudyError
from uwcoop.experiment.executors import Executor
from uwcoop.experiment.study_flights import Batch, Flown, Plan, fly_checked

__all__ = ["dask_cluster"]

_CONNECT_S = 10.0
"""A scheduler that has not answered after this time is not there."""
_ADDRESS = re.compile(r"([a-z]+://)?(\[[0-9a-fA-F:]+\]|[\w.-]+):\d{1,5}")
_LOOK_EVERY_S = 1.0


@contextmanager
def dask_cluster(plan: Plan, address: str) -> Iterator[Executor]:
    """The workers of the scheduler at an address (`tcp://HOST:PORT`, or a file that the scheduler wrote).

    Scheduler and workers run what they are sent: connect to those that you trust only. They are left running.

    Raises:
        MissingDependencyError: Dask's distributed is not installed.
        StudyError: no scheduler answers there.
    """
    client = _connected(address)
    try:
        yield _DaskCluster(plan, client, address)
    finally:
        # What still waits or flies is released with its client.
        client.close(timeout=5)


def _connected(address: str) -> Any:
    try:
        import distributed
    except ImportError:
        raise MissingDependencyError("distributed", "cluster") from None
    client: Any = distributed.Client
    if not address.endswith(".json") and not _ADDRESS.fullmatch(address):
        raise StudyError(f"scheduler {address!r} is neither tcp://HOST:PORT nor a scheduler's file (.json)")
    for name in ("distributed", "tornado"):  # what they would print besides, the one line of an error says
        logging.getLogger(name).setLevel(logging.CRITICAL)
    given: dict[str, Any] = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    try:
        return client(**given, timeout=_CONNECT_S, set_as_default=False, name="uwcoop-study")
    except (OSError, ValueError, TimeoutError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise StudyError(f"no Dask scheduler answers at {address}: {reason}") from error


class _DaskCluster:
    def __init__(self, plan: Plan, client: Any, address: str) -> None:
        self._client = client
        self._address = address
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._flying: set[Any] = set()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")  # a chart is large; it goes once
            self._plan = client.submit(pickle.loads, pickle.dumps(plan), pure=False)

    @property
    def slots(self) -> int:
        """See `Executor`: threads of the workers that have joined by now, at least one."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return max(1, sum(int(worker["nthreads"]) for worker in workers))

    def submit(self, batch: Batch) -> None:
        """See `Executor`."""
        future = self._client.submit(fly_checked, self._plan, batch, pure=False)
        self._flying.add(future)
        future.add_done_callback(self._done.put)

    def next_flown(self) -> list[Flown]:
        """See `Executor`."""
        from distributed.scheduler import KilledWorker

        future = self._next_done()
        self._flying.discard(future)
        try:
            return list(future.result())
        except KilledWorker as error:
            raise StudyError(
                f"workers of {self._address} died over and over while they flew the same missions: do they have enough "
                "memory? Finished missions are kept, --resume continues"
            ) from error
        except ModuleNotFoundError as error:
            raise StudyError(
                f"a worker of {self._address} has no {error.name}: install uwcoop there"
            ) from error
        except (CancelledError, OSError) as error:
            raise self._gone() from error

    def _next_done(self) -> Any:
        while True:
            try:
                return self._done.get(timeout=_LOOK_EVERY_S)
            except queue.Empty:
                if self._client.status != "running":
                    raise self._gone() from None

    def _gone(self) -> StudyError:
        return StudyError(
            f"the Dask scheduler at {self._address} is gone: finished missions are kept, --resume continues elsewhere"
        )
