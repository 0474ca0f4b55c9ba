//! Teammates of one group: for each particle one Gaussian over all their states, given that particle's own track.

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::event::VehicleId;
use crate::kernels::jitter::{JitterScratch, jitter_followers};
use crate::kernels::team::{BLOCK, packed, packed_len};
use crate::random::Stream;

/// The Gaussian of one group of teammates for each of N particles.
///
/// ```text
/// mean         D columns of N, covariance: packed lower triangle, one column of N for each element
///              member 0: e n b c_e c_n heading thrust | member 1: …
/// ```
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Group {
    particles: usize,
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
    pub fn new(particles: usize) -> Self {
        Self {
            particles,
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
        BLOCK * self.members.len()
    }

    /// A member's first state.
    #[must_use]
    pub fn base_of(&self, vehicle: VehicleId) -> Option<usize> {
        self.members.iter().position(|m| *m == vehicle).map(|k| BLOCK * k)
    }

    /// Takes in a member at `position_m` with standard deviations `sigmas`, independent of the others; its datum offset is
    /// zero, or what each particle says.
    pub fn join(
        &mut self,
        vehicle: VehicleId,
        position_m: [f64; 2],
        offset_m: Option<&[f64]>,
        sigmas: [f64; BLOCK],
    ) {
        let (n, before) = (self.particles, self.dim());
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
        for (k, sigma) in sigmas.into_iter().enumerate() {
            let at = packed(before + k, before + k) * n;
            self.covariance[at..at + n].fill(sigma * sigma);
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

    /// After the own cloud lost its way: what particles knew apart, they know together.
    pub fn forget(&mut self, added: [f64; BLOCK]) {
        let (n, d) = (self.particles, self.dim());
        let inverse = 1.0 / n as f64;
        let mean: Vec<f64> = self.mean.chunks(n).map(|c| c.iter().sum::<f64>() * inverse).collect();
        for r in 0..d {
            for c in 0..=r {
                let (x, y) = (self.mean_of(r), self.mean_of(c));
                let spread: f64 =
                    x.iter().zip(y).map(|(x, y)| (x - mean[r]) * (y - mean[c])).sum::<f64>() * inverse;
                let more = if r == c { added[r % BLOCK] } else { 0.0 };
                let at = packed(r, c) * n;
                self.covariance[at..at + n].iter_mut().for_each(|p| *p += spread + more);
            }
        }
        for (column, mean) in self.mean.chunks_mut(n).zip(&mean) {
            column.fill(*mean);
        }
    }

    /// Refuses a snapshot of another size.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check(&self, particles: usize) -> Result<(), Error> {
        let d = self.dim();
        let fits = self.particles == particles
            && self.mean.len() == d * particles
            && self.covariance.len() == packed_len(d) * particles
            && self.order.len() == particles
            && self.order.iter().all(|o| (*o as usize) < particles);
        if fits { Ok(()) } else { Err(Error::Snapshot("made with another team".into())) }
    }
}
