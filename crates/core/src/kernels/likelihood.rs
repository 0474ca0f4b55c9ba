//! Log-likelihoods of soundings and ranges, without 2π terms.

use super::dispatch;
use super::lookup::{Grid, Node, Pattern, bilinear, pattern_depths};

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
/// does not fit the grid.
pub fn terrain_log_likelihood_fast(
    grid: &Grid<'_, f32>,
    pattern: &Pattern,
    east: &[f64],
    north: &[f64],
    differences: &[f64],
    sigma_m: f64,
    out: &mut [f64],
) -> bool {
    let inverse = 1.0 / sigma_m as f32;
    let mut previous = [0.0f32; 16];
    let mut sum = [0.0f32; 16];
    let last = differences.len();
    pattern_depths(grid, pattern, east, north, |first, count, k, depths| {
        if k == 0 {
            sum = [0.0; 16];
        } else {
            let difference = differences[k - 1] as f32;
            for l in 0..16 {
                let r = (difference - (depths[l] - previous[l])) * inverse;
                sum[l] += r * r;
            }
        }
        previous = *depths;
        if k == last {
            for l in 0..count {
                out[first + l] = -0.5 * f64::from(sum[l]);
            }
        }
    })
}

/// Second-order Gaussian range likelihood from a teammate's belief (mean, [ee, en, nn]) and a horizontal range.
///
/// With u radial, v tangential, d the distance: k = vᵀPv/d, V = σ_R² + uᵀPu + k²/2, −½(R − d − k/2)²/V − ½ ln V.
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
        let (de, dn) = (east - self.mean_m[0], north - self.mean_m[1]);
        let d = (de * de + dn * dn).sqrt();
        let d = if d > 1e-9 { d } else { 1e-9 };
        let (ue, un) = (de / d, dn / d);
        let [ee, en, nn] = self.covariance_m2;
        let radial = ue * ue * ee + 2.0 * ue * un * en + un * un * nn;
        let tangential = un * un * ee - 2.0 * ue * un * en + ue * ue * nn;
        let k = tangential / d;
        (self.range_m - d - 0.5 * k, self.sigma_m * self.sigma_m + radial + 0.5 * k * k)
    }
}

dispatch! {
    /// Adds `temper` × the Gaussian range log-likelihood to `out`.
    pub fn add_range_gaussian(belief: &RangeBelief, temper: f64, east: &[f64], north: &[f64], out: &mut [f64]) {
        for ((&e, &n), out) in east.iter().zip(north).zip(out) {
            let (innovation, variance) = belief.innovation(e, n);
            *out -= temper * 0.5 * (innovation * innovation / variance + super::math::ln(variance));
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
        const LANES: usize = 8;
        for ((&e, &n), out) in east.iter().zip(north).zip(out) {
            let mut sums = [0.0; LANES];
            for ((se, sn), sw) in
                sample_east.chunks(LANES).zip(sample_north.chunks(LANES)).zip(sample_weight.chunks(LANES))
            {
                for (((se, sn), sw), sum) in se.iter().zip(sn).zip(sw).zip(&mut sums) {
                    let (de, dn) = (e - se, n - sn);
                    *sum += sw * ((de * de + dn * dn).sqrt() - range_m).abs();
                }
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
        let s = offset_variance + noise;
        let squared = innovation * innovation;
        let gaussian = self.dof == f64::INFINITY;
        let log_likelihood = if gaussian {
            -0.5 * squared / s - 0.5 * s.ln()
        } else {
            -0.5 * (self.dof + 1.0) * (squared / (self.dof * s)).ln_1p() - 0.5 * s.ln()
        };
        let r = self.shared * noise;
        let inflation = if gaussian {
            1.0
        } else {
            ((self.dof + squared / (offset_variance + r)) / (self.dof + 1.0)).max(1.0)
        };
        let gain = offset_variance / (offset_variance + inflation * r);
        (log_likelihood / self.shared, gain * innovation, offset_variance * (1.0 - gain))
    }
}
