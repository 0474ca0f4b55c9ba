"""A mission over a bottom that cannot localise: a public multibeam chart of 51-53 m with 0.3 m of uncertainty.

The chart is the US Naval Oceanographic Office's sample BAG (not part of this project; see the reference data's own
provenance). Navigators get it with the uncertainty of each of its nodes. The true seabed of a mission is that chart
plus one draw of an error of just that size, correlated over `CORRELATION_LENGTH_M`: the file states how large its errors
are, not over which distance they hold. Vehicles, sensors and acoustics are simulated.

    python studies/navo.py REFERENCE OUT      writes OUT/scenario.toml
"""

from __future__ import annotations

import sys
from pathlib import Path

CHART = Path("data/navo_bag/JD211_public_Release_1-4_UTM.bag")
CORRELATION_LENGTH_M = 20.0

NOTE = (
    "A public multibeam chart of 51-53 m of water whose stated uncertainty, 0.3 m, exceeds its relief. "
    "Localisation is impossible there; a consistent navigator states a large covariance: an ANEES near 2. The"
    " chart is not part of this project."
)

SCENARIO = """\
name = "navo"
description = "Three AUVs over a flat bottom whose chart's uncertainty exceeds its relief; a new seabed for each mission"
duration_s = 900

[chart]
source = "{chart}"
correlation_length_m = {length_m}

[chart.seabed]
each_mission = true

[vehicles]
count = 3
speed_mps = 1.5

[drift]
preset = "table-1"

[current]
model = "random-walk"
walk_mps_per_sqrt_s = 0.01

[sensors.water_depth]
sigma_m = 0.1

[acoustics]
modem = "micromodem-64"
slot_s = 3.0
max_range_m = 950.0
range_sigma_m = 1.0

[navigator.all]                    # told what this world does: no biases, and a current that starts at zero
drift = "table-1"
sigma_current0_mps = 0.0
sigma_heading_bias0_rad = 0.0
sigma_thrust_bias0_mps = 0.0
"""


def write_mission(reference: Path, folder: Path) -> Path:
    """Writes the scenario; returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario = folder / "scenario.toml"
    chart = (reference / CHART).resolve().as_posix()
    scenario.write_text(SCENARIO.format(chart=chart, length_m=CORRELATION_LENGTH_M))
    return scenario


def main() -> None:
    """Writes the scenario."""
    print(write_mission(Path(sys.argv[1]), Path(sys.argv[2])))


if __name__ == "__main__":
    main()
