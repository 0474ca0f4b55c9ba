"""The missions of a study, flown by an executor in batches that are long enough to be worth their sending."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

from uwcoop.errors import UwcoopError
from uwcoop.experiment.executors import Executor, Here, cores, local_processes
from uwcoop.experiment.study_flights import FlownSeed, Plan, Unit, units_of
from uwcoop.navigators import Custom

if TYPE_CHECKING:
    from uwcoop.scenario.models import Scenario

__all__ = ["flights"]

_BATCH_S = 0.5
"""A batch should take at least so long: below, sending it counts."""
_QUEUED = 2
"""Batches submitted for each slot, so that none waits for the next."""


def flights(
    pending: Mapping[int, Sequence[int]],
    variants: Sequence[Scenario],
    navigators: Sequence[str | Custom],
    *,
    processes: int | None,
    scheduler: str | None = None,
    keep_errors: bool = False,
) -> Iterator[tuple[int, FlownSeed]]:
    """Every pending mission's rows with its seed, in the order in which they finish; a seed may come in parts.

    Args:
        pending: by seed, indices of the variants to fly.
        variants: the scenario of each variant.
        navigators: who flies.
        processes: at most so many at a time on this machine; None: all cores.
        scheduler: address of a Dask scheduler, whose workers fly instead.
        keep_errors: also keep the error over time of each mission.

    Raises:
        UwcoopError: what a mission raises, with its seed; workers are ended.
        StudyError: workers that died, or a scheduler that is gone.
    """
    units = deque(units_of(pending, variants))
    if not units:
        return
    flown = {k for which in pending.values() for k in which}
    plan = Plan.of(variants, navigators, keep_errors=keep_errors, flown=flown)
    with _executor(plan, len(units), processes, scheduler) as executor:
        yield from _flown(executor, units)


def _executor(
    plan: Plan, units: int, processes: int | None, scheduler: str | None
) -> AbstractContextManager[Executor]:
    if scheduler is not None:
        from uwcoop.experiment.dask_cluster import dask_cluster

        return dask_cluster(plan, scheduler)
    workers = min(processes or cores(), units)
    return nullcontext(Here(plan)) if workers <= 1 else local_processes(plan, workers)


def _flown(executor: Executor, units: deque[Unit]) -> Iterator[tuple[int, FlownSeed]]:
    flying, ended, seconds = 0, 0, 0.0
    while units or flying:
        slots = executor.slots
        while units and flying < _QUEUED * slots:
            size = _batch_size(seconds / ended if ended else math.inf, len(units), slots)
            executor.submit(tuple(units.popleft() for _ in range(size)))
            flying += 1
        batch = executor.next_flown()
        flying -= 1
        for one in batch:
            if one.error is not None:
                raise _with_seed(one.error, one.unit.seed) from one.error
            ended, seconds = ended + 1, seconds + one.seconds
            yield one.unit.seed, one.results


def _batch_size(unit_s: float, left: int, slots: int) -> int:
    """Units that take half a second together; one where they are alone or their time is not known yet. Near the end a
    batch is no more than a slot's share."""
    if slots == 1:
        return 1
    return max(1, min(math.ceil(_BATCH_S / max(unit_s, 1e-6)), left // (_QUEUED * slots)))


def _with_seed(error: UwcoopError, seed: int) -> UwcoopError:
    error.args = (f"{error} (seed {seed})",)
    return error
