"""Digests of the tracks of every packaged scenario and navigator, to prove that a change of structure keeps the bits.

    python benches/python/track_hashes.py before.json            # on the old code
    python benches/python/track_hashes.py after.json             # on the new code
    python benches/python/track_hashes.py --compare before.json after.json

One machine and one build profile: an instruction set with fused multiply-add changes the last bits.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

VARIABLES = (
    "position_m",
    "covariance_m2",
    "truth_position_m",
    "yaw_rad",
    "ess",
    "packet_bytes",
    "off_chart",
    "heard",
)
"""`rejected` is left out: what is counted may grow while every estimate stays."""


def digest(values: Any) -> str:
    """SHA-256 of an array's bytes; all NaN bit patterns count as one."""
    array = np.ascontiguousarray(values)
    if array.dtype.kind == "f":
        array = np.where(np.isnan(array), np.nan, array)
    return hashlib.sha256(array.tobytes()).hexdigest()[:16]


def mission(job: tuple[str, int, str | None]) -> dict[str, dict[str, str]]:
    """Digests by "scenario seed navigator", then by variable."""
    import uwcoop
    from uwcoop.navigators import NAVIGATORS

    name, seed, duration = job
    overrides = [] if duration is None else [f"duration_s={duration}"]
    found: dict[str, dict[str, str]] = {}
    try:
        log = uwcoop.simulate(_scenario(name, overrides), seed=seed)
    except Exception as error:
        return {f"{name} {seed}": {"error": f"{type(error).__name__}: {error}"[:200]}}
    for navigator in NAVIGATORS:
        key = f"{name} {seed} {navigator}"
        try:
            tracks = uwcoop.run(log, [navigator], clouds=False).tracks
        except Exception as error:
            # What does not fit a scenario must go on not fitting, whatever the words.
            found[key] = {"error": type(error).__name__}
            continue
        found[key] = {
            v: digest(tracks[v].sel(navigator=navigator) if "navigator" in tracks[v].dims else tracks[v])
            for v in VARIABLES
        }
    return found


def _scenario(name: str, overrides: list[str]) -> Any:
    from uwcoop import scenario

    return scenario.load(name, overrides)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, nargs="+")
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    if arguments.compare:
        before, after = (json.loads(f.read_text()) for f in arguments.file)
        differ = [
            f"{key}: {', '.join(v for v in before[key] if after.get(key, {}).get(v) != before[key][v])}"
            for key in before
            if after.get(key) != before[key]
        ]
        print("\n".join(differ) or f"all {len(before)} missions have the same bits")
        return bool(differ)
    from uwcoop import scenario

    names = [name for name, _ in scenario.packaged()]
    jobs = [(name, seed, None) for name in names for seed in (0, 1)]
    found: dict[str, dict[str, str]] = {}
    with ProcessPoolExecutor(arguments.processes) as pool:
        for job, part in zip(jobs, pool.map(mission, jobs), strict=True):
            found |= part
            print(job[0], job[1], file=sys.stderr, flush=True)
    arguments.file[0].write_text(json.dumps(found, indent=1, sort_keys=True) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
