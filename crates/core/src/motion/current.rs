//! The current as the difference of velocity over ground and through the water, learnt while the bottom lock lasts.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::{Plane, Triangle};
use crate::event::seconds;
use crate::navigator::drift::Drift;

/// A larger one is none, m/s.
const MOST_MPS: f64 = 5.0;
/// Share of a thrust bias that is in the current in one direction and not in another.
const THRUST_SHARE: f64 = 0.5;

/// What is known of the current.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct LearntCurrent {
    t_ns: Option<i64>,
    mean_mps: Plane,
    covariance: Triangle,
    walk_m2ps2_per_s: f64,
    prior_m2ps2: f64,
    thrust_sigma_mps: f64,
}

impl LearntCurrent {
    pub fn new(drift: &Drift) -> Self {
        let prior_m2ps2 = drift.sigma_current0_mps.powi(2);
        Self {
            t_ns: None,
            mean_mps: [0.0; 2],
            covariance: [prior_m2ps2, 0.0, prior_m2ps2],
            walk_m2ps2_per_s: drift.sigma_current_mps_per_sqrt_s.powi(2),
            prior_m2ps2,
            thrust_sigma_mps: drift.sigma_thrust_bias0_mps,
        }
    }

    pub fn thrust_sigma_mps(&self) -> f64 {
        self.thrust_sigma_mps
    }

    /// What the navigator has come to know of it.
    pub fn set(&mut self, t_ns: i64, mean_mps: Plane, covariance: Triangle) {
        (self.t_ns, self.mean_mps, self.covariance) = (Some(t_ns), mean_mps, covariance);
    }

    fn grown(&self, t_ns: i64) -> Matrix2<f64> {
        let dt_s = self.t_ns.map_or(0.0, |last_ns| seconds(t_ns.saturating_sub(last_ns)).max(0.0));
        let more = self.walk_m2ps2_per_s * dt_s;
        let [ee, en, nn] = self.covariance;
        Matrix2::new(ee + more, en, en, nn + more)
    }

    /// A measurement of it, with this variance on each axis.
    pub fn learn(&mut self, t_ns: i64, measured_mps: Plane, noise_m2ps2: f64) {
        if measured_mps[0].hypot(measured_mps[1]) > MOST_MPS {
            return;
        }
        let before = self.grown(t_ns);
        let Some(inverse) = (before + Matrix2::identity() * noise_m2ps2).try_inverse() else { return };
        let gain = before * inverse;
        let mean = Vector2::from(self.mean_mps);
        let updated = before - gain * before;
        let mean = mean + gain * (Vector2::from(measured_mps) - mean);
        self.set(
            t_ns,
            mean.into(),
            [updated[(0, 0)], 0.5 * (updated[(0, 1)] + updated[(1, 0)]), updated[(1, 1)]],
        );
    }

    /// Mean and covariance at `t_ns`; `error` is that of the velocity over ground that it was learnt with.
    pub fn at(&self, t_ns: i64, [ee, en, nn]: Triangle, of_command: bool) -> (Plane, Triangle) {
        let grown = self.grown(t_ns);
        let thrust = if of_command { (THRUST_SHARE * self.thrust_sigma_mps).powi(2) } else { 0.0 };
        let variance = |own: f64, error: f64| (own + error).min(self.prior_m2ps2.max(own)) + thrust;
        let (ee, nn) = (variance(grown[(0, 0)], ee), variance(grown[(1, 1)], nn));
        let most = (ee * nn).sqrt();
        (self.mean_mps, [ee, (grown[(0, 1)] + en).clamp(-most, most), nn])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::tests::drift;

    #[test]
    fn a_current_is_learnt_and_forgotten() {
        let mut current = LearntCurrent::new(&drift());
        for second in 0..60 {
            current.learn(second * 1_000_000_000, [0.2, -0.1], 0.05 * 0.05);
        }
        let (mean, [ee, _, nn]) = current.at(60_000_000_000, [0.0; 3], false);
        assert!((mean[0] - 0.2).abs() < 1e-3 && (mean[1] + 0.1).abs() < 1e-3, "{mean:?}");
        assert!(ee < 0.03 * 0.03 && nn < 0.03 * 0.03);
        let later = current.at(160_000_000_000, [0.0; 3], false).1;
        assert!(later[0] > ee + 0.009, "a walk of 0.01 m/s for each root second: {later:?}");
        let turned = current.at(60_000_000_000, [0.0; 3], true).1;
        assert!((turned[0] - ee - 0.05 * 0.05).abs() < 1e-12);
        current.learn(61_000_000_000, [80.0, 0.0], 0.01);
        assert!((current.at(61_000_000_000, [0.0; 3], false).0[0] - 0.2).abs() < 1e-3, "no current");
    }
}
