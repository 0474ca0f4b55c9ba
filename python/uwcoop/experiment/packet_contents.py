"""The fields of a packaged navigator's packet, after some time of a mission."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uwcoop import _native, acoustics
from uwcoop.errors import NavigatorError, ScheduleError
from uwcoop.navigators import Context, build, options_of, spec_of

if TYPE_CHECKING:
    from uwcoop.scenario.setup import MissionSetup

__all__ = ["Field", "packet_bytes", "packet_fields", "packet_of"]


@dataclass(frozen=True)
class Field:
    """One field of a packet, as the encoder describes it."""

    name: str
    bits: int
    """Of one."""
    count: int
    """How many of them there are."""
    meaning: str
    """Range, step and rounding of a number; empty for counters, bitmaps and checks."""
    bounds: tuple[float, float] | None = None
    """Least and greatest value of a number in bounded steps."""

    @property
    def total_bits(self) -> int:
        """Bits of all of them."""
        return self.bits * self.count


def packet_bytes(name: str, setup: MissionSetup, vehicles: int, capacity_bytes: int) -> int | None:
    """Length of what a packaged navigator sends once it is under way, tag included; None if it sends nothing.

    A navigator that fits its packet to the slot is asked with the slot's capacity; one whose packet is too
    long for it, without a limit, so that the schedule can say what is missing.

    Raises:
        ScheduleError: the mission has no schedule.
        NavigatorError: an unknown navigator or option, or a method that the team is too large for.
    """
    packet, _ = packet_of(name, setup, vehicles, capacity_bytes)
    return None if packet is None else len(packet)


def packet_fields(name: str, setup: MissionSetup, vehicles: int, capacity_bytes: int) -> tuple[Field, ...]:
    """What a packaged navigator's packet consists of; empty if it sends nothing. As `packet_bytes`."""
    return packet_of(name, setup, vehicles, capacity_bytes)[1]


def packet_of(
    name: str, setup: MissionSetup, vehicles: int, capacity_bytes: int
) -> tuple[bytes | None, tuple[Field, ...]]:
    """A packaged navigator's packet and its fields. As `packet_bytes`."""
    options = options_of(name, setup)
    if spec_of(name).central:
        return None, ()
    plan = setup.acoustics
    if plan is None:
        raise ScheduleError(f"{name}'s packet: the mission has no table acoustics, and so no slots")
    tag_bytes = setup.authentication.tag_bytes
    context = Context(0, vehicles, plan.sound_speed_mps, 0, None, _ranging(setup.fuses_ranges, vehicles))

    def ready() -> tuple[_native.Navigator, int]:
        navigator = build(name, context, options, None)
        if setup.exchanges_roles:
            launch_ns = _landed_beside_the_landmark(navigator)
        else:
            launch_ns = _under_way(navigator, setup.sensors, plan.slot_s * vehicles)
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
    return packet, tuple(
        Field(field, bits, count, _meaning(scale), None if scale is None else (scale[1], scale[2]))
        for field, bits, count, scale in fields
    )


def _ranging(known: tuple[bool, ...], vehicles: int) -> tuple[bool, ...]:
    """Who uses ranges in a team of another size: as many as in the scenario's, and the first one only sends."""
    if len(known) == vehicles or all(known):
        return known if len(known) == vehicles else ()
    users = min(sum(known), vehicles - 1)
    return (False,) * (vehicles - users) + (True,) * users


def _under_way(navigator: _native.Navigator, sensors: Collection[str], cycle_s: float) -> int:
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
                "peer_depth_m": 2.0,
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
