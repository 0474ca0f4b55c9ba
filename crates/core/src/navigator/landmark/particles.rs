//! Weighted particles over all states, for beliefs that a Gaussian does not describe: a distant or unknown start, an
//! hour without positionings.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::joint::{Covariance, Joint, JointVector, STATES};
use super::model::{Acoustics, Gate, Measurement, log_likelihoods, offsets};
use super::odometry::Increment;
use super::pose_algebra::at_transmit;
use crate::kernels::landmark::systematic_resample;
use crate::measurement::angle::wrap;
use crate::random::Stream;

/// Angles among the states.
const YAWS: [usize; 2] = [2, 5];

/// Weighted samples of the joint state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointParticles {
    /// One state each.
    pub states: Vec<JointVector>,
    /// Normalised weights.
    pub weights: Vec<f64>,
}

/// `count` vectors of standard normals.
fn normals(count: usize, stream: &Stream) -> Vec<JointVector> {
    let mut out = vec![JointVector::zeros(); count];
    let (mut a, mut b) = (vec![0.0; count], vec![0.0; count]);
    for pair in 0..STATES.div_ceil(2) {
        stream.normal_pairs(pair as u32, &mut a, &mut b);
        for (i, x) in out.iter_mut().enumerate() {
            x[2 * pair] = a[i];
            if 2 * pair + 1 < STATES {
                x[2 * pair + 1] = b[i];
            }
        }
    }
    out
}

/// A root of a positive semi-definite matrix: Cholesky with what rounding took away put back.
fn root(covariance: &Covariance) -> Covariance {
    let mut held = *covariance;
    for k in 0..STATES {
        held[(k, k)] = held[(k, k)] * (1.0 + 1e-12) + 1e-18;
    }
    held.cholesky().map_or_else(
        || Covariance::from_fn(|r, c| if r == c { held[(r, r)].max(0.0).sqrt() } else { 0.0 }),
        |c| c.unpack(),
    )
}

impl JointParticles {
    /// Samples of a Gaussian.
    #[must_use]
    pub fn of(joint: &Joint, count: usize, stream: &Stream) -> Self {
        let root = root(&joint.covariance);
        let states = normals(count, stream)
            .into_iter()
            .map(|z| {
                let mut x = joint.mean + root * z;
                for k in YAWS {
                    x[k] = wrap(x[k]);
                }
                x
            })
            .collect();
        Self { states, weights: vec![1.0 / count as f64; count] }
    }

    /// Mean (circular for yaws) and covariance.
    #[must_use]
    pub fn joint(&self) -> Joint {
        let mut mean = JointVector::zeros();
        for (x, w) in self.states.iter().zip(&self.weights) {
            mean += x * *w;
        }
        for k in YAWS {
            let (s, c) = self.states.iter().zip(&self.weights).fold((0.0, 0.0), |(s, c), (x, w)| {
                let (sin, cos) = x[k].sin_cos();
                (s + w * sin, c + w * cos)
            });
            mean[k] = s.atan2(c);
        }
        let mut covariance = Covariance::zeros();
        for (x, w) in self.states.iter().zip(&self.weights) {
            let d = difference(x, &mean);
            covariance += d * d.transpose() * *w;
        }
        Joint { mean, covariance }
    }

    /// Moves every sample by the odometry and its own biases.
    pub fn advance(&mut self, increment: &Increment, walk: f64, stream: &Stream) {
        let mut noise = Covariance::zeros();
        noise.fixed_view_mut::<3, 3>(0, 0).copy_from(&increment.covariance);
        let root = root(&noise);
        let step = walk * increment.dt_s.sqrt();
        for (x, z) in self.states.iter_mut().zip(normals(self.weights.len(), stream)) {
            let noise = root.fixed_view::<3, 3>(0, 0) * z.fixed_rows::<3>(0);
            let bias = x.fixed_rows::<3>(6).into_owned();
            let (displacement, yaw) = increment.corrected(&bias);
            let (s, c) = x[2].sin_cos();
            let (f, l) = (displacement.x + noise.x, displacement.y + noise.y);
            x[0] += c * f - s * l;
            x[1] += s * f + c * l;
            x[2] = wrap(x[2] + yaw + noise.z);
            x[6] += step * z[6];
        }
    }

    /// Weighs the samples by a positioning with per-channel outliers; false, and nothing changed, if none fits at all.
    pub fn weigh(
        &mut self,
        measured: &Measurement,
        delay: &Increment,
        acoustics: &Acoustics,
        gate: &Gate,
    ) -> bool {
        let logs: Vec<f64> = self
            .states
            .iter()
            .zip(&self.weights)
            .map(|(x, w)| {
                let own = [x[0], x[1], x[2]];
                let at = at_transmit(own, delay, &x.fixed_rows::<3>(6).into_owned());
                // In the landmark's frame: it stands at home.
                let [a, b] = log_likelihoods(offsets(own, at, [0.0; 3], measured), acoustics, gate);
                a + b + w.max(1e-300).ln()
            })
            .collect();
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !top.is_finite() {
            return false;
        }
        let weights: Vec<f64> = logs.iter().map(|l| (l - top).exp()).collect();
        let total: f64 = weights.iter().sum();
        self.weights = weights.into_iter().map(|w| w / total).collect();
        true
    }

    /// Effective sample size.
    #[must_use]
    pub fn ess(&self) -> f64 {
        1.0 / self.weights.iter().map(|w| w * w).sum::<f64>()
    }

    /// Systematic resampling, then roughening by `share` σ n^(−1/6) along the cloud's own axes.
    pub fn resample(&mut self, u0: f64, share: f64, stream: &Stream) {
        let n = self.states.len();
        let spread = root(&self.joint().covariance) * (share * (n as f64).powf(-1.0 / 6.0));
        let mut index = vec![0u32; n];
        systematic_resample(&self.weights, u0, &mut index);
        let noise = normals(n, stream);
        self.states = index
            .iter()
            .zip(noise)
            .map(|(i, z)| {
                let mut x = self.states[*i as usize] + spread * z;
                for k in YAWS {
                    x[k] = wrap(x[k]);
                }
                x
            })
            .collect();
        self.weights.fill(1.0 / n as f64);
    }

    /// Own positions in the world: easting and northing, m.
    #[must_use]
    pub fn positions(&self) -> (Vec<f64>, Vec<f64>) {
        self.states
            .iter()
            .map(|x| {
                let (s, c) = x[5].sin_cos();
                (x[3] + c * x[0] - s * x[1], x[4] + s * x[0] + c * x[1])
            })
            .unzip()
    }

    /// Mardia's kurtosis of the own pose over that of a Gaussian: 1 for one, above for tails and several modes.
    #[must_use]
    pub fn kurtosis_ratio(&self) -> f64 {
        let joint = self.joint();
        // Own pose only: the landmark may be known exactly.
        let own: SMatrix<f64, 3, 3> = joint.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let Some(inverse) = own.try_inverse() else { return f64::INFINITY };
        let fourth: f64 = self
            .states
            .iter()
            .zip(&self.weights)
            .map(|(x, w)| {
                let d: SVector<f64, 3> = difference(x, &joint.mean).fixed_rows::<3>(0).into_owned();
                w * d.dot(&(inverse * d)).powi(2)
            })
            .sum();
        fourth / 15.0
    }

    /// The samples in the packet's coordinates.
    #[must_use]
    pub fn polar(&self) -> Vec<SVector<f64, 6>> {
        self.states
            .iter()
            .map(|x| {
                let [x_, y_, yaw] = [x[0], x[1], x[2]];
                SVector::from([x[3], x[4], x[5], x_.hypot(y_), y_.atan2(x_), yaw])
            })
            .collect()
    }
}

fn difference(x: &JointVector, mean: &JointVector) -> JointVector {
    let mut d = x - mean;
    for k in YAWS {
        d[k] = wrap(d[k]);
    }
    d
}
