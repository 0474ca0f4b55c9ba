//! Log-likelihoods of soundings and ranges, without 2π terms.

use super::dispatch;
use super::lookup::{Grid, Node, Paired, bilinear};
use super::math::ln;
use super::pattern::{Block, LANES, Pattern, pattern_blocks};
use crate::measurement::range::{self, LateArrivals};
use crate::measurement::sounding;

/// Depth differences along a rigid segment (15), exact f64 path.
///
/// `offsets` are the ℓ + 1 sounding positions relative to the particle, oldest first; `differences` the ℓ measured
/// differences z_{k+1} − z_k. A difference that touches no depth costs `missing`; with `missing` NaN such a particle gets
/// NaN.
pub fn terrain_log_likelihood<T: Node>(
    grid: &Grid<'_, T>,
    east: &[f64],
    north: &[f64],
    offsets: &[[f64; 2]],
    differences: &[f64],
    sigma_m: f64,
    missing: f64,
    out: &mut [f64],
) {
    let inverse = 1.0 / sigma_m;
    for ((&e, &n), out) in east.iter().zip(north).zip(out) {
        let mut sum = 0.0;
        let mut previous = f64::NAN;
        for (k, [oe, on]) in offsets.iter().enumerate() {
            let depth = bilinear(grid, e + oe, n + on);
            if k > 0 {
                let r = (differences[k - 1] - (depth - previous)) * inverse;
                sum += if r.is_nan() { missing } else { -0.5 * r * r };
            }
            previous = depth;
        }
        *out = sum;
    }
}

/// As [`terrain_log_likelihood`] with NaN for missing, on the f32 path. False, and nothing written, where the pattern
/// does not fit the grid or has not one point more than there are differences.
pub fn terrain_log_likelihood_fast(
    grid: &Grid<'_, Paired>,
    pattern: &Pattern,
    east: &[f64],
    north: &[f64],
    differences: &[f64],
    sigma_m: f64,
    out: &mut [f64],
) -> bool {
    pattern.len() == differences.len() + 1
        && pattern_blocks(
            grid,
            pattern,
            east,
            north,
            Differences {
                differences,
                inverse: 1.0 / sigma_m as f32,
                out,
                previous: [0.0; LANES],
                sum: [0.0; LANES],
            },
        )
}

/// Sums the squared misfits of depth differences, block by block.
struct Differences<'a> {
    differences: &'a [f64],
    inverse: f32,
    out: &'a mut [f64],
    previous: [f32; LANES],
    sum: [f32; LANES],
}

impl Block for Differences<'_> {
    #[inline(always)]
    fn take(&mut self, _: usize, _: usize, k: usize, depths: &[[f32; LANES]]) {
        // In locals, which stay in registers; differences begin at the second point.
        let (mut previous, mut sum, skip) =
            if k > 0 { (self.previous, self.sum, 0) } else { (depths[0], [0.0; LANES], 1) };
        for (depths, difference) in depths[skip..].iter().zip(&self.differences[k + skip - 1..]) {
            let difference = *difference as f32;
            for l in 0..LANES {
                let r = (difference - (depths[l] - previous[l])) * self.inverse;
                sum[l] += r * r;
            }
            previous = *depths;
        }
        (self.previous, self.sum) = (previous, sum);
    }

    #[inline(always)]
    fn finish(&mut self, first: usize, count: usize) {
        for (out, sum) in self.out[first..first + count].iter_mut().zip(self.sum) {
            *out = -0.5 * f64::from(sum);
        }
    }
}

/// Second-order Gaussian range likelihood from a teammate's belief (mean, [ee, en, nn]) and a horizontal range.
///
/// With u the line of sight and d, κ of [`range::expected`]: V = σ_R² + uᵀPu + κ²/2, −½(R − d − κ/2)²/V − ½ ln V.
#[derive(Debug, Clone, Copy)]
pub struct RangeBelief {
    /// Mean of the teammate's position, m.
    pub mean_m: [f64; 2],
    /// Covariance [ee, en, nn], m².
    pub covariance_m2: [f64; 3],
    /// Measured horizontal range, m.
    pub range_m: f64,
    /// Standard deviation of the range, m.
    pub sigma_m: f64,
}

impl RangeBelief {
    /// Innovation and its variance for a particle at (east, north).
    #[inline(always)]
    #[must_use]
    pub fn innovation(&self, east: f64, north: f64) -> (f64, f64) {
        let expected = range::expected([east - self.mean_m[0], north - self.mean_m[1]], self.covariance_m2);
        let radial = range::along(expected.direction, self.covariance_m2);
        let variance = self.sigma_m * self.sigma_m + radial + expected.curvature_m2();
        (expected.innovation(self.range_m), variance)
    }
}

dispatch! {
    /// Adds `temper` × the Gaussian range log-likelihood to `out`.
    pub fn add_range_gaussian(belief: &RangeBelief, temper: f64, east: &[f64], north: &[f64], out: &mut [f64]) {
        for ((&e, &n), out) in east.iter().zip(north).zip(out) {
            let (innovation, variance) = belief.innovation(e, n);
            *out -= temper * 0.5 * (innovation * innovation / variance + ln(variance));
        }
    }
}

dispatch! {
    /// Adds `temper` × the log-likelihood of a range that may be late to `out`.
    pub fn add_range_late(
        belief: &RangeBelief,
        late: &LateArrivals,
        temper: f64,
        east: &[f64],
        north: &[f64],
        out: &mut [f64],
    ) {
        for ((&e, &n), out) in east.iter().zip(north).zip(out) {
            let (innovation, variance) = belief.innovation(e, n);
            *out += temper * late.likelihood(innovation, variance).log_z;
        }
    }
}

/// The paper's range likelihood (17) of each particle: −ln Σ_j w_j | ‖x − ϖ_j‖ − R |, N² distances.
pub fn range_eq17(
    range_m: f64,
    sample_east: &[f64],
    sample_north: &[f64],
    sample_weight: &[f64],
    east: &[f64],
    north: &[f64],
    out: &mut [f64],
) {
    out.fill(0.0);
    add_range_misfit(range_m, sample_east, sample_north, sample_weight, east, north, out);
    misfit_to_log_likelihood(out);
}

/// Sums of (17) to −ln of them. A sum of zero would be a likelihood of infinity: a micrometre is far below any range's
/// noise.
pub fn misfit_to_log_likelihood(sums: &mut [f64]) {
    sums.iter_mut().for_each(|sum| *sum = -sum.max(1e-6).ln());
}

dispatch! {
    /// Adds Σ_j w_j | ‖x − ϖ_j‖ − R | of each particle, the sum in (17).
    pub fn add_range_misfit(
        range_m: f64,
        sample_east: &[f64],
        sample_north: &[f64],
        sample_weight: &[f64],
        east: &[f64],
        north: &[f64],
        out: &mut [f64],
    ) {
        const WIDE: usize = 8;
        let m = sample_east.len().min(sample_north.len()).min(sample_weight.len());
        let (se, se_rest) = sample_east[..m].as_chunks::<WIDE>();
        let (sn, sn_rest) = sample_north[..m].as_chunks::<WIDE>();
        let (sw, sw_rest) = sample_weight[..m].as_chunks::<WIDE>();
        for ((&e, &n), out) in east.iter().zip(north).zip(out) {
            let term = |se: f64, sn: f64, sw: f64| {
                let (de, dn) = (e - se, n - sn);
                sw * ((de * de + dn * dn).sqrt() - range_m).abs()
            };
            let mut sums = [0.0; WIDE];
            for ((se, sn), sw) in se.iter().zip(sn).zip(sw) {
                for l in 0..WIDE {
                    sums[l] += term(se[l], sn[l], sw[l]);
                }
            }
            for (((se, sn), sw), sum) in se_rest.iter().zip(sn_rest).zip(sw_rest).zip(&mut sums) {
                *sum += term(*se, *sn, *sw);
            }
            *out += sums.iter().sum::<f64>();
        }
    }
}

/// Noise model of absolute soundings against a chart with a datum offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetModel {
    /// Standard deviation of a sounding, m.
    pub sigma_m: f64,
    /// Soundings that share one chart error: weight 1/n_c in the likelihood, n_c times the noise in the offset (n_c ≥ 1).
    pub shared: f64,
    /// Degrees of freedom of Student's t; infinite for a Gaussian.
    pub dof: f64,
}

impl OffsetModel {
    /// Log-likelihood of `innovation` for an offset variance and a chart deviation, and the offset's new
    /// (correction, variance).
    #[inline(always)]
    #[must_use]
    pub fn update(&self, innovation: f64, offset_variance: f64, sigma_map_m: f64) -> (f64, f64, f64) {
        let noise = self.sigma_m * self.sigma_m + sigma_map_m * sigma_map_m;
        let squared = innovation * innovation;
        let log_likelihood = sounding::log_likelihood(squared, offset_variance + noise, self.dof);
        let r = self.shared * noise;
        let inflation = sounding::inflation(squared, offset_variance + r, self.dof);
        let gain = offset_variance / (offset_variance + inflation * r);
        (log_likelihood / self.shared, gain * innovation, offset_variance * (1.0 - gain))
    }
}

/// Columns of a sounding, all of the cloud's length.
pub struct SoundingColumns<'a> {
    /// Charted depth under each particle, m; NaN where there is none.
    pub depth_m: &'a [f64],
    /// Standard deviation of the chart there, m.
    pub sigma_map_m: &'a [f64],
    /// Datum offset, m.
    pub offset_m: &'a [f64],
    /// Its variance before the walk, m².
    pub offset_variance_m2: &'a [f64],
    /// Out: log-likelihood, NaN where there is no depth.
    pub log_likelihood: &'a mut [f64],
    /// Out: what to add to the offset, m; 0 where there is no depth.
    pub correction_m: &'a mut [f64],
    /// Out: the offset's new variance, m²; as it was where there is no depth.
    pub variance_m2: &'a mut [f64],
    /// Out: innovation, m; 0 where there is no depth.
    pub innovation_m: &'a mut [f64],
    /// Out: its variance, m²; 0 where there is no depth.
    pub innovation_variance_m2: &'a mut [f64],
}

dispatch! {
    /// [`OffsetModel::update`] of every particle with the sounding `water_depth_m` and the offset's walk `walk_m2`.
    pub fn sounding_update(model: &OffsetModel, water_depth_m: f64, walk_m2: f64, columns: &mut SoundingColumns<'_>) {
        let c = columns;
        let n = c.depth_m.len();
        let (depth, sigma) = (&c.depth_m[..n], &c.sigma_map_m[..n]);
        let (offset, before) = (&c.offset_m[..n], &c.offset_variance_m2[..n]);
        let (l, correction) = (&mut c.log_likelihood[..n], &mut c.correction_m[..n]);
        let (variance, innovations) = (&mut c.variance_m2[..n], &mut c.innovation_m[..n]);
        let spread = &mut c.innovation_variance_m2[..n];
        for i in 0..n {
            let known = !depth[i].is_nan();
            let prior = before[i] + walk_m2;
            let innovation = water_depth_m - depth[i] - offset[i];
            let innovation = if known { innovation } else { 0.0 };
            let (log_likelihood, step, after) = model.update(innovation, prior, sigma[i]);
            l[i] = if known { log_likelihood } else { f64::NAN };
            correction[i] = step;
            variance[i] = if known { after } else { before[i] };
            innovations[i] = innovation;
            let s = prior + model.sigma_m * model.sigma_m + sigma[i] * sigma[i];
            spread[i] = if known { s } else { 0.0 };
        }
    }
}
