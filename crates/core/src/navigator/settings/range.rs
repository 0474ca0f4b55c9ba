//! Options of the ranges of `dmpf` and `mpf`.

use serde::{Deserialize, Serialize};

use super::{Bound, Bounded};
use crate::navigator::clock::ClockOptions;
use crate::navigator::range::{RangeMethod, RangeOptions};
use crate::packet::PacketKind;

/// Form of a broadcast belief without a limit on bandwidth, or with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BeliefForm {
    /// 15 bytes, never overstating knowledge.
    Rounded,
    /// 47 bytes.
    F64,
}

impl From<BeliefForm> for PacketKind {
    fn from(form: BeliefForm) -> Self {
        match form {
            BeliefForm::Rounded => Self::Belief,
            BeliefForm::F64 => Self::BeliefF64,
        }
    }
}

/// Ranges to teammates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RangeSettings {
    /// Whether to broadcast and to use ranges.
    pub use_ranges: bool,
    /// Standard deviation of a range, m.
    pub sigma_range_m: f64,
    /// Ranges that contradict the cloud by more than this many sigmas are gated and counted; `None`: never.
    pub range_gate_sigmas: Option<f64>,
    /// What may be wrong with one-way ranges: clocks, sound speed, late arrivals.
    pub clock: ClockOptions,
}

impl RangeSettings {
    /// Bounds of its options.
    pub const BOUNDS: [Bounded; 2] =
        [("sigma_range_m", Bound::POSITIVE), ("range_gate_sigmas", Bound::POSITIVE)];
    /// Its options but for the switch.
    pub const OPTIONS: [&'static str; 3] = ["sigma_range_m", "range_gate_sigmas", "clock"];
    /// Why they are not read.
    pub const OFF: &'static str = "use_ranges is false";

    /// The gate; infinite for never.
    #[must_use]
    pub fn gate_sigmas(&self) -> f64 {
        self.range_gate_sigmas.unwrap_or(f64::INFINITY)
    }

    /// With a likelihood; `None` where ranges are not used.
    #[must_use]
    pub fn options(&self, method: RangeMethod, entropy_sigma_m: Option<f64>) -> Option<RangeOptions> {
        let gate_sigmas = self.gate_sigmas();
        self.use_ranges.then_some(RangeOptions {
            method,
            sigma_m: self.sigma_range_m,
            gate_sigmas,
            entropy_sigma_m,
            clock: self.clock,
        })
    }
}

impl Default for RangeSettings {
    fn default() -> Self {
        Self { use_ranges: true, sigma_range_m: 1.0, range_gate_sigmas: None, clock: ClockOptions::default() }
    }
}
