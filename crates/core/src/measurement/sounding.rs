//! A sounding against a chart: Student tails, error that neighbours share, the chart as a plane, holes.

use crate::kernels::math::ln;
use crate::kernels::weights::known_share;

/// No echo sounder is better than a millimetre, m.
pub const LEAST_SIGMA_M: f64 = 1e-3;
/// Soundings that share a chart error when a vehicle hardly moves: enough to make one count for nothing.
const MOST_SHARED: f64 = 1e6;
/// Share of the weight that must have a chart for a sounding to be weighed.
const CHART_SHARE: f64 = 0.2;

/// n_c, soundings that share one chart error: 2 L / s for a correlation length L and soundings s apart, at least 1. One
/// for the first sounding (`apart_m` is `None`).
#[must_use]
pub fn sharing_error(correlation_m: f64, apart_m: Option<f64>) -> f64 {
    apart_m.map_or(1.0, |d| (2.0 * correlation_m / d.max(1e-9)).clamp(1.0, MOST_SHARED))
}

/// Log-likelihood of a squared innovation whose variance is `s_m2`: Student's t with `dof` degrees of freedom, a Gaussian
/// for infinitely many, without constants.
#[inline(always)]
#[must_use]
pub fn log_likelihood(squared_m2: f64, s_m2: f64, dof: f64) -> f64 {
    // Both forms are computed and one is selected: the choice is common to all particles.
    let gaussian = dof == f64::INFINITY;
    let dof = if gaussian { 1.0 } else { dof };
    let tails = 0.5 * (dof + 1.0) * ln(1.0 + squared_m2 / (dof * s_m2));
    -(if gaussian { 0.5 * squared_m2 / s_m2 } else { tails }) - 0.5 * ln(s_m2)
}

/// f ≥ 1, by how much Student's t inflates the noise of a Kalman update whose innovation has the variance `s_m2`.
#[inline(always)]
#[must_use]
pub fn inflation(squared_m2: f64, s_m2: f64, dof: f64) -> f64 {
    let gaussian = dof == f64::INFINITY;
    let dof = if gaussian { 1.0 } else { dof };
    let heavy = (dof + squared_m2 / s_m2) / (dof + 1.0);
    if gaussian || heavy < 1.0 { 1.0 } else { heavy }
}

/// A chart as a plane over a spread of positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Mean depth, m.
    pub mean_m: f64,
    /// ∂depth/∂[east, north].
    pub gradient: [f64; 2],
    /// Variance that the five points show beside the plane, m²; rounding may take it below zero.
    pub residual_m2: f64,
}

/// √3: the outer points lie so many standard deviations from the centre.
pub const OUTER: f64 = 1.732_050_807_568_877_2;

/// Cholesky's factor [l11, l21, l22] of a position's covariance [ee, en, nn]; a millimetre keeps quotients defined.
#[inline(always)]
#[must_use]
pub fn position_factor([ee, en, nn]: [f64; 3]) -> [f64; 3] {
    let l11 = (if ee > 1e-6 { ee } else { 1e-6 }).sqrt();
    let l21 = en / l11;
    let rest = nn - l21 * l21;
    [l11, l21, (if rest > 1e-6 { rest } else { 1e-6 }).sqrt()]
}

/// Statistical linearisation over five points: depths at the mean, and at the mean ± √3 of each column of `factor`.
#[inline(always)]
#[must_use]
pub fn plane([h0, h1, h2, h3, h4]: [f64; 5], [l11, l21, l22]: [f64; 3]) -> Plane {
    let mean = h0 / 3.0 + (h1 + h2 + h3 + h4) / 6.0;
    let (d1, d2) = ((h1 - h2) / (2.0 * OUTER), (h3 - h4) / (2.0 * OUTER));
    let square = |h: f64| (h - mean) * (h - mean);
    let residual =
        square(h0) / 3.0 + (square(h1) + square(h2) + square(h3) + square(h4)) / 6.0 - d1 * d1 - d2 * d2;
    let north = d2 / l22;
    let east = (d1 - north * l21) / l11;
    Plane { mean_m: mean, gradient: [east, north], residual_m2: residual }
}

/// Log of the mean likelihood of the particles that have one, which is what those over a hole or off the chart (NaN) take.
/// `None` where too little of the weight has a chart: the sounding must not be used then.
#[must_use]
pub fn neutral_log_likelihood(log_likelihood: &[f64], weights: &[f64]) -> Option<f64> {
    let (top, share) = known_share(log_likelihood, weights);
    if share < CHART_SHARE || !top.is_finite() {
        return None;
    }
    // Without a hole nobody takes it.
    if !log_likelihood.iter().any(|l| l.is_nan()) {
        return Some(top);
    }
    let known = log_likelihood.iter().zip(weights).filter(|(l, _)| !l.is_nan());
    let sum: f64 = known.map(|(l, w)| w * (l - top).exp()).sum();
    Some(top + (sum / share).ln())
}
