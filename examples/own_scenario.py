"""A scenario of one's own: a chart from an array, a TOML file that names it, and runs with two speeds of the current.

Files go to the folder `own-scenario` below the current one, or to the folder that the command line names.
"""

import sys
from pathlib import Path

import numpy as np

import uwcoop
from uwcoop.charts import write_chart

SCENARIO = """\
name = "sound"
description = "Two AUVs between two banks"
duration_s = 300

[chart]
source = "sound.nc"               # relative to this file

[[vehicles]]
name = "west"
speed_mps = 1.2
path = {kind = "waypoints", waypoints_m = [[100, 100], [300, 180], [100, 260], [300, 340]]}

[[vehicles]]
name = "east"
speed_mps = 1.2
path = {kind = "waypoints", waypoints_m = [[600, 100], [420, 180], [600, 260], [420, 340]]}

[current]
model = "constant"
speed_mps = 0.15
direction_deg = 200

[drift]
preset = "no-dvl"                 # the vehicles' dead reckoning

[acoustics]
modem = "micromodem-64"
slot_s = 3.0
max_range_m = 900.0

[acoustics.loss]
probability = 0.1

[navigator.all]
drift = "no-dvl"                  # what the navigators assume of it
"""


def sound_chart() -> uwcoop.Chart:
    """Two banks with sand waves: 176 x 226 nodes, 4 m apart; the depths have an error of 0.1 m."""
    north, east = np.meshgrid(np.arange(-100.0, 604.0, 4.0), np.arange(-100.0, 804.0, 4.0), indexing="ij")
    banks = 18.0 - 6.0 * np.exp(-(((east - 200) / 90) ** 2)) - 5.0 * np.exp(-(((east - 520) / 70) ** 2))
    waves = 1.5 * np.sin(east / 21 + north / 47) + 1.0 * np.cos(north / 17)
    return uwcoop.Chart(
        banks + waves, -100.0, -100.0, 4.0, sigma_map_m=0.1, correlation_length_m=10.0, name="sound"
    )


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_chart(sound_chart(), folder / "sound.nc")
    scenario = folder / "sound.toml"
    scenario.write_text(SCENARIO, encoding="utf-8")

    for overrides in ([], ["current.speed_mps=0.05"]):
        result = uwcoop.run(scenario, ["dead-reckoning", "mpf"], seed=1, overrides=overrides)
        print(overrides or "as the file states it")
        for name, navigator in result.summary["navigators"].items():
            for vehicle, merit in navigator["vehicles"].items():
                print(
                    f"  {name:15} {vehicle:5} {merit['rmse_m']:7.2f} m rms   NEES {merit['anees']:6.2f} (ideal 2)"
                )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "own-scenario"))
