//! Settings of `landmark`, `landmark-ekf` and `dead-reckoning-dvl`; the package's methods page is their source.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::landmark_exchange::ExchangeSettings;
use super::{Bound, Bounded, Context, Made, Settings, Unread, all_unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::navigator::landmark::consensus::ConsensusRule;
use crate::navigator::landmark::jump_hypotheses::JumpRule;
use crate::navigator::landmark::model::Acoustics;
use crate::navigator::landmark::{BiasModelAverage, Landmark, LandmarkOptions};

/// How a vehicle that lost its way is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecoveryBy {
    /// Alternatives in which the vehicle jumped are followed beside the belief until one is likelier.
    Odds,
    /// A vote of the last positionings, which sees a turn later and is deceived by outliers more often.
    Consensus,
}

/// Settings of the Gaussian landmark navigators.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LandmarkSettings {
    /// Channels, frame and packet.
    #[serde(flatten)]
    pub exchange: ExchangeSettings,
    /// Mutual positioning and exchanges; without, dead reckoning.
    pub use_fixes: bool,
    /// For so long the errors of positionings by one landmark last, s; 0: each has its own.
    pub fix_correlation_s: f64,
    /// Particles while a Gaussian does not describe the belief; 0: always a Gaussian.
    pub particles: usize,
    /// Resample at this share of the particles.
    pub resample_share: f64,
    /// Jitter after resampling, in σ n^(−1/6).
    pub roughening: f64,
    /// A Gaussian does while the bend ρ σ_β² / 2 of a direction stays below so many σ_r …
    pub bend_sigmas: f64,
    /// … and the relative yaw is known better than this …
    pub yaw_limit_deg: f64,
    /// … and, to leave the particles, their kurtosis is at most so many times a Gaussian's.
    pub kurtosis_limit: f64,
    /// Start the mover anew where several positionings agree with each other and contradict the belief.
    pub recovery: bool,
    /// How that is noticed.
    pub recovery_by: RecoveryBy,
    /// For so many positionings a jump of the vehicle that its odometry did not notice is held possible.
    pub jump_window: u32,
    /// How far such a jump goes, per axis, m …
    pub jump_sigma_m: f64,
    /// … and how far it turns. One that goes anywhere is followed besides.
    pub jump_sigma_yaw_deg: f64,
    /// Prior odds of one between two positionings.
    pub jump_share: f64,
    /// Posterior odds from which one is believed.
    pub jump_odds: f64,
    /// Positionings that are looked at.
    pub consensus_window: usize,
    /// Of these, how many must agree.
    pub consensus_quorum: usize,
    /// Largest χ² of three degrees of freedom between two that agree (95 %).
    pub consensus_agree: f64,
    /// Least χ² of three degrees of freedom for a reset (1.4e-6).
    pub consensus_disagree: f64,
    /// Gyro bias, DVL scale and misalignment as states, calibrated while landed and by positioning.
    pub bias_states: bool,
    /// Prior probability that there are such biases: a filter without them runs beside, and the estimate is the mean of
    /// both, weighed by how well each foresaw what was measured. 1: the states alone.
    pub bias_share: f64,
    /// Prior of the gyro bias.
    pub sigma_gyro_bias0_degps: f64,
    /// Its walk.
    pub sigma_gyro_bias_degps_per_sqrt_s: f64,
    /// Prior of the DVL scale.
    pub sigma_dvl_scale0: f64,
    /// Prior of the DVL misalignment.
    pub sigma_dvl_misalignment0_deg: f64,
    /// What the odometry does not see of a landing, per axis, m.
    pub sigma_landing_m: f64,
    /// The same of the yaw.
    pub sigma_landing_yaw_deg: f64,
}

impl Default for LandmarkSettings {
    fn default() -> Self {
        Self {
            exchange: ExchangeSettings::default(),
            use_fixes: true,
            fix_correlation_s: 0.0,
            particles: 1500,
            resample_share: 0.5,
            roughening: 0.2,
            bend_sigmas: 0.5,
            yaw_limit_deg: 20.0,
            kurtosis_limit: 1.5,
            recovery: true,
            recovery_by: RecoveryBy::Odds,
            jump_window: 8,
            jump_sigma_m: 0.2,
            jump_sigma_yaw_deg: 30.0,
            jump_share: 1e-4,
            jump_odds: 10.0,
            consensus_window: 6,
            consensus_quorum: 4,
            consensus_agree: 7.8,
            consensus_disagree: 30.0,
            bias_states: false,
            bias_share: 0.5,
            sigma_gyro_bias0_degps: 0.01,
            sigma_gyro_bias_degps_per_sqrt_s: 0.0,
            sigma_dvl_scale0: 0.01,
            sigma_dvl_misalignment0_deg: 0.5,
            sigma_landing_m: 0.03,
            sigma_landing_yaw_deg: 0.0,
        }
    }
}

const OF_PARTICLES: [&str; 5] =
    ["resample_share", "roughening", "bend_sigmas", "yaw_limit_deg", "kurtosis_limit"];
const OF_JUMPS: [&str; 5] = ["jump_window", "jump_sigma_m", "jump_sigma_yaw_deg", "jump_share", "jump_odds"];
const OF_CONSENSUS: [&str; 4] =
    ["consensus_window", "consensus_quorum", "consensus_agree", "consensus_disagree"];
const OF_BIASES: [&str; 5] = [
    "bias_share",
    "sigma_gyro_bias0_degps",
    "sigma_gyro_bias_degps_per_sqrt_s",
    "sigma_dvl_scale0",
    "sigma_dvl_misalignment0_deg",
];
const OF_FIXES: [&str; 9] = [
    "fix_correlation_s",
    "sigma_range_m",
    "sigma_own_bearing_deg",
    "sigma_peer_bearing_deg",
    "outlier_share",
    "packet_bytes",
    "packet_format",
    "recovery",
    "particles",
];

impl LandmarkSettings {
    fn options(&self) -> Result<LandmarkOptions, Error> {
        let exchange = &self.exchange;
        let prior = |sigma: f64| if self.bias_states { sigma } else { 0.0 };
        let recovery = self.recovery.then_some(self.recovery_by);
        Ok(LandmarkOptions {
            acoustics: Acoustics { sigma: exchange.sigma(), threshold: [3.0; 3] },
            outliers: (exchange.outlier_share > 0.0).then(|| (exchange.outlier_share, exchange.widths())),
            use_fixes: self.use_fixes,
            fix_correlation_s: self.fix_correlation_s,
            particles: self.particles,
            resample_share: self.resample_share,
            roughening: self.roughening,
            bend_sigmas: self.bend_sigmas,
            yaw_limit_rad: self.yaw_limit_deg.to_radians(),
            kurtosis_limit: self.kurtosis_limit,
            consensus: (recovery == Some(RecoveryBy::Consensus)).then_some(ConsensusRule {
                window: self.consensus_window,
                quorum: self.consensus_quorum,
                agree: self.consensus_agree,
                disagree: self.consensus_disagree,
            }),
            jump: (recovery == Some(RecoveryBy::Odds)).then(|| JumpRule {
                window: self.jump_window,
                sigma_m: self.jump_sigma_m,
                sigma_rad: self.jump_sigma_yaw_deg.to_radians(),
                share: self.jump_share,
                odds: self.jump_odds,
            }),
            bias_sigma: [
                prior(self.sigma_gyro_bias0_degps.to_radians()),
                prior(self.sigma_dvl_scale0),
                prior(self.sigma_dvl_misalignment0_deg.to_radians()),
            ],
            gyro_bias_walk: self.sigma_gyro_bias_degps_per_sqrt_s.to_radians(),
            landing_sigma: [self.sigma_landing_m, self.sigma_landing_yaw_deg.to_radians()],
            first_landmark: exchange.first_landmark(),
            packet: exchange.packet()?,
        })
    }
}

impl Settings for LandmarkSettings {
    const METHOD: &'static str = "landmark";

    fn bounds() -> Vec<Bounded> {
        let own = [
            ("fix_correlation_s", Bound::NON_NEGATIVE),
            ("particles", Bound::between(0.0, 1e6, "0 or 10 to 1,000,000")),
            ("resample_share", Bound::SHARE),
            ("roughening", Bound::NON_NEGATIVE),
            ("bend_sigmas", Bound::POSITIVE),
            ("yaw_limit_deg", Bound::POSITIVE),
            ("kurtosis_limit", Bound::POSITIVE),
            ("jump_window", Bound::between(1.0, 100.0, "1 to 100")),
            ("jump_sigma_m", Bound::NON_NEGATIVE),
            ("jump_sigma_yaw_deg", Bound::NON_NEGATIVE),
            ("jump_share", Bound::SHARE),
            ("jump_odds", Bound::POSITIVE),
            ("consensus_window", Bound::between(2.0, 100.0, "2 to 100")),
            ("consensus_quorum", Bound::between(2.0, 100.0, "2 to 100")),
            ("consensus_agree", Bound::POSITIVE),
            ("consensus_disagree", Bound::POSITIVE),
            ("bias_share", Bound::SHARE),
            ("sigma_gyro_bias0_degps", Bound::NON_NEGATIVE),
            ("sigma_gyro_bias_degps_per_sqrt_s", Bound::NON_NEGATIVE),
            ("sigma_dvl_scale0", Bound::NON_NEGATIVE),
            ("sigma_dvl_misalignment0_deg", Bound::NON_NEGATIVE),
            ("sigma_landing_m", Bound::NON_NEGATIVE),
            ("sigma_landing_yaw_deg", Bound::NON_NEGATIVE),
        ];
        own.into_iter().chain(ExchangeSettings::BOUNDS).collect()
    }

    fn unread(&self) -> Vec<Unread> {
        const NO_FIXES: &str = "use_fixes is false";
        let (fixes, share) = (self.use_fixes, self.exchange.outlier_share);
        let no_particles = fixes && self.particles == 0;
        let by = |by: RecoveryBy| fixes && self.recovery && self.recovery_by == by;
        let none = fixes && !self.recovery;
        all_unread(!fixes, &OF_FIXES, NO_FIXES)
            .chain(all_unread(!fixes, &ExchangeSettings::WIDTHS, NO_FIXES))
            .chain(all_unread(!fixes, &ExchangeSettings::CLUSTERS, NO_FIXES))
            .chain(all_unread(!fixes, &OF_PARTICLES, NO_FIXES))
            .chain(all_unread(!fixes, &["recovery_by"], NO_FIXES))
            .chain(all_unread(!fixes, &OF_JUMPS, NO_FIXES))
            .chain(all_unread(!fixes, &OF_CONSENSUS, NO_FIXES))
            .chain(all_unread(fixes && share == 0.0, &ExchangeSettings::WIDTHS, "outlier_share is 0"))
            .chain(all_unread(no_particles, &OF_PARTICLES, "particles is 0"))
            .chain(all_unread(no_particles, &ExchangeSettings::CLUSTERS, "particles is 0"))
            .chain(all_unread(none, &["recovery_by"], "recovery is false"))
            .chain(all_unread(none, &OF_JUMPS, "recovery is false"))
            .chain(all_unread(none, &OF_CONSENSUS, "recovery is false"))
            .chain(all_unread(by(RecoveryBy::Odds), &OF_CONSENSUS, "recovery_by is \"odds\""))
            .chain(all_unread(by(RecoveryBy::Consensus), &OF_JUMPS, "recovery_by is \"consensus\""))
            .chain(all_unread(!self.bias_states, &OF_BIASES, "bias_states is false"))
            .collect()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let options = self.options()?;
        let Context { vehicle, vehicles, seed, .. } = *context;
        if self.bias_states && self.bias_share < 1.0 {
            return Made::navigator(BiasModelAverage::new(vehicle, vehicles, options, seed, self.bias_share));
        }
        Made::navigator(Landmark::new(vehicle, vehicles, options, seed))
    }
}
