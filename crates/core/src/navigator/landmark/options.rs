//! What `landmark`, `landmark-ekf` and the dead reckoning from DVL and gyro are made from.

use super::consensus::ConsensusRule;
use super::jump_hypotheses::JumpRule;
use super::model::{Acoustics, Gate, Pose};
use crate::error::{Error, non_negative};
use crate::mixture::FitOptions;
use crate::packet::landmark::{ExchangeFormat, ExchangeSize};

/// Options of the Gaussian navigators. Defaults live with the Python models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandmarkOptions {
    /// Standard deviations of the acoustic channels; the thresholds are not used.
    pub acoustics: Acoustics,
    /// ε and the widths of the outliers' densities; `None`: no outliers, every measurement has full weight.
    pub outliers: Option<(f64, [f64; 3])>,
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
    /// Refuses what cannot be.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`] naming the option.
    pub fn validate(&self) -> Result<(), Error> {
        self.acoustics.validate()?;
        if let Some((share, widths)) = self.outliers {
            check_mixture(share, widths)?;
        }
        for (name, value) in [
            ("roughening", self.roughening),
            ("bend_sigmas", self.bend_sigmas),
            ("yaw_limit_rad", self.yaw_limit_rad),
            ("kurtosis_limit", self.kurtosis_limit),
            ("sigma_gyro_bias0_radps", self.bias_sigma[0]),
            ("sigma_dvl_scale0", self.bias_sigma[1]),
            ("sigma_dvl_misalignment0_rad", self.bias_sigma[2]),
            ("sigma_gyro_bias_radps_per_sqrt_s", self.gyro_bias_walk),
            ("sigma_landing_m", self.landing_sigma[0]),
            ("sigma_landing_yaw_rad", self.landing_sigma[1]),
        ] {
            non_negative(name, value)?;
        }
        check_share("resample_share", self.resample_share)?;
        for value in self.first_landmark {
            crate::error::finite("pose of the first landmark", value)?;
        }
        if self.particles != 0 && !(10..=1_000_000).contains(&self.particles) {
            return Err(Error::OutOfBound {
                quantity: "particles",
                value: self.particles as f64,
                bound: "0 or 10 to 1,000,000",
            });
        }
        if let Some(rule) = self.consensus {
            if rule.quorum < 2 || rule.quorum > rule.window {
                return Err(Error::OutOfBound {
                    quantity: "consensus_quorum",
                    value: rule.quorum as f64,
                    bound: "2 to consensus_window",
                });
            }
            non_negative("consensus_agree", rule.agree)?;
            non_negative("consensus_disagree", rule.disagree)?;
        }
        if let Some(rule) = self.jump {
            non_negative("jump_sigma_m", rule.sigma_m)?;
            non_negative("jump_sigma_yaw_rad", rule.sigma_rad)?;
            check_share("jump_share", rule.share)?;
            crate::error::positive("jump_odds", rule.odds)?;
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
pub fn check_mixture(share: f64, widths: [f64; 3]) -> Result<(), Error> {
    check_share("outlier_share", share)?;
    for width in widths {
        crate::error::positive("outlier width", width)?;
    }
    Ok(())
}

/// A share in (0, 1].
///
/// # Errors
/// [`Error::OutOfBound`].
pub fn check_share(quantity: &'static str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value <= 1.0 {
        return Ok(());
    }
    Err(Error::OutOfBound { quantity, value, bound: "above 0, at most 1" })
}
