//! Fusing a range to a teammate's broadcast belief: the paper's eq 17, or its Gaussian second-order form.

use serde::{Deserialize, Serialize};

use super::Outcome;
use super::clock::ClockOptions;
use super::particle_core::ParticleCore;
use super::radio::{BroadcastBelief, HeardBelief};
use super::settings::check_all;
use super::settings::range::RangeSettings;
use crate::error::Error;
use crate::kernels::likelihood::{
    RangeBelief, add_range_gaussian, add_range_late, misfit_to_log_likelihood, range_eq17,
};
use crate::kernels::weights::{kernel_entropy, moments};
use crate::measurement::range::CloudInnovation;
use crate::packet::Belief;
use crate::random::Purpose;

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
    /// Kernel width of the entropies whose difference says what a range told (19)–(21), m; none leaves that out.
    pub entropy_sigma_m: Option<f64>,
    /// What may be wrong with ranges, beside their noise.
    pub clock: ClockOptions,
}

impl RangeOptions {
    /// Refuses what is not finite or outside its bounds, and a model of clocks for (17), which has no variance.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        check_all(&RangeSettings::BOUNDS, &[("sigma_range_m", self.sigma_m)])?;
        self.clock.validate()?;
        let clock = &self.clock;
        let told = clock.differ() || clock.sound_speed_sigma_mps > 0.0 || clock.late_share > 0.0;
        if told && matches!(self.method, RangeMethod::Eq17 { .. }) {
            let value = clock.late_share.max(clock.sound_speed_sigma_mps).max(clock.offset_sigma_s);
            return Err(Error::OutOfBound {
                quantity: "clock, with eq17",
                value,
                bound: "zero: eq17 has no variance",
            });
        }
        Ok(())
    }

    /// The same with a standing error's variance in that of the range.
    #[must_use]
    pub fn inflated(mut self, standing_m2: f64) -> Self {
        if standing_m2 > 0.0 {
            self.sigma_m = (self.sigma_m * self.sigma_m + standing_m2).sqrt();
        }
        self
    }

    /// The same with a Gaussian likelihood to a further power; (17) knows none.
    #[must_use]
    pub fn counting(mut self, share: f64) -> Self {
        if let RangeMethod::Gaussian { temper } = &mut self.method {
            *temper *= share;
        }
        self
    }
}

impl BroadcastBelief {
    /// Mean, m, and covariance [ee, en, nn], m², of what was said.
    #[must_use]
    pub fn moments(&self) -> ([f64; 2], [f64; 3]) {
        match self {
            Self::Gaussian(belief) => gaussian(belief),
            Self::Cloud(cloud) => moments(&cloud.weights, &cloud.east, &cloud.north),
            Self::Mixture(modes) => {
                let mut mean = [0.0; 2];
                let mut square = [0.0; 3];
                for (share, belief) in modes {
                    let ([e, n], [ee, en, nn]) = gaussian(belief);
                    mean[0] += share * e;
                    mean[1] += share * n;
                    square[0] += share * (ee + e * e);
                    square[1] += share * (en + e * n);
                    square[2] += share * (nn + n * n);
                }
                let [e, n] = mean;
                (mean, [square[0] - e * e, square[1] - e * n, square[2] - n * n])
            }
        }
    }

    /// One Gaussian with the moments of what was said. Particles are where the vehicle is now, the range holds for where
    /// it was at arrival: the belief is moved along by the displacement since.
    pub(super) fn summary(&self, range_m: f64, moved_m: [f64; 2], sigma_m: f64) -> RangeBelief {
        let (mean, covariance_m2) = self.moments();
        RangeBelief { mean_m: [mean[0] + moved_m[0], mean[1] + moved_m[1]], covariance_m2, range_m, sigma_m }
    }
}

fn gaussian(belief: &Belief) -> ([f64; 2], [f64; 3]) {
    let p = belief.covariance_m2;
    ([belief.mean_m.x, belief.mean_m.y], [p.m11, p.m12, p.m22])
}

impl<const K: usize> ParticleCore<K> {
    /// Weighs the particles by a range that was measured at `toa_ns`, to where the sender believed to be at launch.
    pub fn range(&mut self, heard: &HeardBelief, toa_ns: i64, options: &RangeOptions) -> Outcome {
        let (true, Some(moved)) = (self.started(), self.displacement_since(toa_ns)) else {
            self.rejected += 1;
            return Outcome::Rejected;
        };
        let belief = heard.belief.summary(heard.range_m, moved, options.sigma_m);
        let late = options.clock.late();
        let seen = self.seen(&belief);
        self.innovation.0 = Some(seen.into());
        if options.gate_sigmas.is_finite() && seen.contradicts(options.gate_sigmas, late.as_ref()) {
            self.rejected += 1;
            return Outcome::Gated;
        }
        let prior_nat = options.entropy_sigma_m.map(|sigma_m| self.entropy(sigma_m));
        let mut column = self.cloud.likelihood_column();
        column.fill(0.0);
        match (options.method, &heard.belief) {
            (RangeMethod::Gaussian { temper }, BroadcastBelief::Mixture(modes)) => {
                let modes: Vec<(f64, RangeBelief)> = modes
                    .iter()
                    .map(|(w, b)| {
                        (*w, BroadcastBelief::Gaussian(*b).summary(heard.range_m, moved, options.sigma_m))
                    })
                    .collect();
                for ((l, e), n) in column.iter_mut().zip(&self.cloud.east).zip(&self.cloud.north) {
                    let density = modes.iter().map(|(w, b)| {
                        let (innovation, variance) = b.innovation(*e, *n);
                        w * match &late {
                            Some(late) => late.likelihood(innovation, variance).log_z.exp(),
                            None => (-0.5 * innovation * innovation / variance).exp() / variance.sqrt(),
                        }
                    });
                    // A range that no mode explains must not make the weights zero: 1e-300 is less than any density.
                    *l = temper * density.sum::<f64>().max(1e-300).ln();
                }
            }
            (RangeMethod::Gaussian { temper }, _) => {
                let (east, north) = (&self.cloud.east, &self.cloud.north);
                match &late {
                    Some(late) => add_range_late(&belief, late, temper, east, north, &mut column),
                    None => add_range_gaussian(&belief, temper, east, north, &mut column),
                }
            }
            (RangeMethod::Eq17 { .. }, BroadcastBelief::Cloud(cloud)) => {
                let along = |x: &[f64], by: f64| x.iter().map(|v| v + by).collect::<Vec<_>>();
                let (e, n) = (along(&cloud.east, moved[0]), along(&cloud.north, moved[1]));
                let own = &self.cloud;
                range_eq17(heard.range_m, &e, &n, &cloud.weights, &own.east, &own.north, &mut column);
            }
            (RangeMethod::Eq17 { samples }, BroadcastBelief::Mixture(modes)) => {
                let samples = if samples == 0 { self.cloud.len() } else { samples };
                for (share, mode) in modes {
                    let mode =
                        BroadcastBelief::Gaussian(*mode).summary(heard.range_m, moved, options.sigma_m);
                    let stream = self.next_stream(Purpose::Belief);
                    let drawn = ((share * samples as f64).round() as usize).max(1);
                    self.cloud.add_belief_misfit(&mode, drawn, &stream, &mut column);
                }
                misfit_to_log_likelihood(&mut column);
            }
            (RangeMethod::Eq17 { samples }, BroadcastBelief::Gaussian(_)) => {
                let samples = if samples == 0 { self.cloud.len() } else { samples };
                let stream = self.next_stream(Purpose::Belief);
                self.cloud.belief_likelihood(&belief, samples, &stream, &mut column);
            }
        }
        if !self.cloud.reweight(column) {
            self.rejected += 1;
            return Outcome::Gated;
        }
        if let (Some(prior_nat), Some(sigma_m)) = (prior_nat, options.entropy_sigma_m) {
            self.information_nat = prior_nat - self.entropy(sigma_m);
        }
        Outcome::Fused
    }

    fn entropy(&self, sigma_m: f64) -> f64 {
        kernel_entropy(self.cloud.weights(), &self.cloud.east, &self.cloud.north, sigma_m)
    }

    /// The range against what the cloud and the belief admit.
    fn seen(&self, belief: &RangeBelief) -> CloudInnovation {
        let places = self.cloud.east.iter().zip(&self.cloud.north);
        let particles = self.cloud.weights().iter().zip(places).map(|(w, (e, n))| {
            let (innovation, variance) = belief.innovation(*e, *n);
            (*w, innovation, variance)
        });
        CloudInnovation::of(particles)
    }
}
