//! Teammates of one group: for each particle one Gaussian over all their states, given that particle's own track.

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::event::VehicleId;
use crate::kernels::jitter::{JitterScratch, jitter_followers};
use crate::kernels::team::{BLOCK, BlockLayout, packed, packed_len};
use crate::navigator::clock::ClockPrior;
use crate::random::Stream;

/// What is known of a teammate that joins.
#[derive(Debug, Clone, Copy)]
pub struct MemberPrior {
    /// Standard deviations of the block's first states.
    pub sigmas: [f64; BLOCK],
    /// Of its clock, where that may differ.
    pub clock: ClockPrior,
    /// Standard deviation of the scale of ranges, which the group's first member brings in.
    pub scale_sigma: f64,
}

/// What widens every block, by variances.
#[derive(Debug, Clone, Copy)]
pub struct Widening {
    /// Of the block's first states.
    pub states: [f64; BLOCK],
    /// Of the clock difference, m².
    pub clock_m2: f64,
}

/// The Gaussian of one group of teammates for each of N particles.
///
/// ```text
/// mean         D columns of N, covariance: packed lower triangle, one column of N for each element
///              s | member 0: e n b c_e c_n heading thrust β β̇ | member 1: …
/// ```
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Group {
    particles: usize,
    /// Which states it has.
    pub layout: BlockLayout,
    /// Who has joined, in the order of their blocks.
    pub members: Vec<VehicleId>,
    /// Means.
    pub mean: Vec<f64>,
    /// Covariances, of the particles that `order` names.
    pub covariance: Vec<f64>,
    /// Whose covariance each particle has: resampling moves indices, the next packet moves the numbers.
    pub order: Vec<u32>,
    #[serde(skip)]
    spare: Vec<f64>,
    #[serde(skip)]
    normals: Vec<f64>,
    #[serde(skip)]
    jitter: JitterScratch,
}

impl Group {
    /// Without members.
    #[must_use]
    pub fn new(particles: usize, layout: BlockLayout) -> Self {
        Self {
            particles,
            layout,
            members: Vec::new(),
            mean: Vec::new(),
            covariance: Vec::new(),
            order: (0..particles as u32).collect(),
            spare: Vec::new(),
            normals: Vec::new(),
            jitter: JitterScratch::default(),
        }
    }

    /// Number of states.
    #[must_use]
    pub fn dim(&self) -> usize {
        if self.members.is_empty() { 0 } else { self.layout.base(self.members.len()) }
    }

    /// A member's first state.
    #[must_use]
    pub fn base_of(&self, vehicle: VehicleId) -> Option<usize> {
        self.members.iter().position(|m| *m == vehicle).map(|k| self.layout.base(k))
    }

    /// Takes in a member at `position_m`, independent of the others; its datum offset is zero, or what each particle says.
    pub fn join(
        &mut self,
        vehicle: VehicleId,
        position_m: [f64; 2],
        offset_m: Option<&[f64]>,
        prior: &MemberPrior,
    ) {
        let n = self.particles;
        let (first, before) = (self.members.is_empty(), self.layout.base(self.members.len()));
        self.members.push(vehicle);
        let after = self.dim();
        self.mean.resize(after * n, 0.0);
        for (axis, position) in position_m.into_iter().enumerate() {
            self.mean[(before + axis) * n..(before + axis + 1) * n].fill(position);
        }
        if let Some(offset) = offset_m {
            self.mean[(before + 2) * n..(before + 3) * n].copy_from_slice(offset);
        }
        self.covariance.resize(packed_len(after) * n, 0.0);
        let mut set = |r: usize, c: usize, value: f64| {
            let at = packed(r, c) * n;
            self.covariance[at..at + n].fill(value);
        };
        for (k, sigma) in prior.sigmas.into_iter().enumerate() {
            set(before + k, before + k, sigma * sigma);
        }
        if let Some(clock) = self.layout.clock_of(before) {
            set(clock, clock, prior.clock.difference_m2);
            set(clock + 1, clock, prior.clock.coupled_m2_per_s);
            set(clock + 1, clock + 1, prior.clock.rate_m2_per_s2);
        }
        if first && self.layout.scale {
            set(0, 0, prior.scale_sigma * prior.scale_sigma);
        }
        self.spare.resize(self.covariance.len(), 0.0);
    }

    /// What a kernel reads and writes; [`Group::written`] must follow.
    #[allow(clippy::type_complexity)]
    pub fn columns(&mut self) -> (usize, &mut [f64], &[f64], &[u32], &mut [f64]) {
        let dim = self.dim();
        self.spare.resize(self.covariance.len(), 0.0);
        (dim, &mut self.mean, &self.covariance, &self.order, &mut self.spare)
    }

    /// Covariances were written in the particles' order.
    pub fn written(&mut self) {
        std::mem::swap(&mut self.covariance, &mut self.spare);
        self.order.iter_mut().enumerate().for_each(|(i, o)| *o = i as u32);
    }

    /// One column of means.
    #[must_use]
    pub fn mean_of(&self, state: usize) -> &[f64] {
        &self.mean[state * self.particles..(state + 1) * self.particles]
    }

    /// One element of the covariance, for all particles, in an order of its own ([`Group::order`]).
    #[must_use]
    pub fn covariance_of(&self, r: usize, c: usize) -> &[f64] {
        let at = packed(r, c) * self.particles;
        &self.covariance[at..at + self.particles]
    }

    /// Means go with their particle; covariances when they are next needed.
    pub fn gather(&mut self, ancestors: &[u32]) {
        let n = self.particles;
        if self.members.is_empty() {
            return;
        }
        // The first columns of the spare serve as memory.
        self.spare.resize(self.covariance.len().max(n), 0.0);
        let column = &mut self.spare[..n];
        for mean in self.mean.chunks_mut(n) {
            for (new, a) in column.iter_mut().zip(ancestors) {
                *new = mean[*a as usize];
            }
            mean.copy_from_slice(column);
        }
        for (new, a) in column.iter_mut().zip(ancestors) {
            // Indices below 2^32 are exact.
            *new = f64::from(self.order[*a as usize]);
        }
        for (order, new) in self.order.iter_mut().zip(&*column) {
            *order = *new as u32;
        }
    }

    /// Liu–West on the means, jointly with the particles' own states.
    pub fn jitter(&mut self, own: &[&[f64]], own_normals: &[&[f64]], h: f64, stream: &Stream, lane: u32) {
        let (n, d) = (self.particles, self.dim());
        if d == 0 {
            return;
        }
        self.normals.resize(d.next_multiple_of(2) * n, 0.0);
        for (k, pair) in self.normals.chunks_mut(2 * n).enumerate() {
            let (a, b) = pair.split_at_mut(n);
            stream.normal_pairs(lane + k as u32, a, b);
        }
        jitter_followers(own, own_normals, &mut self.mean, &self.normals, h, &mut self.jitter);
    }

    /// After the own cloud lost its way: what particles knew apart, they know together. Means are those of the particles,
    /// equally weighted without `weights`.
    pub fn forget(&mut self, added: &Widening, weights: Option<&[f64]>) {
        let (n, d) = (self.particles, self.dim());
        let inverse = 1.0 / n as f64;
        let average = |terms: &mut dyn Iterator<Item = f64>| match weights {
            Some(weights) => terms.zip(weights).map(|(x, w)| w * x).sum(),
            None => terms.sum::<f64>() * inverse,
        };
        let mean: Vec<f64> = self.mean.chunks(n).map(|c| average(&mut c.iter().copied())).collect();
        for r in 0..d {
            for c in 0..=r {
                let (x, y) = (self.mean_of(r), self.mean_of(c));
                let spread: f64 = average(&mut x.iter().zip(y).map(|(x, y)| (x - mean[r]) * (y - mean[c])));
                let more = if r == c { self.widened(r, added) } else { 0.0 };
                let at = packed(r, c) * n;
                self.covariance[at..at + n].iter_mut().for_each(|p| *p += spread + more);
            }
        }
        for (column, mean) in self.mean.chunks_mut(n).zip(&mean) {
            column.fill(*mean);
        }
    }

    /// By what one state's variance grows.
    fn widened(&self, state: usize, added: &Widening) -> f64 {
        let Some(within) = state.checked_sub(self.layout.head()) else { return 0.0 };
        match within % self.layout.stride() {
            k if k < BLOCK => added.states[k],
            BLOCK => added.clock_m2,
            _ => 0.0,
        }
    }

    /// Every block's position moves with its particle, which was at `from_m` on average and is at (east, north) now.
    pub fn follow(&mut self, from_m: [f64; 2], east: &[f64], north: &[f64]) {
        let n = self.particles;
        let bases: Vec<usize> = (0..self.members.len()).map(|k| self.layout.base(k)).collect();
        for base in bases {
            for (axis, own) in [east, north].into_iter().enumerate() {
                let column = &mut self.mean[(base + axis) * n..(base + axis + 1) * n];
                column.iter_mut().zip(own).for_each(|(x, own)| *x += own - from_m[axis]);
            }
        }
    }

    /// Refuses a snapshot of another size.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check(&self, particles: usize, layout: BlockLayout) -> Result<(), Error> {
        let d = self.dim();
        let fits = self.particles == particles
            && self.layout == layout
            && self.mean.len() == d * particles
            && self.covariance.len() == packed_len(d) * particles
            && self.order.len() == particles
            && self.order.iter().all(|o| (*o as usize) < particles);
        if fits { Ok(()) } else { Err(Error::Snapshot("made with another team".into())) }
    }
}
