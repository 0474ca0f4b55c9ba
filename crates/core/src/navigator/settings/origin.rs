//! Settings of the navigators that exchange pose graphs (Walls & Eustice 2012).

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Bound, Bounded, Context, Made, Settings, Unread, all_unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::information::replica::Methods;
use crate::navigator::origin::deif::{Deif, Repair};
use crate::navigator::origin::heading_bank::HeadingBank;
use crate::navigator::origin::lasting::LastingOptions;
use crate::navigator::origin::local_options::LocalOptions;
use crate::navigator::origin::mdeif::{Mdeif, MdeifOptions};
use crate::packet::graph::GraphForm;

/// Form of a broadcast.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PacketForm {
    /// float64, for studies.
    #[serde(rename = "f64")]
    F64,
    /// Quantised for a frame of 32 bytes.
    #[serde(rename = "32")]
    Frame32,
    /// Of 64 bytes.
    #[serde(rename = "64")]
    Frame64,
    /// Of 256 bytes.
    #[serde(rename = "256")]
    Frame256,
}

impl From<PacketForm> for GraphForm {
    fn from(form: PacketForm) -> Self {
        match form {
            PacketForm::F64 => Self::F64,
            PacketForm::Frame32 => Self::Frame32,
            PacketForm::Frame64 => Self::Frame64,
            PacketForm::Frame256 => Self::Frame256,
        }
    }
}

/// Bounds of [`LocalOptions`].
pub const LOCAL_BOUNDS: [Bounded; 7] = [
    ("process_noise_m2_per_s3", Bound::POSITIVE),
    ("process_noise_dvl_m2_per_s3", Bound::POSITIVE),
    ("sigma_velocity0_mps", Bound::POSITIVE),
    ("sigma_odometry_scale", Bound::POSITIVE),
    ("sigma_gyro_bias_radps", Bound::NON_NEGATIVE),
    ("sigma_range_m", Bound::POSITIVE),
    ("gate_sigmas", Bound::POSITIVE),
];

/// Bounds of [`LastingOptions`].
pub const LASTING_BOUNDS: [Bounded; 5] = [
    ("sigma_range_bias_m", Bound::NON_NEGATIVE),
    ("sigma_range_drift_m", Bound::NON_NEGATIVE),
    ("range_drift_s", Bound::POSITIVE),
    ("noise_scale_max", Bound::between(1.0, 10.0, "1 to 10")),
    ("noise_scale_rate", Bound::SHARE),
];

/// Settings of `mdeif`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MdeifSettings {
    /// Own motion and sensors.
    #[serde(flatten)]
    pub local: LocalOptions,
    /// Errors that last, and noise that fits the day.
    #[serde(flatten)]
    pub lasting: LastingOptions,
    /// Form of a broadcast. Follows `acoustics.packet`.
    pub packet_form: PacketForm,
    /// With how many of the last transmissions an f64 packet holds the exact joint.
    pub exact_lags: usize,
    /// Reconstruct by the exact joint with the last node where the packet holds it.
    pub use_joint: bool,
    /// Else by equation (6) where its health indicator allows; else by the filtered-error model.
    pub use_equation_6: bool,
    /// Equation (6) is trusted while rounding costs it no more than this share of the least direction of what it solves for.
    pub health_loss_max: f64,
}

impl Default for MdeifSettings {
    fn default() -> Self {
        Self {
            local: LocalOptions::default(),
            lasting: LastingOptions::default(),
            packet_form: PacketForm::F64,
            exact_lags: 6,
            use_joint: true,
            use_equation_6: true,
            health_loss_max: 1e-4,
        }
    }
}

impl Settings for MdeifSettings {
    const METHOD: &'static str = "mdeif";

    fn bounds() -> Vec<Bounded> {
        let own =
            [("exact_lags", Bound::between(0.0, 8.0, "0 to 8")), ("health_loss_max", Bound::NON_NEGATIVE)];
        own.into_iter().chain(LOCAL_BOUNDS).chain(LASTING_BOUNDS).collect()
    }

    fn unread(&self) -> Vec<Unread> {
        let drifts = self.lasting.sigma_range_drift_m > 0.0;
        let grows = self.lasting.noise_scale_max > 1.0;
        all_unread(!self.use_equation_6, &["health_loss_max"], "use_equation_6 is false")
            .chain(all_unread(!drifts, &["range_drift_s"], "sigma_range_drift_m is 0"))
            .chain(all_unread(!grows, &["noise_scale_rate"], "noise_scale_max is 1"))
            .collect()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let options = MdeifOptions {
            local: self.local,
            lasting: self.lasting,
            form: self.packet_form.into(),
            exact_lags: self.exact_lags,
            methods: Methods {
                joint: self.use_joint,
                lags: self.exact_lags as u64,
                equation_6: self.use_equation_6,
                loss_max: self.health_loss_max,
            },
        };
        let mdeif = Mdeif::new(context.vehicle, &context.ranging(), options, context.sound_speed_mps);
        Made::navigator(mdeif.map(HeadingBank::new))
    }
}

/// Settings of `deif`: as published, packets of float64.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeifSettings {
    /// Own motion and sensors.
    #[serde(flatten)]
    pub local: LocalOptions,
}

fn deif(local: LocalOptions, context: &Context<'_>, repair: Repair) -> Result<Made, Error> {
    let ranging = context.ranging();
    Made::navigator(Deif::new(context.vehicle, &ranging, local, repair, context.sound_speed_mps))
}

impl Settings for DeifSettings {
    const METHOD: &'static str = "deif";
    const WITHOUT: &'static [Unread] = &[("packet_form", "deif broadcasts float64, as published")];

    fn bounds() -> Vec<Bounded> {
        LOCAL_BOUNDS.to_vec()
    }

    fn unread(&self) -> Vec<Unread> {
        Vec::new()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        deif(self.local, context, Repair::Oracle)
    }
}

/// Settings of `deif-redundant`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeifRedundantSettings {
    /// Own motion and sensors.
    #[serde(flatten)]
    pub local: LocalOptions,
    /// How many delta informations a packet holds: its own and the ones before it.
    pub repeats: usize,
}

impl Default for DeifRedundantSettings {
    fn default() -> Self {
        Self { local: LocalOptions::default(), repeats: 6 }
    }
}

impl Settings for DeifRedundantSettings {
    const METHOD: &'static str = "deif-redundant";
    const WITHOUT: &'static [Unread] = DeifSettings::WITHOUT;

    fn bounds() -> Vec<Bounded> {
        [("repeats", Bound::between(1.0, 16.0, "1 to 16"))].into_iter().chain(LOCAL_BOUNDS).collect()
    }

    fn unread(&self) -> Vec<Unread> {
        Vec::new()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        deif(self.local, context, Repair::Repeat(self.repeats))
    }
}
