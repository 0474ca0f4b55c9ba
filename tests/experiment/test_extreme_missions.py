"""Missions at the ends of what there is: many vehicles, many and few particles, poles, the date line, a day."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop.errors import NavigatorError
from uwcoop.scenario import load, parse

SMALL = ["navigator.all.particles=50", "duration_s=200"]


def estimates_are_sound(result: Any) -> None:
    covariance = result.tracks["covariance_m2"].to_numpy()
    assert np.isfinite(result.tracks["position_m"].to_numpy()).all()
    assert np.isfinite(covariance).all()
    assert (np.linalg.eigvalsh(covariance) > -1e-9).all()


def test_sixty_four_vehicles_fly_and_a_method_for_sixteen_says_so() -> None:
    many = load("flat-bay", ["vehicles={count = 64}", *SMALL])
    result = uwcoop.run(many, ["dead-reckoning", "mpf"], clouds=False)
    estimates_are_sound(result)
    assert result.tracks.sizes["vehicle"] == 64
    rmse = {
        name: np.median([v["rmse_m"] for v in result.summary["navigators"][name]["vehicles"].values()])
        for name in ("dead-reckoning", "mpf")
    }
    assert rmse["mpf"] < rmse["dead-reckoning"]
    # Those beyond the sixteen that a packet can name are heard as well.
    received = result.tracks["received"].isel(vehicle=slice(16, None)).to_numpy()
    assert received.any()
    with pytest.raises(NavigatorError, match="vehicles of a team is 64, outside 1 to 16"):
        uwcoop.run(many, ["team"], clouds=False)


def test_few_particles_are_flown_down_to_ten_and_fewer_refused() -> None:
    for name in ("mpf", "dmpf", "team"):
        few = load("flat-bay", ["navigator.all.particles=10", "duration_s=120"])
        estimates_are_sound(uwcoop.run(few, [name], clouds=False))
        two = load("flat-bay", ["navigator.all.particles=2", "duration_s=120"])
        with pytest.raises(NavigatorError, match=rf"navigator\.{name}\.particles is 2: .* equal to 10"):
            uwcoop.run(two, [name], clouds=False)


@pytest.mark.long
@pytest.mark.parametrize("name", ["mpf", "team"])
def test_a_million_particles(name: str) -> None:
    estimates_are_sound(
        uwcoop.run(
            load("flat-bay", ["navigator.all.particles=1000000", "duration_s=12"]), [name], clouds=False
        )
    )


PLACES = {
    "north pole": ((89.999, 0.0), (89.999, 90.0), 157.9),
    "at the north pole": ((90.0, 0.0), (89.999, 0.0), 111.7),
    "south pole": ((-89.999, 10.0), (-89.999, 100.0), 157.9),
    "date line": ((10.0, 179.999), (10.0, -179.999), 219.2),
    "equator and Greenwich": ((0.0, -0.001), (0.0, 0.001), 222.6),
}
"""Two ends of a path and how far apart they are on WGS 84, m."""


@pytest.mark.parametrize("name", PLACES)
def test_poles_and_date_line(name: str) -> None:
    start, end, apart_m = PLACES[name]
    vehicles = [
        {"name": v, "path": {"kind": "waypoints", "waypoints_deg": ends}}
        for v, ends in (("a", [start, end]), ("b", [end, start]))
    ]
    scenario = parse(
        {
            "name": "place",
            "duration_s": 100,
            "vehicles": vehicles,
            "origin": {"latitude_deg": start[0], "longitude_deg": start[1]},
            "acoustics": {"modem": "micromodem-64", "slot_s": 5.0, "max_range_m": 950.0},
        },
        "place",
    )
    result = uwcoop.run(scenario, ["dead-reckoning", "mpf", "team"], clouds=False)
    estimates_are_sound(result)
    truth = result.log.truth
    assert truth is not None
    first = truth["position_m"].to_numpy()[:, 0]
    assert math.dist(*first) == pytest.approx(apart_m, rel=2e-3)
    for navigator in ("dead-reckoning", "mpf", "team"):
        vehicles_of = result.summary["navigators"][navigator]["vehicles"].values()
        assert all(v["rmse_m"] < 15.0 for v in vehicles_of)


DAY = """
import json, sys
import uwcoop
from peak_memory import peak_of_this_process_mb
from uwcoop.scenario import load
name, world, hours = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
sparse = ["acoustics.slot_s=600", "navigator.all.particles=100"] if world == "st-john" else []
peaks = []
for h in hours:
    uwcoop.run(load(world, [f"duration_s={3600 * h}", *sparse]), [name], clouds=False)
    peaks.append(peak_of_this_process_mb())
print(json.dumps(peaks))
"""


@pytest.mark.long
@pytest.mark.parametrize("name", ["dead-reckoning", "mpf", "team", "dmpf"])
def test_a_day_costs_the_memory_of_its_log_and_record(name: str) -> None:
    """What a navigator itself holds is flat (`navigator_day` of the core); log and record grow with the mission."""
    command = [sys.executable, "-c", DAY, name, "st-john", "[2, 24]"]
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=3600, check=False, cwd=Path(__file__).parents[1]
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    two, day = json.loads(ended.stdout.splitlines()[-1])
    # Three vehicles at 1 Hz: some 300 bytes for each second of each in the log, 150 and more in the record and tracks.
    assert day - two < 3 * 22 * 3600 * 1500 / 2**20, (two, day)
