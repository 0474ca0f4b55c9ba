//! Options of `landmark-paper`.

use super::model::{Acoustics, Gate, MonitorRule, Pose};
use super::options::{PacketOptions, check_mixture};
use crate::error::{Error, finite};
use crate::navigator::settings::{LandmarkPaperSettings, Settings, check_all};

/// Options of `landmark-paper`. Defaults and bounds: [`LandmarkPaperSettings`].
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
    /// Refuses what is outside the bounds of the settings, or contradicts itself.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        self.acoustics.validate()?;
        if let Gate::Mixture { share, widths } = self.gate {
            check_mixture(share, widths)?;
        }
        let [constant, root] = self.sigma_velocity;
        let [low, high] = self.speed_bounds_mps;
        let mut values = vec![
            ("particles", self.particles as f64),
            ("sigma_velocity_constant_mps", constant),
            ("sigma_velocity_root", root),
            ("speed_min_mps", low),
            ("speed_max_mps", high),
            ("sigma_yaw_rate_degps", self.sigma_yaw_rate_radps.to_degrees()),
            ("replace_share", self.replace_share),
        ];
        if let Some(rule) = self.monitor {
            values.extend([("monitor_ratio", rule.ratio), ("monitor_trials", f64::from(rule.trials))]);
        }
        check_all(&LandmarkPaperSettings::bounds(), &values)?;
        for value in self.first_landmark {
            finite("pose of the first landmark", value)?;
        }
        if low > high {
            return Err(Error::OutOfBound {
                quantity: "speed_min_mps",
                value: low,
                bound: "0 to speed_max_mps",
            });
        }
        Ok(())
    }
}
