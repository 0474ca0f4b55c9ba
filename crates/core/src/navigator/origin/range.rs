//! A range between the sender's node at launch and the receiver's at arrival.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::local_options::LocalOptions;
use crate::error::{Error, non_negative};
use crate::event::seconds;
use crate::information::{Innovation, Joint, NODE, Term};
use crate::link::{range_m, slant_to_horizontal};
use crate::measurement::range::LateArrivals;
use crate::navigator::Outcome;
use crate::navigator::radio::SLANT_GATES;

/// A range that is this likely by a longer way is left out.
const LATE_LEFT_OUT: f64 = 0.99;

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

    /// The range of a slant range that was reduced to the horizontal.
    #[must_use]
    pub fn range(&self, slant_m: f64, horizontal_m: f64) -> Range {
        let slope = slant_m / horizontal_m;
        // Of an error that stands nothing is renewed: the range counts by the share of the rest.
        let counted_m = self.whole_m * (self.whole_m / self.fresh_m);
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
    /// Its standard deviation, m: that of the slant range times slant over horizontal. Ranges are gated by it.
    pub sigma_m: f64,
    /// The standard deviation with which it is fused, m: larger where a part of the error stands from range to range.
    pub counted_m: f64,
    /// Arrivals by a longer way.
    pub late: Option<LateArrivals>,
}

impl Range {
    /// From the travel time, reduced by both depths; `None` for one so steep that it has no information on the
    /// horizontal distance.
    ///
    /// # Errors
    /// [`Error::Link`] for a travel time that is none, or a slant range too short for the depths.
    pub fn measured(
        tol_ns: i64,
        toa_ns: i64,
        sound_speed_mps: f64,
        own_depth_m: f64,
        sender_depth_m: f64,
        options: &LocalOptions,
    ) -> Result<Option<Self>, Error> {
        non_negative("sender's depth, m", sender_depth_m)?;
        let noise = RangeNoise::of(options, tol_ns, toa_ns, sound_speed_mps);
        let slant_m = range_m(tol_ns, toa_ns, sound_speed_mps)?;
        let horizontal =
            slant_to_horizontal(slant_m, own_depth_m, sender_depth_m, noise.whole_m, SLANT_GATES)?;
        if horizontal.clamped || horizontal.range_m <= noise.whole_m {
            return Ok(None);
        }
        Ok(Some(noise.range(slant_m, horizontal.range_m)))
    }

    /// Fuses it between the sender's node at launch and the receiver's at arrival, linearised at their means. Gated (and
    /// nothing changed) when it contradicts the joint by more than `gate_sigmas`, comes by a longer way for all that is
    /// known, or the means coincide. One that may be late counts by how likely it is not (an update with R/γ).
    pub fn fuse(&self, joint: &mut Joint, sender: usize, receiver: usize, gate_sigmas: f64) -> Outcome {
        let between = (joint.node_mean(receiver) - joint.node_mean(sender)).fixed_rows::<2>(0).into_owned();
        let distance_m = between.norm();
        if distance_m <= f64::MIN_POSITIVE {
            return Outcome::Gated;
        }
        let mut observe = SMatrix::<f64, 1, NODE>::zeros();
        observe.fixed_view_mut::<1, 2>(0, 0).copy_from(&(between / distance_m).transpose());
        let terms = [Term { node: receiver, observe }, Term { node: sender, observe: -observe }];
        let (value, predicted) = (SVector::<f64, 1>::new(self.range_m), SVector::<f64, 1>::new(distance_m));
        let innovation = |joint: &Joint, variance_m2: f64| -> Option<Innovation<1>> {
            joint.innovation(&terms, &value, &predicted, &SMatrix::<f64, 1, 1>::new(variance_m2))
        };
        let Some(seen) = innovation(joint, self.sigma_m * self.sigma_m)
            .filter(|seen| seen.squared <= gate_sigmas * gate_sigmas)
        else {
            return Outcome::Gated;
        };
        let late_share =
            self.late.map_or(0.0, |late| late.likelihood(seen.off[0], seen.covariance[(0, 0)]).late_share);
        if late_share > LATE_LEFT_OUT {
            return Outcome::Gated;
        }
        let counted_m2 = self.counted_m * self.counted_m / (1.0 - late_share);
        let counted =
            if counted_m2 > self.sigma_m * self.sigma_m { innovation(joint, counted_m2) } else { Some(seen) };
        match counted {
            Some(counted) if joint.fuse(&counted).is_ok() => Outcome::Fused,
            _ => Outcome::Gated,
        }
    }
}
