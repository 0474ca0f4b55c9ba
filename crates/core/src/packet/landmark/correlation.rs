//! Covariance ↔ standard deviations and the partial correlations of the Cholesky factor.

use nalgebra::{SMatrix, SVector};

/// (σ, partial correlations row by row) of a covariance; `None` unless it is positive definite.
pub fn split(covariance: &SMatrix<f64, 6, 6>) -> Option<(SVector<f64, 6>, [f64; 15])> {
    let sigma = SVector::<f64, 6>::from_fn(|k, _| covariance[(k, k)].sqrt());
    if !sigma.iter().all(|s| s.is_finite() && *s > 0.0) {
        return None;
    }
    let correlation = SMatrix::<f64, 6, 6>::from_fn(|r, c| covariance[(r, c)] / (sigma[r] * sigma[c]));
    let root = correlation.cholesky()?.unpack();
    let mut partial = [0.0; 15];
    let mut at = 0;
    for r in 1..6 {
        let mut left = 1.0;
        for c in 0..r {
            let l: f64 = root[(r, c)];
            partial[at] = if left > 0.0 { l / f64::sqrt(left) } else { 0.0 };
            left -= l * l;
            at += 1;
        }
    }
    Some((sigma, partial))
}

/// The covariance of standard deviations and partial correlations in (−1, 1): always positive definite.
pub fn join(sigma: &SVector<f64, 6>, partial: &[f64; 15]) -> SMatrix<f64, 6, 6> {
    let mut root = SMatrix::<f64, 6, 6>::zeros();
    root[(0, 0)] = 1.0;
    let mut at = 0;
    for r in 1..6 {
        let mut left: f64 = 1.0;
        for c in 0..r {
            root[(r, c)] = partial[at] * left.sqrt();
            left -= root[(r, c)] * root[(r, c)];
            at += 1;
        }
        root[(r, r)] = left.max(0.0).sqrt();
    }
    let scaled = SMatrix::<f64, 6, 6>::from_fn(|r, c| sigma[r] * root[(r, c)]);
    scaled * scaled.transpose()
}
