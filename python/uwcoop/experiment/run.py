"""One mission through one or more navigators: events in, tracks and figures of merit out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from uwcoop import _native
from uwcoop.acoustics.authentication import authenticator_of
from uwcoop.charts.native import native_chart
from uwcoop.errors import LogError
from uwcoop.evaluation import metrics
from uwcoop.evaluation.cramer_rao import BOUNDS, bounds_of
from uwcoop.evaluation.pose_tracks import pose_variables
from uwcoop.experiment.mission import open_mission
from uwcoop.experiment.navigator_choice import check_packets_fit, default_navigators
from uwcoop.missionlog import MissionLog
from uwcoop.navigators import NAVIGATORS, Context, Custom, PythonNavigator, build, build_central, options_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.scenario.models import Scenario

__all__ = ["RunResult", "native_mission", "replay_for", "run", "sample_times_ns"]

CLOUD_EVERY = 10
"""Particles are kept at every so many instants of the record (10 keeps a mission's replay near 4 MB)."""


@dataclass(frozen=True)
class RunResult:
    """What a run gives: the mission, its tracks, packets, particle clouds and the summary."""

    log: MissionLog
    tracks: xr.Dataset
    """Estimates and truth; see the reference for dimensions and units."""
    packets: dict[str, NDArray[Any]]
    """One row for each packet at each receiver and navigator."""
    clouds: xr.Dataset | None
    """Particles at every 10th instant, float32."""
    seconds: dict[str, float]
    """Run time by navigator, s."""
    sent: dict[str, dict[str, float]]
    """By navigator, what the whole team put on the air: `bytes` and `air_time_s` in all, and how many `polls` of two-way
    ranging are in them."""

    @property
    def summary(self) -> dict[str, Any]:
        """What `summary.json` holds."""
        summary = metrics.summarise(self.tracks, seconds=self.seconds, packets=self.packets)
        for name, sent in self.sent.items():
            summary["navigators"][name]["sent"] = sent
        return summary


def run(
    mission: MissionLog | Scenario | str | Path,
    navigators: Iterable[str | Custom] | None = None,
    *,
    seed: int | None = None,
    chart: Chart | str | Path | None = None,
    overrides: Sequence[str] = (),
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
        overrides: "dotted.key=value" each: any key of a scenario, `navigator.*` of a log.
        clouds: whether to keep particles for pictures.
        threads: navigators that run side by side (0: all cores). The results are the same bits for any number.
        progress: called with a navigator's name when it is done.

    Raises:
        ScenarioError, LogError, ChartError, NavigatorError: one line that says what is wrong.
    """
    log = open_mission(mission, seed, chart, overrides)
    chosen = default_navigators(log.setup, len(log.vehicles)) if navigators is None else list(navigators)
    names = [n if isinstance(n, str) else n.name for n in chosen]
    repeated = {n for n in names if names.count(n) > 1}
    if repeated:
        raise LogError(f"navigator {sorted(repeated)[0]!r} is asked for more than once")
    check_packets_fit((n for n in chosen if isinstance(n, str)), log.setup, len(log.vehicles))
    filter_seed = log.seed if seed is None else seed
    native = native_mission(log)
    sample_ns = sample_times_ns(log)
    shared = None if log.chart is None else native_chart(log.chart)
    replays = [
        replay_for(log, native, navigator, shared, filter_seed, sample_ns, CLOUD_EVERY if clouds else 0)
        for navigator in chosen
    ]
    if threads == 1:
        for name, replay in zip(names, replays, strict=True):
            replay.run()
            if progress:
                progress(name)
    else:
        _native.run_all(replays, threads)
        for name in names if progress else ():
            progress(name)  # type: ignore[misc]
    seconds = {name: replay.seconds for name, replay in zip(names, replays, strict=True)}
    records = [replay.tracks() for replay in replays]
    return RunResult(
        log=log,
        tracks=_tracks(log, names, records),
        packets=_packets(records),
        clouds=_clouds(log, names, records) if clouds else None,
        seconds=seconds,
        sent={name: _sent(native, record) for name, record in zip(names, records, strict=True)},
    )


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


def sample_times_ns(log: MissionLog) -> NDArray[np.int64]:
    """Instants of the record: 1 Hz from 0 to the end, and every time of arrival."""
    grid = np.arange(0, log.duration_ns + 1, 1_000_000_000, dtype=np.int64)
    arrivals = [table["toa_ns"] for table in (log.opportunities, log.receptions) if table]
    times = np.unique(np.concatenate([grid, *arrivals]).astype(np.int64))
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
    if NAVIGATORS[navigator].central:
        return build_central(navigator, contexts[0], options, chart)
    return [build(navigator, context, options, chart) for context in contexts]


def _tracks(log: MissionLog, names: Sequence[str], records: Sequence[dict[str, Any]]) -> xr.Dataset:
    t_ns = records[0]["t_ns"]
    each = ("navigator", "vehicle", "time")
    covariance = np.stack([r["covariance_m2"] for r in records])
    sent, heard = np.zeros(covariance.shape[:3], np.int64), np.zeros(covariance.shape[:3], bool)
    gained = np.full(covariance.shape[:3], np.nan)
    for k, record in enumerate(records):
        at = np.minimum(np.searchsorted(t_ns, record["sent"]["tol_ns"]), len(t_ns) - 1)
        np.add.at(sent[k], (record["sent"]["sender"], at), record["sent"]["bytes"])
        at = np.minimum(np.searchsorted(t_ns, record["polls"]["t_ns"]), len(t_ns) - 1)
        np.add.at(sent[k], (record["polls"]["sender"], at), record["polls"]["bytes"])
        packets = record["packets"]
        used = packets["accepted"] & (packets["toa_ns"] <= t_ns[-1])
        at_arrival = (k, packets["receiver"][used], np.searchsorted(t_ns, packets["toa_ns"][used]))
        heard[at_arrival] = True
        gained[at_arrival] = packets["information_nat"][used]
    optional: dict[str, Any] = {}
    if np.isfinite(gained).any():
        nat = {
            "units": "nat",
            "long_name": "mutual information of the position and the range that arrived now",
        }
        optional["mutual_information"] = (each, gained, nat)
    for bound, values in bounds_of(log, t_ns).items():
        optional[bound] = (("vehicle", "time"), values, {"units": "m", "long_name": BOUNDS[bound]})
    received = np.zeros(covariance.shape[1:3], bool)
    for table in (log.opportunities, log.receptions):
        if table:
            inside = table["toa_ns"] <= t_ns[-1]
            received[table["receiver"][inside], np.searchsorted(t_ns, table["toa_ns"][inside])] = True

    def stack(key: str) -> NDArray[Any]:
        return np.stack([r[key] for r in records])

    metres = {"units": "m"}
    return xr.Dataset(
        {
            "position_m": ((*each, "axis"), stack("mean_m"), metres),
            "covariance_m2": ((*each, "axis", "axis_b"), _square(covariance), {"units": "m2"}),
            "truth_position_m": (("vehicle", "time", "axis"), _truth(log, t_ns), metres),
            "yaw_rad": (each, stack("yaw_rad"), {"units": "rad"}),
            "ess": (each, stack("ess"), {"units": "1", "long_name": "effective sample size"}),
            "packet_bytes": (each, sent, {"units": "byte", "long_name": "bytes sent, polls included"}),
            "rejected": (each, stack("rejected").astype(np.int64), {"long_name": "gated or rejected so far"}),
            "off_chart": (each, stack("off_chart"), {"long_name": "no chart to go by: dead reckoning"}),
            "acquiring": (each, stack("acquiring"), {"long_name": "searching for its position"}),
            "heard": (each, heard, {"long_name": "a packet that arrived now was used"}),
            "received": (("vehicle", "time"), received, {"long_name": "a signal could be heard now"}),
            **optional,
            **pose_variables(log, records, t_ns),
            **_diagnostics(records),
        },
        coords={
            "navigator": list(names),
            "vehicle": list(log.vehicles),
            "time": ("time", t_ns / 1e9, {"units": "s"}),
            "axis": ["east", "north"],
            "axis_b": ["east", "north"],
        },
        attrs={"mission": log.name, "seed": log.seed, "settle_s": log.setup.metrics.settle_s},
    )


def _diagnostics(records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The navigators' diagnostics, a variable each; NaN for a navigator without it."""
    shape = records[0]["ess"].shape
    stated = {
        name: np.stack([r["diagnostics"].get(name, np.full(shape, np.nan)) for r in records])
        for name in sorted({name for r in records for name in r["diagnostics"]})
    }
    by = {"role": "diagnostic", "long_name": "as the navigator states it"}
    return {name: (("navigator", "vehicle", "time"), values, by) for name, values in stated.items()}


def _sent(mission: _native.Mission, record: dict[str, Any]) -> dict[str, float]:
    """Bytes and air time of everything that a team launched, polls included."""
    sizes, counts = np.unique(record["sent"]["bytes"], return_counts=True)
    answers_s = sum(n * mission.air_time_s(int(size)) for size, n in zip(sizes, counts.tolist(), strict=True))
    polls = record["polls"]
    return {
        "bytes": int(record["sent"]["bytes"].sum() + polls["bytes"].sum()),
        "air_time_s": float(answers_s + polls["air_time_ns"].sum() / 1e9),
        "polls": len(polls["bytes"]),
    }


def _square(upper: NDArray[np.float64]) -> NDArray[np.float64]:
    """[ee, en, nn] → 2 × 2."""
    return upper[..., [0, 1, 1, 2]].reshape(*upper.shape[:-1], 2, 2)


def _truth(log: MissionLog, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """True positions at the record's instants, piecewise linear as vehicles move; NaN where unknown."""
    out = np.full((len(log.vehicles), len(t_ns), 2), np.nan)
    if log.truth is None:
        return out
    known_s = log.truth["time"].to_numpy()
    position = log.truth["position_m"].to_numpy()
    for v in range(len(log.vehicles)):
        for axis in range(2):
            out[v, :, axis] = np.interp(t_ns / 1e9, known_s, position[v, :, axis], left=np.nan, right=np.nan)
    return out


def _packets(records: Sequence[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    columns = {key: np.concatenate([r["packets"][key] for r in records]) for key in records[0]["packets"]}
    counts = [len(r["packets"]["sender"]) for r in records]
    return {"navigator": np.repeat(np.arange(len(records)), counts), **columns}


def _clouds(log: MissionLog, names: Sequence[str], records: Sequence[dict[str, Any]]) -> xr.Dataset | None:
    times = np.unique([t_ns for r in records for t_ns, *_ in r["clouds"]]).astype(np.int64)
    most = max((len(w) for r in records for *_, w in r["clouds"]), default=0)
    if not len(times):
        return None
    shape = (len(names), len(log.vehicles), len(times), most)
    particles = np.full((*shape, 2), np.nan, np.float32)
    weight = np.full(shape, np.nan, np.float32)
    for k, record in enumerate(records):
        for t_ns, vehicle, positions, weights in record["clouds"]:
            at = np.searchsorted(times, t_ns)
            particles[k, vehicle, at, : len(weights)] = positions
            weight[k, vehicle, at, : len(weights)] = weights
    dims = ("navigator", "vehicle", "cloud_time", "particle")
    return xr.Dataset(
        {"particles_m": ((*dims, "axis"), particles, {"units": "m"}), "weight": (dims, weight)},
        coords={
            "navigator": list(names),
            "vehicle": list(log.vehicles),
            "cloud_time": ("cloud_time", times / 1e9, {"units": "s"}),
            "axis": ["east", "north"],
        },
    )
