"""Which navigators take part in a mission, and whether their packets fit its slots."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from uwcoop import acoustics
from uwcoop.errors import NavigatorError, ScheduleError
from uwcoop.experiment.packet_contents import packet_bytes, packet_fields
from uwcoop.navigators import NAVIGATORS, options_of, spec_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog
    from uwcoop.scenario.setup import MissionSetup

__all__ = ["check_packets_fit", "check_plan_fits", "default_navigators"]


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


def check_plan_fits(navigators: Iterable[str], log: MissionLog) -> None:
    """Refuse a mission that was planned where a packaged navigator's packet cannot say it: a vehicle deeper than the
    depth field reaches, or further from the origin than the position fields do. It would be silent there.

    A mission that has happened is not refused: its silent slots are counted as `unsent`.

    Raises:
        ScheduleError: names the navigator, vehicle, value and bound.
    """
    plan, truth = log.setup.acoustics, log.known_truth
    if plan is None or truth is None:
        return
    capacity = acoustics.slot_capacity_bytes(plan)
    position_m, depth_m = (truth[name].to_numpy() for name in ("position_m", "depth_m"))
    reached: dict[str, tuple[str, NDArray[np.float64]]] = {
        "sender's depth": ("depth", depth_m),
        "mean easting": ("easting", position_m[..., 0]),
        "mean northing": ("northing", position_m[..., 1]),
    }
    for name in navigators:
        for field in packet_fields(name, log.setup, len(log.vehicles), capacity):
            if field.bounds is None or field.name not in reached:
                continue
            quantity, values = reached[field.name]
            least, greatest = field.bounds
            beyond = np.maximum(least - values, values - greatest)
            vehicle, instant = np.unravel_index(np.argmax(beyond), beyond.shape)
            if beyond[vehicle, instant] > 0:
                raise ScheduleError(
                    f"vehicle {log.vehicles[vehicle]}: {quantity} {values[vehicle, instant]:.1f} m at t = {instant} s "
                    f"does not fit {name}'s packet, which holds {least:.10g} to {greatest:.10g} m: "
                    "plan within that, or choose other navigators"
                )


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
