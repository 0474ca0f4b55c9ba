"""Every reason for which a mission log is refused: one line that names value, bound, vehicle and time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sample_log import FRAMES, sample_log
from uwcoop.errors import LogError
from uwcoop.frames import Origin
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.validate import validate

Break = Callable[[MissionLog], object]


def _set(kind: str, column: str, row: int, value: float) -> Break:
    """Put a value into a table of the log."""

    def apply(log: MissionLog) -> None:
        table = dict(log.tables())[kind]
        table[column][row] = value

    return apply


def _swap(kind: str, *rows: int) -> Break:
    """Exchange two rows of a table."""

    def apply(log: MissionLog) -> None:
        for column in dict(log.tables())[kind].values():
            column[list(rows)] = column[list(reversed(rows))]

    return apply


def _link(**values: float) -> Break:
    return lambda log: setattr(log, "link", replace(log.link, **values))


def _truth(name: str, value: float) -> Break:
    def apply(log: MissionLog) -> None:
        assert log.truth is not None
        log.truth[name].to_numpy()[0, 0] = value

    return apply


def _truth_times(log: MissionLog) -> None:
    assert log.truth is not None
    log.truth = log.truth.assign_coords(time=log.truth["time"].to_numpy() * 0)


def _finer_than_nanoseconds(log: MissionLog) -> None:
    assert log.truth is not None
    log.truth = log.truth.assign_coords(time=log.truth["time"].to_numpy() + 1e-10)


S = 1_000_000_000
# Row 4 of an event table of three vehicles is V2's at 1 s (plus 7 ns for all but motion).
CASES: list[tuple[str, Break, str]] = [
    ("NaN water depth", _set("water_depth", "water_depth_m", 4, np.nan),
     "water_depth: water_depth_m nan of vehicle 'V2' at t = 1.000000007 s must be finite"),
    ("infinite depth", _set("depth", "depth_m", 4, -np.inf),
     "depth: depth_m -inf of vehicle 'V2' at t = 1.000000007 s must be finite"),
    ("NaN velocity", _set("motion", "velocity_n_mps", 4, np.nan),
     "motion: velocity_n_mps nan of vehicle 'V2' at t = 1 s must be finite"),
    ("NaN sigma", _set("heading", "sigma_rad", 4, np.nan), "heading: sigma_rad nan of vehicle 'V2'"),
    ("negative sigma", _set("turn_rate", "sigma_radps", 4, -0.5),
     "turn_rate: sigma_radps -0.5 of vehicle 'V2' at t = 1.000000007 s must be at least 0"),
    ("water above ground", _set("water_depth", "water_depth_m", 4, 0.0), "water_depth_m 0.0 of vehicle 'V2'"),
    ("range of zero", _set("acoustic_fix", "range_m", 4, 0.0), "range_m 0.0 of vehicle 'V2'"),
    ("infinite bearing", _set("acoustic_fix", "peer_bearing_rad", 4, np.inf), "peer_bearing_rad inf"),
    ("fix with oneself", _set("acoustic_fix", "peer", 4, 1),
     "acoustic_fix: peer 1 of vehicle 'V2' at t = 1.000000007 s must be another vehicle"),
    ("unknown peer", _set("acoustic_fix", "peer", 4, 3),
     "peer 3 of vehicle 'V2' at t = 1.000000007 s must be"),
    ("answer before question", _set("acoustic_fix", "transmit_ns", 4, 2 * S),
     "transmit_ns 2 s of vehicle 'V2' at t = 1.000000007 s must be at most the event's own time"),
    ("question before start", _set("acoustic_fix", "transmit_ns", 4, -1), "transmit_ns -0.000000001 s"),
    ("unknown vehicle", _set("depth", "vehicle", 4, 7),
     "depth: vehicle 7 at t = 1.000000007 s must be an index into the team: 0 to 2"),
    ("vehicle below zero", _set("depth", "vehicle", 4, -1), "depth: vehicle -1"),
    ("before the start", _set("motion", "t_ns", 0, -S),
     "motion: t_ns -1 s of vehicle 'V1' must be within the mission: 0 to 45 s"),
    ("after the end", _set("motion", "t_ns", -1, 46 * S), "motion: t_ns 46 s of vehicle 'V3' must be within"),
    ("out of order", _set("motion", "t_ns", 4, 0),
     "motion: t_ns 0 s of vehicle 'V2' must be in order: the row before is at 1 s"),
    ("vehicles out of order", _swap("motion", 3, 4),
     "motion: vehicle 0 at t = 1 s must be in order at equal times"),
    ("negative variance", _set("fix", "cov_nn_m2", 4, -1.0), "fix: cov_nn_m2 -1.0 of vehicle 'V2'"),
    ("correlation above one", _set("fix", "cov_en_m2", 4, 26.0),
     "fix: cov_en_m2 26.0 of vehicle 'V2' at t = 1.000000007 s must be at most the product"),
    ("certain yet correlated", _set("fix", "cov_ee_m2", 4, 0.0), "fix: cov_en_m2 -3.1"),
    ("faster than sound", _set("ground_velocity", "forward_mps", 4, 1e308),
     "ground_velocity: forward_mps 1e+308 of vehicle 'V2' at t = 1.000000007 s must be at most 1000"),
    ("below the sea floor", _set("depth", "depth_m", 4, 12_001.0), "must be at most 12000"),
    ("odometry covariance", _set("odometry", "cov_fl", 4, 1e6), "odometry: cov_fl 1000000.0 of vehicle 'V2'"),
    ("slots out of order", _swap("slots", 2, 3),
     "slots: tol_ns 9.000000017 s of vehicle 'V3' must be in order"),
    ("slot twice", _set("slots", "tol_ns", 3, 9 * S + 17),
     "slots: sender 0 at t = 9.000000017 s must be in order"),
    ("slot after the end", _set("slots", "tol_ns", -1, 50 * S), "slots: tol_ns 50 s"),
    ("negative capacity", _set("slots", "capacity_bytes", 2, -1), "slots: capacity_bytes -1 of vehicle 'V3'"),
    ("unknown sender", _set("slots", "sender", 2, 3), "slots: sender 3 at t = 9.000000017 s must be"),
    ("hears itself", _set("opportunities", "receiver", 2, 1),
     "opportunities: sender 1 of vehicle 'V2' at t = 5.000000017 s must be another vehicle"),
    ("arrives before launch", _set("opportunities", "toa_ns", 2, 5 * S),
     "opportunities: toa_ns 5 s of vehicle 'V1' at t = 5.000000017 s must be at or after the time of launch"),
    ("impossible chance", _set("opportunities", "survive_probability", 2, 1.5),
     "opportunities: survive_probability 1.5 of vehicle 'V1' at t = 5.000000017 s must be between 0 and 1"),
    ("NaN chance", _set("opportunities", "survive_probability", 2, np.nan), "survive_probability nan"),
    ("no such slot", _set("opportunities", "sender", 2, 2),
     "opportunities: sender 2 of vehicle 'V1' at t = 5.000000017 s must be one that has a slot then"),
    ("arrives twice", _set("opportunities", "receiver", 3, 0), "must be the only arrival of its slot"),
    ("draw of one", lambda log: log.opportunities["draws"].__setitem__((2, 1), 1.0),
     "opportunities: draw 1.0 at t = 5.000000017 s must be in [0, 1)"),
    ("NaN draw", lambda log: log.opportunities["draws"].__setitem__((2, 1), np.nan),
     "opportunities: draw nan"),
    ("draws too narrow", lambda log: log.opportunities.update(draws=log.opportunities["draws"][:, 1:]),
     f"opportunities: draws are float64 (20, {FRAMES - 1}), they must be float64 (20, {FRAMES})"),
    ("no draws", lambda log: log.opportunities.pop("draws"), "opportunities: column 'draws' is missing"),
    ("reception from oneself", _set("receptions", "sender", 0, 1), "receptions: sender 1 of vehicle 'V2'"),
    ("decoded before arrival", _set("receptions", "toa_ns", 0, 40 * S),
     "receptions: toa_ns 40 s of vehicle 'V2'"),
    ("reception before launch", _set("receptions", "tol_ns", 0, 2 * S),
     "must be at or after the time of launch"),
    ("payload missing", lambda log: log.payloads.pop(), "receptions: 19 payloads for 20 rows"),
    ("payload of text", lambda log: log.payloads.__setitem__(0, "x"), "receptions: a payload is str"),
    ("payloads alone", lambda log: log.receptions.clear(), "receptions: 20 payloads have no rows"),
    ("unknown kind", lambda log: log.events.update(sonar={}), "event kind 'sonar' is unknown"),
    ("missing column", lambda log: log.events["depth"].pop("sigma_m"), "depth: column 'sigma_m' is missing"),
    ("extra column", lambda log: log.events["depth"].update(x=np.zeros(3)), "depth: column 'x' is unknown"),
    ("ragged table", lambda log: log.events["depth"].update(depth_m=np.zeros(3)),
     "depth: column 'depth_m' has shape (3,), not (120,)"),
    ("float32 column", lambda log: log.events["depth"].update(depth_m=np.zeros(120, np.float32)),
     "depth: column 'depth_m' is float32, not float64"),
    ("nobody", lambda log: setattr(log, "vehicles", ()), "the team has 0 vehicles: it needs at least 1"),
    ("same name twice", lambda log: setattr(log, "vehicles", ("A", "A", "B")),
     "vehicle name 'A' is given 2 times"),
    ("nameless", lambda log: setattr(log, "vehicles", ("A", " ", "B")), "vehicle name ' ' must not be empty"),
    ("no duration", lambda log: setattr(log, "duration_ns", 0), "duration 0 s must be above 0 s"),
    ("too long", lambda log: setattr(log, "duration_ns", 2**31 * S), "duration 2147483648 s must be"),
    ("seed of text", lambda log: setattr(log, "seed", "7"), "seed '7' must be int"),
    ("origin off the globe", lambda log: setattr(log, "origin", Origin(91.0, 0.0)),
     "origin: latitude_deg 91.0"),
    ("frameless link", _link(frame_bytes=0), "link: frame_bytes 0 must be finite and at least 1"),
    ("link without frames", _link(max_frames=0), "link: max_frames 0"),
    ("negative air time", _link(frame_s=-1.0), "link: frame_s -1.0"),
    ("standing sound", _link(sound_speed_mps=0.0), "link: sound_speed_mps 0.0 must be finite and above 0"),
    ("infinite truth", _truth("depth_m", np.inf), "truth: depth_m holds an infinite value"),
    ("truth out of order", _truth_times, "truth: times must increase"),
    ("truth between nanoseconds", _finer_than_nanoseconds,
     "truth: time 1e-10 s is not a whole number of nanoseconds"),
    ("truth of others", lambda log: setattr(log, "truth", log.truth.isel(vehicle=[0, 1])),
     "truth: sizes {'vehicle': 2, 'time': 40, 'axis': 2} must be vehicle 3"),
    ("truth in another order", lambda log: setattr(log, "truth", log.truth.isel(vehicle=[1, 0, 2])),
     "truth: vehicles ['V2', 'V1', 'V3'] must be ['V1', 'V2', 'V3']"),
    ("unknown truth", lambda log: setattr(log, "truth", log.truth.rename(depth_m="depth")),
     "truth: variables"),
    ("single-precision truth", lambda log: setattr(log, "truth", log.truth.astype(np.float32)),
     "truth: current_mps is float32"),
]  # fmt: skip


@pytest.mark.parametrize(("broken", "message"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_a_log_that_cannot_be_is_refused_in_one_line(broken: Break, message: str) -> None:
    log = sample_log()
    validate(log)
    broken(log)
    with pytest.raises(LogError) as refusal:
        validate(log)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_absent_parts_are_no_error() -> None:
    """A real log may hold nothing but a depth sensor; an acoustic fix may lack what was not measured."""
    log = sample_log(seconds=5)
    bare = MissionLog(
        "bare", 0, log.vehicles, log.duration_ns, log.link, events={"depth": log.events["depth"]}
    )
    validate(bare)
    for name in ("range_m", "own_bearing_rad", "peer_bearing_rad"):
        log.events["acoustic_fix"][name][:] = np.nan
    log.truth["current_mps"].to_numpy()[:] = np.nan  # type: ignore[index]
    log.truth = log.truth.drop_vars(["yaw_rad", "depth_m"])  # type: ignore[union-attr]
    validate(log)


def test_a_singular_covariance_is_allowed() -> None:
    log = sample_log(seconds=5)
    root = np.array([0.3, -0.7, 1e-3])
    matrix = np.outer(root, root)
    for name, (i, j) in zip(
        ("ff", "fl", "fy", "ll", "ly", "yy"), zip(*np.triu_indices(3), strict=True), strict=True
    ):
        log.events["odometry"][f"cov_{name}"][:] = matrix[i, j]
    validate(log)
