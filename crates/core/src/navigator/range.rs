//! Fusing a range to a teammate's broadcast belief: the paper's eq 17, or its Gaussian second-order form.

use serde::{Deserialize, Serialize};

use super::Outcome;
use super::common::{Heard, ParticleCore};
use crate::kernels::likelihood::{RangeBelief, add_range_gaussian};
use crate::noise::Purpose;

/// How a range weighs the particles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum RangeMethod {
    /// `1 / Σ_j | ‖x − ϖ_j‖ − R̂ |` over samples of the belief (17); 0 samples stands for the number of particles.
    Eq17 {
        /// How many samples.
        samples: usize,
    },
    /// Gaussian with the belief's curvature, its logarithm multiplied by `temper`.
    Gaussian {
        /// In (0, 1]; 1 counts the belief as if it knew nothing from this vehicle.
        temper: f64,
    },
}

/// The standing options of a range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RangeOptions {
    /// Which likelihood.
    pub method: RangeMethod,
    /// Standard deviation of the range, m.
    pub sigma_m: f64,
    /// Ranges further off than this many standard deviations of innovation and cloud are gated; infinite for never.
    pub gate_sigmas: f64,
}

impl<const K: usize> ParticleCore<K> {
    /// Weighs the particles by a range that was measured at `toa_ns`, to where the sender believed to be at launch.
    pub fn range(&mut self, heard: &Heard, toa_ns: i64, options: &RangeOptions) -> Outcome {
        let (true, Some(moved)) = (self.started(), self.displacement_since(toa_ns)) else {
            self.rejected += 1;
            return Outcome::Rejected;
        };
        let p = heard.belief.covariance_m2;
        // Particles are where the vehicle is now, the range holds for where it was: move the belief along instead.
        let belief = RangeBelief {
            mean_m: [heard.belief.mean_m.x + moved[0], heard.belief.mean_m.y + moved[1]],
            covariance_m2: [p.m11, p.m12, p.m22],
            range_m: heard.range_m,
            sigma_m: options.sigma_m,
        };
        if options.gate_sigmas.is_finite() && self.contradicts(&belief, options.gate_sigmas) {
            self.rejected += 1;
            return Outcome::Gated;
        }
        let mut column = self.cloud.likelihood_column();
        match options.method {
            RangeMethod::Gaussian { temper } => {
                add_range_gaussian(&belief, temper, &self.cloud.east, &self.cloud.north, &mut column);
            }
            RangeMethod::Eq17 { samples } => {
                let samples = if samples == 0 { self.cloud.len() } else { samples };
                let stream = self.next_stream(Purpose::Belief);
                self.cloud.belief_likelihood(&belief, samples, &stream, &mut column);
            }
        }
        if self.cloud.reweight(column) {
            Outcome::Fused
        } else {
            self.rejected += 1;
            Outcome::Gated
        }
    }

    /// True if the mean innovation is too far from zero for what the cloud and the belief admit.
    fn contradicts(&self, belief: &RangeBelief, gate_sigmas: f64) -> bool {
        let (mut mean, mut square, mut variance) = (0.0, 0.0, 0.0);
        for ((w, e), n) in self.cloud.weights().iter().zip(&self.cloud.east).zip(&self.cloud.north) {
            let (innovation, v) = belief.innovation(*e, *n);
            mean += w * innovation;
            square += w * innovation * innovation;
            variance += w * v;
        }
        let spread = (square - mean * mean).max(0.0);
        mean * mean > gate_sigmas * gate_sigmas * (variance + spread)
    }
}
