"""Writes docs/results/origin-state.md: consistency, equalities, bytes against accuracy, recordings.

python studies/origin_state.py page DATA

python studies/origin_state.py consistency --runs 50
python studies/origin_state.py equalities --runs 20
python studies/origin_state.py bytes --runs 20
python studies/origin_state.py recordings DATA
python studies/origin_state.py speed
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import uwcoop
from uwcoop import scenario
from uwcoop.errors import UwcoopError
from uwcoop.evaluation import metrics
from uwcoop.experiment.mission import open_mission
from uwcoop.navigators import options_of
from uwcoop.world.simulate import simulate

Table = list[Sequence[str]]
Parts = dict[str, str]
"""Text by mark of the page."""


HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "results" / "origin-state.md"
TEXT = HERE / "origin_state_page.md"
"""The page, a `<<mark>>` in place of each table."""


def main() -> None:
    """One table, or the whole page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("table", choices=["page", *sorted(TABLES)])
    parser.add_argument("data", nargs="?", type=Path, help="folder with goats/ and plaza/")
    parser.add_argument("--runs", type=int, help="missions of a table; else as on the page")
    arguments = parser.parse_args()
    if arguments.table in ("page", "recordings") and arguments.data is None:
        parser.error(f"{arguments.table} needs DATA, the folder with goats/ and plaza/")
    if arguments.table != "page":
        print("\n".join(TABLES[arguments.table](arguments).values()))
        return
    lags = options_of("mdeif").model_dump()["exact_lags"]
    found = {
        "exact_lags": str(lags),
        "machine": f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}",
    }
    for name, made in TABLES.items():
        print(name, flush=True)
        found |= made(arguments)
    text = TEXT.read_text(encoding="utf-8")
    for mark, table in found.items():
        text = text.replace(f"<<{mark}>>", table)
    PAGE.write_text(text, encoding="utf-8")


def consistency(arguments: argparse.Namespace) -> Parts:
    """ANEES and errors by vehicle of every navigator, and the interval of consistent ones."""
    text, runs = "", arguments.runs or 50
    for name, spoken in (("ship-and-auv", ["auv"]), ("four-vehicle-team", None)):
        result = uwcoop.study(name, runs)
        rows = [row for row in result.rows if spoken is None or row["vehicle"] in spoken]
        vehicles = len({row["vehicle"] for row in rows})
        low, high = metrics.anees_bounds(2, runs * vehicles)
        text += (f"{name}, {runs} runs, {' and '.join(spoken or ['all vehicles'])}; "
                 f"95 % of consistent teams: {low:.2f} to {high:.2f}\n\n")  # fmt: skip
        table: Table = [("navigator", "RMSE (m)", "median (m)", "95 % (m)", "ANEES", "packet (B)")]
        for navigator in dict.fromkeys(row["navigator"] for row in rows):
            own = [row for row in rows if row["navigator"] == navigator]
            size = [row["packet_bytes_mean"] for row in own if row["packet_bytes_mean"] is not None]
            table.append((
                navigator,
                f"{np.sqrt(np.mean([row['rmse_m'] ** 2 for row in own])):.3f}",
                f"{np.median([row['median_error_m'] for row in own]):.2f}",
                f"{np.median([row['p95_error_m'] for row in own]):.2f}",
                f"{np.mean([row['anees'] for row in own]):.2f}",
                f"{np.mean(size):.0f}" if size else "-",
            ))  # fmt: skip
        text += shown(table) + "\n"
    return {"consistency": text}


def equalities(arguments: argparse.Namespace) -> Parts:
    """Largest differences from the references at the times of arrival, over all runs."""
    runs = arguments.runs or 20
    lossless = ["acoustics.losses=[]"]
    table: Table = [("scenario", "navigator", "reference", "when", "position (m)", "variance, low", "high")]
    table += compare("ship-and-auv", lossless, "deif", "cekf", runs, {"all": (0, np.inf)})
    windows = {"before": (0, 3400), "hold": (3400, 3700), "after": (3700, 4000), "late": (4000, np.inf)}
    table += compare("ship-and-auv-blackout", [], "mdeif", "cekf", runs, windows)
    table += compare("ship-and-auv-long-blackout", [], "mdeif", "cekf", runs, {"all": (0, np.inf)})
    table += compare("four-vehicle-team", [], "mdeif", "cekf-received", runs, {"all": (0, np.inf)})
    return {"equalities": shown(table) + "\n"}


def compare(
    name: str,
    overrides: list[str],
    navigator: str,
    reference: str,
    runs: int,
    windows: dict[str, tuple[float, float]],
) -> Table:
    """Rows of `equalities`: largest difference of position, least and largest ratio of the variance (trace)."""
    worst = {when: [0.0, np.inf, 0.0] for when in windows}
    for seed in range(runs):
        tracks = uwcoop.run(name, [navigator, reference], seed=seed, overrides=overrides, clouds=False).tracks
        heard = tracks["heard"].values.all(axis=0)
        position, variance = (
            tracks["position_m"].values,
            np.trace(tracks["covariance_m2"].values, axis1=-2, axis2=-1),
        )
        off = np.hypot(*np.moveaxis(position[0] - position[1], -1, 0))
        ratio = variance[0] / variance[1]
        time_s = tracks["time"].values
        for when, (start, end) in windows.items():
            at = heard & (time_s >= start) & (time_s < end)
            if at.any():
                low, high = ratio[at].min(), ratio[at].max()
                worst[when] = [
                    max(worst[when][0], off[at].max()),
                    min(worst[when][1], low),
                    max(worst[when][2], high),
                ]
    return [
        (name + (" lossless" if overrides else ""), navigator, reference, when,
         f"{off:.1e}", f"{100 * (low - 1):+.2e} %", f"{100 * (high - 1):+.2e} %")
        for when, (off, low, high) in worst.items()
    ]  # fmt: skip


def bytes_(arguments: argparse.Namespace) -> Parts:
    """What each form of packet costs and brings."""
    runs = arguments.runs or 20
    table: Table = [("packet", "navigator", "bytes, mean", "largest", "RMSE of the auv (m)", "ANEES")]
    for form in ("f64", "256", "64", "32"):
        for navigator in ("mdeif", "nekf", "interleaved", "deif", "deif-redundant"):
            if form != "f64" and navigator not in ("mdeif", "nekf"):
                continue
            try:
                result = uwcoop.study(
                    "ship-and-auv", runs, [navigator], overrides=[f"acoustics.packet={form}"]
                )
            except UwcoopError as reason:
                table.append((form, navigator, str(reason), "", "", ""))
                continue
            rows = [row for row in result.rows if row["vehicle"] == "auv"]
            sent = [row for row in result.rows if row["vehicle"] == "ship"]
            table.append((
                form, navigator,
                f"{np.mean([row['packet_bytes_mean'] for row in sent]):.1f}",
                f"{max(row['packet_bytes_max'] for row in sent)}",
                f"{np.sqrt(np.mean([row['rmse_m'] ** 2 for row in rows])):.3f}",
                f"{np.mean([row['anees'] for row in rows]):.2f}",
            ))  # fmt: skip
    parts = {"bytes": shown(table) + "\n"}
    table = [
        ("scenario", "packet", "difference (cm, rms)", "RMSE (cm)", "variance, mean", "least", "largest")
    ]
    for name, forms in (("ship-and-auv", ("256", "64", "32")), ("four-vehicle-team", ("256", "64"))):
        for form in forms:
            off, error, mean, low, high = rounding_cost(name, form, range(runs))
            table.append((
                name, form, f"{100 * off:.2f}", f"{100 * error:+.2f}",
                *(f"{100 * (ratio - 1):+.2f} %" for ratio in (mean, low, high)),
            ))  # fmt: skip
    return parts | {"rounding": shown(table) + "\n"}


LAGS = {"256": 3, "64": 0, "32": 1}
"""Exact lags that a rounded packet of each form holds."""


def rounding_cost(name: str, form: str, seeds: Iterable[int]) -> tuple[float, float, float, float, float]:
    """What rounding costs `mdeif`, against float64 packets that say the same: no equation (6), as many exact lags.

    Returns rms difference of the positions (m), difference of the RMSE (m), and mean, least and largest ratio of the
    variances (trace); all instants after 50 s, all vehicles that use ranges.
    """
    same = ["navigator.mdeif.use_equation_6=false", f"navigator.mdeif.exact_lags={LAGS[form]}"]
    off, ratios, squared = [], [], []
    for seed in seeds:
        found = []
        for overrides in ([f"acoustics.packet={form}"], ["acoustics.packet=f64", *same]):
            tracks = uwcoop.run(name, ["mdeif"], seed=seed, overrides=overrides, clouds=False).tracks
            used = [k for k, vehicle in enumerate(tracks["vehicle"].values) if vehicle != "ship"]
            found.append(tracks.isel(navigator=0, vehicle=used, time=tracks["time"].values > 50))
        places = [tracks["position_m"].values for tracks in found]
        spread = [np.trace(tracks["covariance_m2"].values, axis1=-2, axis2=-1) for tracks in found]
        truth = found[0]["truth_position_m"].values
        off.append(((places[0] - places[1]) ** 2).sum(axis=-1).mean())
        squared.append([((place - truth) ** 2).sum(axis=-1).mean() for place in places])
        ratio = spread[0] / spread[1]
        ratios.append((ratio.mean(), ratio.min(), ratio.max()))
    rmse = np.sqrt(np.mean(squared, axis=0))
    mean, low, high = np.array(ratios).T
    return float(np.sqrt(np.mean(off))), float(rmse[0] - rmse[1]), mean.mean(), low.min(), high.max()


def recordings(arguments: argparse.Namespace) -> Parts:
    """Every navigator on the recordings: all beacons, then one at a time."""
    text = ""
    files = [("goats/goats_14.pyfg", 4), ("goats/goats_15.pyfg", 3), ("plaza/Plaza1_.mat", 4)]
    for file, _ in files:
        path = arguments.data / file
        every = open_mission(path).vehicles[1:]
        table: Table = [("beacons", "navigator", "RMSE (m)", "95 % (m)", "ANEES", "gated")]
        ways = [(), *[(b,) for b in every]]
        for beacons in [*ways, None] if file.startswith("goats") else ways:
            chosen = [f"recording.beacons={list(beacons)}"] if beacons else []
            if beacons is None:
                chosen = ["recording.range_delay_edges=0.5"]
            if file.startswith("plaza"):
                # Others than mdeif need a heading: that of the file, which is the truth's.
                chosen.append("recording.sigma_start_yaw_rad=0.01")
            summary = uwcoop.run(path, overrides=chosen, clouds=False).summary
            for navigator, found in summary["navigators"].items():
                own = next(iter(found["vehicles"].values()))
                row = (
                    f"{own['rmse_m']:.2f}",
                    f"{own['p95_error_m']:.2f}",
                    f"{own['anees']:.1f}",
                    str(own["rejected"]),
                )
                said = "all, half an edge earlier" if beacons is None else ", ".join(beacons) or "all"
                table.append((said, navigator, *row))
        text += f"{file}\n\n{shown(table)}\n"
    return {"recordings": text}


def speed(arguments: argparse.Namespace) -> Parts:
    """CPU seconds of this process for one mission in one call, least of five."""
    log = simulate("ship-and-auv", 0)
    table: Table = [("navigator", "CPU (s), least of 5")]
    for navigator in scenario.load("ship-and-auv").navigators:
        spent = []
        for _ in range(5):
            start = time.process_time()
            uwcoop.run(log, [navigator], clouds=False)
            spent.append(time.process_time() - start)
        table.append((navigator, f"{min(spent):.2f}"))
    return {"speed": shown(table) + "\n"}


TABLES: dict[str, Any] = {
    "consistency": consistency, "equalities": equalities, "bytes": bytes_, "recordings": recordings, "speed": speed,
}  # fmt: skip


def shown(table: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    head, *rows = table
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


if __name__ == "__main__":
    main()
