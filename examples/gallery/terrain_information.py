"""Where terrain tells a vehicle its place: soundings of one's own bay, in degrees, become a chart and a picture."""

import csv
import sys
from pathlib import Path

import numpy as np

import uwcoop
from uwcoop.charts.information import describe
from uwcoop.figures.chart import chart_figure


def write_soundings(path: Path) -> None:
    """Three days of survey lines, 8 m apart, over a shelf with mounds in its east. Yours come from a sounder."""
    rng = np.random.default_rng(4)
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["Longitude (°)", "Latitude (°)", "Depth (m)", "day"])
        for line in range(60):
            north = 8.0 * line
            for east in np.arange(0.0, 800.0, 5.0):
                waves = 1.2 * np.sin(east / 14) * np.cos(north / 19) / (1 + np.exp((400 - east) / 40))
                depth = 6 + 0.012 * north + waves + 0.08 * rng.standard_normal()
                place = [f"{-70.5 + east / 82_856:.7f}", f"{41.9 + north / 111_070:.7f}"]
                table.writerow([*place, f"{depth:.2f}", f"day{line % 3}"])


def main(folder: Path) -> None:
    write_soundings(folder / "soundings.csv")
    chart = uwcoop.load_chart(folder / "soundings.csv", cell_m=5.0)
    facts = describe(chart)
    terrain = facts["terrain"]
    print(f"{facts['size_m']['east']:.0f} m x {facts['size_m']['north']:.0f} m")
    print(f"chart error {facts['sigma_map_m']:.2f} m, correlated over {facts['correlation_length_m']:.0f} m")
    print(
        f"on {100 * terrain['helps_share']:.0f} % of the bay one crossing of {terrain['window_m']:.0f} m "
        f"fixes both coordinates to {terrain['helps_below_m']:.0f} m"
    )
    chart_figure(chart).savefig(folder / "terrain_information.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
