"""What the sensors of one vehicle say of each other: attitude, depth and turn rate at any instant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.importers.mapping.series import interpolated

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.frames import LocalFrame
    from uwcoop.missionlog.model import Columns

    Floats = NDArray[np.float64]
    Integers = NDArray[np.int64]

__all__ = ["Attitude", "Known", "MissionParts"]


@dataclass(frozen=True)
class Attitude:
    """Yaw from east, counter-clockwise, unwrapped; roll to starboard and pitch up. Radians."""

    t_ns: Integers
    yaw_rad: Floats
    roll_rad: Floats
    pitch_rad: Floats

    def at(self, t_ns: Integers) -> tuple[Floats, Floats, Floats]:
        """Yaw, roll and pitch at instants, (N,) each."""
        yaw, roll, pitch = (
            interpolated(t_ns, self.t_ns, v) for v in (self.yaw_rad, self.roll_rad, self.pitch_rad)
        )
        return yaw, roll, pitch


@dataclass
class Known:
    """Of one vehicle, as far as it was read."""

    index: int
    name: str
    frame: LocalFrame | None
    attitude: Attitude | None = None
    depth_ns: Integers | None = None
    depth_m: Floats | None = None
    rate_ns: Integers | None = None
    rate_radps: Floats | None = None

    def depth_at(self, t_ns: Integers) -> Floats | None:
        """Depth of the navigated point, (N,)."""
        if self.depth_ns is None or self.depth_m is None:
            return None
        return interpolated(t_ns, self.depth_ns, self.depth_m)

    def yaw_rate_at(self, t_ns: Integers) -> Floats:
        """Yaw rate, rad/s: the gyro's, else that of the heading, else 0."""
        if self.rate_ns is not None and self.rate_radps is not None:
            return interpolated(t_ns, self.rate_ns, self.rate_radps)
        if self.attitude is not None and len(self.attitude.t_ns) > 2:
            seconds = (self.attitude.t_ns - self.attitude.t_ns[0]) / 1e9
            return interpolated(t_ns, self.attitude.t_ns, np.gradient(self.attitude.yaw_rad, seconds))
        return np.zeros(len(t_ns))

    def offset_m(self, arm_m: tuple[float, float, float], t_ns: Integers) -> Floats:
        """(N, 3) east, north, up of a lever arm (forward, left, up); without an attitude its height alone."""
        if not any(arm_m):
            return np.zeros((len(t_ns), 3))
        if self.attitude is None:
            return np.tile([0.0, 0.0, arm_m[2]], (len(t_ns), 1))
        return turned_to_world(np.array(arm_m), *self.attitude.at(t_ns))


def turned_to_world(body: Floats, yaw: Floats, roll: Floats, pitch: Floats) -> Floats:
    """(N, 3) east, north, up of a vector forward, left, up of a vehicle with this attitude."""
    forward, left, up = body
    # About forward by roll (starboard down), about left by pitch (bow up), about up by yaw.
    y1, z1 = left * np.cos(roll) - up * np.sin(roll), left * np.sin(roll) + up * np.cos(roll)
    x2, z2 = forward * np.cos(pitch) - z1 * np.sin(pitch), forward * np.sin(pitch) + z1 * np.cos(pitch)
    east, north = x2 * np.cos(yaw) - y1 * np.sin(yaw), x2 * np.sin(yaw) + y1 * np.cos(yaw)
    return np.column_stack([east, north, z2])


@dataclass
class MissionParts:
    """Event tables of all vehicles as they are made, on absolute times; and what is to be said of them."""

    events: dict[str, list[Columns]] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)

    def add(
        self, kind: str, vehicle: int, t_ns: Integers, **values: Floats | Integers | NDArray[np.bool_]
    ) -> None:
        """Append events of a kind."""
        table: Columns = {"t_ns": t_ns, "vehicle": np.full(len(t_ns), vehicle, np.int64), **values}
        self.events.setdefault(kind, []).append(table)
