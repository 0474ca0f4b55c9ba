"""A recording in memory, and the mission that it becomes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from uwcoop.acoustics.link import Link
from uwcoop.acoustics.modem import MODEMS, NO_LIMIT_BYTES
from uwcoop.errors import LogError
from uwcoop.missionlog.model import (
    OPPORTUNITY_COLUMNS,
    SLOT_COLUMNS,
    Columns,
    MissionLog,
    columns,
    event_columns,
)
from uwcoop.scenario.base import NonNegative, Positive, Table, nearest
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Integers = NDArray[np.int64]

SPEED_MPS = 1500.0
"""A range becomes a travel time at this speed, whatever it was measured with; it ends when the range was measured."""
LONGEST_S, FARTHEST_M = 7 * 86_400.0, 100_000.0
"""Times, since the start, and ranges beyond these are damage."""
HEADING_KNOWN_RAD = 0.35
"""With a larger sigma of the heading at the start, `mdeif` alone runs: it has hypotheses."""
NAVIGATORS = ("local-only", "cekf", "mdeif", "nekf", "interleaved", "covariance-intersection")


class Options(Table):
    """`recording.*`: values that the files do not state, or state wrongly."""

    beacons: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Whose ranges are used; empty: all. One: the geometry of a single ship."""
    sigma_range_m: Positive
    """Of a range, as the navigators weigh it."""
    gate_sigmas: Positive = 4.0
    """Ranges that contradict the belief by more sigmas are gated and counted."""
    sigma_beacon_m: Positive
    """Of the place of a beacon on each axis: the same error in all of its ranges."""
    sigma_start_m: Positive = 0.1
    """Of the place where the vehicle starts."""
    start_yaw_rad: Annotated[float, Field(ge=-2 * np.pi, le=2 * np.pi)] | None = None
    """Heading at the start, from east, counter-clockwise; None: that of the file."""
    sigma_start_yaw_rad: Annotated[float, Field(gt=0, le=4)] = 0.01
    """Of the heading at the start; 3.2: it is not known. Above 0.35 only `mdeif` has hypotheses for it."""
    sigma_odometry_m: NonNegative
    """Of each displacement on each axis, beside what grows with its length."""
    sigma_odometry_share: NonNegative
    """The part that grows with its length, along the track; across the track a third of it."""
    sigma_yaw_rad: NonNegative
    """Of each change of yaw."""
    sigma_range_bias_share: NonNegative = 1.0
    """Prior of the constant error of a beacon's ranges, as a share of `sigma_range_m`; estimated by `mdeif`. 0: none."""
    sigma_range_drift_share: NonNegative = 1.25
    """The same of the error that changes slowly, for signals close in time come by the same way. 0: none."""
    range_drift_s: Positive = 30.0
    """Time in which the correlation of that error falls to 1/e."""
    late_share: Annotated[float, Field(ge=0, le=0.9)] = 0.05
    """Share of ranges that come late by a longer way."""
    lateness_share: Positive = 5.0
    """Their mean lateness, as a multiple of `sigma_range_m`."""
    noise_scale_max: Annotated[float, Field(ge=1, le=10)] = 3.0
    """Noise may grow to so many times what is stated, as innovations show; `mdeif` only. 1: as stated."""
    sigma_odometry_scale: Positive = 1e-3
    """Prior of the scale of odometry."""
    sigma_gyro_bias_radps: NonNegative = 0.0
    """Prior of the drift rate of the yaw that is integrated."""


class PyfgOptions(Options):
    """Of factor graphs: the values found on the GOATS runs, whose files state guesses."""

    sigma_range_m: Positive = 4.0
    sigma_beacon_m: Positive = 5.0
    sigma_odometry_m: NonNegative = 0.4
    sigma_odometry_share: NonNegative = 0.0
    sigma_yaw_rad: NonNegative = 1e-4
    range_delay_edges: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """So much of an edge of odometry before its pose a range was heard. 0: at the pose, as the format has it. Where poses
    were made of what came in since the one before, as on the GOATS runs, a half is the middle of what can be."""


class PlazaOptions(Options):
    """Of the Plaza files: a gyro that hardly drifts, an odometer that slips, ranges that read up to 5 m long. No heading
    is measured: the file's is that of the truth."""

    sigma_range_m: Positive = 3.0
    sigma_start_yaw_rad: Annotated[float, Field(gt=0, le=4)] = 3.2
    gate_sigmas: Positive = 6.0
    sigma_beacon_m: Positive = 0.01
    sigma_odometry_m: NonNegative = 0.01
    sigma_odometry_share: NonNegative = 0.05
    sigma_yaw_rad: NonNegative = 1e-3


class LabyrinthOptions(Options):
    """Of the indoor UWB files: sigmas as the file states them; the heading at the start is not known."""

    sigma_range_m: Positive = 0.1
    sigma_beacon_m: Positive = 0.01
    sigma_start_yaw_rad: Annotated[float, Field(gt=0, le=4)] = 3.2
    sigma_odometry_m: NonNegative = 0.001
    sigma_odometry_share: NonNegative = 0.05
    sigma_yaw_rad: NonNegative = 0.01


@dataclass(frozen=True)
class Recording:
    """One vehicle's odometry and its ranges to beacons, in metres, radians and seconds from the start."""

    name: str
    vehicle: str
    beacons: dict[str, tuple[float, float]]
    start: tuple[float, float, float]
    """East, north, yaw."""
    odometry_s: Floats
    """(N,) ascending: when each displacement is done."""
    displacement_m: Floats
    """(N, 2) forward and left since the one before."""
    yaw_change_rad: Floats
    """(N,)."""
    range_s: Floats
    """(M,) in any order."""
    range_beacon: list[str]
    """(M,)."""
    range_m: Floats
    """(M,)."""
    truth_s: Floats
    """(T,) ascending."""
    truth: Floats
    """(T, 3) east, north, yaw."""
    odometry_share: Floats | None = None
    """(N,) share of an edge that each displacement is; its variance is the same share. None: each is a whole edge."""


def mission_of(found: Recording, options: Options) -> MissionLog:
    """The recording as a mission of the vehicle and the chosen beacons.

    Raises:
        LogError: a beacon that is not in the recording, or nothing to replay.
    """
    for name in options.beacons:
        if name not in found.beacons:
            raise LogError(
                f"recording {found.name} has no beacon {name!r}: {nearest(name, list(found.beacons))}"
            )
    beacons = [name for name in found.beacons if not options.beacons or name in options.beacons]
    used = np.isin(found.range_beacon, beacons) if found.range_beacon else np.zeros(0, bool)
    if not used.any() or not found.odometry_s.size:
        raise LogError(f"recording {found.name} has no ranges, or no odometry, to replay")
    vehicles = (found.vehicle, *beacons)
    sender = np.array([vehicles.index(b) for b, use in zip(found.range_beacon, used, strict=True) if use])
    longest_s = max(float(np.abs(a).max()) for a in (found.odometry_s, found.range_s[used], found.truth_s))
    farthest_m = float(found.range_m[used].max())
    if not (longest_s <= LONGEST_S and farthest_m <= FARTHEST_M):
        raise LogError(
            f"recording {found.name} has times to {longest_s:g} s and ranges to {farthest_m:g} m: "
            f"must be at most {LONGEST_S:g} s and {FARTHEST_M:g} m"
        )
    slots, opportunities = _signals(found.range_s[used], sender, found.range_m[used])
    end_s = float(np.ceil(max(found.odometry_s[-1], opportunities["toa_ns"].max() / 1e9, found.truth_s[-1])))
    modem = MODEMS["unlimited"]
    navigators = NAVIGATORS if options.sigma_start_yaw_rad <= HEADING_KNOWN_RAD else ("mdeif",)
    return MissionLog(
        name=found.name,
        seed=0,
        vehicles=vehicles,
        duration_ns=round(end_s) * 1_000_000_000,
        link=Link("unlimited", modem.frame_bytes, modem.max_frames, 0.0, 0.0, SPEED_MPS),
        events=_events(found, options, beacons),
        slots=slots,
        opportunities=opportunities,
        setup=MissionSetup.parse(
            {
                "name": found.name,
                "recording": options.model_dump(mode="json"),
                "metrics": {"settle_s": 0.0},
                "navigators": list(navigators),
                "vehicles": [{"name": name, "fuses_ranges": name == found.vehicle} for name in vehicles],
                "navigator": _navigator_options(options),
            }
        ),
        truth=_truth(found, beacons),
        notes=_notes(found, options),
    )


def _notes(found: Recording, options: Options) -> tuple[str, ...]:
    """What was assumed."""
    if options.sigma_start_yaw_rad <= HEADING_KNOWN_RAD:
        return ()
    return (
        f"heading at the start: not measured (sigma {options.sigma_start_yaw_rad:g} rad): only mdeif has hypotheses "
        "for it; recording.sigma_start_yaw_rad states one that is known",
    )


def _navigator_options(options: Options) -> dict[str, dict[str, Any]]:
    """What navigators are told of ranges and odometry."""
    sigma_m = options.sigma_range_m
    lasting = {
        "sigma_range_bias_m": options.sigma_range_bias_share * sigma_m,
        "sigma_range_drift_m": options.sigma_range_drift_share * sigma_m,
        "noise_scale_max": options.noise_scale_max,
    }
    if options.sigma_range_drift_share > 0:
        lasting["range_drift_s"] = options.range_drift_s
    return {
        "all": {
            "sigma_range_m": sigma_m,
            "gate_sigmas": options.gate_sigmas,
            "sigma_odometry_scale": options.sigma_odometry_scale,
            "sigma_gyro_bias_radps": options.sigma_gyro_bias_radps,
            "clock": {"late_share": options.late_share, "lateness_m": options.lateness_share * sigma_m},
        },
        "mdeif": lasting,
    }


def _ascending(t_ns: Integers) -> Integers:
    """The same times, equal ones a microsecond apart: no two signals start together."""
    spread = t_ns.copy()
    for k in range(1, len(spread)):
        spread[k] = max(spread[k], spread[k - 1] + 1000)
    return spread


def _signals(range_s: Floats, sender: Integers, range_m: Floats) -> tuple[Columns, Columns]:
    """A slot for each range, heard by the vehicle for certain when the range was measured."""
    travel_ns = np.round(range_m / SPEED_MPS * 1e9).astype(np.int64)
    launch_ns = np.maximum(np.round(range_s * 1e9).astype(np.int64) - travel_ns, 0)
    order = np.argsort(launch_ns, kind="stable")
    tol_ns, travel_ns, sender = _ascending(launch_ns[order]), travel_ns[order], sender[order]
    count = len(tol_ns)
    slots = columns(
        SLOT_COLUMNS, tol_ns=tol_ns, sender=sender, capacity_bytes=np.full(count, NO_LIMIT_BYTES, np.int64)
    )
    opportunities = columns(
        OPPORTUNITY_COLUMNS,
        tol_ns=tol_ns,
        sender=sender,
        receiver=np.zeros(count, np.int64),
        toa_ns=tol_ns + travel_ns,
        survive_probability=np.ones(count),
    )
    opportunities["draws"] = np.zeros((count, 1))
    return slots, opportunities


def _events(found: Recording, options: Options, beacons: list[str]) -> dict[str, Columns]:
    """Headings and fixes at the start of all, the vehicle's odometry, and one of rest for each beacon."""
    everyone = np.arange(1 + len(beacons))
    none = np.zeros(len(everyone), np.int64)
    places = np.array([found.start[:2], *(found.beacons[b] for b in beacons)])
    variance = np.array([options.sigma_start_m, *[options.sigma_beacon_m] * len(beacons)]) ** 2
    start_yaw_rad = found.start[2] if options.start_yaw_rad is None else options.start_yaw_rad
    yaw = np.array([start_yaw_rad, *[0.0] * len(beacons)])
    sigma_yaw = np.array([options.sigma_start_yaw_rad, *[0.0] * len(beacons)])
    still = len(beacons)
    share = np.ones(len(found.odometry_s)) if found.odometry_share is None else found.odometry_share
    length = np.hypot(*found.displacement_m.T) / share
    along = options.sigma_odometry_m**2 + (options.sigma_odometry_share * length) ** 2
    across = options.sigma_odometry_m**2 + (options.sigma_odometry_share * length / 3) ** 2
    along, across = along * share, across * share
    zero = np.zeros(still + len(length))

    def padded(values: Floats) -> Floats:
        return np.concatenate([np.zeros(still), values])

    return {
        "heading": event_columns("heading", none, everyone, yaw_rad=yaw, sigma_rad=sigma_yaw),
        "fix": event_columns(
            "fix", none, everyone, e_m=places[:, 0], n_m=places[:, 1],
            cov_ee_m2=variance, cov_en_m2=np.zeros(len(everyone)), cov_nn_m2=variance,
        ),
        "odometry": event_columns(
            "odometry",
            np.concatenate([np.zeros(still), np.round(found.odometry_s * 1e9)]).astype(np.int64),
            np.concatenate([everyone[1:], np.zeros(len(length), np.int64)]),
            forward_m=padded(found.displacement_m[:, 0]), left_m=padded(found.displacement_m[:, 1]),
            yaw_change_rad=padded(found.yaw_change_rad),
            cov_ff=padded(along), cov_fl=zero, cov_fy=zero, cov_ll=padded(across), cov_ly=zero,
            cov_yy=padded(share * options.sigma_yaw_rad**2),
        ),
    }  # fmt: skip


def _truth(found: Recording, beacons: list[str]) -> xr.Dataset:
    import xarray as xr

    shape = (1 + len(beacons), len(found.truth_s))
    position = np.empty((*shape, 2))
    yaw = np.zeros(shape)
    position[0], yaw[0] = found.truth[:, :2], found.truth[:, 2]
    for k, name in enumerate(beacons, 1):
        position[k] = found.beacons[name]
    data: dict[str, Any] = {
        "position_m": (("vehicle", "time", "axis"), position, {"units": "m"}),
        "yaw_rad": (("vehicle", "time"), yaw, {"units": "rad"}),
    }
    coordinates = {
        "vehicle": [found.vehicle, *beacons],
        # Whole nanoseconds, as a log on disk holds them.
        "time": ("time", np.round(found.truth_s * 1e9) / 1e9, {"units": "s"}),
        "axis": ["east", "north"],
    }
    return xr.Dataset(data, coords=coordinates)
