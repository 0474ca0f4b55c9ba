"""The origin state under a blackout: the ship hears nothing for five minutes, and the AUV loses nothing by it."""

import sys
from pathlib import Path

import uwcoop
from uwcoop.figures.origin import origin_figure


def main(folder: Path) -> None:
    result = uwcoop.run("ship-and-auv-blackout", ["local-only", "cekf", "mdeif"], seed=1, clouds=False)
    tracks = result.tracks
    for name, outcome in result.summary["navigators"].items():
        merit = outcome["vehicles"]["auv"]
        print(f"{name:10} auv  {merit['rmse_m']:5.2f} m rms   NEES {merit['anees']:4.2f} (ideal 2)")
    age_s = tracks["origin_age_s"].sel(navigator="mdeif", vehicle="ship")
    for text, from_s, to_s in (("before", 0, 3400), ("during", 3400, 3720), ("after", 3720, 4500)):
        print(
            f"oldest origin {text:6} the blackout: {float(age_s.sel(time=slice(from_s, to_s)).max()):3.0f} s"
        )
    origin_figure(tracks).savefig(folder / "origin_blackout.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
