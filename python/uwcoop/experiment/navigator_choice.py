"""Which navigators take part in a mission, and whether their packets fit its slots."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from uwcoop import acoustics
from uwcoop.errors import NavigatorError, ScheduleError
from uwcoop.experiment.packet_contents import packet_bytes
from uwcoop.navigators import NAVIGATORS, options_of, spec_of

if TYPE_CHECKING:
    from uwcoop.scenario.setup import MissionSetup

__all__ = ["check_packets_fit", "default_navigators"]


def check_packets_fit(navigators: Iterable[str], setup: MissionSetup, vehicles: int) -> None:
    """Raise `ScheduleError` for a packaged navigator whose packet does not fit the mission's slots.

    A log of another origin may have no schedule: nothing is checked then.
    """
    plan = setup.acoustics
    if plan is None:
        return
    capacity = acoustics.slot_capacity_bytes(plan)
    for name in navigators:
        size = packet_bytes(name, setup, vehicles, capacity)
        if size is not None:
            acoustics.check_packet(plan, size, f"{name}'s packet")


def default_navigators(setup: MissionSetup, vehicles: int) -> list[str]:
    """The packaged navigators that take part by default: those that the scenario lists, or all that suit any
    scenario; without those whose packets are too long for its modem.

    Raises:
        NavigatorError: the scenario lists an unknown navigator, or one twice.
    """
    listed = list(setup.navigators)
    for name in listed:
        options_of(name, setup)
        if listed.count(name) > 1:
            raise NavigatorError(f"navigators lists {name!r} {listed.count(name)} times: must be once")
    fits = []
    for name in listed or [name for name, spec in NAVIGATORS.items() if not spec.listed_only]:
        if spec_of(name).needs_bandwidth:
            try:
                check_packets_fit([name], setup, vehicles)
            except ScheduleError:
                continue
        fits.append(name)
    return fits
