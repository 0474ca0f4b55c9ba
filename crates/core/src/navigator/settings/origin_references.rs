//! Settings of what navigators that exchange pose graphs are compared with.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::origin::{LOCAL_BOUNDS, PacketForm};
use super::range::RangeSettings;
use super::{Bound, Bounded, Context, Made, Settings, Unread, all_unread};
use crate::chart::Chart;
use crate::error::Error;
use crate::navigator::origin::belief::{BeliefNavigator, BeliefOptions, Correlation};
use crate::navigator::origin::central::{Cekf, CentralOptions, Received};
use crate::navigator::origin::interleaved::{Interleaved, InterleavedOptions};
use crate::navigator::origin::local_options::LocalOptions;
use crate::packet::PacketKind;

/// What a centralised filter is fed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fed {
    /// All that the team senses and hears.
    Everything,
    /// Each vehicle alone, with the raw data of exactly the packets that reached it.
    Received,
}

/// Settings of `cekf` and `cekf-received`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CekfSettings {
    /// Own motion and sensors.
    #[serde(flatten)]
    pub local: LocalOptions,
    /// What it is fed.
    pub fed: Fed,
    /// Length of the packet that a range is assumed to ride on, for loss and air time; 0: a frame whatever its size.
    pub assumed_packet_bytes: usize,
}

impl Default for CekfSettings {
    fn default() -> Self {
        Self { local: LocalOptions::default(), fed: Fed::Everything, assumed_packet_bytes: 0 }
    }
}

impl Settings for CekfSettings {
    const METHOD: &'static str = "cekf";

    fn bounds() -> Vec<Bounded> {
        let own = ("assumed_packet_bytes", Bound::between(0.0, 4096.0, "0 to 4096"));
        [own].into_iter().chain(LOCAL_BOUNDS).collect()
    }

    fn unread(&self) -> Vec<Unread> {
        Vec::new()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let options = CentralOptions {
            local: self.local,
            ranging: context.ranging(),
            sound_speed_mps: context.sound_speed_mps,
            packet_bytes: self.assumed_packet_bytes,
        };
        match self.fed {
            Fed::Everything => Made::central(Cekf::new(options)),
            Fed::Received => Made::central(Received::new(options)),
        }
    }
}

/// Settings of `nekf`, `covariance-intersection` and `local-only`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeliefSettings {
    /// Own motion and sensors.
    #[serde(flatten)]
    pub local: LocalOptions,
    /// What is assumed of a teammate's belief and one's own.
    pub correlation: Correlation,
    /// Factor on the process noises.
    pub process_noise_factor: f64,
    /// False: it neither uses ranges nor broadcasts.
    pub use_ranges: bool,
    /// f64: 47 bytes; any other: 15, rounded so that a belief is never overstated. Follows `acoustics.packet`.
    pub packet_form: PacketForm,
}

impl Default for BeliefSettings {
    fn default() -> Self {
        Self {
            local: LocalOptions::default(),
            correlation: Correlation::Ignored,
            process_noise_factor: 1.0,
            use_ranges: true,
            packet_form: PacketForm::F64,
        }
    }
}

impl Settings for BeliefSettings {
    const METHOD: &'static str = "belief-exchange";

    fn bounds() -> Vec<Bounded> {
        [("process_noise_factor", Bound::POSITIVE)].into_iter().chain(LOCAL_BOUNDS).collect()
    }

    fn unread(&self) -> Vec<Unread> {
        let of_ranges = ["sigma_range_m", "clock", "correlation", "packet_form"];
        all_unread(!self.use_ranges, &of_ranges, RangeSettings::OFF).collect()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let options = BeliefOptions {
            local: self.local,
            correlation: self.correlation,
            process_noise_factor: self.process_noise_factor,
            ranging: context.ranges() && self.use_ranges,
            talking: self.use_ranges,
            packet: match self.packet_form {
                PacketForm::F64 => PacketKind::BeliefF64,
                _ => PacketKind::Belief,
            },
        };
        let Context { vehicle, vehicles, sound_speed_mps, .. } = *context;
        Made::navigator(BeliefNavigator::new(vehicle, vehicles, options, sound_speed_mps))
    }
}

/// Settings of `interleaved`: its bank is broadcast in float64, 42 bytes for each filter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InterleavedSettings {
    /// Own motion and sensors.
    #[serde(flatten)]
    pub local: LocalOptions,
}

impl Settings for InterleavedSettings {
    const METHOD: &'static str = "interleaved";
    const WITHOUT: &'static [Unread] = &[("packet_form", "interleaved broadcasts its bank as float64")];

    fn bounds() -> Vec<Bounded> {
        LOCAL_BOUNDS.to_vec()
    }

    fn unread(&self) -> Vec<Unread> {
        Vec::new()
    }

    fn make(&self, context: &Context<'_>, _chart: Option<Arc<Chart>>) -> Result<Made, Error> {
        let options = InterleavedOptions { local: self.local, ranging: context.ranges() };
        let Context { vehicle, vehicles, sound_speed_mps, .. } = *context;
        Made::navigator(Interleaved::new(vehicle, vehicles, options, sound_speed_mps))
    }
}
