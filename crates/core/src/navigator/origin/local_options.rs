//! Options that every navigator of this family shares.

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::navigator::clock::ClockOptions;
use crate::navigator::settings::check_all;
use crate::navigator::settings::origin::LOCAL_BOUNDS;

/// How a vehicle's own motion and sensors are modelled, and ranges weighed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LocalOptions {
    /// Spectral density of the acceleration per axis, m²/s³, of a vehicle that does not measure its velocity.
    pub process_noise_m2_per_s3: f64,
    /// The same of one that does (from its first DVL velocity on).
    pub process_noise_dvl_m2_per_s3: f64,
    /// Prior of the velocity per axis, m/s.
    pub sigma_velocity0_mps: f64,
    /// Prior of the scale of odometry.
    pub sigma_odometry_scale: f64,
    /// Prior of the rate at which a heading that is integrated from odometry drifts, rad/s.
    pub sigma_gyro_bias_radps: f64,
    /// Of a (slant) range, m.
    pub sigma_range_m: f64,
    /// Fixes and ranges that contradict the belief by more sigmas are gated and counted.
    pub gate_sigmas: f64,
    /// What may be wrong with ranges, beside their noise.
    pub clock: ClockOptions,
}

impl LocalOptions {
    /// Refuses what is outside the bounds of the settings.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        self.clock.validate()?;
        check_all(
            &LOCAL_BOUNDS,
            &[
                ("process_noise_m2_per_s3", self.process_noise_m2_per_s3),
                ("process_noise_dvl_m2_per_s3", self.process_noise_dvl_m2_per_s3),
                ("sigma_velocity0_mps", self.sigma_velocity0_mps),
                ("sigma_odometry_scale", self.sigma_odometry_scale),
                ("sigma_gyro_bias_radps", self.sigma_gyro_bias_radps),
                ("sigma_range_m", self.sigma_range_m),
                ("gate_sigmas", self.gate_sigmas),
            ],
        )
    }
}

impl Default for LocalOptions {
    fn default() -> Self {
        Self {
            process_noise_m2_per_s3: 1e-4,
            process_noise_dvl_m2_per_s3: 1e-2,
            sigma_velocity0_mps: 1.0,
            sigma_odometry_scale: 1e-3,
            sigma_gyro_bias_radps: 0.0,
            sigma_range_m: 1.0,
            gate_sigmas: 6.0,
            clock: ClockOptions::default(),
        }
    }
}
