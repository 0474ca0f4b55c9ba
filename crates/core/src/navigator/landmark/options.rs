//! What `landmark`, `landmark-ekf` and the dead reckoning from DVL and gyro are made from.

use super::consensus::ConsensusRule;
use super::jump_hypotheses::JumpRule;
use super::model::{Acoustics, Gate, Pose};
use crate::error::{Error, finite};
use crate::mixture::FitOptions;
use crate::navigator::settings::landmark_exchange::ExchangeSettings;
use crate::navigator::settings::{LandmarkSettings, Settings, check_all};
use crate::packet::landmark::{ExchangeFormat, ExchangeSize};

/// Options of the Gaussian navigators. Defaults and bounds: [`LandmarkSettings`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandmarkOptions {
    /// Standard deviations of the acoustic channels; the thresholds are not used.
    pub acoustics: Acoustics,
    /// ε and the widths of the outliers' densities; `None`: no outliers, every measurement has full weight.
    pub outliers: Option<(f64, [f64; 3])>,
    /// For so long the errors of positionings by one landmark last, s; 0: each has its own.
    pub fix_correlation_s: f64,
    /// Whether acoustic fixes are used at all; without, this is dead reckoning.
    pub use_fixes: bool,
    /// Particles while a Gaussian does not do; 0: never.
    pub particles: usize,
    /// Resample at this share of the particles.
    pub resample_share: f64,
    /// Roughening, in σ n^(−1/6).
    pub roughening: f64,
    /// A Gaussian does while ρ σ_β² / 2, the bend of its tangent, stays below this many σ_r …
    pub bend_sigmas: f64,
    /// … and the standard deviation of the relative yaw below this, rad …
    pub yaw_limit_rad: f64,
    /// … and, to leave the particles, their kurtosis below this multiple of a Gaussian's.
    pub kurtosis_limit: f64,
    /// Recovery; `None` never resets.
    pub consensus: Option<ConsensusRule>,
    /// Alternatives in which the vehicle jumped; `None`: none are followed.
    pub jump: Option<JumpRule>,
    /// Priors of gyro bias (rad/s), DVL scale, DVL misalignment (rad); zeros: no bias states.
    pub bias_sigma: [f64; 3],
    /// Walk of the gyro bias, rad/s/√s.
    pub gyro_bias_walk: f64,
    /// Disturbance at landing: position per axis, m; yaw, rad.
    pub landing_sigma: [f64; 2],
    /// The first landmark's pose.
    pub first_landmark: Pose,
    /// Exchange packet.
    pub packet: PacketOptions,
}

/// The exchange packet and how particles become modes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PacketOptions {
    /// Layout.
    pub format: ExchangeFormat,
    /// Size.
    pub size: ExchangeSize,
    /// BIC or AIC.
    pub criterion: crate::mixture::Criterion,
    /// Expectation–maximisation.
    pub fit: FitOptions,
    /// Points that the choice of the number of modes looks at.
    pub search_points: usize,
}

impl PacketOptions {
    /// Whether packets end in the checksum of [`append_crc`](crate::packet::append_crc); format 1 and 8 bytes have checks of their own.
    #[must_use]
    pub fn has_checksum(&self) -> bool {
        self.format == ExchangeFormat::Two && self.size != ExchangeSize::B8
    }
}

impl LandmarkOptions {
    /// Refuses what is outside the bounds of the settings, or contradicts itself.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`] naming the option.
    pub fn validate(&self) -> Result<(), Error> {
        self.acoustics.validate()?;
        if let Some((share, widths)) = self.outliers {
            check_mixture(share, widths)?;
        }
        let [gyro_radps, scale, misalignment_rad] = self.bias_sigma;
        let [landing_m, landing_rad] = self.landing_sigma;
        let mut values = vec![
            ("fix_correlation_s", self.fix_correlation_s),
            ("resample_share", self.resample_share),
            ("roughening", self.roughening),
            ("bend_sigmas", self.bend_sigmas),
            ("yaw_limit_deg", self.yaw_limit_rad.to_degrees()),
            ("kurtosis_limit", self.kurtosis_limit),
            ("sigma_gyro_bias0_degps", gyro_radps.to_degrees()),
            ("sigma_gyro_bias_degps_per_sqrt_s", self.gyro_bias_walk.to_degrees()),
            ("sigma_dvl_scale0", scale),
            ("sigma_dvl_misalignment0_deg", misalignment_rad.to_degrees()),
            ("sigma_landing_m", landing_m),
            ("sigma_landing_yaw_deg", landing_rad.to_degrees()),
            ("particles", self.particles as f64),
        ];
        if let Some(rule) = self.consensus {
            values.extend([
                ("consensus_window", rule.window as f64),
                ("consensus_quorum", rule.quorum as f64),
                ("consensus_agree", rule.agree),
                ("consensus_disagree", rule.disagree),
            ]);
        }
        if let Some(rule) = self.jump {
            values.extend([
                ("jump_window", f64::from(rule.window)),
                ("jump_sigma_m", rule.sigma_m),
                ("jump_sigma_yaw_deg", rule.sigma_rad.to_degrees()),
                ("jump_share", rule.share),
                ("jump_odds", rule.odds),
            ]);
        }
        check_all(&LandmarkSettings::bounds(), &values)?;
        for value in self.first_landmark {
            finite("pose of the first landmark", value)?;
        }
        if (1..10).contains(&self.particles) {
            return Err(Error::OutOfBound {
                quantity: "particles",
                value: self.particles as f64,
                bound: "0 or 10 to 1,000,000",
            });
        }
        if let Some(rule) = self.consensus.filter(|rule| rule.quorum > rule.window) {
            return Err(Error::OutOfBound {
                quantity: "consensus_quorum",
                value: rule.quorum as f64,
                bound: "2 to consensus_window",
            });
        }
        Ok(())
    }

    /// The likelihood of particles.
    #[must_use]
    pub fn gate(&self) -> Gate {
        self.outliers.map_or(Gate::None, |(share, widths)| Gate::Mixture { share, widths })
    }
}

/// ε in (0, 1) and widths above zero.
///
/// # Errors
/// [`Error::OutOfBound`].
pub fn check_mixture(share: f64, [width_m, own_rad, peer_rad]: [f64; 3]) -> Result<(), Error> {
    if share == 0.0 {
        return Err(Error::OutOfBound { quantity: "outlier_share", value: share, bound: "above 0" });
    }
    let values = [
        ("outlier_share", share),
        ("outlier_width_m", width_m),
        ("outlier_width_rad", own_rad),
        ("outlier_width_rad", peer_rad),
    ];
    check_all(&ExchangeSettings::BOUNDS, &values)
}
