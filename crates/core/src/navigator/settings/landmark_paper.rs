//! Settings of `landmark-paper` (Matsuda, Maki, Sato & Sakamaki 2017).

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::landmark_exchange::ExchangeSettings;
use super::{Bound, Bounded, Context, Made, Settings, Unread, all_unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::navigator::landmark::model::{Acoustics, Gate, MonitorRule, RatioReading};
use crate::navigator::landmark::{LandmarkPaper, PaperOptions};

/// How outliers are kept from deciding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GateName {
    /// Range and own direction share one gate, as (12) is printed.
    Joint,
    /// Each channel has its own.
    Separate,
    /// None.
    None,
    /// A mixture likelihood with `outlier_share`.
    Mixture,
}

/// How L̄ and L_max are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reading {
    /// As printed.
    Linear,
    /// Their logarithms.
    Log,
}

/// Settings of `landmark-paper`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LandmarkPaperSettings {
    /// Channels, frame and packet.
    #[serde(flatten)]
    pub exchange: ExchangeSettings,
    /// n: 3000 in the post-processing of section IV.C, 300 in the sea trial.
    pub particles: usize,
    /// k_r of (12), Table 4.
    pub k_range: f64,
    /// k_θ^M of (12), Table 4.
    pub k_own_bearing: f64,
    /// k_θ^L of (14), Table 4.
    pub k_peer_bearing: f64,
    /// How outliers are kept from deciding.
    pub gate: GateName,
    /// σ_v = constant + root √|v|, Table 4.
    pub sigma_velocity_constant_mps: f64,
    /// See `sigma_velocity_constant_mps`.
    pub sigma_velocity_root: f64,
    /// |v| is taken inside these bounds, Table 4.
    pub speed_min_mps: f64,
    /// See `speed_min_mps`.
    pub speed_max_mps: f64,
    /// σ_ω, Table 4.
    pub sigma_yaw_rate_degps: f64,
    /// Particle reconstruction (section II.C); the sea trial had none.
    pub reconstruction: bool,
    /// k: 0.85³, section IV.B.
    pub monitor_ratio: f64,
    /// a, section IV.B.
    pub monitor_trials: u32,
    /// L̄ < k L_max as printed fires on a perfect filter four times out of five; log compares logarithms.
    pub monitor_reading: Reading,
    /// r of (19), section IV.B.
    pub replace_share: f64,
}

impl Default for LandmarkPaperSettings {
    fn default() -> Self {
        Self {
            exchange: ExchangeSettings::default(),
            particles: 3000,
            k_range: 3.0,
            k_own_bearing: 3.0,
            k_peer_bearing: 3.0,
            gate: GateName::Joint,
            sigma_velocity_constant_mps: 0.00084,
            sigma_velocity_root: 0.038,
            speed_min_mps: 0.05,
            speed_max_mps: 0.5,
            sigma_yaw_rate_degps: 0.0745,
            reconstruction: true,
            monitor_ratio: 0.6,
            monitor_trials: 2,
            monitor_reading: Reading::Log,
            replace_share: 0.5,
        }
    }
}

impl Settings for LandmarkPaperSettings {
    const METHOD: &'static str = "landmark-paper";

    fn bounds() -> Vec<Bounded> {
        let own = [
            ("particles", Bound::between(10.0, 1e6, "10 to 1,000,000")),
            ("k_range", Bound::POSITIVE),
            ("k_own_bearing", Bound::POSITIVE),
            ("k_peer_bearing", Bound::POSITIVE),
            ("sigma_velocity_constant_mps", Bound::NON_NEGATIVE),
            ("sigma_velocity_root", Bound::NON_NEGATIVE),
            ("speed_min_mps", Bound::NON_NEGATIVE),
            ("speed_max_mps", Bound::NON_NEGATIVE),
            ("sigma_yaw_rate_degps", Bound::NON_NEGATIVE),
            ("monitor_ratio", Bound::SHARE),
            ("monitor_trials", Bound::between(0.0, 1000.0, "0 to 1000")),
            ("replace_share", Bound::SHARE),
        ];
        own.into_iter().chain(ExchangeSettings::BOUNDS).collect()
    }

    fn unread(&self) -> Vec<Unread> {
        let mixture = self.gate == GateName::Mixture;
        let gated = matches!(self.gate, GateName::Joint | GateName::Separate);
        let of_reconstruction = ["monitor_ratio", "monitor_trials", "monitor_reading", "replace_share"];
        all_unread(!mixture, &["outlier_share"], "gate is not \"mixture\"")
            .chain(all_unread(!mixture, &ExchangeSettings::WIDTHS, "gate is not \"mixture\""))
            .chain(all_unread(
                !gated,
                &["k_range", "k_own_bearing", "k_peer_bearing"],
                "gate is neither \"joint\" nor \"separate\"",
            ))
            .chain(all_unread(!self.reconstruction, &of_reconstruction, "reconstruction is false"))
            .collect()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let exchange = &self.exchange;
        let options = PaperOptions {
            particles: self.particles,
            acoustics: Acoustics {
                sigma: exchange.sigma(),
                threshold: [self.k_range, self.k_own_bearing, self.k_peer_bearing],
            },
            gate: match self.gate {
                GateName::Joint => Gate::Joint,
                GateName::Separate => Gate::Separate,
                GateName::None => Gate::None,
                GateName::Mixture => {
                    Gate::Mixture { share: exchange.outlier_share, widths: exchange.widths() }
                }
            },
            sigma_velocity: [self.sigma_velocity_constant_mps, self.sigma_velocity_root],
            speed_bounds_mps: [self.speed_min_mps, self.speed_max_mps],
            sigma_yaw_rate_radps: self.sigma_yaw_rate_degps.to_radians(),
            monitor: self.reconstruction.then_some(MonitorRule {
                ratio: self.monitor_ratio,
                trials: self.monitor_trials,
                reading: match self.monitor_reading {
                    Reading::Linear => RatioReading::Linear,
                    Reading::Log => RatioReading::Log,
                },
            }),
            replace_share: self.replace_share,
            first_landmark: exchange.first_landmark(),
            packet: exchange.packet()?,
        };
        Made::navigator(LandmarkPaper::new(context.vehicle, context.vehicles, options, context.seed))
    }
}
