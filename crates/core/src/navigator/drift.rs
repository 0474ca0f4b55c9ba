//! How dead reckoning drifts: priors and random walks of the states that are estimated beside the position.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::settings::{DriftSettings, check_all};
use crate::error::Error;
use crate::kernels::particles::MAX_LINEAR;
use crate::motion::DvlErrors;

/// How a vehicle's dead reckoning drifts. Random walks are per root second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// White velocity noise as a walk of the position, m/√s.
    pub sigma_position_m_per_sqrt_s: f64,
    /// Walk of the current, m/s/√s.
    pub sigma_current_mps_per_sqrt_s: f64,
    /// Prior of the current per axis, m/s.
    pub sigma_current0_mps: f64,
    /// Prior of the compass bias, rad.
    pub sigma_heading_bias0_rad: f64,
    /// Its walk, rad/√s.
    pub sigma_heading_bias_rad_per_sqrt_s: f64,
    /// Prior of the thrust bias, m/s.
    pub sigma_thrust_bias0_mps: f64,
    /// Its walk, m/s/√s.
    pub sigma_thrust_bias_mps_per_sqrt_s: f64,
    /// Of a DVL, where the vehicle has one.
    pub dvl: DvlErrors,
}

impl Drift {
    /// Refuses what is outside the bounds of the settings.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        check_all(
            &DriftSettings::bounds(),
            &[
                ("sigma_position_m_per_sqrt_s", self.sigma_position_m_per_sqrt_s),
                ("sigma_current_mps_per_sqrt_s", self.sigma_current_mps_per_sqrt_s),
                ("sigma_current0_mps", self.sigma_current0_mps),
                ("sigma_heading_bias0_rad", self.sigma_heading_bias0_rad),
                ("sigma_heading_bias_rad_per_sqrt_s", self.sigma_heading_bias_rad_per_sqrt_s),
                ("sigma_thrust_bias0_mps", self.sigma_thrust_bias0_mps),
                ("sigma_thrust_bias_mps_per_sqrt_s", self.sigma_thrust_bias_mps_per_sqrt_s),
                ("sigma_dvl_scale", self.dvl.sigma_scale),
                ("sigma_dvl_misalignment_rad", self.dvl.sigma_misalignment_rad),
                ("dvl_hold_s", self.dvl.hold_s),
            ],
        )
    }

    /// Prior covariance of the linear states.
    #[must_use]
    pub fn prior<const K: usize>(&self) -> SMatrix<f64, K, K> {
        let sigmas = [
            self.sigma_current0_mps,
            self.sigma_current0_mps,
            self.sigma_heading_bias0_rad,
            self.sigma_thrust_bias0_mps,
        ];
        SMatrix::from_fn(|r, c| if r == c { sigmas[r] * sigmas[r] } else { 0.0 })
    }

    /// Process noise of the linear states over `dt_s`.
    #[must_use]
    pub fn walk<const K: usize>(&self, dt_s: f64) -> SMatrix<f64, K, K> {
        let sigmas: [f64; MAX_LINEAR] = [
            self.sigma_current_mps_per_sqrt_s,
            self.sigma_current_mps_per_sqrt_s,
            self.sigma_heading_bias_rad_per_sqrt_s,
            self.sigma_thrust_bias_mps_per_sqrt_s,
        ];
        SMatrix::from_fn(|r, c| if r == c { sigmas[r] * sigmas[r] * dt_s } else { 0.0 })
    }

    /// Process noise of the position over `dt_s`, [ee, en, nn].
    #[must_use]
    pub fn position_walk(&self, dt_s: f64) -> [f64; 3] {
        let q = self.sigma_position_m_per_sqrt_s * self.sigma_position_m_per_sqrt_s * dt_s;
        [q, 0.0, q]
    }
}
