"""Budget of a navigator's packet: fields, bits, bytes, frames, air time, slot and cycle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from uwcoop import acoustics
from uwcoop.errors import NavigatorError
from uwcoop.experiment.navigator_choice import default_navigators
from uwcoop.experiment.packet_contents import Field, packet_bytes, packet_of
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    from uwcoop.scenario.acoustics import Acoustics
    from uwcoop.scenario.models import Scenario

__all__ = [
    "TEAM_SIZES",
    "Budget",
    "Cost",
    "Positioning",
    "SlotPlan",
    "TeamPlan",
    "budget",
]

TEAM_SIZES = (2, 3, 4, 5, 8, 12, 16)
"""Sizes of a team that the planner shows beside the scenario's own."""


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
    """Signals of the mutual positioning with the landmark, beside the packets of exchanges."""

    interval_s: float
    """Between two of one vehicle."""
    reply_bytes: int
    """Size of the landmark's reply: its bearing and depth; it takes one signal."""
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
    """Bytes of a reply beside the packet; 0 in one-way ranging."""
    costs: dict[str, Cost | None]
    """By navigator; None: it sends nothing."""
    tag_bytes: int = 0
    """Of every packet's authentication, in `costs` already."""
    teams: tuple[TeamPlan, ...] = ()
    slots: tuple[SlotPlan, ...] = ()
    positioning: Positioning | None = None
    """None where no vehicle is positioned by a landmark."""


def budget(scenario: Scenario, navigators: Iterable[str] | None = None) -> Budget:
    """Fields → bits → frames → air time → slot → cycle for each navigator; the same for other teams and slots.

    Raises:
        ScheduleError: a packet that does not fit its slot, with the arithmetic.
        NavigatorError: an unknown navigator or option.
    """
    plan = scenario.acoustics
    link = acoustics.link_of(plan)
    capacity = acoustics.slot_capacity_bytes(plan)
    setup = MissionSetup.of(scenario)
    names = [vehicle.name for vehicle in scenario.team]
    order = list(plan.order) or names
    cycle_s = plan.slot_s * len(order)
    asked = default_navigators(setup, len(names)) if navigators is None else list(navigators)
    costs = {name: _cost(name, setup, plan, len(names), capacity) for name in asked}
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
        tag_bytes=setup.authentication.tag_bytes,
        teams=tuple(_team_plan(size, setup, plan, talking, capacity) for size in sizes),
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


def _cost(name: str, setup: MissionSetup, plan: Acoustics, vehicles: int, capacity: int) -> Cost | None:
    packet, fields = packet_of(name, setup, vehicles, capacity)
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
    vehicles: int, setup: MissionSetup, plan: Acoustics, talking: Iterable[str], capacity: int
) -> TeamPlan:
    sizes: dict[str, int | None] = {}
    for name in talking:
        try:
            sizes[name] = packet_bytes(name, setup, vehicles, capacity)
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
