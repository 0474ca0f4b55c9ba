"""Attitude and turn rate: quaternions, angles or a magnetometer → yaw from east, counter-clockwise, of true north."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError, MissingDependencyError
from uwcoop.frames import wrap_angle
from uwcoop.importers.import_config import HeadingSensor, TurnRateSensor
from uwcoop.importers.mapping.series import Series
from uwcoop.importers.mapping.vehicle_data import Attitude

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.frames import LocalFrame
    from uwcoop.importers.mapping.binding import Binding
    from uwcoop.importers.mapping.vehicle_data import Known, MissionParts

    Floats = NDArray[np.float64]

__all__ = ["add_heading", "add_turn_rate", "declination_deg"]

SIGMA_DEG, SIGMA_DEGPS = 2.0, 0.1
_MOST_SIGMA_DEG = 60.0
_DEG = 180 / np.pi
_DOWN = ("ned", "frd")


def add_heading(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """The vehicle's attitude, and its heading events.

    Raises:
        LogError: radians that are taken as degrees, or the reverse; a declination that cannot be found.
    """
    settings = binding.settings
    assert isinstance(settings, HeadingSensor)
    _refuse_other_unit(binding, found)
    found = _with_orientation(found)
    attitude = _attitude(binding, found)
    said = list(found.said)
    turn = 0.0
    if settings.declination_deg == "wmm" or settings.declination_deg:
        value = settings.declination_deg
        east = (
            declination_deg(known.frame, int(found.t_ns[0]), binding.where)
            if value == "wmm"
            else float(value)
        )
        turn -= np.deg2rad(east)
        how = " by the World Magnetic Model" if value == "wmm" else ""
        said.append(f"declination {east:+.2f} deg{how}")
    elif "mag_x" in found.values:
        said.append('magnetic heading taken as true (declination_deg = "wmm" corrects it)')
    if known.frame is not None and abs(known.frame.convergence_deg) > 0.05:
        turn += np.deg2rad(known.frame.convergence_deg)
        said.append(f"turned by the grid's convergence of {known.frame.convergence_deg:+.2f} deg")
    yaw = np.unwrap(attitude.yaw_rad + turn - np.deg2rad(settings.mounting_deg[2]))
    roll = attitude.roll_rad - np.deg2rad(settings.mounting_deg[0])
    pitch = attitude.pitch_rad - np.deg2rad(settings.mounting_deg[1])
    known.attitude = Attitude(found.t_ns, yaw, roll, pitch)
    kept = Series(found.t_ns, {**found.values, "yaw_": yaw}, found.total, tuple(said)).thinned(
        "heading", settings.max_rate_hz
    )
    sigma, how = _sigma_deg(kept, settings)
    parts.add(
        "heading", known.index, kept.t_ns, yaw_rad=wrap_angle(kept.values["yaw_"]), sigma_rad=np.deg2rad(sigma),
    )  # fmt: skip
    parts.said.append(sentence(binding, kept, how, frame=_frame_said(binding)))


def add_turn_rate(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """Turn rate events, counter-clockwise."""
    settings = binding.settings
    assert isinstance(settings, TurnRateSensor)
    rate = found.values["turn_rate"] * (-1.0 if binding.frame in _DOWN else 1.0)
    if np.abs(rate).max() > 200.0 and settings.unit is None and "turn_rate" not in binding.units:
        raise LogError(
            f"{binding.where}: it reaches {np.abs(rate).max() / 57.29578:.1f} rad/s: degrees a second? "
            'unit = "deg/s" or "rad/s" says which'
        )
    known.rate_ns, known.rate_radps = found.t_ns, np.deg2rad(rate)
    kept = Series(found.t_ns, {**found.values, "rate": rate}, found.total, found.said).thinned(
        "turn_rate", settings.max_rate_hz
    )
    sigma, how = np.full(len(kept.t_ns), settings.sigma_degps or SIGMA_DEGPS), "assumed"
    if settings.sigma_degps is not None:
        how = "as set"
    elif (stated := stated_sigma(kept, _DEG)) is not None:
        sigma, how = stated, "as stated"
    parts.add(
        "turn_rate", known.index, kept.t_ns, yaw_rate_radps=np.deg2rad(kept.values["rate"]),
        sigma_radps=np.deg2rad(sigma),
    )  # fmt: skip
    parts.said.append(sentence(binding, kept, f"sigma {np.median(sigma):.3g} deg/s {how}"))


def declination_deg(frame: LocalFrame | None, t_ns: int, where: str) -> float:
    """By the World Magnetic Model, east positive.

    Raises:
        LogError: the place is not known, or the time is not of the model's years.
        MissingDependencyError: pygeomag is not installed.
    """
    if frame is None or t_ns < 315_532_800 * 10**9:
        raise LogError(f'{where}: declination_deg = "wmm" needs the place and the date: give the number')
    try:
        from pygeomag import GeoMag
    except ImportError as error:
        raise MissingDependencyError("pygeomag", "logs") from error
    when = datetime.fromtimestamp(t_ns / 1e9, UTC)
    year = when.year + (when.timetuple().tm_yday - 0.5) / 365.25
    # Each edition of the model holds for five years.
    edition = min(max(2010 + 5 * int((year - 2010) // 5), 2010), 2025)
    model = GeoMag(coefficients_file=f"wmm/WMM_{edition}.COF")
    try:
        found = model.calculate(
            glat=frame.origin.latitude_deg, glon=frame.origin.longitude_deg, alt=0, time=year
        )
    except ValueError as error:
        raise LogError(f"{where}: declination: {error}: give the number") from error
    return float(found.d)


def stated_sigma(found: Series, of_variance: float = 1.0) -> Floats | None:
    """Standard deviations that every row states: `sigma` in the quantity's unit (degrees for angles), or the root of
    `variance` times `of_variance`, since messages hold rad²."""
    for name, power in (("variance", 0.5), ("sigma", 1.0)):
        if name in found.values:
            values = found.values[name]
            if len(values) and (np.isfinite(values) & (values > 0) & (values < 1e6)).all():
                return np.asarray(values**power * (of_variance if name == "variance" else 1.0))
    return None


def sentence(binding: Binding, found: Series, how: str = "", *, frame: str = "") -> str:
    """One line of the import report: what was read of a sensor, and what was done with it."""
    about = [f"{len(found.t_ns):,} of {found.total:,} rows of {binding.channel.name}"]
    if frame:
        about.append(frame)
    if how:
        about.append(how)
    settings = binding.settings
    if any(settings.lever_arm_m):
        about.append(f"lever arm {', '.join(f'{v:g}' for v in settings.lever_arm_m)} m")
    if any(settings.mounting_deg):
        about.append(f"mounted at {', '.join(f'{v:g}' for v in settings.mounting_deg)} deg")
    if settings.offset_s:
        about.append(f"stamps {settings.offset_s:+g} s")
    return f"{binding.vehicle} {binding.role}: {'; '.join([*about, *found.said])}"


def _frame_said(binding: Binding) -> str:
    if "heading" in binding.columns:
        return "clockwise from north"
    if "mag_x" in binding.columns:
        return f"magnetometer, {'forward-right-down' if binding.frame in _DOWN else 'forward-left-up'}"
    return "yaw clockwise from north (NED)" if binding.frame in _DOWN else "yaw from east (ENU)"


def _with_orientation(found: Series) -> Series:
    if "unknown" in found.values:
        found = found.chosen(found.values["unknown"] != -1, "{} without orientation")
    if "qw" in found.values:
        norm = sum(found.values[q] ** 2 for q in ("qx", "qy", "qz", "qw"))
        found = found.chosen(np.asarray(np.abs(norm - 1) < 0.05), "{} whose quaternion is none")
    return found


def _attitude(binding: Binding, found: Series) -> Attitude:
    values, down = found.values, binding.frame in _DOWN
    zero = np.zeros(len(found.t_ns))
    if "qw" in values:
        yaw, roll, pitch = _of_quaternion(*(values[q] for q in ("qx", "qy", "qz", "qw")))
        # In ENU and FLU pitch is about the left axis, bow down; here up counts.
        yaw, pitch = (np.pi / 2 - yaw, pitch) if down else (yaw, -pitch)
        return Attitude(found.t_ns, yaw, roll, pitch)
    roll = np.deg2rad(np.nan_to_num(values.get("roll", zero)))
    pitch = np.deg2rad(np.nan_to_num(values.get("pitch", zero)))
    if "heading" in values:
        return Attitude(found.t_ns, np.deg2rad(90.0 - values["heading"]), roll, pitch)
    if "yaw" in values:
        yaw = np.deg2rad(90.0 - values["yaw"] if down else values["yaw"])
        return Attitude(found.t_ns, yaw, roll, pitch if down else -pitch)
    heading = np.arctan2(-values["mag_y"] if down else values["mag_y"], values["mag_x"])
    return Attitude(found.t_ns, np.pi / 2 - heading, zero, zero)


def _of_quaternion(x: Floats, y: Floats, z: Floats, w: Floats) -> tuple[Floats, Floats, Floats]:
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    return yaw, roll, pitch


def _refuse_other_unit(binding: Binding, found: Series) -> None:
    """Headings of a whole mission within 2 pi degrees are radians; they are asked for, not guessed."""
    name = next((q for q in ("heading", "yaw") if q in found.values), None)
    if name is None or binding.settings.unit is not None or len(found.t_ns) < 3:
        return
    values = found.values[name]
    if name in binding.units:  # stated by the type
        return
    if values.min() >= -3.2 and values.max() <= 6.3 and np.ptp(values) > 0.02:
        raise LogError(
            f"{binding.where}: {name} is {values.min():.3f} to {values.max():.3f} throughout: degrees, or radians? "
            'unit = "deg" or unit = "rad" says which'
        )


def _sigma_deg(found: Series, settings: HeadingSensor) -> tuple[Floats, str]:
    count = len(found.t_ns)
    if settings.sigma_deg is not None:
        return np.full(count, settings.sigma_deg), f"sigma {settings.sigma_deg:g} deg as set"
    stated = stated_sigma(found, _DEG)
    if stated is not None and stated.max() < _MOST_SIGMA_DEG:
        return stated, f"sigma {np.median(stated):.3g} deg as stated"
    return np.full(count, SIGMA_DEG), f"sigma {SIGMA_DEG:g} deg assumed"
