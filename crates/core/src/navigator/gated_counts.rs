//! What was gated or rejected, by kind of event.

use serde::{Deserialize, Serialize};

use super::Outcome;
use crate::event::Payload;

/// Counts since the start of the mission.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GatedCounts {
    fixes: u64,
    soundings: u64,
    ranges: u64,
    packets: u64,
}

impl GatedCounts {
    /// Counts what became of an event, of which `more` measurements were gated or packets rejected.
    pub fn count(&mut self, payload: &Payload, outcome: Outcome, more: u64) {
        match payload {
            Payload::Fix { .. } => self.fixes += more,
            Payload::WaterDepth { .. } => self.soundings += more,
            Payload::Reception { .. } if outcome == Outcome::Rejected => self.packets += more,
            Payload::Reception { .. } => self.ranges += more,
            _ => {}
        }
    }

    /// By name.
    #[must_use]
    pub fn diagnostics(&self) -> [(&'static str, f64); 4] {
        [
            ("gated_fixes", self.fixes as f64),
            ("gated_soundings", self.soundings as f64),
            ("gated_ranges", self.ranges as f64),
            ("rejected_packets", self.packets as f64),
        ]
    }
}
