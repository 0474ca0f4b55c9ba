"""`uwcoop node`, `uwcoop channel`, `uwcoop watch`, `uwcoop black-box`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uwcoop.cli.onboard_devices import modem_of, nmea_drivers
from uwcoop.cli.options import SeedOption
from uwcoop.cli.terminal import say

if TYPE_CHECKING:
    from uwcoop.onboard.transports import Address
    from uwcoop.onboard.vehicle import VehicleNavigator

__all__ = ["black_box", "channel", "node", "watch"]

ScenarioOption = Annotated[
    str,
    typer.Option(
        "--scenario", metavar="SCENARIO", help="The team's scenario: a packaged name, or a TOML file."
    ),
]
VehicleOption = Annotated[
    str, typer.Option("--vehicle", metavar="NAME", help="Which of the team's vehicles.")
]
NavigatorOption = Annotated[
    str | None,
    typer.Option(
        "--navigator", "-n", metavar="NAME", help="Else the first that the scenario lists, or team."
    ),
]
PortOption = Annotated[
    int,
    typer.Option(
        "--base-port",
        metavar="PORT",
        help="The watch listens here, the channel one above, then the vehicles in order.",
    ),
]
PeerOption = Annotated[
    list[str] | None,
    typer.Option(
        "--peer",
        metavar="NAME=HOST:PORT",
        help="Where channel, watch, a vehicle or a driver of sensors is, if not at its usual port. Repeatable.",
    ),
]
BindOption = Annotated[
    str | None, typer.Option("--bind", metavar="HOST:PORT", help="Listen here instead of on loopback.")
]
EpochOption = Annotated[
    float | None,
    typer.Option(
        metavar="UNIX_S",
        help="Mission time 0 by the system clock. Without it the channel has the clock.",
    ),
]
BASE_PORT = 7400


def node(
    vehicle: VehicleOption,
    scenario: ScenarioOption,
    navigator: NavigatorOption = None,
    state: Annotated[
        Path | None,
        typer.Option("--state", metavar="DIR", help="Journal and checkpoints; a node that was killed resumes from it."),
    ] = None,
    black_box: Annotated[
        Path | None,
        typer.Option("--black-box", metavar="FILE.mcap", help="At the end, the dive as a log for `uwcoop run`."),
    ] = None,
    epoch: EpochOption = None,
    modem: Annotated[
        str | None,
        typer.Option(
            metavar="micromodem:DEVICE|unet:HOST:PORT",
            help="With --epoch: a WHOI Micromodem at tcp:HOST:PORT or serial:PATH:BAUD, or a UnetStack modem's "
            "gateway, instead of the channel.",
        ),
    ] = None,
    nmea: Annotated[
        list[str] | None,
        typer.Option(
            metavar="DEVICE",
            help="With --epoch: sensors that speak NMEA 0183 or PD6, at udp:HOST:PORT (listened to), tcp:HOST:PORT or "
            "serial:PATH:BAUD. Repeatable.",
        ),
    ] = None,
    nmea_map: Annotated[
        Path | None, typer.Option("--nmea-map", metavar="FILE.toml", help="Which sentences become which events.")
    ] = None,
    transport: Annotated[str, typer.Option(metavar="udp|zenoh", help="How messages travel.")] = "udp",
    base_port: PortOption = BASE_PORT,
    peer: PeerOption = None,
    bind: BindOption = None,
    checkpoint_s: Annotated[float, typer.Option(min=0.1, metavar="S", help="Between two checkpoints.")] = 30.0,
    reorder_s: Annotated[
        float, typer.Option(min=0.0, max=60.0, metavar="S", help="With --epoch: how long events may be under way.")
    ] = 0.2,
    lead_s: Annotated[
        float, typer.Option(min=0.0, max=60.0, metavar="S", help="With --epoch: from the packet to its launch.")
    ] = 0.5,
    silent_after_s: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="A sensor that is silent for so long raises an alarm; 0: none.")
    ] = 10.0,
    seed: SeedOption = None,
) -> None:  # fmt: skip
    """Run one vehicle's navigator: events in, packets in and out, estimates out."""
    from uwcoop.errors import ScenarioError
    from uwcoop.onboard.journal import Journal
    from uwcoop.onboard.service import NodeService, ServiceOptions, SystemClock
    from uwcoop.onboard.transports import open_transport
    from uwcoop.onboard.vehicle import VehicleNavigator

    if black_box is not None and state is None:
        raise typer.BadParameter("needs the journal: --state DIR", param_hint="--black-box")
    made = VehicleNavigator.from_scenario(scenario, vehicle, navigator, seed=seed)
    if made.mission.vehicles.count("watch") or made.mission.vehicles.count("channel"):
        raise ScenarioError("a vehicle is called watch or channel: these are names of programs")
    addresses = _addresses(made.mission.vehicles, base_port, peer)
    own = addresses.pop(made.name)
    wires = open_transport(transport, made.name, own if bind is None else _address(bind), addresses)
    clock = None if epoch is None else SystemClock(round(epoch * 1e9))
    sensors = nmea_drivers(nmea, nmea_map, made, clock)
    journal = None if state is None else Journal(state, made.digest)
    options = ServiceOptions(checkpoint_s, reorder_s, lead_s, silent_after_s=silent_after_s)
    service = NodeService(
        made,
        wires,
        journal,
        clock=clock,
        modem=modem_of(modem, made, clock),
        drivers=sensors,
        options=options,
    )
    time_of = (
        "the channel's"
        if clock is None
        else f"the system's less epoch {epoch:.3f} s, now {clock.now_ns() / 1e9:.3f} s"
    )
    say(f"{made.name}: {made.navigator} of {made.mission.name}, seed {made.mission.seed}; clock: {time_of}")
    if state is None:
        say("note: without --state nothing is kept: a node that is killed starts anew")
    elif service.node.now_ns >= 0:
        say(
            f"resumed at {service.node.now_ns / 1e9:.3f} s, {service.node.resumed} lines of the journal done again"
        )
    try:
        service.run()
    finally:
        wires.close()
        if journal is not None:
            journal.close()
    for driver in sensors:
        say(f"nmea: {_counts(driver.counts)}")
    say(f"{made.name}: ended at {service.node.now_ns / 1e9:.3f} s; {_counts(service.node.counts)}")
    if black_box is not None and state is not None:
        _write_black_box(state, made, black_box)


def channel(
    scenario: Annotated[
        str | None, typer.Option("--scenario", metavar="SCENARIO", help="The mission is simulated from it.")
    ] = None,
    play: Annotated[
        Path | None,
        typer.Option("--play", metavar="MISSION.mcap", help="Feed the nodes the sensors of this log; else packets only."),
    ] = None,
    speed: Annotated[
        float, typer.Option(min=0.0, metavar="X", help="With --play: times real time; 0: as fast as the nodes are.")
    ] = 1.0,
    epoch: EpochOption = None,
    transport: Annotated[str, typer.Option(metavar="udp|zenoh", help="How messages travel.")] = "udp",
    base_port: PortOption = BASE_PORT,
    peer: PeerOption = None,
    bind: BindOption = None,
    wait_s: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="With --play: how long to wait for the nodes before the start.")
    ] = 30.0,
    patience_s: Annotated[
        float, typer.Option(min=0.05, metavar="S", help="With --play: how long to wait for a node's answer.")
    ] = 5.0,
    seed: SeedOption = None,
) -> None:  # fmt: skip
    """Be the water between nodes: geometry, losses and delays of a scenario or a log."""
    from uwcoop.experiment.mission import open_mission
    from uwcoop.onboard.channel import Channel
    from uwcoop.onboard.service import SystemClock
    from uwcoop.onboard.transports import open_transport

    if (scenario is None) == (play is None):
        raise typer.BadParameter(
            "one of both is needed: a scenario, or a mission to play", param_hint="--scenario, --play"
        )
    if play is None and epoch is None:
        raise typer.BadParameter(
            "without --play, nodes have clocks of their own: give all the same", param_hint="--epoch"
        )
    if play is not None and epoch is not None:
        raise typer.BadParameter("with --play the channel has the clock", param_hint="--epoch")
    log = open_mission(scenario or str(play), seed)
    addresses = _addresses(log.vehicles, base_port, peer)
    own = addresses.pop("channel")
    wires = open_transport(transport, "channel", own if bind is None else _address(bind), addresses)
    water = Channel(log, wires, say)
    say(f"channel of {log.name}, seed {log.seed}: {len(log.vehicles)} vehicles, {log.duration_ns / 1e9:g} s")
    try:
        if epoch is None:
            water.play(speed, wait_s=wait_s, patience_s=patience_s)
        else:
            water.relay(SystemClock(round(epoch * 1e9)).now_ns)
    finally:
        wires.close()
    say(
        f"ended: {len(water.water.launched)} packets launched, {water.refused} messages refused, {wires.dropped} dropped"
    )


def watch(
    scenario: ScenarioOption,
    transport: Annotated[str, typer.Option(metavar="udp|zenoh", help="How messages travel.")] = "udp",
    base_port: PortOption = BASE_PORT,
    peer: PeerOption = None,
    bind: BindOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="The nodes' messages as lines on stdout.")] = False,
    rerun: Annotated[bool, typer.Option("--rerun", help="The live replay view in a Rerun viewer.")] = False,
    rerun_url: Annotated[
        str | None,
        typer.Option(
            metavar="URL", help="The live view in the viewer that runs there (rerun+http://…/proxy)."
        ),
    ] = None,
    until_s: Annotated[
        float | None, typer.Option("--for", min=0.0, metavar="S", help="End after so long; else by Ctrl-C.")
    ] = None,
) -> None:
    """Show what the nodes say: position, sigma, last heard, slots, alarms."""
    from uwcoop import scenario as scenarios
    from uwcoop.onboard.transports import open_transport
    from uwcoop.report.onboard_table import watch_drawn, watch_lines, watch_table

    if as_json and (rerun or rerun_url is not None):
        raise typer.BadParameter("lines or the view, not both", param_hint="--json, --rerun")
    team = scenarios.load(scenario).team
    names = tuple(vehicle.name for vehicle in team)
    addresses = _addresses(names, base_port, peer)
    own = addresses.pop("watch")
    wires = open_transport(transport, "watch", own if bind is None else _address(bind), addresses)
    try:
        if rerun or rerun_url is not None:
            from uwcoop.onboard.vehicle import empty_mission
            from uwcoop.viewer.live import spawn_viewer

            drawn = spawn_viewer(
                names, [vehicle.depth_m for vehicle in team], empty_mission(scenario).chart, rerun_url
            )
            watch_drawn(wires, drawn.take, until_s)
        else:
            (watch_lines if as_json else watch_table)(wires, names, until_s)
    finally:
        wires.close()


def black_box(
    vehicle: VehicleOption,
    scenario: ScenarioOption,
    state: Annotated[Path, typer.Option("--state", metavar="DIR", help="Where the node kept its journal.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIVE.mcap", help="The log to write.")],
    navigator: NavigatorOption = None,
    seed: SeedOption = None,
) -> None:
    """Write what a node saw and did as a log that `uwcoop run` replays to the same bits, also after a kill."""
    from uwcoop.onboard.vehicle import VehicleNavigator

    _write_black_box(state, VehicleNavigator.from_scenario(scenario, vehicle, navigator, seed=seed), output)


def _write_black_box(state: Path, made: VehicleNavigator, path: Path) -> None:
    from uwcoop.onboard.black_box import write_black_box

    log = write_black_box(state, made, path)
    events = sum(len(table["t_ns"]) for table in log.events.values())
    used = len(log.slots["tol_ns"]) if log.slots else 0
    say(f"wrote {path}: {events} sensor events, {len(log.payloads)} packets received, {used} slots used")


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items())) or "nothing happened"


def _address(text: str) -> Address:
    from uwcoop.onboard.transports import address_of

    return address_of(text)


def _addresses(names: tuple[str, ...], base_port: int, peers: list[str] | None) -> dict[str, Address]:
    from uwcoop.errors import ScenarioError
    from uwcoop.onboard.transports import default_addresses

    found = default_addresses(names, base_port)
    for text in peers or ():
        name, equals, address = text.partition("=")
        if not equals or not name:
            raise ScenarioError(f"peer {text!r} is not of the form NAME=HOST:PORT")
        found[name] = _address(address)
    return found
