"""How many bytes are enough: the same missions with packets of four lengths, error and consistency against bytes."""

import sys
from pathlib import Path

import uwcoop
from uwcoop.figures.bytes import bytes_figure, summarised

FORMS = ["f64", "256", "64", "32"]  # float64 without a limit, then frames of so many bytes


def main(folder: Path) -> None:
    studied = uwcoop.study(
        "ship-and-auv",
        runs=2,
        navigators=["local-only", "mdeif", "nekf"],
        vary={"acoustics.packet": FORMS},
        overrides=["duration_s=1500"],
        processes=1,
    )
    # The ship has GPS; what the packets are for is the vehicle under water.
    rows = [row for row in studied.rows if row["vehicle"] == "auv"]
    for entry in summarised(rows, ["acoustics.packet"]):
        sent = "nothing" if entry["bytes"] is None else f"{entry['bytes']:.0f} bytes"
        print(f"{entry['navigator']:10} {entry['variant']:11} {sent:10} {entry['rmse_m']:5.2f} m rms")
    picture = bytes_figure(rows, ["acoustics.packet"], title="ship-and-auv, the AUV, 2 missions")
    picture.axes[0].set_xticks([15, 30, 60, 120, 240, 480], minor=False)
    picture.axes[0].set_xticks([], minor=True)
    picture.savefig(folder / "bytes_enough.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
