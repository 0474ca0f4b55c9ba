"""Every option of every packaged navigator changes the tracks of a mission made for it, or is refused."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import lru_cache
from typing import Any, get_args

import numpy as np
import pytest

import uwcoop
from uwcoop import _native
from uwcoop.errors import NavigatorError
from uwcoop.importers.datasets.recording import PlazaOptions, Recording, mission_of
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.model import event_columns
from uwcoop.navigators import NAVIGATORS, OriginOptions, options_of
from uwcoop.navigators.base import METHODS
from uwcoop.navigators.landmark import ExchangeOptions
from uwcoop.scenario import load

BIAS_OPTIONS = (
    "sigma_heading_bias0_rad",
    "sigma_heading_bias_rad_per_sqrt_s",
    "sigma_thrust_bias0_mps",
    "sigma_thrust_bias_mps_per_sqrt_s",
)
DRIFTING = (
    "duration_s=110",
    # A monitor that alarms often, so that its options have an effect.
    "navigator.all={particles=40, monitor_alarm=1.05, monitor_forgetting=0.3}",
    "navigator.all.monitor_quiet_s=3.0",
    "navigator.all.monitor_repeat_s=20.0",
    *(f"navigator.{name}={{}}" for name in ("dead-reckoning", "mpf", "team")),
)
MISSIONS: dict[str, tuple[str, tuple[str, ...]]] = {
    "particles": ("st-john-drift", DRIFTING),
    "unlimited": ("st-john-drift", (*DRIFTING, 'acoustics.modem="unlimited"')),
    "origin": ("ship-and-auv", ("duration_s=1000",)),
    "landmark": ("seafloor-survey-kidnap", ()),
    # Equation (6) serves where more packets in a row were lost than the packet has exact lags.
    "lossy": (
        "ship-and-auv",
        ("duration_s=2000", 'acoustics.losses=[{model="independent", probability=0.6}]'),
    ),
    # Clouds that are still wide when roles are exchanged.
    "vague": ("seafloor-survey-kidnap", ("exchange.static_fixes=6", "acoustics.loss.probability=0.3")),
}
"""Scenario and overrides of a mission."""

OF_ODOMETRY = ("sigma_odometry_scale", "sigma_gyro_bias_radps")
OF_EQUATION_6 = ("use_equation_6", "health_loss_max")
OF_WIDE_CLOUDS = (
    "resample_share",
    "clusters_by",
    "cluster_starts",
    "cluster_iterations",
    "cluster_tolerance",
    "cluster_ridge_one",
    "cluster_ridge_many",
    "cluster_search_points",
)
OF_A_DVL = ("sigma_dvl_scale", "sigma_dvl_misalignment_rad", "dvl_hold_s")
GATED = {"range_gate_sigmas": 1.0}

SWITCHES: dict[tuple[str, ...], dict[str, Any]] = {
    ("modes",): {"packet": "modes"},
    ("range_temper", "clock"): {"range_method": "gaussian"},
    ("consensus_window", "consensus_quorum", "consensus_agree", "consensus_disagree"): {
        "recovery_by": "consensus",
        "consensus_disagree": 3.0,
    },
    ("outlier_share", "outlier_width_m", "outlier_width_rad"): {"gate": "mixture"},
    (
        "bias_share",
        "sigma_gyro_bias0_degps",
        "sigma_gyro_bias_degps_per_sqrt_s",
        "sigma_dvl_scale0",
        "sigma_dvl_misalignment0_deg",
    ): {"bias_states": True},
    # Expectation-maximisation that is stopped early: which start it ends in then matters.
    ("cluster_starts",): {"cluster_iterations": 3, "clusters_by": "aic"},
    ("range_drift_s",): {"sigma_range_drift_m": 1.0},
    ("noise_scale_rate",): {"noise_scale_max": 5.0},
    OF_EQUATION_6: {"packet_form": "f64", "exact_lags": 1, "use_joint": False},
    OF_WIDE_CLOUDS: {
        "sigma_range_m": 3.0,
        "sigma_own_bearing_deg": 40.0,
        "sigma_peer_bearing_deg": 40.0,
        "bend_sigmas": 0.001,
        "packet_bytes": 128,
        "particles": 400,
    },
    # Never one Gaussian: particles until the end, and modes in the exchange packet.
    (
        "particles",
        "roughening",
        "yaw_limit_deg",
        "kurtosis_limit",
    ): {"bend_sigmas": 0.02, "packet_bytes": 128},
}
"""What makes a navigator read an option, where it has the switch."""

CHANGED: dict[str, Any] = {
    "sigma_position_m_per_sqrt_s": 0.5,
    "sigma_current_mps_per_sqrt_s": 0.1,
    "sigma_current0_mps": 0.5,
    "sigma_heading_bias0_rad": 0.2,
    "sigma_dvl_scale": 0.1,
    "sigma_dvl_misalignment_rad": 0.1,
    "dvl_hold_s": 8.0,
    "sigma_thrust_bias0_mps": 0.3,
    "sigma_heading_bias_rad_per_sqrt_s": 0.01,
    "sigma_thrust_bias_mps_per_sqrt_s": 0.02,
    "range_gate_sigmas": 0.3,
    "consensus_agree": 0.01,
    "range_samples": 7,
    "range_temper": 0.1,
    "entropy_sigma_m": 1.0,
    "update_entropy_sigma_m": 1.0,
    "roughening_m2": 8.0,
    "jump_share": 0.3,
    "jump_odds": 0.1,
    "sigma_depth_m": 2.0,
    "sigma_offset_m_per_sounding": 0.1,
    "student_dof": 3.0,
    "correlation_length_m": 25.0,
    "sigma_map_m": 0.5,
    "sounding_spacing_m": 4.0,
    "least_ess_share": 0.4,
    "depth_noise_factor_max": 1.0,  # as stated
    "packet_least_ess_share": 0.4,
    "packet_spacing_m": 20.0,
    "team_drift": ("dvl", "no-dvl", "dvl"),
    "group_size": 1,
    "frame_bytes": 64,
    "tag_bytes": 0,
    "offset_difference_m": 0.1,
    "exact_lags": 0,
    "gate_sigmas": 0.3,
    "packet_bytes": 16,
    "packet_format": 1,
    "particles": 60,
    "drift": "dvl",
    "monitor_alarm": 4.0,
    "monitor_forgetting": 0.5,
    # Below the alarm: it is never reached.
    "monitor_clip": 0.5,
    # Below `monitor_quiet_s`: no alarm repeats another.
    "monitor_repeat_s": 1.0,
    "fix_correlation_s": 5.0,
    "sigma_gyro_bias_radps": 1e-3,
    "sigma_range_bias_m": 5.0,
    "sigma_range_drift_m": 5.0,
    "sigma_range_m": 25.0,
    "clock": {"late_share": 0.5},
    "referee_nat": 0.0,
    "health_loss_max": 0.0,
    "speed_max_mps": 0.06,
    "bend_sigmas": 0.02,
    "yaw_limit_deg": 1.0,
    "kurtosis_limit": 0.9,
    "jump_window": 1,
    "consensus_quorum": 6,
    "cluster_starts": 30,
    "cluster_iterations": 1,
    "cluster_tolerance": 1.0,
    "cluster_ridge_one": 1.0,
    "cluster_ridge_many": 10.0,
    "cluster_search_points": 20,
    "landmark0_e_m": 1.0,
    "landmark0_n_m": 1.0,
    "landmark0_yaw_rad": 0.1,
    "sigma_gyro_bias_degps_per_sqrt_s": 0.01,
    "sigma_landing_yaw_deg": 1.0,
}
"""Values that differ from the default by enough."""


def kind_of(name: str, option: str = "") -> str:
    if option == "fill_reach_m":
        return "holes"
    if option in OF_A_DVL:
        return "dvl"
    model = NAVIGATORS[name].options
    if issubclass(model, ExchangeOptions):
        return "vague" if option in OF_WIDE_CLOUDS else "landmark"
    if issubclass(model, OriginOptions):
        if option in OF_ODOMETRY:
            return "odometry"
        return "lossy" if option in OF_EQUATION_6 else "origin"
    return "unlimited" if NAVIGATORS[name].needs_bandwidth or name == "team" else "particles"


@lru_cache
def mission(kind: str) -> MissionLog:
    if kind == "holes":
        return with_holes(mission("unlimited"))
    if kind == "dvl":
        return with_a_dvl(uwcoop.simulate(load(MISSIONS["unlimited"][0], MISSIONS["unlimited"][1]), seed=1))
    if kind == "odometry":
        return with_odometry()
    name, overrides = MISSIONS[kind]
    # Without truth no bound is computed.
    return replace(uwcoop.simulate(load(name, overrides), seed=1), truth=None)


def with_a_dvl(log: MissionLog) -> MissionLog:
    """The mission with a compass and a DVL that loses the bottom for a while."""
    assert log.truth is not None
    step_m = np.diff(log.truth.position_m.values, axis=1)
    time_s = log.truth.time.values
    over_ground = step_m / np.diff(time_s)[None, :, None]
    yaw = np.arctan2(over_ground[..., 1], over_ground[..., 0])
    tables = []
    for vehicle in range(len(log.vehicles)):
        t_ns = (time_s[:-1] * 1e9).astype(np.int64)
        own = np.full(len(t_ns), vehicle)
        small = np.full(len(t_ns), 0.02)
        heading = event_columns("heading", t_ns=t_ns, vehicle=own, yaw_rad=yaw[vehicle], sigma_rad=small)
        seen = (time_s[:-1] < 40) | (time_s[:-1] > 60)
        speed = np.hypot(*over_ground[vehicle].T)
        lock = event_columns(
            "ground_velocity", t_ns=t_ns[seen], vehicle=own[seen], forward_mps=speed[seen],
            left_mps=0 * speed[seen], sigma_mps=small[seen],
        )  # fmt: skip
        tables.append((heading, lock))
    whole = [{name: np.concatenate([t[k][name] for t in tables]) for name in tables[0][k]} for k in (0, 1)]
    order = [np.lexsort((table["vehicle"], table["t_ns"])) for table in whole]
    heading, lock = ({n: c[o] for n, c in table.items()} for table, o in zip(whole, order, strict=True))
    return replace(log, truth=None, events={**log.events, "heading": heading, "ground_velocity": lock})


def with_odometry() -> MissionLog:
    """A vehicle that drives a bend by odometry and hears a beacon."""
    count = 60
    yaw = np.linspace(0.0, 1.5, count + 1)
    place = np.cumsum(np.column_stack([np.cos(yaw), np.sin(yaw)]), axis=0)
    recording = Recording(
        name="bend",
        vehicle="robot",
        beacons={"L0": (50.0, -20.0)},
        start=(float(place[0, 0]), float(place[0, 1]), 0.0),
        odometry_s=np.arange(1.0, count + 1),
        displacement_m=np.tile([1.0, 0.0], (count, 1)),
        yaw_change_rad=np.diff(yaw),
        range_s=np.arange(1, count) + 0.5,
        range_beacon=["L0"] * (count - 1),
        range_m=np.hypot(*(place[1:count] - (50.0, -20.0)).T),
        truth_s=np.arange(count + 1.0),
        truth=np.column_stack([place, yaw]),
    )
    return replace(mission_of(recording, PlazaOptions(sigma_start_yaw_rad=0.05)), truth=None)


def with_holes(log: MissionLog) -> MissionLog:
    """The mission on a chart that has stripes without depths, wider than the default reach and narrower than another."""
    assert log.chart is not None
    depth_m = np.array(log.chart.depth_m)
    east_m = log.chart.cell_m * np.arange(depth_m.shape[1])
    depth_m[:, east_m % 700.0 < 400.0] = np.nan
    return replace(log, chart=replace(log.chart, depth_m=depth_m))


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(one)}" for key, one in value.items()) + "}"
    return json.dumps(value)


@lru_cache(maxsize=64)
def digest(name: str, options: tuple[tuple[str, str], ...], kind: str) -> str:
    told = [f"navigator.{name}.{option}={value}" for option, value in options]
    tracks = uwcoop.run(mission(kind), [name], overrides=told, clouds=False).tracks
    found = hashlib.sha256()
    for variable in sorted(tracks.data_vars):
        values = tracks[variable].values
        found.update(np.ascontiguousarray(values).tobytes())
    return found.hexdigest()


def changed(name: str, option: str, default: Any) -> Any:
    if (name, option) == ("covariance-intersection-inflated", "sigma_range_m"):
        return 0.05  # a vaguer range has no share in the intersection
    if option in CHANGED:
        return CHANGED[option]
    if isinstance(default, bool):
        return not default
    if isinstance(default, str):
        words = get_args(NAVIGATORS[name].options.model_fields[option].annotation)
        return next(word for word in words if word != default)
    if isinstance(default, int):
        return default + 1 if default < 8 else default // 2
    share = METHODS[NAVIGATORS[name].options.method]["bounds"].get(option, {}).get("le") == 1.0
    return default / 3 if share else default * 4


def base(name: str, option: str) -> dict[str, Any]:
    spec = NAVIGATORS[name]
    known = spec.options.model_fields
    found: dict[str, Any] = {}
    if "drift" in known and option in BIAS_OPTIONS and "bias_states" in known:
        found["bias_states"] = True
    if option == "sigma_range_m" and "range_gate_sigmas" in known:
        found |= GATED
    for switched, switch in SWITCHES.items():
        if option in switched:
            found |= {key: value for key, value in switch.items() if key in known}
    if name == "landmark-paper":
        found["particles"] = 300
    found = {key: value for key, value in found.items() if key != option and key not in spec.fixed}
    unread = dict(_native.unread_options(name, json.dumps(found)))
    return {key: value for key, value in found.items() if key not in unread}


def is_refused(name: str, option: str, stated: dict[str, Any]) -> bool:
    unread = dict(_native.unread_options(name, json.dumps(stated)))
    if option not in unread:
        return False
    with pytest.raises(NavigatorError, match=rf"navigator\.{name}\.{option}: not read, because "):
        digest(name, as_key(stated), kind_of(name))
    return True


@pytest.mark.parametrize("name", list(NAVIGATORS))
def test_every_option_has_an_effect_or_is_refused(name: str) -> None:
    spec = NAVIGATORS[name]
    defaults = options_of(name).model_dump()
    silent, effects = [], 0
    for option in spec.options.model_fields:
        if option in spec.fixed:
            continue
        stated = base(name, option)
        other = {**stated, option: changed(name, option, defaults[option])}
        if is_refused(name, option, other):
            continue
        effects += 1
        kind = kind_of(name, option)
        if digest(name, as_key(stated), kind) == digest(name, as_key(other), kind):
            silent.append(option)
    assert not silent, f"{name} takes {', '.join(silent)} in silence"
    assert effects >= 4


def as_key(options: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((option, toml(value)) for option, value in options.items()))
