//! Loops over the particles of the alternating landmark method: a particle is the mover's pose beside the landmark's.

use super::dispatch;
use super::math::cos_sin_turns;
use crate::measurement::angle::wrap_fast;

/// (cos, sin) of an angle in [−π, π].
#[inline(always)]
#[must_use]
pub fn cos_sin(angle: f64) -> (f64, f64) {
    let turns = angle * (1.0 / std::f64::consts::TAU);
    cos_sin_turns(if turns < 0.0 { turns + 1.0 } else { turns })
}

/// One step of the mover's odometry, common to all particles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryStep {
    /// Measured ground velocity in the body frame, m/s.
    pub velocity_mps: [f64; 2],
    /// Its standard deviation per axis, m/s.
    pub sigma_mps: f64,
    /// Measured yaw rate, rad/s.
    pub yaw_rate_radps: f64,
    /// Its standard deviation, rad/s.
    pub sigma_radps: f64,
    /// Duration, s.
    pub dt_s: f64,
}

dispatch! {
    /// Prediction (5)–(8): position with the yaw before the step, then the yaw, each particle with its own noise.
    pub fn predict(
        step: &OdometryStep,
        x: &mut [f64],
        y: &mut [f64],
        yaw: &mut [f64],
        forward_noise: &[f64],
        left_noise: &[f64],
        yaw_noise: &[f64],
    ) {
        let OdometryStep { velocity_mps: [forward, left], sigma_mps, yaw_rate_radps, sigma_radps, dt_s } = *step;
        let particles = x.iter_mut().zip(y).zip(yaw);
        let noise = forward_noise.iter().zip(left_noise).zip(yaw_noise);
        for (((x, y), yaw), ((nf, nl), nw)) in particles.zip(noise) {
            let (c, s) = cos_sin(*yaw);
            let f = (forward + sigma_mps * nf) * dt_s;
            let l = (left + sigma_mps * nl) * dt_s;
            *x += c * f - s * l;
            *y += s * f + c * l;
            *yaw = wrap_fast(*yaw + (yaw_rate_radps + sigma_radps * nw) * dt_s);
        }
    }
}

/// Systematic resampling of m from weights (not necessarily normalised): index i is the least j with
/// C_j > (u₀ + i)/m, the last C taken as 1.
pub fn systematic_resample(weights: &[f64], u0: f64, out: &mut [u32]) {
    let total: f64 = weights.iter().sum();
    let m = out.len() as f64;
    let last = weights.len().saturating_sub(1);
    let (mut j, mut cumulative) = (0, weights.first().copied().unwrap_or(0.0) / total);
    for (i, index) in out.iter_mut().enumerate() {
        let u = (u0 + i as f64) / m;
        while j < last && cumulative <= u {
            j += 1;
            cumulative += weights[j] / total;
        }
        *index = j as u32;
    }
}
