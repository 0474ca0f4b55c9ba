//! A range between the sender's node at launch and the receiver's at arrival.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::error::{Error, non_negative};
use crate::information::{Joint, NODE, Term};
use crate::link::{depth_rounding_m2, range_m, slant_to_horizontal};
use crate::navigator::Outcome;
use crate::navigator::radio::SLANT_GATES;

/// A horizontal range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// m.
    pub range_m: f64,
    /// Its standard deviation, m: that of the slant range times slant over horizontal, and what the sender's rounded depth
    /// adds.
    pub sigma_m: f64,
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
        sigma_range_m: f64,
    ) -> Result<Option<Self>, Error> {
        non_negative("sender's depth, m", sender_depth_m)?;
        let slant_m = range_m(tol_ns, toa_ns, sound_speed_mps)?;
        let slant_sigma_m =
            if sender_step_m > 0.0 { sigma_range_m.hypot(sender_step_m) } else { sigma_range_m };
        let horizontal =
            slant_to_horizontal(slant_m, own_depth_m, sender_depth_m, slant_sigma_m, SLANT_GATES)?;
        if horizontal.clamped || horizontal.range_m <= sigma_range_m {
            return Ok(None);
        }
        let sigma_m = sigma_range_m * slant_m / horizontal.range_m;
        let rounding_m2 = depth_rounding_m2(horizontal.range_m, own_depth_m - sender_depth_m, sender_step_m);
        Ok(Some(Self { range_m: horizontal.range_m, sigma_m }.with_rounding(rounding_m2)))
    }

    /// The same with this variance in addition, m².
    #[must_use]
    pub fn with_rounding(mut self, rounding_m2: f64) -> Self {
        if rounding_m2 > 0.0 {
            self.sigma_m = (self.sigma_m * self.sigma_m + rounding_m2).sqrt();
        }
        self
    }

    /// Fuses it between the sender's node at launch and the receiver's at arrival, linearised at their means. Gated (and
    /// nothing changed) when it contradicts the joint by more than `gate_sigmas`, or the means coincide.
    pub fn fuse(&self, joint: &mut Joint, sender: usize, receiver: usize, gate_sigmas: f64) -> Outcome {
        let between = (joint.node_mean(receiver) - joint.node_mean(sender)).fixed_rows::<2>(0).into_owned();
        let distance_m = between.norm();
        if distance_m <= f64::MIN_POSITIVE {
            return Outcome::Gated;
        }
        let mut observe = SMatrix::<f64, 1, NODE>::zeros();
        observe.fixed_view_mut::<1, 2>(0, 0).copy_from(&(between / distance_m).transpose());
        let terms = [Term { node: receiver, observe }, Term { node: sender, observe: -observe }];
        let noise = SMatrix::<f64, 1, 1>::new(self.sigma_m * self.sigma_m);
        let (value, predicted) = (SVector::<f64, 1>::new(self.range_m), SVector::<f64, 1>::new(distance_m));
        match joint.innovation(&terms, &value, &predicted, &noise) {
            Some(innovation)
                if innovation.squared <= gate_sigmas * gate_sigmas && joint.fuse(&innovation).is_ok() =>
            {
                Outcome::Fused
            }
            _ => Outcome::Gated,
        }
    }
}
