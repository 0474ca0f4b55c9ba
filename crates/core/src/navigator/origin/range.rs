//! A range between the sender's node at launch and the receiver's at arrival.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::lasting::Seen;
use super::local_options::LocalOptions;
use crate::error::{Error, non_negative};
use crate::event::seconds;
use crate::information::{Innovation, Joint, NODE, Term};
use crate::link::{depth_rounding_m2, range_m, slant_to_horizontal};
use crate::measurement::range::LateArrivals;
use crate::navigator::radio::SLANT_GATES;
use crate::navigator::{Innovation as RangeInnovation, LastInnovation, Outcome};

/// A range that is this likely by a longer way is left out.
const LATE_LEFT_OUT: f64 = 0.99;

/// The k-th range with one standing error of variance S beside a fresh one of σ² adds the information
/// σ²/((σ² + kS)(σ² + (k − 1)S)). Each counts by (σ² + S)(σ² + STANDS S)/σ²: a vehicle that moves forgets older ones by its own
/// drift.
const STANDS: f64 = 4.0;

/// What a range's error is made of, as far as one range tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeNoise {
    /// Noise of this range alone, m.
    pub fresh_m: f64,
    /// Noise and what stands from range to range (clocks, sound speed), one standard deviation, m.
    pub whole_m: f64,
    /// Arrivals by a longer way.
    pub late: Option<LateArrivals>,
}

impl RangeNoise {
    /// Of a travel time, by the options. Neither clocks nor sound speed are estimated here.
    #[must_use]
    pub fn of(options: &LocalOptions, tol_ns: i64, toa_ns: i64, sound_speed_mps: f64) -> Self {
        let fresh_m = options.sigma_range_m;
        let slant_m = (seconds(toa_ns.saturating_sub(tol_ns)) * sound_speed_mps).max(0.0);
        let standing_m2 = options.clock.standing_m2(sound_speed_mps, slant_m, seconds(tol_ns));
        let whole_m = if standing_m2 > 0.0 { (fresh_m * fresh_m + standing_m2).sqrt() } else { fresh_m };
        Self { fresh_m, whole_m, late: options.clock.late() }
    }

    /// S/σ².
    fn standing_share(&self) -> f64 {
        (self.whole_m / self.fresh_m).powi(2) - 1.0
    }

    /// The range of a slant range that was reduced to the horizontal.
    #[must_use]
    pub fn range(&self, slant_m: f64, horizontal_m: f64) -> Range {
        let slope = slant_m / horizontal_m;
        let counted_m = self.whole_m * (1.0 + STANDS * self.standing_share()).sqrt();
        Range {
            range_m: horizontal_m,
            sigma_m: self.whole_m * slope,
            counted_m: counted_m * slope,
            late: self.late,
        }
    }
}

/// A horizontal range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// m.
    pub range_m: f64,
    /// Its standard deviation, m: that of the slant range times slant over horizontal, and what the sender's rounded depth
    /// adds. Ranges are gated by it.
    pub sigma_m: f64,
    /// The standard deviation with which it is fused, m: larger where a part of the error stands from range to range.
    pub counted_m: f64,
    /// Arrivals by a longer way.
    pub late: Option<LateArrivals>,
}

impl Range {
    /// From the travel time, reduced by both depths, the sender's carried in steps of `sender_step_m` (0 for exact);
    /// `None` for one so steep that it has no information on the horizontal distance.
    ///
    /// # Errors
    /// [`Error::Link`] for a travel time that is none, or a slant range too short for the depths.
    pub fn measured(
        tol_ns: i64,
        toa_ns: i64,
        sound_speed_mps: f64,
        own_depth_m: f64,
        sender_depth_m: f64,
        sender_step_m: f64,
        options: &LocalOptions,
    ) -> Result<Option<Self>, Error> {
        non_negative("sender's depth, m", sender_depth_m)?;
        let noise = RangeNoise::of(options, tol_ns, toa_ns, sound_speed_mps);
        let slant_m = range_m(tol_ns, toa_ns, sound_speed_mps)?;
        let slant_sigma_m =
            if sender_step_m > 0.0 { noise.whole_m.hypot(sender_step_m) } else { noise.whole_m };
        let horizontal =
            slant_to_horizontal(slant_m, own_depth_m, sender_depth_m, slant_sigma_m, SLANT_GATES)?;
        if horizontal.clamped || horizontal.range_m <= noise.whole_m {
            return Ok(None);
        }
        let rounding_m2 = depth_rounding_m2(horizontal.range_m, own_depth_m - sender_depth_m, sender_step_m);
        Ok(Some(noise.range(slant_m, horizontal.range_m).with_rounding(rounding_m2)))
    }

    /// The same with this variance in addition, m².
    #[must_use]
    pub fn with_rounding(mut self, rounding_m2: f64) -> Self {
        if rounding_m2 > 0.0 {
            self.sigma_m = (self.sigma_m * self.sigma_m + rounding_m2).sqrt();
            self.counted_m = (self.counted_m * self.counted_m + rounding_m2).sqrt();
        }
        self
    }

    /// Fuses it between the sender's node at launch and the receiver's at arrival, linearised at their means. Gated (and
    /// nothing changed) when it contradicts the joint by more than `gate_sigmas`, comes by a longer way for all that is
    /// known, or the means coincide. One that may be late counts by how likely it is not (an update with R/γ).
    pub fn fuse(&self, joint: &mut Joint, sender: usize, receiver: usize, gate_sigmas: f64) -> Outcome {
        self.fuse_seen(joint, sender, receiver, gate_sigmas, &mut LastInnovation::default())
    }

    /// As [`Range::fuse`]; `last` takes how the range fitted the joint before.
    pub fn fuse_seen(
        &self,
        joint: &mut Joint,
        sender: usize,
        receiver: usize,
        gate_sigmas: f64,
        last: &mut LastInnovation,
    ) -> Outcome {
        self.fuse_with_error(joint, (sender, receiver), None, (1.0, gate_sigmas), last).0
    }

    /// As [`Range::fuse_seen`] with the node of an error that lasts, whose first two entries add to the range, and its noise
    /// `noise_scale` times as large (variance); and what it told of the noise.
    pub fn fuse_with_error(
        &self,
        joint: &mut Joint,
        (sender, receiver): (usize, usize),
        error: Option<usize>,
        (noise_scale, gate_sigmas): (f64, f64),
        last: &mut LastInnovation,
    ) -> (Outcome, Option<Seen>) {
        let between = (joint.node_mean(receiver) - joint.node_mean(sender)).fixed_rows::<2>(0).into_owned();
        let distance_m = between.norm();
        if distance_m <= f64::MIN_POSITIVE {
            return (Outcome::Gated, None);
        }
        let mut observe = SMatrix::<f64, 1, NODE>::zeros();
        observe.fixed_view_mut::<1, 2>(0, 0).copy_from(&(between / distance_m).transpose());
        let mut terms = vec![Term { node: receiver, observe }, Term { node: sender, observe: -observe }];
        let mut predicted_m = distance_m;
        if let Some(node) = error {
            predicted_m += joint.node_mean(node).fixed_rows::<2>(0).sum();
            terms.push(Term { node, observe: [[1.0], [1.0], [0.0], [0.0]].into() });
        }
        let (value, predicted) = (SVector::<f64, 1>::new(self.range_m), SVector::<f64, 1>::new(predicted_m));
        let innovation = |joint: &Joint, variance_m2: f64| -> Option<Innovation<1>> {
            joint.innovation(&terms, &value, &predicted, &SMatrix::<f64, 1, 1>::new(variance_m2))
        };
        let noise_m2 = self.sigma_m * self.sigma_m * noise_scale;
        let Some(seen) = innovation(joint, noise_m2) else { return (Outcome::Gated, None) };
        let variance_m2 = seen.covariance[(0, 0)];
        last.0 = Some(RangeInnovation { value_m: seen.off[0], variance_m2 });
        let late_share = self.late.map_or(0.0, |late| late.likelihood(seen.off[0], variance_m2).late_share);
        let own_m2 = (observe * joint.block(receiver, receiver) * observe.transpose())[(0, 0)];
        let told = Some(Seen {
            squared: seen.squared,
            on_time: 1.0 - late_share,
            range_share: noise_m2 / variance_m2,
            motion_share: own_m2 / variance_m2,
        });
        if seen.squared > gate_sigmas * gate_sigmas || late_share > LATE_LEFT_OUT {
            return (Outcome::Gated, told);
        }
        let counted_m2 = self.counted_m * self.counted_m * noise_scale / (1.0 - late_share);
        let counted = if counted_m2 > noise_m2 { innovation(joint, counted_m2) } else { Some(seen) };
        match counted {
            Some(counted) if joint.fuse(&counted).is_ok() => (Outcome::Fused, told),
            _ => (Outcome::Gated, told),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::information::Gaussian;
    use crate::navigator::clock::ClockOptions;
    use crate::random::{Purpose, Streams};
    use nalgebra::Matrix4;

    const SOUND_MPS: f64 = 1500.0;
    const TOL: i64 = 600_000_000_000;

    fn told(clock: ClockOptions) -> LocalOptions {
        LocalOptions { clock, ..LocalOptions::default() }
    }

    /// Nodes at the origin and 400 m east of it: the sender's position known to 1 m, the receiver's to 10 m.
    fn joint() -> (Joint, usize, usize) {
        let node = |east_m: f64, sigma_m: f64| {
            let variance_m2 = sigma_m * sigma_m;
            let covariance = Matrix4::from_diagonal(&[variance_m2, variance_m2, 1.0, 1.0].into());
            Gaussian { mean: [east_m, 0.0, 0.0, 0.0].into(), covariance }
        };
        let mut joint = Joint::new();
        let (sender, receiver) = (joint.push(&node(0.0, 1.0)), joint.push(&node(400.0, 10.0)));
        (joint, sender, receiver)
    }

    fn measured(range_m: f64, options: &LocalOptions) -> Range {
        let toa = TOL + (range_m / SOUND_MPS * 1e9) as i64;
        Range::measured(TOL, toa, SOUND_MPS, 5.0, 5.0, 0.0, options).unwrap().unwrap()
    }

    #[test]
    fn an_exchange_from_kilometres_away_is_gated_whatever_the_clocks() {
        let clocks = [0.0, 0.002, 0.010].map(|offset_sigma_s| ClockOptions {
            offset_sigma_s,
            late_share: 0.2,
            ..ClockOptions::default()
        });
        for clock in clocks.into_iter().chain([ClockOptions::default()]) {
            let (mut joint, sender, receiver) = joint();
            let before = joint.node_mean(receiver);
            let outcome = measured(2900.0, &told(clock)).fuse(&mut joint, sender, receiver, 6.0);
            assert_eq!(outcome, Outcome::Gated, "{clock:?}");
            assert_eq!(joint.node_mean(receiver), before);
        }
    }

    #[test]
    fn without_faults_a_range_counts_as_it_is_told() {
        let range = measured(400.0, &LocalOptions::default());
        assert_eq!((range.sigma_m, range.counted_m, range.late), (1.0, 1.0, None));
    }

    #[test]
    fn a_range_that_is_late_for_all_that_is_known_is_left_out_and_a_doubtful_one_counts_less() {
        let clock = ClockOptions { late_share: 0.2, ..ClockOptions::default() };
        let along_m2 = |range_m: f64| {
            let (mut joint, sender, receiver) = joint();
            let outcome = measured(range_m, &told(clock)).fuse(&mut joint, sender, receiver, 6.0);
            (outcome, joint.marginal(receiver).covariance[(0, 0)])
        };
        let (on_time, sure_m2) = along_m2(400.0);
        let (doubtful, doubtful_m2) = along_m2(420.0);
        let (late, late_m2) = along_m2(445.0);
        assert_eq!((on_time, doubtful, late), (Outcome::Fused, Outcome::Fused, Outcome::Gated));
        assert!(sure_m2 < doubtful_m2 && doubtful_m2 < late_m2, "{sure_m2} {doubtful_m2} {late_m2}");
    }

    /// The error of a clock stands: many ranges with the same one must not look like as many that differ.
    #[test]
    fn ranges_with_one_clock_error_are_not_believed_to_average_it() {
        let missions = 200;
        for (offset_sigma_s, ranges) in [(0.0003, 15), (0.001, 20), (0.003, 50), (0.010, 100)] {
            let options = told(ClockOptions { offset_sigma_s, ..ClockOptions::default() });
            let (mut z, mut truth) = (vec![0.0; missions], vec![0.0; missions]);
            Streams::new(1, 0).at(Purpose::Jitter, 0).normal_pairs(0, &mut z, &mut truth);
            let mut square = 0.0;
            for (clock, place) in z.iter().zip(&truth) {
                let (mut joint, sender, receiver) = joint();
                let true_m = 400.0 + 10.0 * place;
                let error_m = std::f64::consts::SQRT_2 * offset_sigma_s * SOUND_MPS * clock;
                for _ in 0..ranges {
                    measured(true_m + error_m, &options).fuse(&mut joint, sender, receiver, 6.0);
                }
                let found = joint.marginal(receiver);
                square += (found.mean[0] - true_m).powi(2) / found.covariance[(0, 0)];
            }
            let mean = square / missions as f64;
            assert!(mean < 2.0, "{offset_sigma_s} s: {mean}");
        }
    }
}
