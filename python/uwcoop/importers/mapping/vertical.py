"""Own depth from depth sensors and pressure; water depth from altimeters, beams and depth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.import_config import AltimeterSensor, DepthSensor, PressureSensor
from uwcoop.importers.mapping.heading import sentence, stated_sigma
from uwcoop.importers.mapping.series import Series
from uwcoop.importers.mapping.vehicle_data import turned_to_world

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.importers.mapping.binding import Binding
    from uwcoop.importers.mapping.vehicle_data import Known, MissionParts

    Floats = NDArray[np.float64]
    Integers = NDArray[np.int64]

__all__ = ["add_altimeter", "add_depth", "add_pressure", "add_water_depth", "depth_of_pressure"]

SIGMA_M = 0.1
GRAVITY_MPS2 = 9.80665
ATMOSPHERE_PA = 101_325.0
_MOST_SIGMA_M = 50.0
_LONGEST_GAP_S = 10.0
_GAUGE_PA = 60_000.0
"""Lower pressures occur below no open sky: a gauge's zero is the surface."""
_GAUGE_SHARE = 0.01
"""So many readings below are no glitches: a gauge that was near the surface, however deep the dive."""


def add_depth(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`depth` events of the navigated point."""
    depth = found.values["depth"] if "depth" in found.values else -found.values["up"]
    _depths(binding, found, depth, known, parts, "")


def add_pressure(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`depth` events from water pressure."""
    settings = binding.settings
    assert isinstance(settings, PressureSensor)
    pressure = found.values["pressure"]
    if settings.surface_pa is not None:
        surface, how = settings.surface_pa, "as set"
    elif np.mean(pressure < _GAUGE_PA) >= _GAUGE_SHARE:
        surface, how = 0.0, "taken as that of a gauge"
    else:
        surface, how = ATMOSPHERE_PA, "standard"
    latitude = None if known.frame is None else known.frame.origin.latitude_deg
    depth, by = depth_of_pressure(pressure - surface, settings.density_kgpm3, latitude)
    _depths(binding, found, depth, known, parts, f"depth by {by}, {surface:g} Pa at the surface ({how})")


def depth_of_pressure(
    gauge_pa: Floats, density_kgpm3: float | None = None, latitude_deg: float | None = None
) -> tuple[Floats, str]:
    """Depth below the surface, m, of a pressure above that of the air, and by which formula.

    With a density: hydrostatic, at standard gravity. Else a standard ocean: TEOS-10 (`gsw`) where it is installed, or
    UNESCO 1983 (Fofonoff & Millard, technical paper 44, algorithm 4), at 45° where the latitude is not known.
    """
    if density_kgpm3 is not None:
        return gauge_pa / (density_kgpm3 * GRAVITY_MPS2), f"a density of {density_kgpm3:g} kg/m3"
    latitude = 45.0 if latitude_deg is None else latitude_deg
    dbar = gauge_pa / 1e4
    try:
        import gsw
    except ImportError:
        sine = np.sin(np.deg2rad(latitude)) ** 2
        gravity = 9.780318 * (1 + (5.2788e-3 + 2.36e-5 * sine) * sine) + 1.092e-6 * dbar
        polynomial = (((-1.82e-15 * dbar + 2.279e-10) * dbar - 2.2512e-5) * dbar + 9.72659) * dbar
        return np.asarray(polynomial / gravity), "UNESCO 1983"
    return np.asarray(-gsw.z_from_p(dbar, latitude), dtype=np.float64), "TEOS-10"


def _depths(
    binding: Binding, found: Series, depth: Floats, known: Known, parts: MissionParts, how: str
) -> None:
    settings = binding.settings
    assert isinstance(settings, DepthSensor)
    # The sensor is so far above the navigated point.
    depth = depth + known.offset_m(settings.lever_arm_m, found.t_ns)[:, 2]
    if np.median(depth) < -1.0:
        raise LogError(
            f"{binding.where}: depth is {depth.min():.2f} to {depth.max():.2f} m, above the surface: positive up? "
            'columns = { up = "…" } says so'
        )
    known.depth_ns, known.depth_m = found.t_ns, depth
    kept = Series(found.t_ns, {**found.values, "depth_": depth}, found.total, found.said).thinned(
        "depth", settings.max_rate_hz
    )
    sigma, stated = _sigma(kept, settings, "variance" if binding.role == "depth" else "")
    if binding.role == "pressure" and settings.sigma_m is None and (pascal := stated_sigma(kept)) is not None:
        sigma, stated = pascal / (1025.0 * GRAVITY_MPS2), "as stated"
    parts.add("depth", known.index, kept.t_ns, depth_m=kept.values["depth_"], sigma_m=sigma)
    said = f"sigma {np.median(sigma):.3g} m {stated}"
    parts.said.append(sentence(binding, kept, f"{how}, {said}" if how else said))


def _sigma(found: Series, settings: DepthSensor, variance: str = "variance") -> tuple[Floats, str]:
    if settings.sigma_m is not None:
        return np.full(len(found.t_ns), settings.sigma_m), "as set"
    stated = stated_sigma(found) if variance else None
    if stated is not None and stated.max() < _MOST_SIGMA_M:
        return stated, "as stated"
    return np.full(len(found.t_ns), SIGMA_M), "assumed"


def add_water_depth(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`water_depth` events of a column that holds it."""
    settings = binding.settings
    assert isinstance(settings, DepthSensor)
    kept = found.thinned("water_depth", settings.max_rate_hz)
    sigma, stated = _sigma(kept, settings)
    parts.add("water_depth", known.index, kept.t_ns, water_depth_m=kept.values["water_depth"], sigma_m=sigma)
    parts.said.append(sentence(binding, kept, f"sigma {np.median(sigma):.3g} m {stated}"))


def add_altimeter(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`water_depth` events: own depth, and the distance along each beam as the attitude tilts it."""
    settings = binding.settings
    assert isinstance(settings, AltimeterSensor)
    if known.depth_ns is None:
        parts.said.append(
            f"{binding.vehicle} altimeter: {binding.channel.name} is not used: a water depth needs the vehicle's depth "
            "([vehicles.depth] or [vehicles.pressure])"
        )
        return
    found = found.thinned("altimeter", settings.max_rate_hz)
    near = np.abs(found.t_ns - _nearest(found.t_ns, known.depth_ns)) <= _LONGEST_GAP_S * 1e9
    found = found.chosen(near, f"{{}} without a depth within {_LONGEST_GAP_S:g} s")
    if not len(found.t_ns):
        raise LogError(
            f"{binding.where}: none of its readings is within {_LONGEST_GAP_S:g} s of a depth: other clocks?"
        )
    depth = known.depth_at(found.t_ns)
    assert depth is not None
    depth = depth - known.offset_m(settings.lever_arm_m, found.t_ns)[:, 2]
    beams = sorted(q for q in found.values if q.startswith("beam_"))
    if "altitude" in found.values and not (beams and settings.beams == "each"):
        below, how = (
            found.values["altitude"] * _fall(binding, known, found.t_ns, np.array([0.0, 0.0, -1.0])),
            "",
        )
        if (
            known.attitude is not None
            and np.ptp(known.attitude.pitch_rad) + np.ptp(known.attitude.roll_rad) > 0
        ):
            how = "along the beam's tilt, "
        tables = [(found.t_ns, depth + below)]
    else:
        tables, how = _beams(binding, found, known, depth, beams)
    sigma, stated = _sigma(found, settings)
    for k, (t_ns, water) in enumerate(tables):
        own = sigma if len(t_ns) == len(sigma) else np.full(len(t_ns), np.median(sigma))
        # Soundings of one ping are a microsecond apart: a log holds one of a vehicle at an instant in a known order.
        parts.add("water_depth", known.index, t_ns + 1000 * k, water_depth_m=water, sigma_m=own)
    parts.said.append(
        sentence(binding, found, f"with the depth, {how}sigma {np.median(sigma):.3g} m {stated}")
    )


def _beams(
    binding: Binding, found: Series, known: Known, depth: Floats, beams: list[str]
) -> tuple[list[tuple[Integers, Floats]], str]:
    """Water depths of a DVL's beams, all or their mean."""
    settings = binding.settings
    assert isinstance(settings, AltimeterSensor)
    tilt = np.deg2rad(settings.beam_tilt_deg)
    water, there = [], []
    for k, name in enumerate(beams):
        azimuth = 2 * np.pi * (k + 0.5) / len(beams)
        direction = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)])
        along = found.values[name]
        heard = np.isfinite(along) & (along > 0)
        water.append(np.where(heard, depth + along * _fall(binding, known, found.t_ns, direction), np.nan))
        there.append(heard)
    how = f"{len(beams)} beams {settings.beam_tilt_deg:g} deg from the axis, "
    if settings.beams == "each":
        return [(found.t_ns[h], w[h]) for w, h in zip(water, there, strict=True)], how + "one sounding each, "
    heard = np.any(there, axis=0)
    table = np.array(water)[:, heard]
    return [(found.t_ns[heard], np.nanmean(table, axis=0))], how + "their mean, "


def _fall(binding: Binding, known: Known, t_ns: Integers, direction: Floats) -> Floats:
    """How far down a metre along a beam leads, (N,); `direction` is forward, left, up on the instrument."""
    zero = np.zeros(1)
    roll, pitch, yaw = (np.full(1, np.deg2rad(v)) for v in binding.settings.mounting_deg)
    mounted = turned_to_world(direction, yaw, roll, pitch)[0]
    if known.attitude is None:
        return np.full(len(t_ns), -turned_to_world(mounted, zero, zero, zero)[0, 2])
    return -turned_to_world(mounted, *known.attitude.at(t_ns))[:, 2]


def _nearest(t_ns: Integers, known_ns: Integers) -> Integers:
    after = (
        np.clip(np.searchsorted(known_ns, t_ns), 1, len(known_ns) - 1)
        if len(known_ns) > 1
        else np.zeros(len(t_ns), int)
    )
    before = np.maximum(after - 1, 0)
    closer = np.abs(known_ns[before] - t_ns) <= np.abs(known_ns[after] - t_ns)
    return np.asarray(np.where(closer, known_ns[before], known_ns[after]), dtype=np.int64)
