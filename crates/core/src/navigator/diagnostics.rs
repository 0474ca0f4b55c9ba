//! What navigators say of themselves beside the estimate: drift, counts by kind of event, teammates.

use serde::{Deserialize, Serialize};

use super::Outcome;
use super::particle_core::ParticleCore;
use crate::event::{Payload, seconds};
use crate::kernels::particles::MAX_LINEAR;
use crate::kernels::weights::weighted_covariance;

/// Names of the linear states and of their standard deviations, as diagnostics have them.
pub const LINEAR_STATES: [[&str; 2]; MAX_LINEAR] = [
    ["current_east_mps", "sigma_current_east_mps"],
    ["current_north_mps", "sigma_current_north_mps"],
    ["heading_bias_rad", "sigma_heading_bias_rad"],
    ["thrust_bias_mps", "sigma_thrust_bias_mps"],
];

/// Counts since the start of the mission.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GatedCounts {
    fixes: u64,
    soundings: u64,
    ranges: u64,
    packets: u64,
    velocities: u64,
}

impl GatedCounts {
    /// Counts what became of an event, of which `more` measurements were gated or packets rejected.
    pub fn count(&mut self, payload: &Payload, outcome: Outcome, more: u64) {
        match payload {
            Payload::Fix { .. } | Payload::Usbl { .. } => self.fixes += more,
            Payload::GroundVelocity { .. } | Payload::Odometry { .. } => self.velocities += more,
            Payload::WaterDepth { .. } => self.soundings += more,
            Payload::Reception { .. } if outcome == Outcome::Rejected => self.packets += more,
            Payload::Reception { .. } | Payload::BeaconRange { .. } => self.ranges += more,
            _ => {}
        }
    }

    /// By name.
    #[must_use]
    pub fn diagnostics(&self) -> [(&'static str, f64); 5] {
        [
            ("gated_fixes", self.fixes as f64),
            ("gated_soundings", self.soundings as f64),
            ("gated_ranges", self.ranges as f64),
            ("rejected_packets", self.packets as f64),
            ("gated_velocities", self.velocities as f64),
        ]
    }
}

impl<const K: usize> ParticleCore<K> {
    /// Counts by kind what an event that began with `rejected_before` added to the gated and rejected.
    pub fn count_gated(&mut self, payload: &Payload, outcome: Outcome, rejected_before: u64) {
        self.gated.count(payload, outcome, self.rejected.saturating_sub(rejected_before));
    }

    /// Mean (10) and standard deviation (12) of each linear state, counts by kind; NaN before the start.
    #[must_use]
    pub fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut columns = Vec::with_capacity(16);
        let mean = self.cloud.linear_mean();
        for (k, column) in self.cloud.linear.iter().enumerate() {
            let spread_m2 = weighted_covariance(self.cloud.weights(), column, mean[k], column, mean[k]);
            let sigma = (self.covariance[(k, k)] + spread_m2).max(0.0).sqrt();
            let [name, name_of_sigma] = LINEAR_STATES[k];
            let known = self.started();
            columns.push((name, if known { mean[k] } else { f64::NAN }));
            columns.push((name_of_sigma, if known { sigma } else { f64::NAN }));
        }
        columns.extend(self.gated.diagnostics());
        columns.push(("restarts", f64::from(self.restarts)));
        columns.extend(self.cloud.information_nat().map(|nat| ("updates_information_nat", nat)));
        columns
    }
}

/// How many teammates were heard, for how long the one that was silent longest, and how uncertain the least certain one
/// was of its position when last heard; from each one's last launch and covariance [ee, en, nn], m². NaN for nobody.
pub fn teammates(
    now_ns: Option<i64>,
    heard: impl Iterator<Item = (i64, [f64; 3])>,
) -> [(&'static str, f64); 3] {
    let (mut count, mut longest_s, mut widest_m) = (0.0, f64::NAN, f64::NAN);
    for (tol_ns, [ee, _, nn]) in heard {
        count += 1.0;
        longest_s = f64::max(longest_s, seconds(now_ns.unwrap_or(tol_ns).saturating_sub(tol_ns)));
        widest_m = f64::max(widest_m, (ee + nn).sqrt());
    }
    [
        ("teammates_heard", count),
        ("teammate_longest_unheard_s", longest_s),
        ("teammate_largest_sigma_m", widest_m),
    ]
}
