"""One mission through one or more navigators: events in, tracks and figures of merit out."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop import _native
from uwcoop.acoustics.authentication import authenticator_of
from uwcoop.charts.native import native_chart
from uwcoop.errors import LogError
from uwcoop.evaluation import metrics
from uwcoop.evaluation.consistency_without_truth import consistency, disagreement, innovations_of
from uwcoop.experiment.counterfactual import without_vehicles
from uwcoop.experiment.held_out import held_out_scores, parse_request, withhold
from uwcoop.experiment.mission import LOG_SUFFIX, has_happened, open_mission
from uwcoop.experiment.navigator_choice import check_packets_fit, check_plan_fits, default_navigators
from uwcoop.experiment.tracks import clouds_of, packets_of, sent_by, tracks_of
from uwcoop.missionlog import Columns, MissionLog
from uwcoop.missionlog.labelled import Labelled
from uwcoop.navigators import Context, Custom, PythonNavigator, build, build_central, options_of, spec_of

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.scenario.models import Scenario

__all__ = ["RunResult", "native_mission", "replay_for", "run", "sample_times_ns"]

_RECORD_BYTES = 150
"""Of one navigator's record, at each instant of a vehicle: mean, covariance, pose, diagnostics."""
_STEPS = 500
"""A replay is interrupted after so small a part of the mission at the latest."""
CLOUD_EVERY = 10
"""Particles are kept at every so many instants of the record (10 keeps a mission's replay near 4 MB)."""


@dataclass(frozen=True)
class RunResult:
    """What a run gives: the mission, its tracks, packets, particle clouds and the summary."""

    log: MissionLog
    recorded: Labelled
    """What `tracks` is made of."""
    packets: dict[str, NDArray[Any]]
    """One row for each packet at each receiver and navigator."""
    clouds: xr.Dataset | None
    """Particles at every 10th instant, float32."""
    seconds: dict[str, float]
    """Run time by navigator, s."""
    sent: dict[str, dict[str, float]]
    """By navigator, what the whole team put on the air: `bytes` and `air_time_s` in all, and how many `polls` of two-way
    ranging are in them."""
    unused: dict[str, dict[str, int]]
    """By navigator, how many events of each kind the team was handed that the navigator has no use for."""
    innovations: dict[str, NDArray[Any]]
    """What navigators expected of soundings, ranges and fixes before they used them, a row each
    (`evaluation.consistency_without_truth.innovations_of`)."""
    outcomes: dict[str, dict[str, NDArray[np.int64]]]
    """By navigator and kind of event, (vehicle, 4): how many were fused, noted, gated, rejected."""
    held_out: Columns = field(default_factory=dict)
    """Fixes that the navigators were not given, as the log has them."""

    @cached_property
    def tracks(self) -> xr.Dataset:
        """Estimates and truth; see the reference for dimensions and units."""
        return self.recorded.to_xarray()

    @property
    def summary(self) -> dict[str, Any]:
        """What `summary.json` holds."""
        summary = metrics.summarise(self.recorded, seconds=self.seconds, packets=self.packets)
        for name, sent in self.sent.items():
            summary["navigators"][name]["sent"] = sent
            if self.unused[name]:
                summary["navigators"][name]["unused"] = self.unused[name]
        parts = {
            "consistency": consistency(self.recorded, self.innovations, self.outcomes),
            "disagreement": disagreement(self.recorded) if len(self.sent) > 1 else {},
            "held_out": held_out_scores(self.recorded, self.held_out) if self.held_out else {},
        }
        for part, by_navigator in parts.items():
            for name, entry in by_navigator.items():
                summary["navigators"][name][part] = entry
        if self.log.counterfactual:
            summary["counterfactual"] = list(self.log.counterfactual)
        return summary


def run(
    mission: MissionLog | Scenario | str | Path,
    navigators: Iterable[str | Custom] | None = None,
    *,
    seed: int | None = None,
    chart: Chart | str | Path | None = None,
    overrides: Sequence[str] = (),
    without: Sequence[str] = (),
    hold_out: str | None = None,
    truth: Sequence[str] = (),
    clouds: bool = True,
    threads: int = 1,
    progress: Callable[[str], None] | None = None,
) -> RunResult:
    """Replays a mission through navigators.

    Args:
        mission: a log, a log's path, a scenario, or the name or path of a scenario (then it is simulated first).
        navigators: names of `uwcoop.navigators.NAVIGATORS` or `Custom` ones; None: those that the scenario lists, or
            all for terrain that fit the modem.
        seed: of the simulation and of the navigators; None takes the mission's own.
        chart: the navigators' chart; None takes the mission's. For a log with another chart it is refused.
        overrides: "dotted.key=value" each: any key of a scenario; of a log what `open_mission` says.
        without: vehicles that are left out, as if they had not been there.
        hold_out: `fix`, `fix:SHARE` or `fix:SHARE@VEHICLE,…`: fixes that navigators are not given and are scored by.
        truth: sources of a truth in place of the log's own (`experiment.given_truth`).
        clouds: whether to keep particles for pictures.
        threads: navigators that run side by side (0: all cores). The results are the same bits for any number.
        progress: called with a navigator's name when it is done.

    Raises:
        ScenarioError, LogError, ChartError, NavigatorError: one line that says what is wrong.
    """
    log = without_vehicles(open_mission(mission, seed, chart, overrides), without)
    if truth:
        from uwcoop.experiment.given_truth import with_truth

        place = Path(mission) if isinstance(mission, str | Path) else None
        log = with_truth(log, truth, place if place is not None and place.suffix == LOG_SUFFIX else None)
    held: Columns = {}
    if hold_out is not None:
        log, held = withhold(log, parse_request(hold_out))
    chosen = default_navigators(log.setup, len(log.vehicles)) if navigators is None else list(navigators)
    names = [n if isinstance(n, str) else n.name for n in chosen]
    repeated = {n for n in names if names.count(n) > 1}
    if repeated:
        raise LogError(f"navigator {sorted(repeated)[0]!r} is asked for more than once")
    packaged = [n for n in chosen if isinstance(n, str)]
    check_packets_fit(packaged, log.setup, len(log.vehicles))
    if not has_happened(mission):
        check_plan_fits(packaged, log)
    filter_seed = log.seed if seed is None else seed
    native = native_mission(log)
    sample_ns = sample_times_ns(log, held.get("t_ns"))
    shared = None if log.chart is None else native_chart(log.chart)
    replays = [
        replay_for(log, native, navigator, shared, filter_seed, sample_ns, CLOUD_EVERY if clouds else 0)
        for navigator in chosen
    ]
    for k in _replayed(replays, log.duration_ns, threads):
        if progress:
            progress(names[k])
    seconds = {name: replay.seconds for name, replay in zip(names, replays, strict=True)}
    records = [replay.tracks() for replay in replays]
    return RunResult(
        log=log,
        recorded=tracks_of(log, names, records),
        packets=packets_of(records),
        clouds=clouds_of(log, names, records) if clouds else None,
        seconds=seconds,
        sent={name: sent_by(native, record) for name, record in zip(names, records, strict=True)},
        unused={name: record["unused"] for name, record in zip(names, records, strict=True)},
        innovations=innovations_of(records),
        outcomes={
            name: {kind: counts.astype(np.int64) for kind, counts in record["outcomes"].items()}
            for name, record in zip(names, records, strict=True)
        },
        held_out=held,
    )


def _replayed(replays: Sequence[_native.Replay], duration_ns: int, threads: int) -> Iterator[int]:
    """Replay all and give the index of each when it is done.

    Each goes step by step: native code does not hear signals, the interpreter between two steps does.
    """
    steps_ns = [duration_ns * k // _STEPS for k in range(1, _STEPS)]
    stopped = threading.Event()

    def whole(replay: _native.Replay) -> None:
        for until_ns in steps_ns:
            if stopped.is_set():
                return
            replay.run(until_ns)
        replay.run()

    if threads == 1 or len(replays) == 1:
        for k, replay in enumerate(replays):
            whole(replay)
            yield k
        return
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        futures = {pool.submit(whole, replay): k for k, replay in enumerate(replays)}
        try:
            for future in as_completed(futures):
                future.result()
                yield futures[future]
        finally:
            stopped.set()
            pool.shutdown(cancel_futures=True)


def native_mission(log: MissionLog) -> _native.Mission:
    """The navigators' half of a log: events, slots and opportunities; the truth stays behind."""
    link = log.link
    return _native.Mission(
        len(log.vehicles),
        (link.frame_bytes, link.max_frames, link.frame_s, link.preamble_s, link.sound_speed_mps),
        log.events,
        log.slots,
        log.opportunities,
        log.receptions,
        log.payloads,
        log.duration_ns,
        log.polls or None,
    )


def sample_times_ns(log: MissionLog, more_ns: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
    """Instants of the record: 1 Hz from 0 to the end, every time of arrival, and `more_ns`.

    Raises:
        LogError: a duration whose record does not fit into this machine's memory.
    """
    least_bytes = log.duration_ns // 1_000_000_000 * len(log.vehicles) * _RECORD_BYTES
    if least_bytes > (memory_bytes := os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")):
        raise LogError(
            f"mission {log.name!r} lasts {log.duration_ns / 1e9:g} s: its record at 1 Hz takes at least "
            f"{least_bytes / 1e9:.0f} GB, this machine has {memory_bytes / 1e9:.0f} GB"
        )
    grid = np.arange(0, log.duration_ns + 1, 1_000_000_000, dtype=np.int64)
    arrivals = [table["toa_ns"] for table in (log.opportunities, log.receptions) if table]
    further = [] if more_ns is None else [more_ns]
    times = np.unique(np.concatenate([grid, *arrivals, *further]).astype(np.int64))
    return times[times <= log.duration_ns]


def replay_for(
    log: MissionLog,
    mission: _native.Mission,
    navigator: str | Custom,
    chart: _native.Chart | None,
    seed: int,
    sample_ns: NDArray[np.int64],
    cloud_every: int = 0,
) -> _native.Replay:
    """A team of one kind of navigator, ready to replay the mission step by step or whole."""
    contexts = [
        Context(k, len(log.vehicles), log.link.sound_speed_mps, seed, log.chart, log.setup.fuses_ranges)
        for k in range(len(log.vehicles))
    ]
    replay = _native.Replay(mission, _estimators(navigator, log, contexts, chart), sample_ns, cloud_every)
    authenticator = authenticator_of(log)
    if authenticator is not None:
        replay.authenticate(authenticator)
    return replay


def _estimators(
    navigator: str | Custom, log: MissionLog, contexts: Sequence[Context], chart: _native.Chart | None
) -> Sequence[_native.Navigator | PythonNavigator] | _native.CentralEstimator:
    """One navigator for each vehicle, or the centralised estimator of all."""
    if isinstance(navigator, Custom):
        return [navigator.make(context) for context in contexts]
    options = options_of(navigator, log.setup)
    if spec_of(navigator).central:
        return build_central(navigator, contexts[0], options)
    return [build(navigator, context, options, chart) for context in contexts]
