//! Settings of `dmpf`: the values of Tan, Chitre & Hover (2016).

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::drift::BIAS_OPTIONS;
use super::range::RangeSettings;
use super::terrain::PARTICLES;
use super::{Bound, Bounded, Context, DriftPreset, DriftSettings, Made, Settings, Unread, all_unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::navigator::dmpf::{Dmpf, DmpfOptions};
use crate::navigator::range::RangeMethod;
use crate::packet::{MODES_MAX, PacketKind};

/// Form of the broadcast belief.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DmpfPacket {
    /// 15 bytes, never overstating knowledge.
    Rounded,
    /// 47 bytes.
    F64,
    /// A Gaussian mixture (section 7).
    Modes,
    /// All particles (section 5.1), 24 bytes each.
    Particles,
}

/// Likelihood of a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RangeLikelihood {
    /// Equation (17).
    Eq17,
    /// Its Gaussian second-order form.
    Gaussian,
}

/// Settings of `dmpf`, `dmpf-unlimited`, `terrain-only` and `ranging-only`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DmpfSettings {
    /// Particles.
    pub particles: usize,
    /// Resample when the effective sample size falls to this share of the particles (14).
    pub resample_share: f64,
    /// Whether soundings are used.
    pub use_terrain: bool,
    /// ℓ, the number of depth differences along the vehicle's track.
    pub window: usize,
    /// Sigma of a difference in (15), m. The paper states none; 0.05 m times √ℓ, since each sounding is used ℓ times.
    pub sigma_like_m: f64,
    /// Variance of the roughening per axis, m²; `None`: twice the resolution of the chart, as section 3.3 has it (2 m² at
    /// 1 m, and without a chart).
    pub roughening_m2: Option<f64>,
    /// Ranges.
    #[serde(flatten)]
    pub range: RangeSettings,
    /// Likelihood of a range.
    pub range_method: RangeLikelihood,
    /// Samples of the broadcast belief in (17); `None`: as many as particles.
    pub range_samples: Option<usize>,
    /// Exponent of the Gaussian range likelihood.
    pub range_temper: f64,
    /// Kernel width of the entropies (20)–(21) that say what a range told, m; `None`: not asked.
    pub entropy_sigma_m: Option<f64>,
    /// The same, of whole measurement updates (18), soundings and ranges; `None`: not asked.
    pub update_entropy_sigma_m: Option<f64>,
    /// Broadcast belief.
    pub packet: DmpfPacket,
    /// Modes of a `modes` packet.
    pub modes: usize,
    /// Drift.
    #[serde(flatten)]
    pub drift: DriftSettings,
}

impl Default for DmpfSettings {
    fn default() -> Self {
        Self {
            particles: 600,
            resample_share: 2.0 / 3.0,
            use_terrain: true,
            window: 14,
            sigma_like_m: 0.2,
            roughening_m2: None,
            range: RangeSettings::default(),
            range_method: RangeLikelihood::Eq17,
            range_samples: None,
            range_temper: 1.0,
            entropy_sigma_m: None,
            update_entropy_sigma_m: None,
            packet: DmpfPacket::Rounded,
            modes: 2,
            drift: DriftSettings { drift: DriftPreset::Table1, ..DriftSettings::default() },
        }
    }
}

impl Settings for DmpfSettings {
    const METHOD: &'static str = "dmpf";

    fn bounds() -> Vec<Bounded> {
        let own = [
            PARTICLES,
            ("resample_share", Bound::SHARE),
            // Soundings stay within the trajectory that is kept, and the fast path within one pattern.
            ("window", Bound::between(1.0, 120.0, "1 to 120 differences")),
            ("sigma_like_m", Bound::POSITIVE),
            ("roughening_m2", Bound::NON_NEGATIVE),
            ("range_samples", Bound::between(1.0, 1e6, "1 to 1,000,000")),
            ("range_temper", Bound::SHARE),
            ("entropy_sigma_m", Bound::POSITIVE),
            ("update_entropy_sigma_m", Bound::POSITIVE),
            ("modes", Bound::between(1.0, MODES_MAX as f64, "1 to 4")),
        ];
        own.into_iter().chain(RangeSettings::BOUNDS).chain(DriftSettings::bounds()).collect()
    }

    fn unread(&self) -> Vec<Unread> {
        let ranges = self.range.use_ranges;
        let eq17 = ranges && self.range_method == RangeLikelihood::Eq17;
        let of_ranges =
            ["range_method", "range_samples", "range_temper", "entropy_sigma_m", "packet", "modes"];
        all_unread(!ranges, &RangeSettings::OPTIONS, RangeSettings::OFF)
            .chain(all_unread(!ranges, &of_ranges, RangeSettings::OFF))
            .chain(all_unread(eq17, &["clock"], "(17) has no variance; range_method = \"gaussian\" has"))
            .chain(all_unread(
                eq17,
                &["range_temper"],
                "(17) has no exponent; range_method = \"gaussian\" has",
            ))
            .chain(all_unread(
                eq17 && self.range.range_gate_sigmas.is_none(),
                &["sigma_range_m"],
                "(17) has no sigma; a gate (range_gate_sigmas) or range_method = \"gaussian\" has",
            ))
            .chain(all_unread(ranges && !eq17, &["range_samples"], "range_method is gaussian"))
            .chain(all_unread(
                eq17 && self.packet == DmpfPacket::Particles,
                &["range_samples"],
                "(17) takes every particle of a \"particles\" packet",
            ))
            .chain(all_unread(
                ranges && self.packet != DmpfPacket::Modes,
                &["modes"],
                "packet is not \"modes\"",
            ))
            .chain(all_unread(!self.use_terrain, &["window", "sigma_like_m"], "use_terrain is false"))
            .chain(all_unread(true, &BIAS_OPTIONS, "dmpf has no bias states"))
            .collect()
    }

    fn make(&self, context: &Context<'_>, chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let method = match self.range_method {
            RangeLikelihood::Eq17 => RangeMethod::Eq17 { samples: self.range_samples.unwrap_or(0) },
            RangeLikelihood::Gaussian => RangeMethod::Gaussian { temper: self.range_temper },
        };
        let options = DmpfOptions {
            particles: self.particles,
            window: self.window,
            sigma_like_m: self.sigma_like_m,
            resample_share: self.resample_share,
            roughening_m2: self.roughening_m2.unwrap_or_else(|| twice_the_resolution(chart.as_deref())),
            range: self.range.options(method, self.entropy_sigma_m),
            terrain: self.use_terrain,
            packet: match self.packet {
                DmpfPacket::Rounded => PacketKind::Belief,
                DmpfPacket::F64 => PacketKind::BeliefF64,
                DmpfPacket::Modes => PacketKind::Mixture,
                DmpfPacket::Particles => PacketKind::Cloud,
            },
            modes: self.modes,
            update_entropy_sigma_m: self.update_entropy_sigma_m,
            drift: self.drift.options(),
        };
        let Context { vehicle, vehicles, sound_speed_mps, seed, .. } = *context;
        Made::navigator(Dmpf::new(vehicle, vehicles, options, chart, sound_speed_mps, seed))
    }
}

/// The paper's number: "two times the map resolution" as a variance, so of a map in metres, m².
fn twice_the_resolution(chart: Option<&Chart>) -> f64 {
    2.0 * chart.map_or(1.0, |chart| chart.grid().cell_m)
}
