"""Velocities over ground and through the water, commands, and odometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.importers.import_config import OdometrySensor, VelocitySensor
from uwcoop.importers.mapping.heading import sentence, stated_sigma
from uwcoop.importers.mapping.series import Series

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.importers.mapping.binding import Binding
    from uwcoop.importers.mapping.vehicle_data import Known, MissionParts

    Floats = NDArray[np.float64]

__all__ = ["add_command", "add_odometry", "add_velocity"]

SIGMA_MPS = {"ground_velocity": 0.02, "water_velocity": 0.1}
_ODOMETRY_STEP_S = 1.0


def body_velocity(binding: Binding, found: Series, known: Known) -> Floats:
    """(N, 2) forward and left of the navigated point, m/s: turned by the mounting, and the lever arm's turn taken off."""
    values, settings = found.values, binding.settings
    forward = values["forward"]
    if "left" in values:
        left = -values["left"] if binding.frame in ("frd", "ned") else values["left"]
    else:
        left = -values["right"] if "right" in values else np.zeros(len(forward))
    turn = np.deg2rad(settings.mounting_deg[2])
    x, y = forward * np.cos(turn) - left * np.sin(turn), forward * np.sin(turn) + left * np.cos(turn)
    arm = settings.lever_arm_m
    if arm[0] or arm[1]:
        rate = known.yaw_rate_at(found.t_ns)
        x, y = x + rate * arm[1], y - rate * arm[0]
    return np.column_stack([x, y])


def add_velocity(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`ground_velocity` or `water_velocity` events."""
    settings = binding.settings
    assert isinstance(settings, VelocitySensor)
    velocity = body_velocity(binding, found, known)
    kept = Series(
        found.t_ns, {**found.values, "x_": velocity[:, 0], "y_": velocity[:, 1]}, found.total, found.said
    ).thinned(binding.role, settings.max_rate_hz)
    sigma, how = np.full(len(kept.t_ns), settings.sigma_mps or SIGMA_MPS[binding.role]), "assumed"
    if settings.sigma_mps is not None:
        how = "as set"
    elif (stated := stated_sigma(kept)) is not None:
        sigma, how = stated, "as stated"
    parts.add(
        binding.role, known.index, kept.t_ns, forward_mps=kept.values["x_"], left_mps=kept.values["y_"], sigma_mps=sigma,
    )  # fmt: skip
    frame = "forward, right" if binding.frame in ("frd", "ned") else "forward, left"
    parts.said.append(sentence(binding, kept, f"sigma {np.median(sigma):.3g} m/s {how}", frame=frame))


def add_command(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`motion` events: the velocity through the water that was commanded, in the world."""
    kept = found.thinned("command", binding.settings.max_rate_hz)
    if "east_velocity" in kept.values:
        east, north = kept.values["east_velocity"], kept.values["north_velocity"]
        if binding.frame == "ned":
            east, north = north, east
        how = ""
    elif known.attitude is None:
        parts.said.append(
            f"{binding.vehicle} command: {binding.channel.name} is not used: a speed needs a heading"
        )
        return
    else:
        yaw, _, _ = known.attitude.at(kept.t_ns)
        east, north = kept.values["speed"] * np.cos(yaw), kept.values["speed"] * np.sin(yaw)
        how = "speed along the heading"
    parts.add("motion", known.index, kept.t_ns, velocity_e_mps=east, velocity_n_mps=north)
    parts.said.append(sentence(binding, kept, how))


def add_odometry(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`odometry` events: displacements in the body between poses a second apart at least."""
    settings = binding.settings
    assert isinstance(settings, OdometrySensor)
    values = found.values
    if "qw" in values:
        yaw = np.arctan2(
            2 * (values["qw"] * values["qz"] + values["qx"] * values["qy"]),
            1 - 2 * (values["qy"] ** 2 + values["qz"] ** 2),
        )
    else:
        yaw = np.deg2rad(values["yaw"])
    x, y = values["x"], values["y"]
    if binding.frame == "ned":
        x, y, yaw = y, x, np.pi / 2 - yaw
    yaw = yaw - np.deg2rad(settings.mounting_deg[2])
    forward, left, _ = settings.lever_arm_m
    x, y = x - forward * np.cos(yaw) + left * np.sin(yaw), y - forward * np.sin(yaw) - left * np.cos(yaw)
    rate = settings.max_rate_hz or 1 / _ODOMETRY_STEP_S
    kept = Series(found.t_ns, {"x": x, "y": y, "yaw": np.unwrap(yaw)}, found.total, found.said).thinned(
        "odometry", rate
    )
    dx, dy, turn = (np.diff(kept.values[q]) for q in ("x", "y", "yaw"))
    before = kept.values["yaw"][:-1]
    seconds = np.diff(kept.t_ns) / 1e9
    variance, yaw_variance = (
        settings.sigma_m_per_sqrt_s**2 * seconds, np.deg2rad(settings.sigma_yaw_deg_per_sqrt_s) ** 2 * seconds
    )  # fmt: skip
    none = np.zeros(len(dx))
    parts.add(
        "odometry", known.index, kept.t_ns[1:],
        forward_m=dx * np.cos(before) + dy * np.sin(before), left_m=-dx * np.sin(before) + dy * np.cos(before),
        yaw_change_rad=turn, cov_ff=variance, cov_fl=none, cov_fy=none, cov_ll=variance, cov_ly=none, cov_yy=yaw_variance,
    )  # fmt: skip
    how = (
        f"displacements, sigma {settings.sigma_m_per_sqrt_s:g} m/sqrt(s) and {settings.sigma_yaw_deg_per_sqrt_s:g} "
        "deg/sqrt(s)"
    )
    parts.said.append(sentence(binding, kept, how))
