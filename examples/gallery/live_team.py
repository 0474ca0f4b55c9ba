"""A live team: three nodes, each a process of its own, exchange packets through simulated water on loopback."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import uwcoop
from uwcoop.missionlog.mcap import write_log
from uwcoop.onboard.messages import decode
from uwcoop.onboard.transports import UdpTransport, default_addresses
from uwcoop.scenario import load

BASE_PORT, NAMES, COLOURS = 17400, ("V1", "V2", "V3"), ("#D55E00", "#0072B2", "#009E73")


def started(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "uwcoop", *arguments, "--base-port", str(BASE_PORT)]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def flown(folder: Path) -> list[dict[str, Any]]:
    """The estimates that the nodes say to the watch, while the channel plays the mission's sensors and water."""
    addresses = default_addresses(NAMES, BASE_PORT)
    watch = UdpTransport(addresses.pop("watch"), addresses)
    running = [started(folder, "node", "--vehicle", name, "--scenario", "team.json") for name in NAMES]
    running += [started(folder, "channel", "--play", "mission.mcap", "--speed", "60", "--wait-s", "60")]
    said: list[dict[str, Any]] = []
    while any(process.poll() is None for process in running):
        for _, datagram in watch.receive(0.05):
            said += [message for message in decode(datagram) if message["type"] == "estimate"]
    watch.close()
    assert not any(process.returncode for process in running), "a node or the channel has failed"
    return said


def main(folder: Path) -> None:
    scenario = load("flat-bay", ["duration_s=180", 'navigators=["team"]'])
    (folder / "team.json").write_text(json.dumps(scenario.resolved()), encoding="utf-8")
    log = uwcoop.simulate(scenario)
    write_log(log, folder / "mission.mcap")
    said = flown(folder)
    replayed = uwcoop.run(log, ["team"], clouds=False).tracks
    picture = Figure(figsize=(9, 3.4), layout="constrained")
    axes = picture.subplots()
    for k, name in enumerate(NAMES):
        own = [message for message in said if message["vehicle"] == k and message["mean_m"][0] is not None]
        t_s, live_m = (np.array([message[key] for message in own]) for key in ("t_ns", "mean_m"))
        at = replayed.sel(navigator="team", vehicle=name).sel(time=t_s * 1e-9, method="nearest")
        apart_m = np.abs(live_m - at.position_m.values).max()
        print(f"{name}: {len(own)} estimates, at most {apart_m:g} m from those of the replay")
        axes.plot(
            t_s * 1e-9, np.hypot(*(live_m - at.truth_position_m.values).T), color=COLOURS[k], label=name
        )
    axes.set(xlabel="time (s)", ylabel="error (m)", title="What three nodes said live, beside the truth")
    axes.legend()
    picture.savefig(folder / "live_team.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
