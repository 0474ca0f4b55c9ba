//! What dead reckoning from now would add to the particles' belief.

use nalgebra::{Matrix2, SMatrix, Vector2};

use super::Estimate;
use super::particle_core::ParticleCore;
use super::range_novelty::Growth;
use crate::event::seconds;
use crate::kernels::particles::displacement_map;
use crate::kernels::weights::weighted_covariance;

impl<const K: usize> ParticleCore<K> {
    /// Process noise of the position from now to `t_ns`, [ee, en, nn], m²: the walk, and a velocity that is out of force.
    #[must_use]
    pub fn position_walk_to(&self, t_ns: i64) -> [f64; 3] {
        let Some(now_ns) = self.now_ns() else { return [0.0; 3] };
        let [ee, en, nn] = self.drift_in_force.position_walk(seconds(t_ns.saturating_sub(now_ns)));
        let held_m2 = self.motion.out_of_force_m2(now_ns, t_ns);
        [ee + held_m2, en, nn + held_m2]
    }

    /// How the position's error would grow along `direction` in `dt_s` of dead reckoning from now.
    #[must_use]
    pub fn growth(&self, direction: [f64; 2], dt_s: f64) -> Growth {
        let (mean, [ee, en, nn]) = self.cloud.position_moments();
        let (_, cross, drift) = self.drift_ahead(mean, dt_s);
        let u = Vector2::from(direction);
        let position_m2 = (u.transpose() * Matrix2::new(ee, en, en, nn) * u)[0];
        let drift_m2 = (u.transpose() * drift * u)[0].max(0.0);
        let [walk_ee, walk_en, walk_nn] = self.drift_in_force.position_walk(dt_s);
        let scale = (position_m2 * drift_m2).sqrt();
        Growth {
            correlation: if scale > 0.0 {
                ((u.transpose() * cross * u)[0] / scale).clamp(0.0, 1.0)
            } else {
                0.0
            },
            drift_m2,
            walk_m2: (u.transpose() * Matrix2::new(walk_ee, walk_en, walk_en, walk_nn) * u)[0],
        }
    }

    /// Mean displacement by the linear states over `dt_s`, its covariance with the position, and its own covariance.
    pub(super) fn drift_ahead(
        &self,
        mean_m: [f64; 2],
        dt_s: f64,
    ) -> (Vector2<f64>, Matrix2<f64>, Matrix2<f64>) {
        let w = self.cloud.weights();
        let map = displacement_map::<K>(self.velocity_mps, dt_s);
        let f = SMatrix::<f64, 2, K>::from_fn(|r, c| map[r][c]);
        let means = self.cloud.linear_mean();
        let columns = &self.cloud.linear;
        let spread = SMatrix::<f64, K, K>::from_fn(|r, c| {
            weighted_covariance(w, &columns[r], means[r], &columns[c], means[c])
        });
        let position = [&self.cloud.east, &self.cloud.north];
        let cross = SMatrix::<f64, 2, K>::from_fn(|r, c| {
            weighted_covariance(w, position[r], mean_m[r], &columns[c], means[c])
        });
        let moved = f * SMatrix::<f64, K, 1>::from(means);
        (moved, cross * f.transpose(), f * (spread + self.covariance) * f.transpose())
    }

    /// Moves an estimate of the present ahead by `dt_s`, with the cloud's own correlation of position and drift.
    pub(super) fn predict(&self, estimate: &mut Estimate, dt_s: f64) {
        let (moved, coupled, drift) = self.drift_ahead(estimate.mean_m, dt_s);
        for a in 0..2 {
            estimate.mean_m[a] += self.velocity_mps[a] * dt_s + moved[a];
        }
        let added = drift + coupled + coupled.transpose();
        let walk = self.position_walk_to(estimate.t_ns);
        estimate.covariance_m2[0] += added[(0, 0)] + walk[0];
        estimate.covariance_m2[1] += added[(0, 1)] + walk[1];
        estimate.covariance_m2[2] += added[(1, 1)] + walk[2];
    }
}
