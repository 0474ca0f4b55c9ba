"""The core against NumPy and numba: one process, alternated, thread CPU time, minimum of many short repeats.

    python benches/python/side_by_side.py [--quick] [--json FILE]

A step is one second of `dmpf` (Tan, Chitre & Hover 2016, Algorithm 1): time update, terrain likelihood of
14 depth differences, weights, residual resampling with roughening, mean and covariance. The rivals are the
best vectorised forms of the same step, with all lookups at once (broadcast) and one point of the segment
after the other (loop), and the same step compiled by numba. They know that the chart begins at 0, 0 with cells
of 1 m and do not check its edge. Ratios are compared with what must hold and what is aimed at; the exit code
is 1 where a must does not hold.
"""

from __future__ import annotations

import argparse
import copy
import ctypes
import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numba_rival import NumbaFilter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from uwcoop import _native
from uwcoop.navigators.options import DmpfOptions

Array = NDArray[np.float64]

SIDE = 1000
"""Nodes of 1 m on a side of the chart: 4 MB of float32."""
WINDOW = 14
"""Depth differences along the track."""
SIGMA_LIKE_M = 0.2
ROUGHENING_M2 = 2.0
SECOND_NS = 1_000_000_000
SETTLE_S = 60
"""Seconds of a mission that are not timed: the segment fills and the cloud settles."""
WARM_S = 3
"""Seconds after each return to that state that are not timed either."""


def raise_malloc_thresholds() -> bool:
    """Keeps large NumPy temporaries on the heap: page faults would be charged to NumPy otherwise."""
    m_trim_threshold, m_mmap_threshold, one_gigabyte = -1, -3, 1 << 30
    try:
        libc = ctypes.CDLL("libc.so.6")
        return bool(
            libc.mallopt(m_mmap_threshold, one_gigabyte) and libc.mallopt(m_trim_threshold, one_gigabyte)
        )
    except (OSError, AttributeError):
        return False


def best_seconds(candidates: dict[str, Callable[[], object]], budget_s: float) -> dict[str, float]:
    """Least thread CPU time of each candidate; they take turns until the budget is spent."""
    best = dict.fromkeys(candidates, math.inf)
    for work in candidates.values():
        work()
    end, rounds = time.monotonic() + budget_s, 0
    while rounds < 5 or time.monotonic() < end:
        for name, work in candidates.items():
            start = time.thread_time_ns()
            work()
            best[name] = min(best[name], (time.thread_time_ns() - start) * 1e-9)
        rounds += 1
    return best


def rich_chart() -> NDArray[np.float32]:
    """A seabed of 32 waves, 12 to 130 m long, that tells places apart everywhere."""
    north, east = np.mgrid[0:SIDE, 0:SIDE].astype(np.float64)
    depth = np.full((SIDE, SIDE), 20.0)
    for k in range(32):
        length = 12.0 * 1.08**k
        ke, kn = 2 * np.pi / length * np.cos(2.399963 * k), 2 * np.pi / length * np.sin(2.399963 * k)
        depth += 0.012 * min(length, 60.0) * np.sin(ke * east + kn * north + 1.7 * k)
    return depth.astype(np.float32)


@dataclass
class Circle:
    """A vehicle on a circle of 300 m at 1.5 m/s, and what its sensors say each second."""

    position_m: Array
    velocity_mps: Array
    water_depth_m: Array

    @classmethod
    def sail(cls, seconds: int, chart: _native.Chart) -> Circle:
        angle = 1.5 / 300.0 * np.arange(seconds + 2)
        position = SIDE / 2 + 300.0 * np.column_stack([np.cos(angle), np.sin(angle)])
        noise = np.random.default_rng(1).normal(0.0, 0.05, seconds + 1)
        return cls(position[:-1], np.diff(position, axis=0), chart.depth_at(position[:-1].copy()) + noise)

    def columns(self) -> dict[str, dict[str, NDArray[np.float64] | NDArray[np.int64]]]:
        """As tables of events: fix, motion, depth, water depth."""
        seconds = len(self.position_m)
        t_ns = np.arange(seconds, dtype=np.int64) * SECOND_NS
        vehicle = np.zeros(seconds, np.int64)
        sigma = np.full(seconds, 0.05)
        stamp = {"t_ns": t_ns, "vehicle": vehicle}
        e, n = self.velocity_mps.T
        return {
            "fix": {
                "t_ns": t_ns[:1], "vehicle": vehicle[:1],
                "e_m": self.position_m[:1, 0].copy(), "n_m": self.position_m[:1, 1].copy(),
                "cov_ee_m2": np.array([25.0]), "cov_en_m2": np.zeros(1), "cov_nn_m2": np.array([25.0]),
            },
            "motion": {**stamp, "velocity_e_mps": e.copy(), "velocity_n_mps": n.copy()},
            "depth": {**stamp, "depth_m": np.full(seconds, 2.0), "sigma_m": sigma},
            "water_depth": {**stamp, "water_depth_m": self.water_depth_m, "sigma_m": sigma},
        }  # fmt: skip


def navigator(particles: int, chart: _native.Chart) -> _native.Navigator:
    """`dmpf` of the only vehicle, as packaged."""
    stated = DmpfOptions(particles=particles, window=WINDOW).stated()
    return _native.make_navigator("dmpf", 0, 1, 1500.0, 7, [], stated, chart)


def replay(particles: int, chart: _native.Chart, circle: Circle) -> _native.Replay:
    """A mission ready to run, recorded at 1 Hz."""
    seconds = len(circle.position_m) - 1
    link = (64, 8, 0.5, 0.1, 1500.0)
    mission = _native.Mission(1, link, circle.columns(), {}, {}, {}, [], seconds * SECOND_NS)
    samples = np.arange(seconds + 1, dtype=np.int64) * SECOND_NS
    return _native.Replay(mission, [navigator(particles, chart)], samples, 0)


def events_by_second(circle: Circle) -> list[list[_native.Event]]:
    """The same events as objects, in the order of a replay."""
    out = []
    for second, (position, velocity, water_depth) in enumerate(
        zip(circle.position_m, circle.velocity_mps, circle.water_depth_m, strict=True)
    ):
        t_ns = second * SECOND_NS
        events = []
        if second == 0:
            fix = {"cov_ee_m2": 25.0, "cov_en_m2": 0.0, "cov_nn_m2": 25.0}
            events.append(_native.Event(t_ns, 0, "fix", e_m=position[0], n_m=position[1], **fix))
        events.append(_native.Event(t_ns, 0, "depth", depth_m=2.0, sigma_m=0.05))
        events.append(_native.Event(t_ns, 0, "water_depth", water_depth_m=water_depth, sigma_m=0.05))
        events.append(
            _native.Event(t_ns, 0, "motion", velocity_e_mps=velocity[0], velocity_n_mps=velocity[1])
        )
        out.append(events)
    return out


class NumpyFilter:
    """The same filter, vectorised as well as NumPy allows: columns, float32 depths, in-place arithmetic."""

    def __init__(
        self, particles: int, depth_m: NDArray[np.float32], circle: Circle, *, broadcast: bool
    ) -> None:
        self.n = particles
        self.flat, self.cols = depth_m.ravel(), depth_m.shape[1]
        self.circle = circle
        self.broadcast = broadcast
        self.rng = np.random.default_rng(3)
        radius, angle = 10.0 * np.sqrt(self.rng.random(particles)), 2 * np.pi * self.rng.random(particles)
        self.e = circle.position_m[0, 0] + radius * np.cos(angle)
        self.n_m = circle.position_m[0, 1] + radius * np.sin(angle)
        self.c = np.zeros((2, particles))
        self.p = np.eye(2) * 0.09
        self.log_w = np.full(particles, -np.log(particles))
        self.w = np.full(particles, 1.0 / particles)
        self.track: list[tuple[float, float, float]] = []
        self.moved = np.zeros(2)
        self.second = self.resampled = 0

    def copy(self) -> NumpyFilter:
        """The same state and stream, apart; chart and mission are shared."""
        twin = copy.copy(self)
        for name in ("e", "n_m", "c", "log_w", "w", "track", "rng"):
            setattr(twin, name, copy.deepcopy(getattr(self, name)))
        return twin

    def step(self) -> tuple[Array, Array]:
        """One second: propagate, weigh, resample, estimate."""
        self.second += 1
        command = self.circle.velocity_mps[self.second - 1]
        self.moved = self.moved + command + self.c @ self.w
        self.propagate(command)
        self.track.append((*self.moved, self.circle.water_depth_m[self.second]))
        if len(self.track) > WINDOW + 1:
            self.track.pop(0)
        if len(self.track) > 1:
            self.weigh()
            if 1.0 / (self.w @ self.w) <= 2.0 / 3.0 * self.n:
                self.resample()
        mean = np.array([self.w @ self.e, self.w @ self.n_m])
        de, dn = self.e - mean[0], self.n_m - mean[1]
        we, wn = self.w * de, self.w * dn
        return mean, np.array([we @ de, we @ dn, wn @ dn])

    def propagate(self, command: Array) -> None:
        """(5)-(8) for one second; S and P are multiples of the identity here, which helps NumPy."""
        s = self.p[0, 0] + 0.05**2
        gain = self.p[0, 0] / s
        zeta = self.rng.standard_normal((2, self.n))
        zeta *= math.sqrt(s)
        self.e += self.c[0]
        self.e += zeta[0]
        self.e += command[0]
        self.n_m += self.c[1]
        self.n_m += zeta[1]
        self.n_m += command[1]
        zeta *= gain
        self.c += zeta
        self.p = self.p - gain * self.p + np.eye(2) * 0.01**2

    def weigh(self) -> None:
        """(15), (9): Gaussian depth differences along the segment."""
        track = np.array(self.track)
        offsets = track[:, :2] - track[-1, :2]
        differences = np.diff(track[:, 2])
        if self.broadcast:
            depths = self.depths(self.e[None] + offsets[:, 0, None], self.n_m[None] + offsets[:, 1, None])
            residual = np.diff(depths, axis=0)
            residual -= differences[:, None].astype(np.float32)
            self.log_w += (-0.5 / SIGMA_LIKE_M**2) * np.einsum("kn,kn->n", residual, residual)
        else:
            total = np.zeros(self.n, np.float32)
            before = self.depths(self.e + offsets[0, 0], self.n_m + offsets[0, 1])
            for (oe, on), difference in zip(offsets[1:], differences.astype(np.float32), strict=True):
                depth = self.depths(self.e + oe, self.n_m + on)
                before -= depth
                before += difference
                before *= before
                total += before
                before = depth
            self.log_w += (-0.5 / SIGMA_LIKE_M**2) * total
        self.log_w -= self.log_w.max()
        np.exp(self.log_w, out=self.w)
        total_w = self.w.sum()
        self.w /= total_w
        self.log_w -= math.log(total_w)

    def depths(self, e: Array, n: Array) -> NDArray[np.float32]:
        """Bilinear lookups; the cloud is well inside the chart, so nothing is checked."""
        column, row = e.astype(np.int32), n.astype(np.int32)
        fe, fn = (e - column).astype(np.float32), (n - row).astype(np.float32)
        row *= self.cols
        row += column
        sw = self.flat.take(row)
        south = self.flat[1:].take(row)
        south -= sw
        south *= fe
        south += sw
        nw = self.flat[self.cols :].take(row)
        north = self.flat[self.cols + 1 :].take(row)
        north -= nw
        north *= fe
        north += nw
        north -= south
        north *= fn
        north += south
        return north

    def resample(self) -> None:
        """(14): residual, with roughening of duplicates."""
        self.resampled += 1
        expected = self.w * self.n
        copies = expected.astype(np.int64)
        left = self.n - int(copies.sum())
        cdf = np.cumsum(expected - copies)
        drawn = np.searchsorted(cdf, self.rng.random(left) * cdf[-1], side="right")
        copies += np.bincount(np.minimum(drawn, self.n - 1), minlength=self.n)
        ancestors = np.repeat(np.arange(self.n), copies)
        self.e, self.n_m, self.c = self.e[ancestors], self.n_m[ancestors], self.c[:, ancestors]
        duplicate = np.flatnonzero(copies[ancestors] > 1)
        jitter = self.rng.standard_normal((2, duplicate.size))
        jitter *= math.sqrt(ROUGHENING_M2)
        self.e[duplicate] += jitter[0]
        self.n_m[duplicate] += jitter[1]
        self.w.fill(1.0 / self.n)
        self.log_w.fill(-math.log(self.n))


def numba_filter(particles: int, depth_m: NDArray[np.float32], circle: Circle) -> NumbaFilter:
    """numba's rival from the same start as NumPy's."""
    start = NumpyFilter(particles, depth_m, circle, broadcast=True)
    return NumbaFilter(
        np.column_stack([start.e, start.n_m]), depth_m, circle.velocity_mps, circle.water_depth_m,
        window=WINDOW, sigma_like_m=SIGMA_LIKE_M, roughening_m2=ROUGHENING_M2,
    )  # fmt: skip


class NativeMission:
    """Times the core over the same seconds again and again, so that it resamples as often each time."""

    def __init__(self, particles: int, chart: _native.Chart, circle: Circle, piece_s: int) -> None:
        self.replay, self.piece_s = replay(particles, chart, circle), piece_s
        self.replay.run(SETTLE_S * SECOND_NS + 1)
        self.start = self.replay.snapshot()

    def ready(self) -> None:
        """Outside the timed part; a restored navigator needs a few steps to find its memory."""
        self.replay.restore(self.start)
        self.replay.run((SETTLE_S + WARM_S) * SECOND_NS + 1)

    def run(self) -> None:
        self.replay.run((SETTLE_S + WARM_S + self.piece_s) * SECOND_NS + 1)


class NativeCalls:
    """The same, one Python call for each event and each estimate."""

    def __init__(self, particles: int, chart: _native.Chart, circle: Circle, piece_s: int) -> None:
        self.navigator = navigator(particles, chart)
        self.events, self.piece_s = events_by_second(circle), piece_s
        self.advance(0, SETTLE_S + 1)
        self.start = self.navigator.snapshot()

    def ready(self) -> None:
        """Outside the timed part."""
        self.navigator.restore(self.start)
        self.advance(SETTLE_S + 1, WARM_S)

    def advance(self, first: int, seconds: int) -> None:
        handle, estimate = self.navigator.handle, self.navigator.estimate
        for second in range(first, first + seconds):
            for event in self.events[second]:
                handle(event)
            estimate(second * SECOND_NS)

    def run(self) -> None:
        self.advance(SETTLE_S + 1 + WARM_S, self.piece_s)


class FilterMission:
    """NumPy's or numba's filter over the same seconds."""

    def __init__(self, start: NumpyFilter | NumbaFilter, piece_s: int) -> None:
        self.start, self.piece_s = start, piece_s
        for _ in range(SETTLE_S):
            start.step()
        self.resampled_share = math.nan

    def ready(self) -> None:
        """Outside the timed part."""
        self.filter = self.start.copy()
        for _ in range(WARM_S):
            self.filter.step()
        self.filter.resampled = 0

    def run(self) -> None:
        for _ in range(self.piece_s):
            self.filter.step()
        self.resampled_share = self.filter.resampled / self.piece_s


def alternate(
    rivals: dict[str, NativeMission | NativeCalls | FilterMission], budget_s: float
) -> dict[str, float]:
    """Least thread CPU time of a second of a mission, by rival, in seconds."""
    best = dict.fromkeys(rivals, math.inf)
    end, rounds = time.monotonic() + budget_s, 0
    while rounds < 5 or time.monotonic() < end:
        for name, rival in rivals.items():
            rival.ready()
            start = time.thread_time_ns()
            rival.run()
            best[name] = min(best[name], (time.thread_time_ns() - start) * 1e-9 / rival.piece_s)
        rounds += 1
    return best


@dataclass
class Row:
    """One line of the table."""

    what: str
    core_ns: float
    rival_ns: float
    rival: str
    ratio: float
    must: str
    aim: str
    passed: bool | None


def at_least(what: str, core_ns: float, rival: str, rival_ns: float, must: float, aim: float) -> Row:
    """A bar that the ratio must reach; NaN for a comparison without one."""
    ratio = rival_ns / core_ns
    if math.isnan(must):
        return Row(what, core_ns, rival_ns, rival, ratio, "", "", None)
    return Row(what, core_ns, rival_ns, rival, ratio, f"≥ {must:g}", f"≥ {aim:g}", ratio >= must)


def at_most(what: str, core_ns: float, rival: str, rival_ns: float, must: float, aim: float) -> Row:
    """A bar that the ratio must stay below."""
    ratio = core_ns / rival_ns
    return Row(what, core_ns, rival_ns, rival, ratio, f"≤ {must:g}", f"≤ {aim:g}", ratio <= must)


def compare_steps(depth: NDArray[np.float32], chart: _native.Chart, budget_s: float) -> list[Row]:
    """Whole steps at three sizes, and one Python call per event against a whole mission."""
    rows: list[Row] = []
    circle = Circle.sail(SETTLE_S + 100, chart)
    none = (math.nan, math.nan)
    # Must and aim against NumPy, and against numba.
    bars = {
        600: ((10.0, 15.0), (2.5, 3.0)),
        10_000: (none, none),
        100_000: ((6.0, 8.0), (1.7, 2.2)),
    }
    for n, (numpy_bars, numba_bars) in bars.items():
        piece_s = {600: 60, 10_000: 20, 100_000: 10}[n]

        def rival(broadcast: bool, n: int = n, piece_s: int = piece_s) -> FilterMission:
            return FilterMission(NumpyFilter(n, depth, circle, broadcast=broadcast), piece_s)

        rivals: dict[str, NativeMission | NativeCalls | FilterMission] = {
            "core": NativeMission(n, chart, circle, piece_s),
            "NumPy broadcast": rival(True),
            "NumPy loop": rival(False),
            "numba": FilterMission(numba_filter(n, depth, circle), piece_s),
        }
        if n == 600:
            rivals["core, call by call"] = NativeCalls(n, chart, circle, piece_s)
        best = {name: 1e9 * s / n for name, s in alternate(rivals, budget_s).items()}
        name = min(("NumPy broadcast", "NumPy loop"), key=best.__getitem__)
        what = f"dmpf step, N = {n}"
        rows.append(at_least(what, best["core"], name, best[name], *numpy_bars))
        rows.append(at_least(what, best["core"], "numba", best["numba"], *numba_bars))
        if n == 600:
            calls = best["core, call by call"]
            rows.append(
                at_most("one call per event, N = 600", calls, "whole mission", best["core"], 1.10, 1.05)
            )
    return rows


def compare_sizes(chart: _native.Chart, budget_s: float) -> Row:
    """Nanoseconds per particle at a million against ten thousand."""
    circle = Circle.sail(SETTLE_S + 40, chart)
    rivals: dict[str, NativeMission | NativeCalls | FilterMission] = {
        "10k": NativeMission(10_000, chart, circle, 20),
        "1M": NativeMission(1_000_000, chart, circle, 10),
    }
    best = alternate(rivals, budget_s)
    ten, million = best["10k"] * 1e9 / 1e4, best["1M"] * 1e9 / 1e6
    return at_most("1M particles against 10k", million, "10k", ten, 1.3, 1.15)


def compare_lookups(depth: NDArray[np.float32], chart: _native.Chart, budget_s: float) -> list[Row]:
    """15 lookups for each of 100k and of 600 particles, per particle; everybody gives a (15, N) array."""
    circle = Circle.sail(1, chart)
    rows = []
    offsets = np.column_stack([-1.3 * np.arange(WINDOW + 1), -0.7 * np.arange(WINDOW + 1)])
    for n, bars in {100_000: (10.0, 12.0), 600: (math.nan, math.nan)}.items():
        position = SIDE / 2 + 5.0 * np.random.default_rng(2).standard_normal((n, 2))
        rival = NumpyFilter(n, depth, circle, broadcast=True)
        east, north = position.T.copy()
        repeats = max(1, 6000 // n)
        out = np.empty((WINDOW + 1, n), np.float32)

        def core(position: Array = position, out: NDArray[np.float32] = out, repeats: int = repeats) -> None:
            for _ in range(repeats):
                _native.pattern_depths(chart, position, offsets, out)

        def broadcast(
            e: Array = east, n_m: Array = north, f: NumpyFilter = rival, repeats: int = repeats
        ) -> None:
            for _ in range(repeats):
                f.depths(e + offsets[:, :1], n_m + offsets[:, 1:])

        def loop(
            e: Array = east,
            n_m: Array = north,
            f: NumpyFilter = rival,
            out: NDArray[np.float32] = out,
            repeats: int = repeats,
        ) -> None:
            for _ in range(repeats):
                for row, (oe, on) in zip(out, offsets, strict=True):
                    row[:] = f.depths(e + oe, n_m + on)

        best = best_seconds({"core": core, "NumPy broadcast": broadcast, "NumPy loop": loop}, budget_s)
        best = {name: 1e9 * s / n / repeats for name, s in best.items()}
        name = min(("NumPy broadcast", "NumPy loop"), key=best.__getitem__)
        what = f"15 lookups, N = {n}"
        rows.append(at_least(what, best["core"], name, best[name], *bars))
    return rows


def compare_ranges(budget_s: float) -> Row:
    """Second-order Gaussian range likelihood against eq 17's 600 × 600 distances."""
    rng = np.random.default_rng(5)
    position, samples = rng.normal(0, 5, (600, 2)), rng.normal(200, 5, (600, 2))
    covariance = np.array([[25.0, 2.0], [2.0, 25.0]])
    mean = [200.0, 200.0]

    def repeat(method: str, times: int) -> Callable[[], None]:
        drawn = samples if method == "eq17" else None

        def work() -> None:
            for _ in range(times):
                _native.range_log_likelihood(position, mean, covariance, 283.0, 1.0, method, drawn)

        return work

    times = {"eq17": 5, "gaussian": 100}
    best = best_seconds({m: repeat(m, k) for m, k in times.items()}, budget_s)
    eq17, gaussian = (1e9 * best[m] / times[m] / 600 for m in ("eq17", "gaussian"))
    return at_least("Gaussian range, 600 (with the call)", gaussian, "eq 17, 600 × 600", eq17, 50.0, 100.0)


def print_table(rows: list[Row], notes: list[str]) -> None:
    table = Table(title="uwcoop core, thread CPU time, minimum of many repeats, alternated in one process")
    for name in ("what", "core, ns/particle", "rival", "rival, ns/particle", "ratio", "must", "aim", ""):
        table.add_column(name, justify="left" if name in ("what", "rival") else "right")
    for row in rows:
        verdict = {True: "[green]pass[/]", False: "[red]FAIL[/]", None: ""}[row.passed]
        table.add_row(
            row.what, f"{row.core_ns:.1f}", row.rival, f"{row.rival_ns:.1f}", f"{row.ratio:.2f}",
            row.must, row.aim, verdict,
        )  # fmt: skip
    console = Console(width=130)
    console.print(table)
    for note in notes:
        console.print(note)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the time")
    parser.add_argument("--json", type=Path, help="write the rows to a file as well")
    arguments = parser.parse_args()
    budget_s = 1.0 if arguments.quick else 8.0
    notes = []
    if not raise_malloc_thresholds():
        notes.append("glibc's malloc thresholds could not be raised: NumPy pays for page faults here")
    depth = rich_chart()
    chart = _native.Chart(depth, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    rows = compare_steps(depth, chart, budget_s)
    lookups = compare_lookups(depth, chart, budget_s)
    rows += lookups
    rows.append(
        at_most(
            "step against lookups, N = 600", rows[0].core_ns, "core's lookups", lookups[-1].core_ns, 2.2, 1.9
        )
    )
    rows.append(compare_ranges(budget_s))
    rows.append(compare_sizes(chart, budget_s))
    print_table(rows, notes)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1), encoding="utf-8")
    return int(any(row.passed is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
