//! Particles in columns with log-weights: moments, effective sample size, resampling, regularisation.

mod columns;
mod resampling;

use serde::{Deserialize, Serialize};

use crate::kernels::likelihood::{RangeBelief, add_range_misfit, misfit_to_log_likelihood};
use crate::kernels::particles::{ParticleStep, cholesky_2x2, propagate_drawn};
use crate::kernels::weights::{self, moments, weighted_means};
use crate::random::Stream;

/// N particles: position, K linear states with a mean each, a datum offset with its own variance each.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Cloud<const K: usize> {
    /// Easting, m.
    pub east: Vec<f64>,
    /// Northing, m.
    pub north: Vec<f64>,
    /// Means of the linear states.
    #[serde(with = "columns")]
    pub linear: [Vec<f64>; K],
    /// Datum offset, m; positive = deeper than the chart. Empty for a filter that has none ([`Cloud::add_offset`]).
    pub offset: Vec<f64>,
    /// Its variance, m².
    pub offset_variance: Vec<f64>,
    log_weights: Vec<f64>,
    weights: Vec<f64>,
    ess: f64,
    information: Option<Information>,
    #[serde(skip)]
    scratch: Scratch,
}

/// What measurement updates (18) told about the position, by the entropy (19)–(21).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Information {
    /// Width of the kernel, m.
    pub sigma_m: f64,
    /// All updates so far: prior after the prediction (5), posterior before resampling, nat.
    pub total_nat: f64,
}

/// Memory that is reused from step to step and carries no state.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    /// Two columns of normals, or any other columns.
    pub a: Vec<f64>,
    /// See `a`.
    pub b: Vec<f64>,
    more: [Vec<f64>; 6],
    column: Vec<f64>,
    cdf: Vec<f64>,
    counts: Vec<u32>,
    ancestors: Vec<u32>,
}

impl Scratch {
    fn fit(&mut self, n: usize) {
        for column in [&mut self.a, &mut self.b, &mut self.column, &mut self.cdf] {
            column.resize(n, 0.0);
        }
        self.more.iter_mut().for_each(|c| c.resize(n, 0.0));
        self.counts.resize(n, 0);
        self.ancestors.resize(n, 0);
    }
}

impl<const K: usize> Cloud<K> {
    /// `count` particles at the origin with equal weights.
    #[must_use]
    pub fn new(count: usize) -> Self {
        let mut cloud = Self {
            east: vec![0.0; count],
            north: vec![0.0; count],
            linear: std::array::from_fn(|_| vec![0.0; count]),
            offset: Vec::new(),
            offset_variance: Vec::new(),
            log_weights: vec![0.0; count],
            weights: vec![0.0; count],
            ess: count as f64,
            information: None,
            scratch: Scratch::default(),
        };
        cloud.equalise();
        cloud
    }

    /// Gives every particle a datum offset of zero.
    pub fn add_offset(&mut self) {
        self.offset = vec![0.0; self.len()];
        self.offset_variance = vec![0.0; self.len()];
    }

    /// Number of particles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.east.len()
    }

    /// Whether all columns have one length; a snapshot's may not.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        let n = self.len();
        let full = [&self.north, &self.log_weights, &self.weights];
        full.into_iter().chain(&self.linear).all(|c| c.len() == n)
            && [&self.offset, &self.offset_variance].iter().all(|c| c.len() == n || c.is_empty())
            && self.offset.len() == self.offset_variance.len()
    }

    /// True for a cloud without particles.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.east.is_empty()
    }

    /// Normalised weights.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Measures what each change of the weights tells, with a kernel of this width, from now on; O(N²) each.
    pub fn measure_information(&mut self, sigma_m: f64) {
        let total_nat = self.information_nat().unwrap_or(0.0);
        self.information = Some(Information { sigma_m, total_nat });
    }

    /// What all changes of the weights told so far, nat; `None` where it is not measured.
    #[must_use]
    pub fn information_nat(&self) -> Option<f64> {
        self.information.map(|information| information.total_nat)
    }

    /// Effective sample size (13).
    #[must_use]
    pub fn ess(&self) -> f64 {
        self.ess
    }

    /// Equal weights.
    pub fn equalise(&mut self) {
        let n = self.len();
        self.weights.fill(1.0 / n as f64);
        self.log_weights.fill(-(n as f64).ln());
        self.ess = n as f64;
    }

    /// Scratch columns of the cloud's length.
    pub fn scratch(&mut self) -> &mut Scratch {
        self.scratch.fit(self.east.len());
        &mut self.scratch
    }

    /// Propagates every particle by `step` (5)–(8) with the normals of `stream`.
    pub fn propagate(&mut self, step: &ParticleStep<K>, stream: &Stream) {
        propagate_drawn(step, stream.key(), &mut self.east, &mut self.north, &mut self.linear);
    }

    /// A column of zeros for log-likelihoods, to be handed to [`Cloud::reweight`].
    pub fn likelihood_column(&mut self) -> Vec<f64> {
        self.scratch.fit(self.east.len());
        let mut column = std::mem::take(&mut self.scratch.column);
        column.fill(0.0);
        column
    }

    /// Effective sample size that [`Cloud::reweight`] would leave; 0 if it would refuse.
    #[must_use]
    pub fn ess_after(&self, log_likelihood: &[f64]) -> f64 {
        weights::ess_after(&self.log_weights, log_likelihood)
    }

    /// Takes a column of [`Cloud::likelihood_column`] back unused.
    pub fn put_back(&mut self, column: Vec<f64>) {
        self.scratch.column = column;
    }

    /// Multiplies the weights by exp(log-likelihood) and normalises; takes the scratch column back.
    ///
    /// False, and weights as they were, if no particle has a finite likelihood.
    pub fn reweight(&mut self, log_likelihood: Vec<f64>) -> bool {
        self.reweight_evidence(log_likelihood).is_some()
    }

    /// As [`Cloud::reweight`]; ln Σ w exp(log-likelihood) over the weights before, nat.
    pub fn reweight_evidence(&mut self, log_likelihood: Vec<f64>) -> Option<f64> {
        self.scratch.column = log_likelihood;
        let added = &mut self.scratch.column;
        if !added.iter().any(|l| l.is_finite()) {
            return None;
        }
        let before = self.information.map(|_| self.weights.clone());
        let (evidence_nat, squares) = weights::update(&self.log_weights, added, &mut self.weights)?;
        std::mem::swap(added, &mut self.log_weights);
        if let (Some(information), Some(before)) = (&mut self.information, before) {
            let [east, north] = [&self.east, &self.north];
            information.total_nat +=
                weights::entropy_drop(&before, &self.weights, east, north, information.sigma_m);
        }
        self.ess = 1.0 / squares;
        Some(evidence_nat)
    }

    /// Fills `out` with the paper's range likelihood (17) against `samples` draws of a belief.
    pub fn belief_likelihood(
        &mut self,
        belief: &RangeBelief,
        samples: usize,
        stream: &Stream,
        out: &mut [f64],
    ) {
        out.fill(0.0);
        self.add_belief_misfit(belief, samples, stream, out);
        misfit_to_log_likelihood(out);
    }

    /// Adds the sum of (17) over `samples` draws of a belief.
    pub fn add_belief_misfit(
        &mut self,
        belief: &RangeBelief,
        samples: usize,
        stream: &Stream,
        out: &mut [f64],
    ) {
        let [east, north, weight, ..] = &mut self.scratch.more;
        for column in [&mut *east, &mut *north, &mut *weight] {
            column.resize(samples, 0.0);
        }
        stream.normal_pairs(0, east, north);
        weight.fill(1.0);
        let [l11, l21, l22] = cholesky_2x2(belief.covariance_m2);
        for (e, n) in east.iter_mut().zip(&mut *north) {
            let (a, b) = (*e, *n);
            *e = belief.mean_m[0] + l11 * a;
            *n = belief.mean_m[1] + l21 * a + l22 * b;
        }
        add_range_misfit(belief.range_m, east, north, weight, &self.east, &self.north, out);
    }

    /// Mean (10) and covariance (11) of the position.
    #[must_use]
    pub fn position_moments(&self) -> ([f64; 2], [f64; 3]) {
        moments(&self.weights, &self.east, &self.north)
    }

    /// Mean of the linear states.
    #[must_use]
    pub fn linear_mean(&self) -> [f64; K] {
        weighted_means(&self.weights, &self.linear.each_ref().map(Vec::as_slice))
    }

    /// Draws positions uniformly in the ellipse whose covariance is given: a disc of radius r for r²/4 per axis.
    pub fn scatter_disc(&mut self, mean_m: [f64; 2], covariance_m2: [f64; 3], stream: &Stream) {
        self.scratch.fit(self.east.len());
        let s = &mut self.scratch;
        stream.uniforms(0, &mut s.a);
        stream.uniforms(1, &mut s.b);
        let [l11, l21, l22] = cholesky_2x2(covariance_m2);
        for i in 0..self.east.len() {
            let radius = 2.0 * s.a[i].sqrt();
            let (sin, cos) = (std::f64::consts::TAU * s.b[i]).sin_cos();
            self.east[i] = mean_m[0] + l11 * radius * cos;
            self.north[i] = mean_m[1] + l21 * radius * cos + l22 * radius * sin;
        }
        self.equalise();
    }

    /// Adds independent normals: `position_m` to positions, `linear[k]` to the linear states.
    pub fn spread(&mut self, position_m: f64, linear: [f64; K], stream: &Stream) {
        self.scratch.fit(self.east.len());
        let s = &mut self.scratch;
        stream.normal_pairs(0, &mut s.a, &mut s.b);
        for i in 0..self.east.len() {
            self.east[i] += position_m * s.a[i];
            self.north[i] += position_m * s.b[i];
        }
        for (k, pair) in self.linear.chunks_mut(2).enumerate() {
            stream.normal_pairs(k as u32 + 1, &mut s.a, &mut s.b);
            for (j, (column, normals)) in pair.iter_mut().zip([&s.a, &s.b]).enumerate() {
                let sigma = linear[2 * k + j];
                column.iter_mut().zip(normals).for_each(|(c, z)| *c += sigma * z);
            }
        }
    }
}
