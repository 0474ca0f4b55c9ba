//! A range between two uncertain positions: second order across the line of sight, and arrivals that come late.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use serde::{Deserialize, Serialize};

use crate::kernels::math::{exp, ln};

/// Two vehicles at one place have no direction between them, m.
const LEAST_DISTANCE_M: f64 = 1e-9;

/// What a range is expected to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedRange {
    /// Unit vector along the line of sight.
    pub direction: [f64; 2],
    /// d, distance of the means, m.
    pub distance_m: f64,
    /// κ: what stands across the line of sight makes a range longer by half of it, m.
    pub curvature_m: f64,
}

/// The range along `relative_m` (mean of one position minus that of the other), whose covariance is [ee, en, nn].
///
/// With t the variance across the line of sight, κ = t / max(d, √t): a range between positions that are known worse than
/// they are apart is longer by the spread, not by its square over a vanishing distance.
#[inline(always)]
#[must_use]
pub fn expected([de, dn]: [f64; 2], covariance_m2: [f64; 3]) -> ExpectedRange {
    let d = (de * de + dn * dn).sqrt();
    let d = if d > LEAST_DISTANCE_M { d } else { LEAST_DISTANCE_M };
    let direction = [de / d, dn / d];
    ExpectedRange { direction, distance_m: d, curvature_m: curvature(across(direction, covariance_m2), d) }
}

impl ExpectedRange {
    /// e = R − d − κ/2, m.
    #[inline(always)]
    #[must_use]
    pub fn innovation(&self, range_m: f64) -> f64 {
        range_m - self.distance_m - 0.5 * self.curvature_m
    }

    /// κ²/2, by which the curvature adds to the variance, m².
    #[inline(always)]
    #[must_use]
    pub fn curvature_m2(&self) -> f64 {
        0.5 * self.curvature_m * self.curvature_m
    }
}

/// Variance along a unit vector.
#[inline(always)]
#[must_use]
pub fn along([ue, un]: [f64; 2], [ee, en, nn]: [f64; 3]) -> f64 {
    ue * ue * ee + 2.0 * ue * un * en + un * un * nn
}

/// Variance across a unit vector, not below zero.
#[inline(always)]
fn across([ue, un]: [f64; 2], [ee, en, nn]: [f64; 3]) -> f64 {
    let t = un * un * ee - 2.0 * ue * un * en + ue * ue * nn;
    if t > 0.0 { t } else { 0.0 }
}

#[inline(always)]
fn curvature(across_m2: f64, distance_m: f64) -> f64 {
    let root = across_m2.sqrt();
    across_m2 / if distance_m > root { distance_m } else { root }
}

/// A range's innovation over a cloud of particles, against what cloud and range allow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudInnovation {
    /// Mean, m.
    pub mean_m: f64,
    /// Mean variance of a particle's innovation, and their spread, m².
    pub variance_m2: f64,
}

impl CloudInnovation {
    /// From (weight, innovation, its variance) of each particle.
    #[must_use]
    pub fn of(particles: impl Iterator<Item = (f64, f64, f64)>) -> Self {
        let (mut mean, mut square, mut variance) = (0.0, 0.0, 0.0);
        for (w, innovation, v) in particles {
            mean += w * innovation;
            square += w * innovation * innovation;
            variance += w * v;
        }
        Self { mean_m: mean, variance_m2: variance + (square - mean * mean).max(0.0) }
    }

    /// Whether it is further from zero than `gate_sigmas`; a model of late arrivals leaves those to the weights, and gates
    /// only what it cannot mean.
    #[must_use]
    pub fn contradicts(&self, gate_sigmas: f64, late: Option<&LateArrivals>) -> bool {
        match late {
            None => self.mean_m * self.mean_m > gate_sigmas * gate_sigmas * self.variance_m2,
            Some(late) => {
                let gate_m = LATE_GATE_SIGMAS * self.variance_m2.sqrt() + LATE_GATE_MEANS * late.mean_m;
                gate_sigmas.is_finite() && self.mean_m.abs() > gate_m
            }
        }
    }
}

/// With late arrivals a range is gated only further off than so many sigmas …
const LATE_GATE_SIGMAS: f64 = 10.0;
/// … and so many times the mean lateness: one in three million is.
const LATE_GATE_MEANS: f64 = 15.0;

/// Ranges of which some come by a longer way: late by an exponential distribution, never early.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LateArrivals {
    /// ε, share of late ones.
    pub share: f64,
    /// L, mean lateness, m.
    pub mean_m: f64,
    /// w, density of what neither explains, per m: it makes an early outlier harmless.
    pub floor_per_m: f64,
}

/// Density of outliers that the model of late arrivals does not explain, per m.
pub const FLOOR_PER_M: f64 = 1e-6;

/// What a range says under [`LateArrivals`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LateLikelihood {
    /// ln Z, with the factor √(2π): without late arrivals −½ (ν²/S + ln S).
    pub log_z: f64,
    /// g = Z′/Z with respect to the innovation, 1/m: a Gaussian state with the covariance hp to the range moves by −hp g.
    pub slope: f64,
    /// g₂ = Z″/Z − g², 1/m²: its covariance becomes P + hp hpᵀ g₂. Above zero, two explanations are alive.
    pub curvature: f64,
    /// Posterior share of the late explanation.
    pub late_share: f64,
}

impl LateArrivals {
    /// ln Z and its derivatives for an innovation ν of variance S: a Gaussian with the share 1 − ε, a Gaussian convolved
    /// with an exponential distribution with ε, and the floor.
    #[inline(always)]
    #[must_use]
    pub fn likelihood(&self, innovation_m: f64, variance_m2: f64) -> LateLikelihood {
        const ROOT_2PI: f64 = 2.506_628_274_631_000_5;
        let (nu, s, rate) = (innovation_m, variance_m2, 1.0 / self.mean_m);
        let (root, inverse) = (s.sqrt(), 1.0 / s);
        let normal = exp(-0.5 * nu * nu * inverse) / root;
        let x = nu / root - root * rate;
        let tail = normal * (root * rate) * mills(x.abs());
        // Past the turn the exponential tail, less what the Gaussian's other side lacks; its exponent is not above zero.
        let exponent = 0.5 * s * rate * rate - nu * rate;
        let exponent = if exponent < 0.0 { exponent } else { 0.0 };
        let whole = ROOT_2PI * exp(exponent) * rate;
        let late = if x < 0.0 { tail } else { whole - tail };
        let on_time = 1.0 - self.share;
        let z = on_time * normal + self.share * late + self.floor_per_m * ROOT_2PI;
        let z = if z > 1e-300 { z } else { 1e-300 };
        let (normal_1, late_1) = (-normal * nu * inverse, (normal - late) * rate);
        let normal_2 = normal * (nu * nu * inverse - 1.0) * inverse;
        let late_2 = (normal_1 - late_1) * rate;
        let slope = (on_time * normal_1 + self.share * late_1) / z;
        LateLikelihood {
            log_z: ln(z),
            slope,
            curvature: (on_time * normal_2 + self.share * late_2) / z - slope * slope,
            late_share: self.share * late / z,
        }
    }
}

/// √(2π)/2 · erfcx(y/√2) for y ≥ 0: Mills' ratio of the normal distribution.
#[inline(always)]
fn mills(y: f64) -> f64 {
    (0.5 * PI).sqrt() * erfcx(y * FRAC_1_SQRT_2)
}

/// exp(z²) erfc(z) for z ≥ 0 to 1e-12: t exp(P(t)) with t = 2/(2 + z), P the Chebyshev interpolant of its logarithm on
/// 0 ≤ t ≤ 1. No branch, so that a loop over particles vectorises.
#[inline(always)]
fn erfcx(z: f64) -> f64 {
    let t = 2.0 / (2.0 + z);
    let twice = 2.0 * (2.0 * t - 1.0);
    let (mut b, mut before) = (0.0, 0.0);
    for c in ERFCX[1..].iter().rev() {
        let next = twice * b - before + c;
        before = b;
        b = next;
    }
    t * exp(0.5 * twice * b - before + ERFCX[0])
}

/// Chebyshev coefficients of ln(erfcx(z)/t) in 2t − 1.
const ERFCX: [f64; 21] = [
    -0.6513268598908547,
    0.6419697923564904,
    0.01947647320418567,
    -0.009561514786808703,
    -0.0009465953444819893,
    0.00036683949785267384,
    4.252332480708169e-05,
    -2.0278578112720782e-05,
    -1.624290004460614e-06,
    1.3036558354306812e-06,
    1.562644198670098e-08,
    -8.523809613782895e-08,
    6.529054633432226e-09,
    5.05934321445299e-09,
    -9.91364179029523e-10,
    -2.2736517070053267e-10,
    9.646775783985466e-11,
    2.393808206693451e-12,
    -6.884236979085174e-12,
    8.86606519055549e-13,
    3.1360415919584323e-13,
];
