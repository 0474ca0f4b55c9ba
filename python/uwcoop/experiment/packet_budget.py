"""What talking costs: a navigator's packet in fields, bits, bytes, frames, air time, slots and cycles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uwcoop import _native, acoustics
from uwcoop.acoustics.authentication import tag_bytes_of
from uwcoop.errors import NavigatorError, ScheduleError
from uwcoop.navigators import NAVIGATORS, Context, build, options_of
from uwcoop.scenario.acoustics import Acoustics

if TYPE_CHECKING:
    from uwcoop.scenario.models import Scenario

__all__ = [
    "TEAM_SIZES",
    "Budget",
    "Cost",
    "Field",
    "Positioning",
    "SlotPlan",
    "TeamPlan",
    "budget",
    "check_packets_fit",
    "default_navigators",
    "packet_bytes",
    "packet_fields",
    "ranging_of",
]

TEAM_SIZES = (2, 3, 4, 5, 8, 12, 16)
"""Sizes of a team that the planner shows beside the scenario's own."""


@dataclass(frozen=True)
class Field:
    """What a packet spends some of its bits on, as the code that encodes it says."""

    name: str
    bits: int
    """Of one."""
    count: int
    """How many of them there are."""
    meaning: str
    """Range, step and rounding of a number; empty for counters, bitmaps and checks."""

    @property
    def total_bits(self) -> int:
        """Bits of all of them."""
        return self.bits * self.count


@dataclass(frozen=True)
class Cost:
    """One navigator's packet on the air."""

    packet_bytes: int
    frames: int
    air_time_s: float
    """Of the packet; in two-way ranging of the poll too."""
    slot_needed_s: float
    """Air time and guard: the shortest slot that it would fit."""
    survive: float
    """Probability that every frame arrives, collisions aside."""
    fields: tuple[Field, ...] = ()
    """In the packet's order; their bits add up to `packet_bytes`, tag included. Empty: the navigator does not say."""


@dataclass(frozen=True)
class TeamPlan:
    """A team of another size in the same slots."""

    vehicles: int
    cycle_s: float
    broadcasts_per_min: float
    """Of each vehicle."""
    heard_per_min: float
    """By each vehicle, if none is lost."""
    packet_bytes: dict[str, int | None]
    """By talking navigator."""
    slot_needed_s: dict[str, float | None]
    """By talking navigator, the shortest slot for its packet; None: no slot of this modem holds it."""


@dataclass(frozen=True)
class SlotPlan:
    """The shortest slot for so many frames, with the scenario's team."""

    frames: int
    capacity_bytes: int
    slot_s: float
    cycle_s: float
    broadcasts_per_min: float
    heard_per_min: float


@dataclass(frozen=True)
class Positioning:
    """What mutual positioning with the landmark puts on the air, beside the packets of exchanges."""

    interval_s: float
    """Between two of one vehicle."""
    reply_bytes: int
    """What the landmark's reply says: its bearing and depth; it takes one signal."""
    signals: int
    """Of one positioning: the question and the reply."""
    air_time_s: float
    """Of both."""
    per_min: float
    """Of the team: everybody but the landmark asks."""


@dataclass(frozen=True)
class Budget:
    """A scenario's schedule and what each navigator's packet makes of it."""

    scenario: str
    modem: str
    frame_bytes: int
    max_frames: int
    frame_s: float
    preamble_s: float
    slot_s: float
    guard_s: float
    cycle_s: float
    """Time in which every sender of the cycle has had its slots."""
    heard_per_min: dict[str, float]
    """By vehicle, packets of the others in a minute if none is lost."""
    poll_bytes: int
    """Length of the poll that asks for each packet; 0 in one-way ranging."""
    poll_air_s: float
    reply_bytes: int
    """What an answer carries beside the packet; 0 in one-way ranging."""
    costs: dict[str, Cost | None]
    """By navigator; None: it sends nothing."""
    tag_bytes: int = 0
    """Of every packet's authentication, in `costs` already."""
    teams: tuple[TeamPlan, ...] = ()
    slots: tuple[SlotPlan, ...] = ()
    positioning: Positioning | None = None
    """None where no vehicle asks a landmark."""


def budget(scenario: Scenario, navigators: Iterable[str] | None = None) -> Budget:
    """Fields → bits → frames → air time → slot → cycle for each navigator, and what other teams and slots would do.

    Raises:
        ScheduleError: a packet that does not fit its slot, with the arithmetic.
        NavigatorError: an unknown navigator or option.
    """
    plan = scenario.acoustics
    link = acoustics.link_of(plan)
    capacity = acoustics.slot_capacity_bytes(plan)
    tables = scenario.resolved()
    names = [vehicle.name for vehicle in scenario.team]
    order = list(plan.order) or names
    cycle_s = plan.slot_s * len(order)
    asked = default_navigators(tables, len(names)) if navigators is None else list(navigators)
    costs = {name: _cost(name, plan, tables, len(names), capacity) for name in asked}
    two_way = plan.ranging == "two-way"
    poll_air_s = acoustics.poll_air_s(plan) if two_way else 0.0
    if plan.packet_bytes is not None:
        acoustics.check_packet(plan, plan.packet_bytes)
    talking = [name for name, cost in costs.items() if cost is not None]
    sizes = sorted({*TEAM_SIZES, len(names)})
    return Budget(
        scenario=scenario.name,
        modem=link.modem,
        frame_bytes=link.frame_bytes,
        max_frames=link.max_frames,
        frame_s=link.frame_s,
        preamble_s=link.preamble_s,
        slot_s=plan.slot_s,
        guard_s=plan.guard,
        cycle_s=cycle_s,
        heard_per_min={
            name: 60 * sum(other != name for other in order) / cycle_s / _pollers(plan, len(names))
            for name in names
        },
        poll_bytes=plan.two_way.poll_bytes if two_way else 0,
        poll_air_s=poll_air_s,
        reply_bytes=acoustics.RESIDENCE_BYTES if two_way else 0,
        costs=costs,
        tag_bytes=tag_bytes_of(tables),
        teams=tuple(_team_plan(size, plan, tables, talking, capacity) for size in sizes),
        slots=tuple(_slot_plans(plan, len(order), len(names))),
        positioning=_positioning(scenario, len(names)),
    )


def _positioning(scenario: Scenario, vehicles: int) -> Positioning | None:
    if scenario.exchange is None:
        return None
    mutual, link = scenario.mutual, acoustics.link_of(scenario.acoustics)
    return Positioning(
        interval_s=mutual.interval_s,
        reply_bytes=mutual.reply_bytes,
        signals=2,
        air_time_s=2 * acoustics.air_time_s(link, 1),
        per_min=60 * (vehicles - 1) / mutual.interval_s,
    )


def check_packets_fit(navigators: Iterable[str], tables: Mapping[str, Any], vehicles: int) -> None:
    """Raise `ScheduleError` for a packaged navigator whose packet does not fit the slots of a resolved scenario.

    A log of another origin has no schedule in its scenario: nothing is checked then.
    """
    if "acoustics" not in tables:
        return
    plan = Acoustics.model_validate(tables["acoustics"])
    capacity = acoustics.slot_capacity_bytes(plan)
    for name in navigators:
        size = packet_bytes(name, tables, vehicles, capacity)
        if size is not None:
            acoustics.check_packet(plan, size, f"{name}'s packet")


def default_navigators(tables: Mapping[str, Any], vehicles: int) -> list[str]:
    """The packaged navigators of a resolved scenario: those that it lists, or all that are for any; without
    those that need a bandwidth that its modem lacks.

    Raises:
        NavigatorError: the scenario lists an unknown navigator, or one twice.
    """
    listed = list(tables.get("navigators", ()))
    for name in listed:
        options_of(name, tables)
        if listed.count(name) > 1:
            raise NavigatorError(f"navigators lists {name!r} {listed.count(name)} times: must be once")
    fits = []
    for name in listed or [name for name, spec in NAVIGATORS.items() if not spec.listed_only]:
        if NAVIGATORS[name].needs_bandwidth:
            try:
                check_packets_fit([name], tables, vehicles)
            except ScheduleError:
                continue
        fits.append(name)
    return fits


def packet_bytes(name: str, tables: Mapping[str, Any], vehicles: int, capacity_bytes: int) -> int | None:
    """Length of what a packaged navigator sends once it is under way, tag included; None if it sends nothing.

    A navigator that fits its packet to the slot is asked with the slot's capacity; one whose packet is too
    long for it, without a limit, so that the schedule can say what is missing. `tables`: a resolved scenario.
    """
    packet, _ = _packet(name, tables, vehicles, capacity_bytes)
    return None if packet is None else len(packet)


def packet_fields(
    name: str, tables: Mapping[str, Any], vehicles: int, capacity_bytes: int
) -> tuple[Field, ...]:
    """What a packaged navigator's packet consists of; empty if it sends nothing. As `packet_bytes`."""
    return _packet(name, tables, vehicles, capacity_bytes)[1]


def _packet(
    name: str, tables: Mapping[str, Any], vehicles: int, capacity_bytes: int
) -> tuple[bytes | None, tuple[Field, ...]]:
    options = options_of(name, tables)
    if NAVIGATORS[name].central:
        return None, ()
    tag_bytes = tag_bytes_of(tables)
    sound_speed_mps = tables["acoustics"]["sound_speed_mps"]
    context = Context(0, vehicles, sound_speed_mps, 0, None, _ranging(tables, vehicles))

    def ready() -> tuple[_native.Navigator, int]:
        navigator = build(name, context, options, None)
        assert isinstance(navigator, _native.Navigator)
        if tables.get("exchange"):
            launch_ns = _landed_beside_the_landmark(navigator)
        else:
            launch_ns = _under_way(navigator, _sensors(tables), tables["acoustics"]["slot_s"] * vehicles)
        if tag_bytes:
            # The key does not change the length; the team's own stays where it is.
            navigator = navigator.authenticated(0, vehicles, _native.Authenticator(bytes(16), tag_bytes, 0))
        return navigator, launch_ns

    navigator, launch_ns = ready()
    try:
        packet, fields = navigator.transmit_described(launch_ns, capacity_bytes)
    except NavigatorError:
        navigator, launch_ns = ready()
        packet, fields = navigator.transmit_described(launch_ns, acoustics.NO_LIMIT_BYTES)
    return packet, tuple(Field(field, bits, count, _meaning(scale)) for field, bits, count, scale in fields)


def _ranging(tables: Mapping[str, Any], vehicles: int) -> tuple[bool, ...]:
    """Who uses ranges in a team of another size: as many as in the scenario's, and the first one only sends."""
    known = ranging_of(tables)
    if len(known) == vehicles or all(known):
        return known if len(known) == vehicles else ()
    users = min(sum(known), vehicles - 1)
    return (False,) * (vehicles - users) + (True,) * users


def _sensors(tables: Mapping[str, Any]) -> dict[str, Any]:
    """What the first vehicle carries."""
    team = tables.get("vehicles", ())
    own = team[0].get("sensors", {}) if isinstance(team, list | tuple) and team else {}
    return {**tables.get("sensors", {}), **own}


def _under_way(navigator: _native.Navigator, sensors: Mapping[str, Any], cycle_s: float) -> int:
    """Two cycles of ordinary events of a vehicle with these sensors and the first cycle's packet, so that the second
    one's holds what it holds on a mission; its launch time."""
    start = {"e_m": 0.0, "n_m": 0.0, "cov_ee_m2": 1.0, "cov_en_m2": 0.0, "cov_nn_m2": 1.0}
    navigator.handle(_native.Event(0, 0, "fix", **start))
    ordinary: dict[str, dict[str, Any]] = {
        "depth": {"depth_m": 2.0, "sigma_m": 0.1},
        "water_depth": {"water_depth_m": 20.0, "sigma_m": 0.1},
    }
    if "heading" in sensors:
        ordinary["heading"] = {"yaw_rad": 0.46, "sigma_rad": 0.01}
    if "ground_velocity" in sensors:
        ordinary["ground_velocity"] = {"forward_mps": 1.1, "left_mps": 0.0, "sigma_mps": 0.05}
    ordinary["motion"] = {"velocity_e_mps": 1.0, "velocity_n_mps": 0.5}
    seconds = min(max(1, round(cycle_s)), 600)
    for second in range(2 * seconds + 1):
        at = 1_000_000_000 * second
        for kind, values in ordinary.items():
            navigator.handle(_native.Event(at, 0, kind, **values))
        if "gps" in sensors and second:
            here = {"e_m": 1.0 * second, "n_m": 0.5 * second}
            navigator.handle(_native.Event(at, 0, "fix", **(start | here)))
        if second == seconds:
            navigator.transmit(at, acoustics.NO_LIMIT_BYTES)
    return 1_000_000_000 * 2 * seconds


def _landed_beside_the_landmark(navigator: _native.Navigator) -> int:
    """A minute of a mover of the alternating landmark that lands and is positioned, so that its next packet hands over
    the role; its launch time."""
    start = {"e_m": 0.0, "n_m": -10.0, "cov_ee_m2": 1.0, "cov_en_m2": 0.0, "cov_nn_m2": 1.0}
    at_once: dict[str, dict[str, Any]] = {
        "fix": start,
        "heading": {"yaw_rad": 0.1, "sigma_rad": 0.09},
        "depth": {"depth_m": 2.0, "sigma_m": 0.1},
    }
    for kind, values in at_once.items():
        navigator.handle(_native.Event(0, 0, kind, **values))
    for second in range(1, 61):
        at = 1_000_000_000 * second
        forward_mps = 0.1 if second < 30 else 0.0
        navigator.handle(_native.Event(at, 0, "turn_rate", yaw_rate_radps=0.0, sigma_radps=0.0013))
        moved = {"forward_mps": forward_mps, "left_mps": 0.0, "sigma_mps": 0.01}
        navigator.handle(_native.Event(at, 0, "ground_velocity", **moved))
        if second == 30:
            navigator.handle(_native.Event(at, 0, "landed"))
        if second % 10 == 0:
            # A mover at (0, -10) that goes 0.1 m/s along 0.1 rad, and the landmark at the origin.
            east, north = 0.1 * min(second, 30), 0.01 * min(second, 30) - 10
            positioned = {
                "range_m": math.hypot(east, north),
                "own_bearing_rad": math.atan2(-north, -east) - 0.1,
                "peer_bearing_rad": math.atan2(north, east),
            }
            asked_ns = at - 500_000_000
            navigator.handle(_native.Event(at, 0, "acoustic_fix", peer=1, transmit_ns=asked_ns, **positioned))
    return 60_000_000_000


def _meaning(scale: tuple[str, float, float, str, float, str] | None) -> str:
    if scale is None:
        return ""
    unit, least, greatest, kind, step, rounding = scale
    size = {
        "linear": f"steps of {step:.6g}{' ' + unit if unit else ''}",
        "factor": f"steps of {100 * (step - 1):.3g} %",
        "atanh": f"steps of {step:.4g} in atanh",
        "growing": f"steps of {step:.6g}{' ' + unit if unit else ''}, then at most 1/64 of the value",
    }[kind]
    return f"{least:.6g} to {greatest:.6g}{' ' + unit if unit else ''}, {size}, rounded {_ROUNDED[rounding]}"


_ROUNDED = {"nearest": "to the nearest", "up": "up", "down": "down", "toward zero": "toward zero"}


def _cost(name: str, plan: Acoustics, tables: Mapping[str, Any], vehicles: int, capacity: int) -> Cost | None:
    packet, fields = _packet(name, tables, vehicles, capacity)
    if packet is None:
        return None
    acoustics.check_packet(plan, len(packet), f"{name}'s packet")
    frames = acoustics.packet_frames(plan, len(packet))
    poll_air_s = acoustics.poll_air_s(plan) if plan.ranging == "two-way" else 0.0
    return Cost(
        packet_bytes=len(packet),
        frames=frames,
        air_time_s=poll_air_s + acoustics.air_time_s(acoustics.link_of(plan), frames),
        slot_needed_s=acoustics.slot_needed_s(plan, frames),
        survive=acoustics.packet_survival(plan, frames),
        fields=fields,
    )


def _pollers(plan: Acoustics, vehicles: int) -> int:
    # A two-way range is the poller's alone: teammates take turns at polling.
    return 1 if plan.ranging == "one-way" else max(1, vehicles - 1)


def _team_plan(
    vehicles: int, plan: Acoustics, tables: Mapping[str, Any], talking: Iterable[str], capacity: int
) -> TeamPlan:
    sizes: dict[str, int | None] = {}
    for name in talking:
        try:
            sizes[name] = packet_bytes(name, tables, vehicles, capacity)
        except NavigatorError:  # a method that a team of this size is too large for
            sizes[name] = None
    most = acoustics.link_of(plan).max_frames
    needed = {}
    for name, size in sizes.items():
        frames = None if size is None else acoustics.packet_frames(plan, size)
        needed[name] = None if frames is None or frames > most else acoustics.slot_needed_s(plan, frames)
    cycle_s = plan.slot_s * vehicles
    return TeamPlan(
        vehicles=vehicles,
        cycle_s=cycle_s,
        broadcasts_per_min=60 / cycle_s,
        heard_per_min=60 * (vehicles - 1) / cycle_s / _pollers(plan, vehicles),
        packet_bytes=sizes,
        slot_needed_s=needed,
    )


def _slot_plans(plan: Acoustics, slots: int, vehicles: int) -> Iterable[SlotPlan]:
    link = acoustics.link_of(plan)
    if not link.frame_s:
        return
    for frames in range(1, link.max_frames + 1):
        slot_s = acoustics.slot_needed_s(plan, frames)
        cycle_s = slot_s * slots
        yield SlotPlan(
            frames=frames,
            capacity_bytes=frames * link.frame_bytes,
            slot_s=slot_s,
            cycle_s=cycle_s,
            broadcasts_per_min=60 / cycle_s,
            heard_per_min=60 * (slots - slots / vehicles) / cycle_s / _pollers(plan, vehicles),
        )


def ranging_of(tables: Mapping[str, Any]) -> tuple[bool, ...]:
    """By vehicle, whether it uses ranges; empty where a resolved scenario, or a log of another origin, does not say."""
    team = tables.get("vehicles", ())
    return tuple(bool(v.get("fuses_ranges", True)) for v in team) if isinstance(team, list | tuple) else ()
