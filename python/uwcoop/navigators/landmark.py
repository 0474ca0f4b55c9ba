"""Options of the alternating landmark navigators, with units in the names; defaults and bounds are the core's.

Source, unless said otherwise: Matsuda, Maki, Sato & Sakamaki (2017); its section, table or equation is named.
"""

from __future__ import annotations

from typing import Literal

from uwcoop.navigators.base import FROM_CORE, NavigatorOptions

__all__ = ["ExchangeOptions", "LandmarkOptions", "LandmarkPaperOptions"]


class ExchangeOptions(NavigatorOptions, method="landmark"):
    """Options of all of them: the acoustic channels, the frame, the packet of a role exchange."""

    sigma_range_m: float = FROM_CORE
    """σ_r, Table 4."""
    sigma_own_bearing_deg: float = FROM_CORE
    """σ_θ of the direction that the mover measures, Table 4."""
    sigma_peer_bearing_deg: float = FROM_CORE
    """σ_θ of the direction that the landmark measures, Table 4."""
    outlier_share: float = FROM_CORE
    """ε: share of outliers among the measurements of a channel, in the mixture likelihood."""
    outlier_width_m: float = FROM_CORE
    """Width of the uniform density of an outlier's range."""
    outlier_width_rad: float = FROM_CORE
    """Width of the uniform density of an outlier's direction."""
    landmark0_e_m: float = FROM_CORE
    """Pose of the first landmark: the frame, unless the scenario has another."""
    landmark0_n_m: float = FROM_CORE
    landmark0_yaw_rad: float = FROM_CORE
    packet_bytes: Literal[8, 16, 32, 40, 64, 128] = FROM_CORE
    """Size of the exchange packet: whole ALOC signals of 8 bytes (section III.A)."""
    packet_format: Literal[1, 2] = FROM_CORE
    """1: layout of the reference cases; 2: check over sender and launch time, variance of rounding added."""
    clusters_by: Literal["bic", "aic"] = FROM_CORE
    """Criterion for the number of clusters of a cloud (section II.D)."""
    cluster_starts: int = FROM_CORE
    """Starts of expectation-maximisation by k-means++."""
    cluster_iterations: int = FROM_CORE
    cluster_tolerance: float = FROM_CORE
    """A start ends when an iteration adds less to the mean log-likelihood of a particle, nat."""
    cluster_ridge_one: float = FROM_CORE
    """Added to the whitened covariance of a single cluster."""
    cluster_ridge_many: float = FROM_CORE
    """The same for two and more."""
    cluster_search_points: int = FROM_CORE
    """Particles from which the number of clusters is chosen."""


class LandmarkPaperOptions(ExchangeOptions, method="landmark-paper"):
    """Options of `landmark-paper`."""

    particles: int = FROM_CORE
    """n: 3000 in the post-processing of section IV.C, 300 in the sea trial."""
    k_range: float = FROM_CORE
    """k_r of (12), Table 4."""
    k_own_bearing: float = FROM_CORE
    """k_θ^M of (12), Table 4."""
    k_peer_bearing: float = FROM_CORE
    """k_θ^L of (14), Table 4."""
    gate: Literal["joint", "separate", "none", "mixture"] = FROM_CORE
    """joint: range and own direction share one gate, as (12) is printed; mixture: with `outlier_share`."""
    sigma_velocity_constant_mps: float = FROM_CORE
    """σ_v = constant + root √|v|, Table 4."""
    sigma_velocity_root: float = FROM_CORE
    speed_min_mps: float = FROM_CORE
    """|v| is taken inside these bounds, Table 4."""
    speed_max_mps: float = FROM_CORE
    sigma_yaw_rate_degps: float = FROM_CORE
    """σ_ω, Table 4."""
    reconstruction: bool = FROM_CORE
    """Particle reconstruction (section II.C); the sea trial had none."""
    monitor_ratio: float = FROM_CORE
    """k: 0.85³, section IV.B."""
    monitor_trials: int = FROM_CORE
    """a, section IV.B."""
    monitor_reading: Literal["linear", "log"] = FROM_CORE
    """L̄ < k L_max as printed gives an alarm on a correct filter four times out of five; log compares logarithms."""
    replace_share: float = FROM_CORE
    """r of (19), section IV.B."""


class LandmarkOptions(ExchangeOptions, method="landmark"):
    """Options of `landmark`, `landmark-ekf` and `dead-reckoning-dvl`; the package's methods page is their source."""

    use_fixes: bool = FROM_CORE
    """Mutual positioning and exchanges; without, dead reckoning."""
    fix_correlation_s: float = FROM_CORE
    """Errors of positionings by one landmark last so long: each of those that follow each other within it counts less. 0:
    each has an error of its own."""
    particles: int = FROM_CORE
    """Particles while a Gaussian does not describe the posterior; 0: always a Gaussian."""
    resample_share: float = FROM_CORE
    roughening: float = FROM_CORE
    """Jitter after resampling, in σ n^(−1/6)."""
    bend_sigmas: float = FROM_CORE
    """A Gaussian is used while the nonlinearity ρ σ_β² / 2 of a direction stays below so many σ_r …"""
    yaw_limit_deg: float = FROM_CORE
    """… and the sigma of the relative yaw is below this …"""
    kurtosis_limit: float = FROM_CORE
    """… and, to return from particles, their kurtosis is at most so many times a Gaussian's."""
    recovery: bool = FROM_CORE
    """Initialise the mover again where several positionings agree with each other and contradict the estimate."""
    recovery_by: Literal["odds", "consensus"] = FROM_CORE
    """odds: alternative hypotheses with an unmeasured motion run beside the estimate until one is more likely; consensus:
    a vote of the last positionings, which detects a turn later and gives more false alarms by outliers."""
    jump_window: int = FROM_CORE
    """An alternative hypothesis (an unmeasured motion of the vehicle) is kept for so many positionings."""
    jump_sigma_m: float = FROM_CORE
    """Sigma of such a motion per axis …"""
    jump_sigma_yaw_deg: float = FROM_CORE
    """… and of its turn. A second alternative allows a motion of any size."""
    jump_share: float = FROM_CORE
    """Prior odds of one between two positionings."""
    jump_odds: float = FROM_CORE
    """Posterior odds at which an alternative replaces the estimate."""
    consensus_window: int = FROM_CORE
    consensus_quorum: int = FROM_CORE
    consensus_agree: float = FROM_CORE
    """Largest χ² of three degrees of freedom between two that agree (95 %)."""
    consensus_disagree: float = FROM_CORE
    """Least χ² of three degrees of freedom for a reset (1.4e-6)."""
    bias_states: bool = FROM_CORE
    """Gyro bias, DVL scale and misalignment as states, calibrated while landed and by positioning."""
    bias_share: float = FROM_CORE
    """Prior probability that there are such biases: a filter without them runs beside, and the estimate is the mean of
    both, weighted by their predictive likelihoods. 1: the filter with biases only."""
    sigma_gyro_bias0_degps: float = FROM_CORE
    sigma_gyro_bias_degps_per_sqrt_s: float = FROM_CORE
    sigma_dvl_scale0: float = FROM_CORE
    sigma_dvl_misalignment0_deg: float = FROM_CORE
    sigma_landing_m: float = FROM_CORE
    """Motion of a landing that the odometry does not measure, per axis."""
    sigma_landing_yaw_deg: float = FROM_CORE
