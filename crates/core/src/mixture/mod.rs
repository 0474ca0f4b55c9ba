//! Small Gaussian mixtures: expectation–maximisation on weighted points, model selection, moments, sampling.
//!
//! [`fit`] is the plain form without random numbers that packets of a few position modes use. [`fit_best`] and
//! [`select`] are the full one: coordinates that wrap, k-means++ starts, whitening, BIC or AIC, a limit on the modes.

mod fitting;
mod selection;
#[cfg(test)]
mod tests;

pub use fitting::{Circular, FitOptions, Fitted, centre, fit_best, fit_from};
pub use selection::{Criterion, distinct, sample_counts, select};

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::kernels::math::{exp, ln};

/// Added to every covariance so that a mode cannot collapse on one point, m² for positions.
const RIDGE: f64 = 0.05;
/// Keeps the mean of a mode that lost all its points defined.
const LEAST_SHARE: f64 = 1e-12;

/// One mode of a mixture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mode<const D: usize> {
    /// Share of the whole; the shares sum to one.
    pub weight: f64,
    /// Mean.
    pub mean: SVector<f64, D>,
    /// Covariance.
    pub covariance: SMatrix<f64, D, D>,
}

/// Mean and covariance of weighted points; weights sum to one.
#[must_use]
pub fn moments<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
) -> (SVector<f64, D>, SMatrix<f64, D, D>) {
    let mut mean = SVector::<f64, D>::zeros();
    for (x, w) in points.iter().zip(weights) {
        mean += x * *w;
    }
    let mut covariance = SMatrix::<f64, D, D>::zeros();
    for (x, w) in points.iter().zip(weights) {
        let d = x - mean;
        covariance += d * d.transpose() * *w;
    }
    (mean, covariance)
}

/// Fits `modes` modes by `iterations` of EM.
///
/// The modes start evenly spread over ± one sigma along the principal axis, each with 1/modes of the covariance: no random
/// numbers, and two well separated clusters are found from there. `None` for no points, no modes, or a covariance that
/// is not finite.
#[must_use]
pub fn fit<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
    modes: usize,
    iterations: usize,
) -> Option<Vec<Mode<D>>> {
    if points.is_empty() || modes == 0 {
        return None;
    }
    let (mean, covariance) = moments(points, weights);
    if !covariance.iter().all(|v| v.is_finite()) {
        return None;
    }
    let axis = principal_sigma(&covariance);
    let ridge = SMatrix::<f64, D, D>::identity() * RIDGE;
    let mut mixture: Vec<Mode<D>> = (0..modes)
        .map(|k| Mode {
            weight: 1.0 / modes as f64,
            mean: mean + axis * if modes > 1 { 2.0 * k as f64 / (modes - 1) as f64 - 1.0 } else { 0.0 },
            covariance: covariance / modes as f64 + ridge,
        })
        .collect();
    let mut responsibility = vec![0.0; points.len() * modes];
    for _ in 0..iterations {
        expect(points, weights, &mixture, &mut responsibility)?;
        maximise(points, &mut mixture, &responsibility, &ridge);
    }
    Some(mixture)
}

/// One sigma along the principal axis; squaring the matrix 2^12-fold leaves nothing but that axis.
fn principal_sigma<const D: usize>(covariance: &SMatrix<f64, D, D>) -> SVector<f64, D> {
    let mut power = *covariance;
    for _ in 0..12 {
        let norm = power.norm();
        if norm <= 0.0 {
            return SVector::zeros();
        }
        power /= norm;
        power *= power;
    }
    let longest = (0..D).map(|d| power.column(d).clone_owned()).max_by(|a, b| a.norm().total_cmp(&b.norm()));
    let Some(axis) = longest.and_then(|c| c.try_normalize(0.0)) else { return SVector::zeros() };
    axis * axis.dot(&(covariance * axis)).max(0.0).sqrt()
}

/// Responsibilities times the points' weights, mode by mode.
fn expect<const D: usize>(
    points: &[SVector<f64, D>],
    weights: &[f64],
    mixture: &[Mode<D>],
    out: &mut [f64],
) -> Option<()> {
    let n = points.len();
    for (mode, out) in mixture.iter().zip(out.chunks_mut(n)) {
        let factor = mode.covariance.cholesky()?;
        let inverse = factor.inverse();
        let log_root: f64 = (0..D).map(|d| factor.l_dirty()[(d, d)].ln()).sum();
        let constant = mode.weight.max(f64::MIN_POSITIVE).ln() - log_root;
        for (x, out) in points.iter().zip(out) {
            let d = x - mode.mean;
            *out = constant - 0.5 * d.dot(&(inverse * d));
        }
    }
    for (i, w) in weights.iter().enumerate() {
        let top = (0..mixture.len()).map(|k| out[k * n + i]).fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = (0..mixture.len()).map(|k| exp(out[k * n + i] - top)).sum();
        let log_total = top + ln(total);
        for k in 0..mixture.len() {
            out[k * n + i] = w * exp(out[k * n + i] - log_total);
        }
    }
    Some(())
}

fn maximise<const D: usize>(
    points: &[SVector<f64, D>],
    mixture: &mut [Mode<D>],
    responsibility: &[f64],
    ridge: &SMatrix<f64, D, D>,
) {
    let n = points.len();
    let shares: Vec<f64> = responsibility.chunks(n).map(|r| r.iter().sum()).collect();
    let total: f64 = shares.iter().sum();
    for ((mode, r), share) in mixture.iter_mut().zip(responsibility.chunks(n)).zip(&shares) {
        let inverse = 1.0 / (share + LEAST_SHARE);
        let mut mean = SVector::<f64, D>::zeros();
        for (x, r) in points.iter().zip(r) {
            mean += x * *r;
        }
        mode.mean = mean * inverse;
        let mut covariance = SMatrix::<f64, D, D>::zeros();
        for (x, r) in points.iter().zip(r) {
            let d = x - mode.mean;
            covariance += d * d.transpose() * *r;
        }
        mode.covariance = covariance * inverse + ridge;
        mode.weight = share / total;
    }
}
