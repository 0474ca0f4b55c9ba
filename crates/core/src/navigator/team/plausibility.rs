//! Whether what a packet claims of its sender's position can be, as far as the receiver knows.
//!
//! The bounds are sums of standard deviations, not roots of sums of squares: errors of dead reckoning are correlated over
//! a mission. An honest packet is practically never outside; a forged one can move nobody further than honest doubt does.

use super::Team;
use super::Teammate;
use super::reception::position_moments;
use crate::event::{VehicleId, seconds};
use crate::navigator::drift::Drift;
use crate::navigator::particle_core::FIXES_BELIEVED;
use crate::packet::{FixContent, ReportedFix};

/// So many sums of standard deviations away, a claim is not believed.
const PLAUSIBLE_SIGMAS: f64 = 5.0;

/// How far dead reckoning may err after `dt_s` at `speed_mps`, one standard deviation of each source added up, m.
fn reckoning_m(drift: &Drift, speed_mps: f64, dt_s: f64) -> f64 {
    let dt_s = dt_s.max(0.0);
    let rate_mps = drift.sigma_current0_mps
        + speed_mps * drift.sigma_heading_bias0_rad
        + drift.sigma_thrust_bias0_mps
        + dt_s.sqrt()
            * (drift.sigma_current_mps_per_sqrt_s
                + speed_mps * drift.sigma_heading_bias_rad_per_sqrt_s
                + drift.sigma_thrust_bias_mps_per_sqrt_s);
    rate_mps * dt_s + drift.sigma_position_m_per_sqrt_s * dt_s.sqrt()
}

fn larger_sigma([ee, _, nn]: [f64; 3]) -> f64 {
    ee.max(nn).max(0.0).sqrt()
}

impl<const K: usize> Team<K> {
    /// Whether a teammate that is heard for the first time stands elsewhere than its range says.
    pub(super) fn start_contradicts(
        &self,
        sender: VehicleId,
        toa_ns: i64,
        range_m: f64,
        fix: &ReportedFix,
    ) -> bool {
        let report = &self.scratch.report;
        let residual_m = match fix.content {
            FixContent::Start(_) => [0.0; 2],
            FixContent::Residual(residual_m) => residual_m,
        };
        let core = &self.terrain.state.core;
        let (own, covariance_m2) = core.cloud.position_moments();
        let back = core.displacement_since(toa_ns).unwrap_or_default();
        let between = [0, 1].map(|a| report.position_m[a] + residual_m[a] - own[a] + back[a]);
        let speed_mps = self.scratch.updates.speed(report);
        let doubt_m = fix.sigma_m
            + reckoning_m(&self.options.drifts[usize::from(sender)], speed_mps, fix.age_s)
            + larger_sigma(covariance_m2)
            + self.options.sigma_range_m
            + self.options.clock.doubt_m(self.radio.sound_speed_mps, range_m, seconds(toa_ns));
        let off_m = (between[0].hypot(between[1]) - range_m).abs();
        // What is not a number contradicts.
        off_m.is_nan() || doubt_m.is_nan() || off_m > PLAUSIBLE_SIGMAS * doubt_m
    }

    /// Takes a fix that contradicts the teammate's block out of the packet and counts it, unless it insists: a lost
    /// teammate that surfaces must be able to start anew. Returns how many contradicting ones there are in a row.
    pub(super) fn weigh_up_fix(
        &mut self,
        index: usize,
        base: usize,
        sender: VehicleId,
        tol_ns: i64,
        mate: &Teammate,
    ) -> u32 {
        let Some(fix) = self.scratch.report.fix else { return mate.contradicting_fixes };
        let FixContent::Residual(residual_m) = fix.content else { return mate.contradicting_fixes };
        if !self.fix_contradicts(index, base, sender, tol_ns, mate, (&fix, residual_m)) {
            return 0;
        }
        if mate.contradicting_fixes + 1 >= FIXES_BELIEVED {
            return 0;
        }
        self.scratch.report.fix = None;
        self.terrain.state.core.rejected += 1;
        mate.contradicting_fixes + 1
    }

    fn fix_contradicts(
        &self,
        index: usize,
        base: usize,
        sender: VehicleId,
        tol_ns: i64,
        mate: &Teammate,
        (fix, residual_m): (&ReportedFix, [f64; 2]),
    ) -> bool {
        let (report, updates) = (&self.scratch.report, &self.scratch.updates);
        let t_ns = tol_ns.saturating_sub((fix.age_s * 1e9).round() as i64);
        let dt_s = seconds(t_ns.saturating_sub(mate.tol_ns)).max(0.0);
        let (group, weights) = (&self.state.groups[index], self.weights());
        let (mean, covariance_m2) = position_moments(group, base, weights);
        // Its current stands three places after its position.
        let (current, current_m2ps2) = position_moments(group, base + 3, weights);
        let (here, began) = (updates.at(t_ns), updates.at(mate.tol_ns));
        let off = [0, 1].map(|a| {
            let reported = report.position_m[a] + here[a] + residual_m[a];
            let expected = mean[a] + here[a] - began[a] + current[a] * dt_s;
            reported - expected
        });
        let drift = &self.options.drifts[usize::from(sender)];
        let doubt_m = fix.sigma_m
            + larger_sigma(covariance_m2)
            + larger_sigma(current_m2ps2) * dt_s
            + reckoning_m(drift, updates.speed(report), dt_s);
        let off_m = off[0].hypot(off[1]);
        off_m.is_nan() || doubt_m.is_nan() || off_m > PLAUSIBLE_SIGMAS * doubt_m
    }
}
