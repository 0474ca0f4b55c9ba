//! Settings of `mpf`; the package's methods page is their source.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::range::{BeliefForm, RangeSettings};
use super::terrain::TerrainSettings;
use super::{Bound, Bounded, Context, DriftSettings, Made, Settings, Unread, all_unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::navigator::mpf::{Mpf, MpfOptions};
use crate::navigator::range::RangeMethod;

/// Exponent of the range likelihood where every range counts alike.
const TEMPER_WITHOUT_NOVELTY: f64 = 0.05;

/// Settings of `mpf` and `mpf-terrain-only`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MpfSettings {
    /// The own core.
    #[serde(flatten)]
    pub terrain: TerrainSettings,
    /// Drift.
    #[serde(flatten)]
    pub drift: DriftSettings,
    /// Ranges.
    #[serde(flatten)]
    pub range: RangeSettings,
    /// A teammate's position is wrong by an error that lasts: of its range counts what is new since it was last heard.
    pub range_novelty: bool,
    /// Further exponent of the range likelihood. `None`: 1 over the number of teammates; 0.05 without `range_novelty`.
    pub range_temper: Option<f64>,
    /// Kernel width of the entropies that say what a range told, m; `None`: not asked.
    pub entropy_sigma_m: Option<f64>,
    /// Broadcast belief.
    pub packet: BeliefForm,
}

impl Default for MpfSettings {
    fn default() -> Self {
        Self {
            terrain: TerrainSettings::default(),
            drift: DriftSettings::default(),
            range: RangeSettings { range_gate_sigmas: Some(6.0), ..RangeSettings::default() },
            range_novelty: true,
            range_temper: None,
            entropy_sigma_m: None,
            packet: BeliefForm::Rounded,
        }
    }
}

impl MpfSettings {
    /// The options on this chart, in a team of so many.
    #[must_use]
    pub fn options(&self, chart: Option<&Chart>, vehicles: usize) -> MpfOptions {
        let temper = self.range_temper.unwrap_or(if self.range_novelty {
            1.0 / vehicles.saturating_sub(1).max(1) as f64
        } else {
            TEMPER_WITHOUT_NOVELTY
        });
        MpfOptions {
            terrain: self.terrain.options(chart, self.drift.options()),
            range: self.range.options(RangeMethod::Gaussian { temper }, self.entropy_sigma_m),
            range_novelty: self.range_novelty,
            packet: self.packet.into(),
        }
    }
}

impl Settings for MpfSettings {
    const METHOD: &'static str = "mpf";
    const WITHOUT: &'static [Unread] = &[
        ("range_method", "mpf has one range likelihood, the Gaussian"),
        ("range_samples", "mpf draws no samples of a broadcast belief"),
    ];

    fn bounds() -> Vec<Bounded> {
        let own = [("range_temper", Bound::SHARE), ("entropy_sigma_m", Bound::POSITIVE)];
        own.into_iter()
            .chain(RangeSettings::BOUNDS)
            .chain(TerrainSettings::bounds())
            .chain(DriftSettings::bounds())
            .collect()
    }

    fn unread(&self) -> Vec<Unread> {
        let of_ranges = ["range_novelty", "range_temper", "entropy_sigma_m", "packet"];
        let off = !self.range.use_ranges;
        self.terrain
            .unread()
            .chain(self.terrain.unread_biases())
            .chain(all_unread(off, &RangeSettings::OPTIONS, RangeSettings::OFF))
            .chain(all_unread(off, &of_ranges, RangeSettings::OFF))
            .collect()
    }

    fn make(&self, context: &Context<'_>, chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let Context { vehicle, vehicles, sound_speed_mps, seed, .. } = *context;
        let options = self.options(chart.as_deref(), vehicles);
        if self.terrain.bias_states {
            Made::navigator(Mpf::<4>::new(vehicle, vehicles, options, chart, sound_speed_mps, seed))
        } else {
            Made::navigator(Mpf::<2>::new(vehicle, vehicles, options, chart, sound_speed_mps, seed))
        }
    }
}
