"""What talking costs: a navigator's packet in bytes, frames, air time, slots and cycles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uwcoop import _native, acoustics
from uwcoop.errors import NavigatorError, ScheduleError
from uwcoop.navigators import NAVIGATORS, Context, build, options_of
from uwcoop.scenario.acoustics import Acoustics

if TYPE_CHECKING:
    from uwcoop.scenario.models import Scenario

__all__ = ["Budget", "Cost", "budget", "fitting", "packet_bytes", "ranging_of", "refuse_misfits"]


@dataclass(frozen=True)
class Cost:
    """One navigator's packet on the air."""

    packet_bytes: int
    frames: int
    air_time_s: float
    slot_needed_s: float
    """Air time and guard: the shortest slot that it would fit."""
    survive: float
    """Probability that every frame arrives, collisions aside."""


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
    costs: dict[str, Cost | None]
    """By navigator; None: it sends nothing."""


def budget(scenario: Scenario, navigators: Iterable[str] | None = None) -> Budget:
    """Bytes → frames → air time → slot → cycle for each navigator.

    Raises:
        ScheduleError: a packet that does not fit its slot, with the arithmetic.
        NavigatorError: an unknown navigator or option.
    """
    plan = scenario.acoustics
    link = acoustics.link_of(plan)
    capacity = acoustics.slot_capacity_bytes(plan)
    names = [vehicle.name for vehicle in scenario.team]
    order = list(plan.order) or names
    cycle_s = plan.slot_s * len(order)
    # A two-way range is the poller's alone: teammates take turns at polling.
    pollers = 1 if plan.ranging == "one-way" else len(names) - 1
    costs: dict[str, Cost | None] = {}
    asked = fitting(scenario.resolved(), len(names)) if navigators is None else navigators
    for name in asked:
        size = packet_bytes(name, scenario.resolved(), len(names), capacity)
        if size is None:
            costs[name] = None
            continue
        acoustics.check_packet(plan, size, f"{name}'s packet")
        frames = acoustics.packet_frames(plan, size)
        costs[name] = Cost(
            packet_bytes=size,
            frames=frames,
            air_time_s=acoustics.air_time_s(link, frames),
            slot_needed_s=acoustics.slot_needed_s(plan, frames),
            survive=acoustics.packet_survival(plan, frames),
        )
    if plan.packet_bytes is not None:
        acoustics.check_packet(plan, plan.packet_bytes)
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
            name: 60 * sum(other != name for other in order) / cycle_s / pollers for name in names
        },
        costs=costs,
    )


def refuse_misfits(navigators: Iterable[str], tables: Mapping[str, Any], vehicles: int) -> None:
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


def fitting(tables: Mapping[str, Any], vehicles: int) -> list[str]:
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
                refuse_misfits([name], tables, vehicles)
            except ScheduleError:
                continue
        fits.append(name)
    return fits


def packet_bytes(name: str, tables: Mapping[str, Any], vehicles: int, capacity_bytes: int) -> int | None:
    """Length of what a packaged navigator sends once it has started; None if it sends nothing.

    A navigator that fits its packet to the slot is asked with the slot's capacity; one whose packet is too
    long for it, without a limit, so that the schedule can say what is missing. `tables`: a resolved scenario.
    """
    context = Context(0, vehicles, tables["acoustics"]["sound_speed_mps"], 0, None, ranging_of(tables))
    navigator = build(name, context, options_of(name, tables), None)
    if isinstance(navigator, _native.TeamEstimator):
        return None
    start = {"e_m": 0.0, "n_m": 0.0, "cov_ee_m2": 1.0, "cov_en_m2": 0.0, "cov_nn_m2": 1.0}
    navigator.handle(_native.Event(0, 0, "fix", **start))
    try:
        packet = navigator.transmit(0, capacity_bytes)
    except NavigatorError:
        packet = navigator.transmit(0, acoustics.NO_LIMIT_BYTES)
    return None if packet is None else len(packet)


def ranging_of(tables: Mapping[str, Any]) -> tuple[bool, ...]:
    """By vehicle, whether it uses ranges; empty where a resolved scenario, or a log of another origin, does not say."""
    team = tables.get("vehicles", ())
    return tuple(bool(v.get("fuses_ranges", True)) for v in team) if isinstance(team, list | tuple) else ()
