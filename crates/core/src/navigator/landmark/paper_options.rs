//! Options of `landmark-paper`.

use super::model::{Acoustics, Gate, MonitorRule, Pose};
use super::options::{PacketOptions, check_mixture, check_share};
use crate::error::{Error, finite, non_negative};

/// Options of `landmark-paper`. Defaults live with the Python model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperOptions {
    /// n.
    pub particles: usize,
    /// Standard deviations and outlier thresholds of the acoustic channels.
    pub acoustics: Acoustics,
    /// How outliers are kept from deciding.
    pub gate: Gate,
    /// Table 4: σ_v = constant + root · √|v|, m/s.
    pub sigma_velocity: [f64; 2],
    /// |v| is taken inside these bounds, m/s.
    pub speed_bounds_mps: [f64; 2],
    /// Table 4: σ_ω, rad/s.
    pub sigma_yaw_rate_radps: f64,
    /// Reconstruction; `None` as in the sea trial.
    pub monitor: Option<MonitorRule>,
    /// r of (19).
    pub replace_share: f64,
    /// The first landmark's pose.
    pub first_landmark: Pose,
    /// Exchange packet.
    pub packet: PacketOptions,
}

impl PaperOptions {
    /// Refuses what is not finite or outside its bounds.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        self.acoustics.validate()?;
        if let Gate::Mixture { share, widths } = self.gate {
            check_mixture(share, widths)?;
        }
        for (name, value) in [
            ("sigma_velocity_constant_mps", self.sigma_velocity[0]),
            ("sigma_velocity_root", self.sigma_velocity[1]),
            ("speed_min_mps", self.speed_bounds_mps[0]),
            ("speed_max_mps", self.speed_bounds_mps[1]),
            ("sigma_yaw_rate_radps", self.sigma_yaw_rate_radps),
        ] {
            non_negative(name, value)?;
        }
        check_share("replace_share", self.replace_share)?;
        if let Some(rule) = self.monitor {
            check_share("monitor_ratio", rule.ratio)?;
        }
        for value in self.first_landmark {
            finite("pose of the first landmark", value)?;
        }
        let [low, high] = self.speed_bounds_mps;
        if low > high {
            return Err(Error::OutOfBound {
                quantity: "speed_min_mps",
                value: low,
                bound: "0 to speed_max_mps",
            });
        }
        if (10..=1_000_000).contains(&self.particles) {
            return Ok(());
        }
        Err(Error::OutOfBound {
            quantity: "particles",
            value: self.particles as f64,
            bound: "10 to 1,000,000",
        })
    }
}
