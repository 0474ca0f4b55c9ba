//! What became of ranges: counts, and the last one as it was judged.

use serde::{Deserialize, Serialize};

use crate::measurement::range::{CloudInnovation, LateArrivals};

/// Counts of ranges that were not used, and the last own range.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct RangeRecord {
    /// Own ranges that the particles contradict.
    pub gated: u64,
    /// Reported ranges that they contradict.
    pub reported_gated: u64,
    /// Reported ranges to a launch that the sender cannot have heard since its last broadcast.
    pub reported_stale: u64,
    /// Ranges that are none: not above zero, or shorter than the difference of the depths.
    pub impossible: u64,
    /// Innovation of the last own range, its standard deviation, and the posterior share of a late arrival.
    last: Option<[f64; 3]>,
}

impl RangeRecord {
    /// Remembers how the last own range was judged.
    pub fn judged(&mut self, seen: &CloudInnovation, late: Option<&LateArrivals>) {
        let share = late.map_or(0.0, |l| l.likelihood(seen.mean_m, seen.variance_m2).late_share);
        self.last = Some([seen.mean_m, seen.variance_m2.sqrt(), share]);
    }

    /// By name; the share of late arrivals where there are any.
    pub fn diagnostics(&self, late: bool) -> Vec<(&'static str, f64)> {
        let [innovation_m, sigma_m, share] = self.last.unwrap_or([f64::NAN; 3]);
        let counts = [
            ("ranges_gated", self.gated),
            ("reported_ranges_gated", self.reported_gated),
            ("reported_ranges_stale", self.reported_stale),
            ("ranges_impossible", self.impossible),
        ];
        let last = [("range_innovation_m", innovation_m), ("range_innovation_sigma_m", sigma_m)];
        let share = late.then_some(("range_late_share", share));
        counts.into_iter().map(|(name, count)| (name, count as f64)).chain(last).chain(share).collect()
    }
}
