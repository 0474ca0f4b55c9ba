"""Options of the alternating landmark navigators: the only place for their defaults, with units in the names.

Source, unless said otherwise: Matsuda, Maki, Sato & Sakamaki (2017); its section, table or equation is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from uwcoop import _native
from uwcoop.navigators.options import NonNegative, Positive, Share

if TYPE_CHECKING:
    from uwcoop.navigators.protocol import Context

__all__ = [
    "LANDMARK_NAVIGATORS",
    "ExchangeOptions",
    "LandmarkOptions",
    "LandmarkPaperOptions",
]

Count = Annotated[int, Field(ge=1, le=1_000_000)]
OutlierShare = Annotated[float, Field(ge=0, lt=1)]


class ExchangeOptions(BaseModel):
    """What all of them share: the acoustic channels, the frame, the packet of a role exchange."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    sigma_range_m: Positive = 0.66
    """σ_r, Table 4."""
    sigma_own_bearing_deg: Positive = 6.0
    """σ_θ of the direction that the mover measures, Table 4."""
    sigma_peer_bearing_deg: Positive = 1.0
    """σ_θ of the direction that the landmark measures, Table 4."""
    outlier_share: OutlierShare = 0.05
    """ε: how many measurements of a channel are outliers, in the mixture likelihood."""
    outlier_width_m: Positive = 60.0
    """Over how many metres an outlier's range may lie."""
    outlier_width_rad: Positive = math.tau
    """Over how much of the circle an outlier's direction may lie."""
    landmark0_e_m: float = 0.0
    """Pose of the first landmark: the frame, unless the scenario has another."""
    landmark0_n_m: float = 0.0
    landmark0_yaw_rad: float = 0.0
    packet_bytes: Literal[8, 16, 32, 40, 64, 128] = 32
    """Size of the exchange packet: whole ALOC signals of 8 bytes (section III.A)."""
    packet_format: Literal[1, 2] = 2
    """1: layout of the reference cases; 2: check over sender and launch time, variance of rounding added."""
    clusters_by: Literal["bic", "aic"] = "bic"
    """What chooses the number of clusters of a cloud (section II.D)."""
    cluster_starts: Count = 3
    """Starts of expectation-maximisation by k-means++."""
    cluster_iterations: Count = 60
    cluster_tolerance: NonNegative = 1e-5
    """A start ends when an iteration adds less to the mean log-likelihood of a particle, nat."""
    cluster_ridge_one: Positive = 1e-9
    """Added to the whitened covariance of a single cluster."""
    cluster_ridge_many: Positive = 1e-3
    """The same for two and more."""
    cluster_search_points: Count = 1000
    """Particles that the choice of the number of clusters looks at."""

    def native(self, correlation_length_m: float) -> dict[str, Any]:
        """All options, angles in radians; nothing here depends on the chart."""
        values = self.model_dump()
        for name in [key for key in values if key.endswith(("_deg", "_degps", "_degps_per_sqrt_s"))]:
            values[_in_radians(name)] = math.radians(values.pop(name))
        return values


def _in_radians(name: str) -> str:
    return name.replace("_degps", "_radps").replace("_deg", "_rad")


class LandmarkPaperOptions(ExchangeOptions):
    """Options of `landmark-paper`."""

    particles: Annotated[int, Field(ge=10, le=1_000_000)] = 3000
    """n: 3000 in the post-processing of section IV.C, 300 in the sea trial."""
    k_range: Positive = 3.0
    """k_r of (12), Table 4."""
    k_own_bearing: Positive = 3.0
    """k_θ^M of (12), Table 4."""
    k_peer_bearing: Positive = 3.0
    """k_θ^L of (14), Table 4."""
    gate: Literal["joint", "separate", "none", "mixture"] = "joint"
    """joint: range and own direction share one gate, as (12) is printed; mixture: with `outlier_share`."""
    sigma_velocity_constant_mps: NonNegative = 0.00084
    """σ_v = constant + root √|v|, Table 4."""
    sigma_velocity_root: NonNegative = 0.038
    speed_min_mps: NonNegative = 0.05
    """|v| is taken inside these bounds, Table 4."""
    speed_max_mps: NonNegative = 0.5
    sigma_yaw_rate_degps: NonNegative = 0.0745
    """σ_ω, Table 4."""
    reconstruction: bool = True
    """Particle reconstruction (section II.C); the sea trial had none."""
    monitor_ratio: Share = 0.6
    """k: 0.85³, section IV.B."""
    monitor_trials: Annotated[int, Field(ge=0, le=1000)] = 2
    """a, section IV.B."""
    monitor_reading: Literal["linear", "log"] = "log"
    """L̄ < k L_max as printed fires on a perfect filter four times out of five; log compares logarithms."""
    replace_share: Share = 0.5
    """r of (19), section IV.B."""


class LandmarkOptions(ExchangeOptions):
    """Options of `landmark`, `landmark-ekf` and `dead-reckoning-dvl`; the package's methods page is their source."""

    use_fixes: bool = True
    """Mutual positioning and exchanges; without, dead reckoning."""
    particles: Annotated[int, Field(ge=0, le=1_000_000)] = 1500
    """Particles while a Gaussian does not describe the belief; 0: always a Gaussian."""
    resample_share: Share = 0.5
    roughening: NonNegative = 0.2
    """Jitter after resampling, in σ n^(−1/6)."""
    bend_sigmas: Positive = 0.5
    """A Gaussian does while the bend ρ σ_β² / 2 of a direction stays below so many σ_r …"""
    yaw_limit_deg: Positive = 20.0
    """… and the relative yaw is known better than this …"""
    kurtosis_limit: Positive = 1.5
    """… and, to leave the particles, their kurtosis is at most so many times a Gaussian's."""
    recovery: bool = True
    """Start the mover anew where several positionings agree with each other and contradict the belief."""
    recovery_by: Literal["odds", "consensus"] = "odds"
    """odds: alternatives in which the vehicle jumped are followed beside the belief until one is likelier; consensus: a
    vote of the last positionings, which sees a turn later and is deceived by outliers more often."""
    jump_window: Annotated[int, Field(ge=1, le=100)] = 8
    """For so many positionings a jump of the vehicle that its odometry did not notice is held possible."""
    jump_sigma_m: NonNegative = 0.2
    """How far such a jump goes, per axis …"""
    jump_sigma_yaw_deg: NonNegative = 30.0
    """… and how far it turns. One that goes anywhere is followed besides."""
    jump_share: Share = 1e-4
    """Prior odds of one between two positionings."""
    jump_odds: Positive = 10.0
    """Posterior odds from which one is believed."""
    consensus_window: Annotated[int, Field(ge=2, le=100)] = 6
    consensus_quorum: Annotated[int, Field(ge=2, le=100)] = 4
    consensus_agree: Positive = 7.8
    """Largest χ² of three degrees of freedom between two that agree (95 %)."""
    consensus_disagree: Positive = 30.0
    """Least χ² of three degrees of freedom for a reset (1.4e-6)."""
    bias_states: bool = False
    """Gyro bias, DVL scale and misalignment as states, calibrated while landed and by positioning."""
    bias_share: Share = 0.5
    """Prior probability that there are such biases: a filter without them runs beside, and the estimate is the mean of
    both, weighed by how well each foresaw what was measured. 1: the states alone."""
    sigma_gyro_bias0_degps: NonNegative = 0.01
    sigma_gyro_bias_degps_per_sqrt_s: NonNegative = 0.0
    sigma_dvl_scale0: NonNegative = 0.01
    sigma_dvl_misalignment0_deg: NonNegative = 0.5
    sigma_landing_m: NonNegative = 0.03
    """What the odometry does not see of a landing, per axis."""
    sigma_landing_yaw_deg: NonNegative = 0.0


def _landmark(
    context: Context, options: Mapping[str, Any], _chart: _native.Chart | None
) -> _native.Navigator:
    return _native.landmark_navigator(context.vehicle, context.vehicles, dict(options), context.seed)


def _paper(context: Context, options: Mapping[str, Any], _chart: _native.Chart | None) -> _native.Navigator:
    return _native.landmark_paper(context.vehicle, context.vehicles, dict(options), context.seed)


Make = Callable[["Context", Mapping[str, Any], "_native.Chart | None"], _native.Navigator]

LANDMARK_NAVIGATORS: dict[str, tuple[str, type[ExchangeOptions], dict[str, Any], Make]] = {
    "dead-reckoning-dvl": (
        "Ground velocity and yaw rate summed up from the deployment's fix.",
        LandmarkOptions,
        {"use_fixes": False, "recovery": False, "particles": 0},
        _landmark,
    ),
    "landmark-paper": (
        "Alternating landmark of Matsuda et al. (2017): particles over mover and landmark, with reconstruction.",
        LandmarkPaperOptions,
        {},
        _paper,
    ),
    "landmark-ekf": (
        "Alternating landmark by an extended Kalman filter that believes every measurement.",
        LandmarkOptions,
        {"outlier_share": 0.0, "recovery": False, "particles": 0},
        _landmark,
    ),
    "landmark": (
        "Robust alternating landmark: mixture likelihoods, recovery by consensus, a Gaussian core once converged.",
        LandmarkOptions,
        {},
        _landmark,
    ),
}
"""Name: what it is, its option model, options that make it what its name says, how it is made."""
