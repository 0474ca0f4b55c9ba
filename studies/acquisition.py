"""Starts that are hardly known, and returns after a transit without a chart: how soon each is found, how honestly.

    python studies/acquisition.py [--runs N] [--processes N] [--worlds NAME,…] [--radii M,…] [--navigators NAME,…]

A vehicle is *found* at the first instant from which on its error stays below 15 m (40 m on a surveyed chart) for a
minute. Beside each wide start stands the same mission with a start known to 10 m.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

import uwcoop
from uwcoop import scenario
from uwcoop.charts import Chart
from uwcoop.evaluation import per_instant
from uwcoop.missionlog import MissionLog
from uwcoop.scenario.vehicle import Vehicle, Waypoints

WORLDS = ("st-john-drift", "flat-bay", "surveyed-bay")
HOLE = "hole"
"""`st-john-drift` or `flat-bay` by waypoints over a hole of 500 m, 730 s of them without a chart."""
LIMIT_M = {"surveyed-bay": 40.0}
DWELL_S = 60.0
HOLE_M = (150.0, 650.0)
WAYPOINTS_M = (
    (60.0, 100.0), (60.0, 900.0), (400.0, 900.0), (400.0, 300.0), (900.0, 300.0), (900.0, 900.0), (700.0, 900.0),
    (700.0, 300.0), (850.0, 300.0), (850.0, 800.0),
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One vehicle of one mission."""

    found_s: float
    """Infinite: never."""
    anees: float
    final_m: float
    final_sigma_m: float
    rmse_m: float
    acquiring_s: float


def wide_start(world: str, radius_m: float, seed: int) -> MissionLog:
    """A packaged mission whose start is known to `radius_m`."""
    return uwcoop.simulate(scenario.load(world, [f"sensors.fix.radius_m={radius_m}"]), seed=seed)


def over_a_hole(world: str, seed: int) -> MissionLog:
    """One vehicle that leaves its chart for 730 s; the seabed under it is as before."""
    spec = scenario.load(world, ["duration_s=2100"])
    path = Waypoints(kind="waypoints", waypoints_m=WAYPOINTS_M)
    log = uwcoop.simulate(spec.model_copy(update={"vehicles": (Vehicle(name="V1", path=path),)}), seed=seed)
    assert log.chart is not None
    return dataclasses.replace(log, chart=with_hole(log.chart))


def with_hole(chart: Chart) -> Chart:
    """The chart without depths between two eastings."""
    depth = chart.depth_m.copy()
    depth[:, (chart.east_m > HOLE_M[0]) & (chart.east_m < HOLE_M[1])] = np.nan
    return dataclasses.replace(chart, depth_m=depth)


def rows(
    log: MissionLog, navigator: str, limit_m: float, overrides: Sequence[str], from_s: float = 0.0
) -> Iterator[Row]:
    """What became of each vehicle from `from_s` on."""
    tracks = uwcoop.run(log, [navigator], clouds=False, overrides=overrides).tracks
    time_s = tracks.time.values.astype(np.float64)
    grid = np.isclose(time_s, np.round(time_s), atol=1e-6)
    error, nees = per_instant.errors(tracks), per_instant.nees(tracks)
    covariance = tracks["covariance_m2"].sel(navigator=navigator).values
    for v in range(len(log.vehicles)):
        t, d = time_s[grid], error.sel(navigator=navigator).values[v][grid]
        p, x = covariance[v][grid], nees.sel(navigator=navigator).values[v][grid]
        counted = t >= max(from_s, 50.0)
        acquiring = tracks["acquiring"].sel(navigator=navigator).values[v][grid]
        yield Row(
            _found(t[t >= from_s] - from_s, d[t >= from_s] < limit_m),
            float(np.nanmean(x[counted])),
            float(d[-1]),
            float(np.sqrt(np.trace(p[-1]))),
            float(np.sqrt(np.nanmean(d[counted] ** 2))),
            float(np.sum(acquiring & (t >= from_s))),
        )


def _found(t_s: np.ndarray, inside: np.ndarray) -> float:
    for start in np.flatnonzero(inside & ~np.r_[False, inside[:-1]]):
        stays = inside[(t_s >= t_s[start]) & (t_s < t_s[start] + DWELL_S)]
        if stays.all() and t_s[-1] - t_s[start] >= DWELL_S:
            return float(t_s[start])
    return float("inf")


def _mission(job: tuple[str, float, int, str, tuple[str, ...]]) -> list[Row]:
    world, radius_m, seed, navigator, overrides = job
    limit_m = LIMIT_M.get(world, 15.0)
    if world.startswith(HOLE):
        log = over_a_hole(world.removeprefix(f"{HOLE}:"), seed)
        return list(rows(log, navigator, limit_m, overrides, back_on_chart_s(log)))
    return list(rows(wide_start(world, radius_m, seed), navigator, limit_m, overrides))


def back_on_chart_s(log: MissionLog) -> float:
    """When the vehicle comes over the chart again for good, s."""
    assert log.truth is not None
    east = log.truth.position_m.values[0, :, 0]
    over = np.flatnonzero((east > HOLE_M[0]) & (east < HOLE_M[1]))
    return float(log.truth.time.values[over[-1]])


def line(world: str, radius_m: float, navigator: str, found: Sequence[Row]) -> str:
    """One row of the table."""
    times = np.array([row.found_s for row in found])
    anees = np.array([row.anees for row in found])
    limit_m = LIMIT_M.get(world, 15.0)
    wrong = sum(row.final_m > 2 * limit_m and row.final_m > 3 * row.final_sigma_m for row in found)
    share = [f"{100 * np.mean(times <= limit):.0f}" for limit in (300, 900)]
    middle, late = (np.quantile(times, q, method="higher") for q in (0.5, 0.9))
    start = "–" if world.startswith(HOLE) else f"{radius_m:g} m"
    return (
        f"| `{world}` | {start} | `{navigator}` | {len(found)} | {middle:.0f} / {late:.0f} s | {share[0]} / {share[1]} % "
        f"| {np.median(anees):.2f} / {np.mean(anees):.2f} | {np.median([r.rmse_m for r in found]):.1f} m "
        f"| {np.mean([r.acquiring_s for r in found]):.0f} s | {wrong} |"
    )


HEAD = (
    "| world | start known to | navigator | vehicles | found, median / 90 % | within 300 / 900 s | ANEES median / mean "
    "| RMSE | acquiring | lost in certainty |\n|---|---|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=17)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--worlds", default=",".join((*WORLDS, f"{HOLE}:st-john-drift", f"{HOLE}:flat-bay")))
    parser.add_argument("--radii", default="10,100,300")
    parser.add_argument("--navigators", default="mpf-terrain-only")
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    asked = parser.parse_args()
    print(HEAD, flush=True)
    with ProcessPoolExecutor(asked.processes) as pool:
        for world in asked.worlds.split(","):
            for radius in [0.0] if world.startswith(HOLE) else map(float, asked.radii.split(",")):
                for navigator in asked.navigators.split(","):
                    jobs = [
                        (world, radius, seed, navigator, tuple(asked.overrides)) for seed in range(asked.runs)
                    ]
                    found = [row for part in pool.map(_mission, jobs) for row in part]
                    print(line(world, radius, navigator, found), flush=True)


if __name__ == "__main__":
    main()
