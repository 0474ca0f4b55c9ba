"""Landmark leapfrog: two hovering vehicles take turns on the seabed around a square; who stood where, and when."""

import sys
from pathlib import Path

import uwcoop
from uwcoop.figures.landmark_map import roles_figure

OVERRIDES = [
    "duration_s=3600",
    "vehicles.0.path={kind='waypoints', waypoints_m=[[0, 0], [70, 0], [70, 60], [0, 60]]}",
    "vehicles.1.path={kind='waypoints', waypoints_m=[[0, -15], [85, -15], [85, 75], [0, 75]]}",
    "exchange.land={at='distance', distance_m=40, first_distance_m=20}",
]


def main(folder: Path) -> None:
    result = uwcoop.run("seafloor-survey", ["dead-reckoning-dvl", "landmark"], seed=1, overrides=OVERRIDES)
    for name, outcome in result.summary["navigators"].items():
        for vehicle, merit in outcome["vehicles"].items():
            print(
                f"{name:18} {vehicle}  {merit['rmse_m']:5.2f} m rms, {merit['final_error_m']:5.2f} m at the end"
            )
    picture = roles_figure(result.log, result.tracks.sel(navigator=["landmark"]))
    picture.savefig(folder / "landmark_leapfrog.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
