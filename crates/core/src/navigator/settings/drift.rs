//! How dead reckoning drifts: a class of vehicle, and what is stated beside it.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Bound, Bounded, Context, Made, Settings, Unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::motion::DvlErrors;
use crate::navigator::dead_reckoning::DeadReckoning;
use crate::navigator::drift::Drift;

/// Drift by class of vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriftPreset {
    /// Tan, Chitre & Hover (2016), Table 1; the paper does not give the priors of the current and the biases.
    #[serde(rename = "table-1")]
    Table1,
    /// Speed through the water from the thrusters, heading from a compass.
    NoDvl,
    /// Speed over ground from a DVL; what is left is slow and small.
    Dvl,
}

impl DriftPreset {
    /// All of them, with the names that scenario files give them.
    pub const ALL: [(&'static str, Self); 3] =
        [("table-1", Self::Table1), ("no-dvl", Self::NoDvl), ("dvl", Self::Dvl)];

    /// Position (m/√s), current (m/s/√s) and its prior (m/s), priors of compass bias (rad) and thrust bias (m/s).
    #[must_use]
    pub fn values(self) -> [f64; 5] {
        match self {
            Self::Table1 => [0.05, 0.01, 0.3, 0.0175, 0.1],
            Self::NoDvl => [0.07, 0.012, 0.15, 1.5_f64.to_radians(), 0.075],
            Self::Dvl => [0.04, 0.003, 0.06, 0.5_f64.to_radians(), 0.01],
        }
    }
}

/// What a preset states, in the order of [`DriftPreset::values`].
pub const PRESET_OPTIONS: [&str; 5] = [
    "sigma_position_m_per_sqrt_s",
    "sigma_current_mps_per_sqrt_s",
    "sigma_current0_mps",
    "sigma_heading_bias0_rad",
    "sigma_thrust_bias0_mps",
];

/// Options that say how biases drift: read where biases are states.
pub const BIAS_OPTIONS: [&str; 4] = [
    "sigma_heading_bias0_rad",
    "sigma_heading_bias_rad_per_sqrt_s",
    "sigma_thrust_bias0_mps",
    "sigma_thrust_bias_mps_per_sqrt_s",
];

/// How dead reckoning drifts; `None` takes the preset's value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DriftSettings {
    /// Class of vehicle.
    pub drift: DriftPreset,
    /// White velocity noise, m/√s.
    pub sigma_position_m_per_sqrt_s: Option<f64>,
    /// Walk of the current, m/s/√s.
    pub sigma_current_mps_per_sqrt_s: Option<f64>,
    /// Prior of the current per axis, m/s.
    pub sigma_current0_mps: Option<f64>,
    /// Prior of the compass bias, rad.
    pub sigma_heading_bias0_rad: Option<f64>,
    /// Prior of the thrust bias, m/s.
    pub sigma_thrust_bias0_mps: Option<f64>,
    /// Walk of the compass bias, rad/√s.
    pub sigma_heading_bias_rad_per_sqrt_s: f64,
    /// Walk of the thrust bias, m/s/√s.
    pub sigma_thrust_bias_mps_per_sqrt_s: f64,
    /// Scale of the velocities of a DVL.
    pub sigma_dvl_scale: f64,
    /// Angle between DVL and compass, rad.
    pub sigma_dvl_misalignment_rad: f64,
    /// A velocity of a DVL holds for so long, s.
    pub dvl_hold_s: f64,
}

impl Default for DriftSettings {
    fn default() -> Self {
        let dvl = DvlErrors::default();
        Self {
            drift: DriftPreset::NoDvl,
            sigma_position_m_per_sqrt_s: None,
            sigma_current_mps_per_sqrt_s: None,
            sigma_current0_mps: None,
            sigma_heading_bias0_rad: None,
            sigma_thrust_bias0_mps: None,
            sigma_heading_bias_rad_per_sqrt_s: 1e-5,
            sigma_thrust_bias_mps_per_sqrt_s: 1e-4,
            sigma_dvl_scale: dvl.sigma_scale,
            sigma_dvl_misalignment_rad: dvl.sigma_misalignment_rad,
            dvl_hold_s: dvl.hold_s,
        }
    }
}

impl DriftSettings {
    /// Bounds of its options.
    #[must_use]
    pub fn bounds() -> Vec<Bounded> {
        PRESET_OPTIONS
            .into_iter()
            .chain([BIAS_OPTIONS[1], BIAS_OPTIONS[3]])
            .map(|o| (o, Bound::NON_NEGATIVE))
            .chain([
                ("sigma_dvl_scale", Bound::between(0.0, 0.5, "0 to 0.5")),
                ("sigma_dvl_misalignment_rad", Bound::between(0.0, 1.0, "0 to 1")),
                ("dvl_hold_s", Bound::between(0.1, 60.0, "0.1 to 60")),
            ])
            .collect()
    }

    /// The preset with what is stated beside it.
    #[must_use]
    pub fn options(&self) -> Drift {
        let preset = self.of(self.drift);
        Drift {
            sigma_position_m_per_sqrt_s: self
                .sigma_position_m_per_sqrt_s
                .unwrap_or(preset.sigma_position_m_per_sqrt_s),
            sigma_current_mps_per_sqrt_s: self
                .sigma_current_mps_per_sqrt_s
                .unwrap_or(preset.sigma_current_mps_per_sqrt_s),
            sigma_current0_mps: self.sigma_current0_mps.unwrap_or(preset.sigma_current0_mps),
            sigma_heading_bias0_rad: self.sigma_heading_bias0_rad.unwrap_or(preset.sigma_heading_bias0_rad),
            sigma_thrust_bias0_mps: self.sigma_thrust_bias0_mps.unwrap_or(preset.sigma_thrust_bias0_mps),
            ..preset
        }
    }

    /// A preset with these walks of the biases.
    #[must_use]
    pub fn of(&self, preset: DriftPreset) -> Drift {
        let [position, current, current0, heading0, thrust0] = preset.values();
        Drift {
            sigma_position_m_per_sqrt_s: position,
            sigma_current_mps_per_sqrt_s: current,
            sigma_current0_mps: current0,
            sigma_heading_bias0_rad: heading0,
            sigma_heading_bias_rad_per_sqrt_s: self.sigma_heading_bias_rad_per_sqrt_s,
            sigma_thrust_bias0_mps: thrust0,
            sigma_thrust_bias_mps_per_sqrt_s: self.sigma_thrust_bias_mps_per_sqrt_s,
            dvl: DvlErrors {
                sigma_scale: self.sigma_dvl_scale,
                sigma_misalignment_rad: self.sigma_dvl_misalignment_rad,
                hold_s: self.dvl_hold_s,
            },
        }
    }
}

/// `dead-reckoning` has no further options.
impl Settings for DriftSettings {
    const METHOD: &'static str = "dead-reckoning";

    fn bounds() -> Vec<Bounded> {
        Self::bounds()
    }

    fn unread(&self) -> Vec<Unread> {
        Vec::new()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        Made::navigator(DeadReckoning::new(context.vehicle, context.vehicles, self.options()))
    }
}
