"""Fixes, USBL positions and truth in the local frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.frames import LocalFrame
from uwcoop.importers.import_config import PositionSensor, UsblSensor
from uwcoop.importers.mapping.heading import sentence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.importers.import_config import ImportConfig
    from uwcoop.importers.mapping.binding import Binding
    from uwcoop.importers.mapping.series import Series
    from uwcoop.importers.mapping.vehicle_data import Known, MissionParts

    Floats = NDArray[np.float64]

__all__ = ["add_fix", "add_usbl", "local_frame", "measured_ns", "positions_m"]

SIGMA_M = {"fix": 5.0, "usbl": 5.0, "truth": 5.0}
_FLOOR_M2 = 1e-4
_MOST_M2 = 1e8


def local_frame(
    config: ImportConfig, bound: Sequence[tuple[Binding, Series]]
) -> tuple[LocalFrame | None, str]:
    """The frame of the mission: around `origin_deg`, else around the first fix, rounded; None: nothing is in degrees.

    Raises:
        LogError: positions in metres beside those in degrees, with no origin told.
    """
    metric = [b for b, s in bound if "east" in s.values and b.role in ("fix", "usbl", "truth")]
    degrees = [(b, s) for b, s in bound if "latitude" in s.values]
    if config.origin_deg is not None:
        return LocalFrame.at(*config.origin_deg), "origin as set"
    if metric and degrees:
        raise LogError(
            f"{metric[0].where} is in metres and {degrees[0][0].where} in degrees: origin_deg = [latitude, "
            "longitude] says where the metres count from"
        )
    if not degrees:
        return (
            None,
            "no position is in degrees: the frame is that of the positions in metres, its place is not known",
        )
    _, first = min(degrees, key=lambda item: int(item[1].t_ns[0]))
    latitude, longitude = (round(float(first.values[q][0]), 4) for q in ("latitude", "longitude"))
    return LocalFrame.at(latitude, longitude), "origin at the first fix, rounded to 0.0001 deg"


def positions_m(binding: Binding, found: Series, known: Known) -> Floats:
    """(N, 2) east and north of the navigated point.

    Raises:
        LogError: degrees that are radians, or no frame.
    """
    values = found.values
    if "latitude" in values:
        _refuse_radians(binding, values["latitude"], values["longitude"])
        assert known.frame is not None
        at = known.frame.to_local(values["latitude"], values["longitude"])
    else:
        east, north = values["east"], values["north"]
        at = np.column_stack([north, east] if binding.frame in ("ned", "frd") else [east, north])
    if binding.role == "usbl":
        return at
    return np.asarray(at - known.offset_m(binding.settings.lever_arm_m, found.t_ns)[:, :2])


def add_fix(binding: Binding, found: Series, known: Known, parts: MissionParts) -> None:
    """`fix` events."""
    settings = binding.settings
    assert isinstance(settings, PositionSensor)
    found = found.thinned("fix", settings.max_rate_hz)
    at = positions_m(binding, found, known)
    ee, en, nn, how = _covariance(binding, found, settings)
    parts.add(
        "fix", known.index, found.t_ns, e_m=at[:, 0], n_m=at[:, 1], cov_ee_m2=ee, cov_en_m2=en, cov_nn_m2=nn
    )  # fmt: skip
    parts.said.append(sentence(binding, found, how))


def add_usbl(
    binding: Binding, found: Series, known: Known, parts: MissionParts, ship: tuple[Known, Floats] | None
) -> None:
    """`usbl` events: positions, or what bearing, elevation and range from a transceiver give.

    Args:
        ship: the vehicle that carries the transceiver, and its (N, 2) position when each was measured.
    """
    settings = binding.settings
    assert isinstance(settings, UsblSensor)
    found = found.thinned("usbl", settings.max_rate_hz)
    measured = measured_ns(found, settings)
    if "bearing" in found.values:
        at, (ee, en, nn), how = _of_bearings(binding, found, measured, known, ship)
    else:
        at = positions_m(binding, found, known)
        ee, en, nn, how = _covariance(binding, found, settings)
    at = at - known.offset_m(settings.lever_arm_m, measured)[:, :2]
    parts.add(
        "usbl", known.index, found.t_ns, measured_ns=measured, e_m=at[:, 0], n_m=at[:, 1], cov_ee_m2=ee, cov_en_m2=en,
        cov_nn_m2=nn,
    )  # fmt: skip
    age_s = float(np.median(found.t_ns - measured)) / 1e9
    aged = f", {age_s:.3g} s old" if age_s else ""
    parts.said.append(sentence(binding, found, how + aged))


def measured_ns(found: Series, settings: UsblSensor) -> NDArray[np.int64]:
    """(N,) when each position was measured: its stamp less its age."""
    age_s = found.values.get("age", np.full(len(found.t_ns), settings.age_s))
    age_ns: NDArray[np.int64] = np.round(np.nan_to_num(np.clip(age_s, 0, 999)) * 1e9).astype(np.int64)
    return found.t_ns - age_ns


def _covariance(
    binding: Binding, found: Series, settings: PositionSensor
) -> tuple[Floats, Floats, Floats, str]:
    count = len(found.t_ns)
    values = found.values
    none = np.zeros(count)
    if settings.sigma_m is not None:
        square = np.full(count, settings.sigma_m**2)
        return square, none, square, f"sigma {settings.sigma_m:g} m as set"
    default = np.full(count, SIGMA_M[binding.role] ** 2)
    if "sigma" in values:
        square = np.where(np.isfinite(values["sigma"]) & (values["sigma"] > 0), values["sigma"] ** 2, default)
        return square, none, square, f"sigma {np.sqrt(np.median(square)):.3g} m as stated"
    if "cov_ee" not in values or "cov_nn" not in values:
        return default, none, default, f"sigma {SIGMA_M[binding.role]:g} m assumed"
    ee, nn, en = values["cov_ee"], values["cov_nn"], values.get("cov_en", none)
    known = np.isfinite(ee) & np.isfinite(nn) & (ee > 0) & (nn > 0) & (ee < _MOST_M2) & (nn < _MOST_M2)
    if "known" in values:  # NavSatFix: type 0 is "unknown"
        known &= values["known"] != 0
    if binding.frame in ("ned", "frd"):
        ee, nn = nn, ee
    ee, nn = (np.where(known, np.maximum(v, _FLOOR_M2), default) for v in (ee, nn))
    bound = 0.999 * np.sqrt(ee * nn)
    en = np.where(known & np.isfinite(en), np.clip(en, -bound, bound), 0.0)
    how = f"sigma {np.sqrt(np.median((ee + nn) / 2)):.3g} m as stated"
    if not known.all():
        how += f", {(~known).sum():,} without one: {SIGMA_M[binding.role]:g} m assumed"
    return ee, en, nn, how


def _of_bearings(
    binding: Binding,
    found: Series,
    measured: NDArray[np.int64],
    known: Known,
    ship: tuple[Known, Floats] | None,
) -> tuple[Floats, tuple[Floats, Floats, Floats], str]:
    settings = binding.settings
    assert isinstance(settings, UsblSensor)
    heading = np.full(len(found.t_ns), settings.transceiver_heading_deg)
    if ship is not None:
        carrier, base = ship
        if carrier.attitude is None:
            raise LogError(
                f"{binding.where}: ship {carrier.name} has no heading, from which its bearings count"
            )
        yaw, _, _ = carrier.attitude.at(measured)
        heading = 90.0 - np.rad2deg(yaw) + settings.transceiver_heading_deg
    elif settings.transceiver_deg is not None and known.frame is not None:
        base = np.repeat(
            known.frame.to_local(*([v] for v in settings.transceiver_deg)), len(found.t_ns), axis=0
        )
    else:
        raise LogError(
            f'{binding.where}: bearings need transceiver_deg = [latitude, longitude], or ship = "…"'
        )
    slant = found.values["range"]
    if "elevation" in found.values:
        level = slant * np.cos(np.deg2rad(found.values["elevation"]))
    else:
        depth = known.depth_at(measured)
        drop = (np.zeros(len(slant)) if depth is None else depth) - settings.transceiver_depth_m
        level = np.sqrt(np.maximum(slant**2 - drop**2, 0.0))
    azimuth = np.deg2rad(heading + found.values["bearing"])
    toward = np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    along, across = settings.sigma_range_m**2, (np.deg2rad(settings.sigma_bearing_deg) * level) ** 2
    across = np.maximum(across, _FLOOR_M2)
    ee = along * toward[:, 0] ** 2 + across * toward[:, 1] ** 2
    nn = along * toward[:, 1] ** 2 + across * toward[:, 0] ** 2
    en = (along - across) * toward[:, 0] * toward[:, 1]
    how = f"bearing and range, sigma {settings.sigma_bearing_deg:g} deg and {settings.sigma_range_m:g} m"
    return base + level[:, None] * toward, (ee, en, nn), how


def _refuse_radians(binding: Binding, latitude: Floats, longitude: Floats) -> None:
    small = np.abs(latitude).max() <= np.pi / 2 and np.abs(longitude).max() <= np.pi
    if small and binding.settings.unit is None and "latitude" not in binding.units:
        raise LogError(
            f"{binding.where}: positions to {np.abs(latitude).max():.4f} N and {np.abs(longitude).max():.4f} E: "
            'degrees, or radians? unit = "deg" or unit = "rad" says which'
        )
