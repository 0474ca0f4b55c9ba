"""UTIAS MRCLAM (Leung et al. 2011): wheeled robots that measure range and bearing of each other -> `MissionLog`.

One robot is the landmark while its odometry shows that it stands still; the others move by theirs. The mover's camera
measures the range and the own bearing of the landmark; the landmark's camera measures the range and the peer's bearing.
The recordings hold all sightings: a schedule thins them out here, and losses are drawn. The landmark's pose at the
start is the frame. No role is exchanged: no robot stops while another has just stood still.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import xarray as xr
from pydantic import Field, ValidationError

from uwcoop.acoustics.link import Link
from uwcoop.acoustics.modem import MODEMS
from uwcoop.errors import LogError
from uwcoop.evaluation.pose_tracks import true_yaw_rad
from uwcoop.frames import turned, wrap_angle
from uwcoop.importers.bounded import refuse_array, refused
from uwcoop.importers.datasets.mrclam_files import Robot, read_data_set
from uwcoop.importers.datasets.mrclam_standing import Standing, longest, span
from uwcoop.missionlog.model import Columns, MissionLog, event_columns
from uwcoop.missionlog.validate import validate
from uwcoop.scenario.base import NonNegative, Positive, Probability, Table
from uwcoop.scenario.setup import MissionSetup
from uwcoop.scenario.validation_message import one_line
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

RATE_HZ = 5
"""Of the log's odometry and truth."""
_VALUES_PER_SAMPLE = 30
"""So many numbers are held for each sample of a robot, truth and intermediate results included."""
ROOM_M = 15.0
"""Where a range that is an outlier may lie: the arena's size."""
FRAME_SIGMA_M, FRAME_SIGMA_RAD = 1e-3, 1e-4
"""The landmark's pose is the frame: certain, but never singular."""


class MrclamOptions(Table):
    """How a data set becomes a mission. Sigmas are what its residuals show over five robots and 750 s of data set 6."""

    landmark: Annotated[int, Field(ge=1, le=5)] | None = None
    """None: the robot that stands still for the longest time while it sees others or is seen."""
    movers: Annotated[tuple[Annotated[int, Field(ge=1, le=5)], ...], Field(strict=False)] = ()
    """Empty: every other robot that the landmark sees or is seen by in the mission's time."""
    start_s: NonNegative | None = None
    """Since the landmark's first odometry; None: where it stands still for the longest time."""
    duration_s: Positive | None = None
    """None: until the landmark moves again."""
    interval_s: Positive = 1.0
    """The schedule: at most one fix of each mover in each interval."""
    pair_within_s: NonNegative = 0.2
    """So far apart in time, at most, are the two directions of one fix."""
    dropout_share: Probability = 0.1
    """Share of fixes that are lost."""
    position_sigma_m: Positive = 1.0
    heading_sigma_deg: Positive = 5.0
    """Prior of the movers, drawn."""
    velocity_sigma_mps: Positive = 0.02
    turn_rate_sigma_degps: Positive = 5.2
    """White, each sample at 5 Hz: 2.3 deg/sqrt(s)."""
    range_sigma_m: Positive = 0.2
    bearing_sigma_deg: Positive = 2.0
    fix_correlation_s: NonNegative = 5.0
    """A camera's error in range stays while it looks at the same robot: up to 0.37 m for 60 s."""
    odometry_scale_sigma: NonNegative = 0.15
    """Of an odometer's scale, a state of `landmark`: over 10 s it is 4 to 8 % too long, with a sigma of 10 % more."""
    gyro_bias_sigma_degps: NonNegative = 0.3
    """Of the turn rate's constant error, a state of `landmark`."""
    settle_s: NonNegative = 10.0
    """Errors count from here on."""


def read_mrclam(folder: str | Path, seed: int = 0, **options: Any) -> MissionLog:
    """A mission of one robot at rest and others that move.

    Args:
        folder: with `Barcodes.dat`, `RobotK_Odometry.dat`, `RobotK_Measurement.dat` and `RobotK_Groundtruth.dat`,
            each as it is or with `.gz`.
        seed: of the priors and the losses that are drawn on top.
        options: of `MrclamOptions`.

    Raises:
        LogError: a file or option that cannot be used; one line.
    """
    path = Path(folder)
    try:
        chosen = MrclamOptions(**options)
    except ValidationError as error:
        raise LogError(one_line(error, options, "mrclam")) from None
    robots, barcode_of = read_data_set(path)
    standing, notes = _standing(robots, barcode_of, chosen, f"mrclam {path}")
    number, start_s, end_s = standing.robot, standing.start_s, standing.end_s
    landmark = robots[number]
    seen = _seen(robots, barcode_of, standing)
    movers = chosen.movers or tuple(r for r, (own, peer) in seen.items() if len(own) + len(peer))
    for mover in movers:
        if mover not in seen:
            raise LogError(f"mrclam {path}: robot {mover} is the landmark or missing: it cannot be a mover")
    if not movers:
        raise LogError(f"mrclam {path}: robot {number} and the others do not see each other in this time")
    with refused(LogError, f"mrclam {path}"):
        samples = math.floor((end_s - start_s) * RATE_HZ)
        refuse_array("a mission", (1 + len(movers), samples, _VALUES_PER_SAMPLE), 8)
    times_s = start_s + np.arange(math.floor((end_s - start_s) * RATE_HZ) + 1) / RATE_HZ
    frame = _pose(landmark, np.array([start_s]))[0]
    team = (number, *movers)
    poses = np.stack([_in_frame(frame, _pose(robots[r], times_s)) for r in team])
    poses[0] = 0.0  # it stands, also where its recording of the truth ends before it does
    log = MissionLog(
        name=f"mrclam-{path.resolve().name}",
        seed=seed,
        vehicles=tuple(f"R{r}" for r in team),
        duration_ns=(len(times_s) - 1) * 1_000_000_000 // RATE_HZ,
        link=_link(),
        events=_events(chosen, seed, [robots[r] for r in team], [seen[r] for r in movers], times_s, poses),
        setup=_setup(chosen),
        truth=_truth([f"R{r}" for r in team], poses),
        notes=notes,
    )
    validate(log)
    return log


def _standing(
    robots: dict[int, Robot], barcode_of: dict[int, int], options: MrclamOptions, where: str
) -> tuple[Standing, tuple[str, ...]]:
    """The landmark and its time at rest, and what was assumed."""
    asked = (options.start_s, options.duration_s)
    if options.landmark is not None:
        if options.landmark not in robots:
            raise LogError(f"{where}: has no robot {options.landmark}")
        return span(options.landmark, robots[options.landmark], *asked, where), ()

    def sees(one: Standing) -> bool:
        return any(len(own) + len(peer) for own, peer in _seen(robots, barcode_of, one).values())

    best, note = longest(robots, *asked, options.settle_s, sees, where)
    return best, (note,)


def _seen(
    robots: dict[int, Robot], barcode_of: dict[int, int], standing: Standing
) -> dict[int, tuple[Array, Array]]:
    """Sightings between the landmark and each other robot while it stands."""
    during = (standing.start_s, standing.end_s)
    return {
        r: _sightings(robots, barcode_of, standing.robot, r, during) for r in robots if r != standing.robot
    }


def _sightings(
    robots: dict[int, Robot],
    barcode_of: dict[int, int],
    landmark: int,
    mover: int,
    span: tuple[float, float],
) -> tuple[Array, Array]:
    """(time, range, bearing) of the landmark by the mover, and of the mover by the landmark, (K, 3) each."""
    both = []
    for observer, subject in ((mover, landmark), (landmark, mover)):
        rows = robots[observer].measured
        mine = (rows[:, 1] == barcode_of[subject]) & (rows[:, 0] >= span[0]) & (rows[:, 0] <= span[1])
        mine &= rows[:, 2] > 0
        both.append(rows[mine][:, [0, 2, 3]])
    return both[0], both[1]


def _fixes(
    options: MrclamOptions, sightings: tuple[Array, Array], start_s: float, rng: np.random.Generator
) -> Array:
    """(time, range, own bearing, peer's bearing), (K, 4), thinned out and with losses; NaN: not measured."""
    own, peer = sightings
    count = int(len(own) + len(peer))
    rows = np.full((count, 4), np.nan)
    rows[: len(own), :3] = own
    rows[len(own) :, [0, 1, 3]] = peer
    for k in range(len(own)) if len(peer) else ():
        near = int(np.argmin(np.abs(peer[:, 0] - own[k, 0])))
        if abs(peer[near, 0] - own[k, 0]) <= options.pair_within_s:
            rows[k, 3] = peer[near, 2]
    # In each interval the sighting with the most measurements, the first of equals.
    slot = np.floor((rows[:, 0] - start_s) / options.interval_s)
    order = np.lexsort((rows[:, 0], np.isnan(rows).sum(axis=1), slot))
    kept = rows[order][np.unique(slot[order], return_index=True)[1]]
    return kept[rng.random(len(kept)) >= options.dropout_share]


def _events(
    options: MrclamOptions,
    seed: int,
    robots: list[Robot],
    sightings: list[tuple[Array, Array]],
    times_s: Array,
    poses: Array,
) -> dict[str, Columns]:
    count = len(robots)
    t_ns = np.arange(len(times_s), dtype=np.int64) * (1_000_000_000 // RATE_HZ)
    starts, everyone = np.zeros(count, dtype=np.int64), np.arange(count)
    sigma_m = np.array([FRAME_SIGMA_M] + [options.position_sigma_m] * (count - 1))
    sigma_rad = np.array([FRAME_SIGMA_RAD] + [math.radians(options.heading_sigma_deg)] * (count - 1))
    draws = np.array([stream(seed, v, Purpose.DEPLOYMENT).standard_normal(3) for v in range(count)])
    draws[0] = 0.0
    first = poses[:, 0] + draws * np.column_stack([sigma_m, sigma_m, sigma_rad])
    moved = np.stack([_held(robot.odometry, times_s) for robot in robots]) * RATE_HZ
    steps = len(times_s) - 1
    each, who = np.tile(t_ns[:-1], count), np.repeat(everyone, steps)
    fixes = []
    for v, seen in enumerate(sightings, start=1):
        rows = _fixes(options, seen, float(times_s[0]), stream(seed, v, Purpose.MUTUAL_LUCK))
        fixes.append(np.column_stack([np.full(len(rows), v), rows]))
    fix = np.concatenate(fixes)
    at = np.round((fix[:, 1] - times_s[0]) * 1e9).astype(np.int64)
    inside = (at >= 0) & (at <= t_ns[-1])
    fix, at = fix[inside], at[inside]
    return {
        "fix": event_columns(
            "fix", starts, everyone, e_m=first[:, 0], n_m=first[:, 1],
            cov_ee_m2=sigma_m**2, cov_en_m2=np.zeros(count), cov_nn_m2=sigma_m**2,
        ),
        "heading": event_columns("heading", starts, everyone, yaw_rad=wrap_angle(first[:, 2]), sigma_rad=sigma_rad),
        "ground_velocity": event_columns(
            "ground_velocity", each, who, forward_mps=moved[:, :, 0].ravel(), left_mps=np.zeros(count * steps),
            sigma_mps=np.full(count * steps, options.velocity_sigma_mps),
        ),
        "turn_rate": event_columns(
            "turn_rate", each, who, yaw_rate_radps=moved[:, :, 1].ravel(),
            sigma_radps=np.full(count * steps, math.radians(options.turn_rate_sigma_degps)),
        ),
        "acoustic_fix": event_columns(
            "acoustic_fix", at, fix[:, 0].astype(np.int64), peer=np.zeros(len(fix), dtype=np.int64), transmit_ns=at,
            range_m=fix[:, 2], own_bearing_rad=wrap_angle(fix[:, 3]), peer_bearing_rad=wrap_angle(fix[:, 4]),
            peer_depth_m=np.full(len(fix), np.nan),  # on the floor of a hall
        ),
        "landed": event_columns("landed", [0], [0]),
        "role_taken": event_columns("role_taken", starts, everyone, landmark=everyone == 0),
    }  # fmt: skip


def _held(odometry: Array, times_s: Array) -> Array:
    """Distance and turn between times (K + 1,) by values that hold until the next, (K, 2)."""
    known = odometry[:, 0]
    sums = np.vstack([np.zeros(2), np.cumsum(odometry[:-1, 1:] * np.diff(known)[:, None], axis=0)])
    return np.column_stack([np.diff(np.interp(times_s, known, column)) for column in sums.T])


def _pose(robot: Robot, times_s: Array) -> Array:
    """True (x, y, yaw) at times, (K, 3); the last known one after the end."""
    table = robot.truth
    x, y = (np.interp(times_s, table[:, 0], column) for column in table[:, 1:3].T)
    inside = np.clip(times_s, table[0, 0], table[-1, 0])
    return np.column_stack([x, y, true_yaw_rad(table[:, 0], table[None, :, 3], inside)[0]])


def _in_frame(frame: Array, poses: Array) -> Array:
    """Poses (K, 3) seen from a pose."""
    angle = np.full(len(poses), -frame[2])
    return np.column_stack([turned(poses[:, :2] - frame[:2], angle), wrap_angle(poses[:, 2] - frame[2])])


def _truth(names: list[str], poses: Array) -> xr.Dataset:
    return xr.Dataset(
        {
            "position_m": (("vehicle", "time", "axis"), poses[:, :, :2], {"units": "m"}),
            "yaw_rad": (("vehicle", "time"), poses[:, :, 2], {"units": "rad"}),
        },
        coords={
            "vehicle": names,
            "time": ("time", np.arange(poses.shape[1]) / RATE_HZ, {"units": "s"}),
            "axis": ["east", "north"],
        },
    )


def _setup(options: MrclamOptions) -> MissionSetup:
    """The set-up that a replay reads beside the events: navigators, and sigmas of the sensors."""
    return MissionSetup.parse({
        "mrclam": options.model_dump(mode="json", exclude_none=True),
        "metrics": {"settle_s": options.settle_s},
        "navigators": ["dead-reckoning-dvl", "landmark-paper", "landmark-ekf", "landmark"],
        "navigator": {
            "all": {
                "sigma_range_m": options.range_sigma_m,
                "sigma_own_bearing_deg": options.bearing_sigma_deg,
                "sigma_peer_bearing_deg": options.bearing_sigma_deg,
                "outlier_width_m": ROOM_M,
                "sigma_velocity_constant_mps": options.velocity_sigma_mps,
                "sigma_velocity_root": 0.0,
                "sigma_yaw_rate_degps": options.turn_rate_sigma_degps,
            },
            "landmark": {"fix_correlation_s": options.fix_correlation_s, **_bias_states(options)},
        },
    })  # fmt: skip


def _bias_states(options: MrclamOptions) -> dict[str, Any]:
    """Priors of what odometers and gyros have wrong, where there are any."""
    scale, gyro_degps = options.odometry_scale_sigma, options.gyro_bias_sigma_degps
    if not (scale > 0 or gyro_degps > 0):
        return {}
    return {"bias_states": True, "sigma_dvl_scale0": scale, "sigma_gyro_bias0_degps": gyro_degps}


def _link() -> Link:
    modem = MODEMS["aloc"]
    return Link("aloc", modem.frame_bytes, modem.max_frames, modem.frame_s, modem.preamble_s, 1500.0)
