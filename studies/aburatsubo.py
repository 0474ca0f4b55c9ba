"""Teams on real soundings: tracks and depths of survey days, a chart made of the other days.

The recording is Takamitsu Iida's single-beam survey of Aburatsubo bay (not part of this project; see the reference
data's own provenance). Positions and soundings are real; odometry and acoustic ranges are simulated. A day that a
vehicle follows is never in that team's chart.

    python studies/aburatsubo.py REFERENCE OUT      writes one folder with chart and scenario for each team
"""

from __future__ import annotations

import csv
import gzip
import sys
from collections import defaultdict
from pathlib import Path

RECORDING = Path("data/aburatsubo/sessions_valid.csv.gz")
DURATION_S = 900
SIGMA_SOUNDING_M = 0.1
LONGEST_GAP_S = 60.0
FASTEST_MPS = 5.0

NOTE = (
    "Each team follows three survey days; their positions and soundings are real, the chart is gridded from the other "
    "days' soundings, aligned and checked against each other, odometry and acoustic ranges are simulated (20 "
    "% loss). The "
    "recording is not part of this project."
)

SCENARIO = """\
name = "{name}"
description = "Real tracks and soundings of {days}; chart of the other days; odometry and ranges simulated"
duration_s = {duration_s}

[chart]
source = "chart.csv"
columns = "lat,lon,depth,survey,time_s"
cell_m = 2.0
{align}
[drift]
preset = "{drift}"

[navigator.all]
drift = "{drift}"

[sensors.water_depth]
sigma_m = {sigma_m}

[acoustics]
modem = "micromodem-64"
slot_s = 4.0
max_range_m = 2000.0
range_sigma_m = 1.0

[acoustics.loss]
model = "independent"
probability = 0.2
"""

VEHICLE = """
[[vehicles]]
name = "{name}"
depth_m = 0.0
[vehicles.track]
file = "{name}.csv"
columns = {{time = "time_s", longitude = "lon", latitude = "lat", sounding = "depth_m"}}
"""

Row = dict[str, str]


def sessions(reference: Path) -> dict[str, list[Row]]:
    """Rows of every session that holds a stretch of `DURATION_S` without long gaps, that stretch only."""
    everything: dict[str, list[Row]] = defaultdict(list)
    with gzip.open(reference / RECORDING, "rt") as file:
        for row in csv.DictReader(file):
            everything[row["f"]].append(row)
    return everything


def stretch(rows: list[Row]) -> list[Row] | None:
    """The first stretch of `DURATION_S` in which time ascends, no gap is long and no step is faster than a boat."""
    rows = sorted(rows, key=lambda r: int(r["ms"]))
    start = 0
    for k in range(1, len(rows)):
        gap_s = (int(rows[k]["ms"]) - int(rows[k - 1]["ms"])) / 1000
        step_m = sum((float(rows[k][a]) - float(rows[k - 1][a])) ** 2 for a in "en") ** 0.5
        if gap_s > LONGEST_GAP_S or step_m > FASTEST_MPS * max(gap_s, 1.0):
            start = k
        if int(rows[k]["ms"]) - int(rows[start]["ms"]) >= 1000 * (DURATION_S + 2):
            return rows[start : k + 1]
    return None


def teams(reference: Path, size: int = 3) -> list[list[str]]:
    """Sessions of different days that hold a stretch, dealt into teams in the order of time."""
    usable: dict[str, str] = {}
    for name, rows in sorted(sessions(reference).items()):
        if stretch(rows):
            usable.setdefault(name[:8], name)
    names = list(usable.values())
    return [names[k : k + size] for k in range(0, len(names) - size + 1, size)]


def write_team(
    reference: Path, team: list[str], folder: Path, drift: str = "dvl", *, align: bool = True
) -> Path:
    """Writes chart, tracks and scenario of one team; returns the scenario's path.

    The other days judge each other: their residuals give the chart's sigma and correlation length.
    """
    everything = sessions(reference)
    days = {name[:8] for name in team}
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "chart.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["lat", "lon", "depth", "survey", "time_s"])
        for name, rows in everything.items():
            if name[:8] not in days:
                writer.writerows([r["lat"], r["lon"], r["z"], name[:8], int(r["ms"]) / 1000] for r in rows)
    vehicles = ""
    for name in team:
        rows = stretch(everything[name])
        if rows is None:
            raise ValueError(f"session {name} has no stretch of {DURATION_S} s")
        vehicle = f"day-{name[:8]}"
        with (folder / f"{vehicle}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["time_s", "lat", "lon", "depth_m"])
            first = int(rows[0]["ms"])
            writer.writerows([(int(r["ms"]) - first) / 1000, r["lat"], r["lon"], r["z"]] for r in rows)
        vehicles += VEHICLE.format(name=vehicle)
    scenario = folder / "scenario.toml"
    scenario.write_text(
        SCENARIO.format(
            name=f"aburatsubo-{team[0][:8]}",
            days=", ".join(sorted(days)),
            duration_s=DURATION_S,
            drift=drift,
            sigma_m=SIGMA_SOUNDING_M,
            align="align = true\n" if align else "",
        )
        + vehicles
    )
    return scenario


def main() -> None:
    """Writes all teams for both classes of drift."""
    reference, out = Path(sys.argv[1]), Path(sys.argv[2])
    for team in teams(reference):
        for drift in ("dvl", "no-dvl"):
            print(write_team(reference, team, out / f"{team[0][:8]}-{drift}", drift))


if __name__ == "__main__":
    main()
