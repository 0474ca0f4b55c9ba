"""What a lost vehicle looks like: far off and certain (`dmpf`), beside the same mission with `team` and `mpf`."""

import sys
from pathlib import Path

import uwcoop
from uwcoop.figures.errors import errors_figure


def main(folder: Path) -> None:
    result = uwcoop.run("flat-bay", ["dmpf", "mpf", "team"], seed=3, clouds=False)
    for name, outcome in result.summary["navigators"].items():
        for vehicle, merit in outcome["vehicles"].items():
            off_m, nees = merit["final_error_m"], merit["anees"]
            print(f"{name:5} {vehicle}  {off_m:5.1f} m off at the end   NEES {nees:5.1f} (ideal 2)")
    picture = errors_figure(result.tracks, result.packets, result.innovations)
    picture.savefig(folder / "lost_vehicle.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
