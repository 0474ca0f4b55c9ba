"""The budget of five vehicles on a modem of one's own: which packets fit, and how often everybody is heard."""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from uwcoop.experiment.packet_budget import budget
from uwcoop.scenario import load

MODEM = "acoustics.modem={frame_bytes=24, max_frames=2, bits_per_s=160, preamble_s=0.2, turnaround_s=0.1}"
MODEM_SAID, COLOURS = "frames of 24 bytes at 160 bit/s", ("#D55E00", "#009E73")
TEAM = ["vehicles.count=5", MODEM, "acoustics.slot_s=4"]


def main(folder: Path) -> None:
    plan = budget(load("flat-bay", TEAM), ["mpf", "team"])
    print(f"slot {plan.slot_s:g} s, of which guard {plan.guard_s:.2f} s; cycle {plan.cycle_s:g} s")
    for name, cost in plan.costs.items():
        assert cost is not None  # None: the navigator sends nothing
        print(
            f"{name:4} {cost.packet_bytes} bytes in {cost.frames} frames of {plan.frame_bytes}: "
            f"{cost.air_time_s:.2f} s on the air, arrives with {100 * cost.survive:.0f} %"
        )
    for team in plan.teams:
        print(f"{team.vehicles:2} vehicles: everybody is heard every {team.cycle_s:.0f} s")
    picture = Figure(figsize=(9, 4.2), layout="constrained")
    axes = picture.subplots()
    for slot in range(5):
        for (name, cost), colour, up in zip(plan.costs.items(), COLOURS, (0.2, -0.2), strict=True):
            assert cost is not None
            label = f"{name}: {cost.packet_bytes} bytes" if slot == 0 else None
            axes.barh(slot + up, cost.air_time_s, 0.35, slot * plan.slot_s, color=colour, label=label)
        guard = "guard: sound on its way" if slot == 0 else None
        begins = (slot + 1) * plan.slot_s - plan.guard_s
        axes.barh(slot, plan.guard_s, 0.8, begins, color="none", edgecolor="0.5", hatch="//", label=guard)
    axes.set_yticks(range(5), [f"V{slot + 1}" for slot in range(5)])
    axes.set(
        xlabel="time in the cycle (s)", xlim=(0, plan.cycle_s), title=f"One cycle of five on {MODEM_SAID}"
    )
    axes.invert_yaxis()
    axes.legend(loc="upper right")
    picture.savefig(folder / "five_vehicles.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
