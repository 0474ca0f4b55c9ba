//! One sounding: lookup, datum offset, tempered weights.

use super::TerrainCore;
use crate::chart::{Chart, SigmaMap};
use crate::cloud::Cloud;
use crate::kernels::likelihood::{OffsetModel, SoundingColumns, sounding_update};
use crate::kernels::lookup::bilinear;
use crate::kernels::pattern::{Pattern, pattern_depths};
use crate::kernels::weights::{known_share, weighted_covariance, weighted_mean};
use crate::measurement::sounding::{LEAST_SIGMA_M, sharing_error};
use crate::navigator::{Innovation, Outcome};

/// A sounding that would leave too few particles is weighed again with twice the sigma, at most so many times.
pub(super) const SOFTENINGS: usize = 6;

#[derive(Default)]
pub(super) struct SoundingScratch {
    here: Pattern,
    depth: Vec<f64>,
    sigma_map: Vec<f64>,
    correction: Vec<f64>,
    variance: Vec<f64>,
    innovation: Vec<f64>,
    innovation_variance: Vec<f64>,
    /// Of the last sounding, where that was weighed, nat.
    pub(super) evidence_nat: Option<f64>,
    around: Vec<f64>,
}

/// How a sounding fits the cloud before the cloud takes it up.
pub(super) struct SoundingFit {
    /// Mean innovation, m, and its variance, m².
    pub innovation_m: f64,
    pub variance_m2: f64,
    /// Its square over its variance; 0 where no particle has a chart.
    pub statistic: f64,
}

impl SoundingFit {
    /// `None` where no particle has a chart.
    fn innovation(&self) -> Option<Innovation> {
        let (value_m, variance_m2) = (self.innovation_m, self.variance_m2);
        (value_m.is_finite() && variance_m2 > 0.0).then_some(Innovation { value_m, variance_m2 })
    }
}

/// What the chart is under the particles and around them, in the mean over those that have one.
pub(super) struct Around {
    /// Variance of the chart's error, m².
    pub map_m2: f64,
    /// Variance of the depth within the neighbourhoods, m².
    pub varies_m2: f64,
}

impl<const K: usize> TerrainCore<K> {
    /// Whether the chart can have this depth at all, whatever the tide.
    #[must_use]
    pub fn possible(&self, water_depth_m: f64, sensor_sigma_m: f64) -> bool {
        let sigma_m =
            self.options.sigma_depth_m.unwrap_or(sensor_sigma_m).hypot(self.options.sigma_offset0_m);
        self.chart.as_ref().is_none_or(|chart| chart.admits(water_depth_m, sigma_m))
    }

    /// A sounding up to its weights; with the health statistic where it was used. Watching and resampling are left to the
    /// caller.
    pub fn weigh_sounding(&mut self, water_depth_m: f64, sensor_sigma_m: f64) -> (Outcome, Option<f64>) {
        self.scratch.evidence_nat = None;
        if self.state.core.started() && !self.possible(water_depth_m, sensor_sigma_m) {
            self.state.core.rejected += 1;
            return (Outcome::Gated, None);
        }
        if self.options.start_anywhere && !self.state.core.started() {
            self.start_anywhere();
        }
        let core = &self.state.core;
        let (true, Some(chart), Some(trajectory)) = (core.started(), &self.chart, &core.trajectory) else {
            return (Outcome::Noted, None);
        };
        let travelled_m = trajectory.travelled_m();
        let apart_m = self.state.sounded_at_m.map(|at| travelled_m - at);
        if apart_m.is_some_and(|d| d < self.options.sounding_spacing_m) {
            return (Outcome::Noted, None);
        }
        let correlation_m = self.options.correlation_length_m.unwrap_or(chart.correlation_length_m());
        let shared = sharing_error(correlation_m, apart_m);
        let mut model = OffsetModel {
            sigma_m: self.options.sigma_depth_m.unwrap_or(sensor_sigma_m).max(LEAST_SIGMA_M),
            shared,
            dof: self.options.student_dof,
        };

        self.acquire_if_wide();
        if self.acquiring() {
            self.state.sounded_at_m = Some(travelled_m);
            return (self.acquire_sounding(model, apart_m.unwrap_or(f64::INFINITY), water_depth_m), None);
        }
        let stated_m = model.sigma_m;
        model.sigma_m *= self.noise_factor();
        let core = &mut self.state.core;
        let Some(chart) = &self.chart else { return (Outcome::Noted, None) };
        let scratch = &mut self.scratch;
        scratch.look_up(chart, &core.cloud.east, &core.cloud.north);
        scratch.sigma_map(self.options.sigma_map_m, chart, &core.cloud.east, &core.cloud.north);
        let q = self.options.sigma_offset_m_per_sounding.powi(2);
        let mut column = core.cloud.likelihood_column();
        let mut fit = None;
        for _ in 0..=SOFTENINGS {
            scratch.weigh(&model, &core.cloud, water_depth_m, q, &mut column);
            // The fit is judged before anything is softened.
            let fit = fit.get_or_insert_with(|| scratch.fit(&column, core.cloud.weights()));
            core.innovation.0 = fit.innovation();
            if !core.fill_holes(&mut column) {
                core.cloud.put_back(column);
                core.rejected += 1;
                return (Outcome::Gated, None);
            }
            if cloud_keeps(&core.cloud, &column, self.options.least_ess_share) {
                break;
            }
            model.sigma_m *= 2.0;
        }
        self.state.sounded_at_m = Some(travelled_m);
        self.scratch.correct(&mut core.cloud);
        self.scratch.evidence_nat = core.cloud.reweight_evidence(column);
        if let (Some(fit), Some(most)) = (&fit, self.options.depth_noise_factor_max) {
            self.state.noise.learn(fit, stated_m, most);
        }
        (Outcome::Fused, fit.map(|fit| fit.statistic))
    }
}

impl SoundingScratch {
    /// Takes the offsets that the last [`SoundingScratch::weigh`] found.
    pub(super) fn correct<const K: usize>(&self, cloud: &mut Cloud<K>) {
        for (b, c) in cloud.offset.iter_mut().zip(&self.correction) {
            *b += c;
        }
        cloud.offset_variance.copy_from_slice(&self.variance);
    }

    /// Depths under the particles, the chart's error widened by how much the depth varies within `kernel_m` (its variance
    /// on each axis) of them.
    pub(super) fn look_up_around<const K: usize>(
        &mut self,
        chart: &Chart,
        cloud: &Cloud<K>,
        kernel_m: f64,
        fixed_m: Option<f64>,
    ) -> Around {
        let (east, north) = (&cloud.east, &cloud.north);
        let n = east.len();
        self.resize(n);
        self.around.resize(5 * n, 0.0);
        let grid = chart.grid();
        let offsets = [[0.0, 0.0], [kernel_m, 0.0], [-kernel_m, 0.0], [0.0, kernel_m], [0.0, -kernel_m]];
        self.here.set(&grid, offsets.into_iter());
        let around = &mut self.around;
        let inside = pattern_depths(&grid, &self.here, east, north, |first, count, k, depths| {
            for (out, d) in around[k * n + first..k * n + first + count].iter_mut().zip(depths) {
                *out = f64::from(*d);
            }
        });
        if !inside {
            for (row, [de, dn]) in around.chunks_mut(n).zip(offsets) {
                for ((out, e), n) in row.iter_mut().zip(east).zip(north) {
                    *out = bilinear(&grid, e + de, n + dn);
                }
            }
        }
        self.depth.copy_from_slice(&self.around[..n]);
        self.sigma_map(fixed_m, chart, east, north);
        let weights = cloud.weights();
        let map_m2 = self.sigma_map.iter().zip(weights).map(|(s, w)| w * s * s).sum();
        let (mut varies_m2, mut charted) = (0.0, 0.0);
        for (i, weight) in weights.iter().enumerate().take(n) {
            let (mut squares, mut known) = (0.0, 0.0);
            for k in 1..5 {
                let off = self.around[k * n + i] - self.depth[i];
                if off.is_finite() {
                    squares += off * off;
                    known += 1.0;
                }
            }
            if known > 0.0 {
                let varies = 2.0 * squares / known;
                varies_m2 += weight * varies;
                charted += weight;
                self.sigma_map[i] = (self.sigma_map[i].powi(2) + varies).sqrt();
            }
        }
        let varies_m2 = if charted > 0.0 { varies_m2 / charted } else { 0.0 };
        Around { map_m2, varies_m2 }
    }

    /// Log-likelihood of one sounding for each particle (NaN without a depth) and the offsets that would follow.
    pub(super) fn weigh<const K: usize>(
        &mut self,
        model: &OffsetModel,
        cloud: &Cloud<K>,
        water_depth_m: f64,
        q_offset_m2: f64,
        column: &mut [f64],
    ) {
        let mut columns = SoundingColumns {
            depth_m: &self.depth,
            sigma_map_m: &self.sigma_map,
            offset_m: &cloud.offset,
            offset_variance_m2: &cloud.offset_variance,
            log_likelihood: column,
            correction_m: &mut self.correction,
            variance_m2: &mut self.variance,
            innovation_m: &mut self.innovation,
            innovation_variance_m2: &mut self.innovation_variance,
        };
        sounding_update(model, water_depth_m, q_offset_m2, &mut columns);
    }

    /// Standard deviation of the chart under each particle.
    fn sigma_map(&mut self, fixed_m: Option<f64>, chart: &Chart, east: &[f64], north: &[f64]) {
        match (fixed_m, chart.sigma_map()) {
            (Some(sigma), _) | (None, &SigmaMap::Uniform(sigma)) => self.sigma_map.fill(sigma),
            (None, SigmaMap::PerNode { .. }) => {
                for ((out, e), n) in self.sigma_map.iter_mut().zip(east).zip(north) {
                    *out = chart.sigma_map_at(*e, *n);
                }
            }
        }
    }

    /// The innovation in the mean over the particles that have a chart, and its variance S + Var_w(h + b).
    fn fit(&self, log_likelihood: &[f64], weights: &[f64]) -> SoundingFit {
        let (_, share) = known_share(log_likelihood, weights);
        // Innovation and its variance are zero for the others.
        let mean = weighted_mean(weights, &self.innovation) / share;
        let square = weighted_covariance(weights, &self.innovation, 0.0, &self.innovation, 0.0) / share;
        let spread = (square - mean * mean).max(0.0);
        let variance_m2 = weighted_mean(weights, &self.innovation_variance) / share + spread;
        let statistic = mean * mean / variance_m2;
        SoundingFit {
            innovation_m: mean,
            variance_m2,
            statistic: if statistic.is_finite() { statistic } else { 0.0 },
        }
    }

    fn resize(&mut self, n: usize) {
        for column in [
            &mut self.depth,
            &mut self.sigma_map,
            &mut self.correction,
            &mut self.variance,
            &mut self.innovation,
            &mut self.innovation_variance,
        ] {
            column.resize(n, 0.0);
        }
    }

    /// Depth under each particle, NaN where there is none.
    fn look_up(&mut self, chart: &Chart, east: &[f64], north: &[f64]) {
        self.resize(east.len());
        let grid = chart.grid();
        self.here.set(&grid, std::iter::once([0.0, 0.0]));
        let depth = &mut self.depth;
        let inside = pattern_depths(&grid, &self.here, east, north, |first, count, _, depths| {
            for (out, d) in depth[first..first + count].iter_mut().zip(depths) {
                *out = f64::from(*d);
            }
        });
        if !inside {
            for ((out, e), n) in self.depth.iter_mut().zip(east).zip(north) {
                *out = bilinear(&grid, *e, *n);
            }
        }
    }
}

/// Whether enough particles would keep weight; a sounding that leaves a handful says more of the cloud than of the sea.
fn cloud_keeps<const K: usize>(cloud: &Cloud<K>, log_likelihood: &[f64], share: f64) -> bool {
    share <= 0.0 || cloud.ess_after(log_likelihood) >= share * cloud.len() as f64
}
