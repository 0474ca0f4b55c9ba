"""After the dive, without a truth: score by fixes that were held out, and hand the tracks to other programs."""

import sys
from dataclasses import replace
from pathlib import Path

import uwcoop
from uwcoop.figures.errors import errors_figure
from uwcoop.report.export.formats import export_tracks
from uwcoop.report.run_folder import write_run
from uwcoop.scenario import load

SURFACINGS = "sensors.gps={rate_hz=0.006, sigma_m=3.0}"  # a fix about every three minutes


def main(folder: Path) -> None:
    log = replace(uwcoop.simulate(load("flat-bay", [SURFACINGS]), seed=2), truth=None)
    result = uwcoop.run(log, ["dead-reckoning", "mpf", "team"], hold_out="fix", clouds=False)
    for name, outcome in result.summary["navigators"].items():
        for vehicle, score in outcome["held_out"].items():
            print(
                f"{name:14} {vehicle}  {score['fixes']} fixes, {score['rms_m']:5.2f} m rms from them "
                f"(their own sigma: {score['sigma_m']:.2f} m), NEES {score['nees']:4.2f} (ideal 2)"
            )
    picture = errors_figure(result.tracks, result.packets, result.innovations, result.held_out)
    picture.savefig(folder / "without_truth.png", dpi=80)
    write_run(result, folder / "dive", print)
    path, routes = export_tracks(folder / "dive", "csv", navigators=["team"])
    print(f"{path.name}: the paths of {len(routes.routes)} vehicles")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
