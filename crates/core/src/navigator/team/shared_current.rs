//! The water current that vehicles share: the displacement by the current of a particle, as information about a
//! teammate's.
//!
//! The displacement s by the current is Gaussian given that particle's positions, as its linear states l are. In each
//! step, s grows by the current, and the measurement of the current by the step's displacement corrects s as well, back
//! to the start (a fixed-point smoother). A sum of filtered currents would lag behind the true displacement, and ranges
//! would then be taken as measurements of the current.

use nalgebra::{Matrix2, SMatrix};
use serde::{Deserialize, Serialize};

use crate::event::VehicleId;
use crate::kernels::particles::{ParticleStep, gather};
use crate::kernels::weights::weighted_mean;

/// Displacement by the current of each particle, now and at each teammate's last packet.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SharedCurrent<const K: usize> {
    /// Since the start, [east, north], m.
    displacement: [Vec<f64>; 2],
    /// Its covariance, the same for all particles, m².
    variance: Matrix2<f64>,
    /// Its covariance with the linear states.
    cross: SMatrix<f64, 2, K>,
    elapsed_s: f64,
    at: Vec<Option<Then>>,
    /// The current of each particle before a step.
    #[serde(skip)]
    before: [Vec<f64>; 2],
}

/// Displacement by the current at the launch of a teammate's last packet.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Then {
    displacement: [Vec<f64>; 2],
    variance_m2: f64,
    elapsed_s: f64,
}

/// Over a shorter time the mean current is the current, s.
const LEAST_SPAN_S: f64 = 0.5;

impl<const K: usize> SharedCurrent<K> {
    /// No displacement yet.
    #[must_use]
    pub fn new(particles: usize, vehicles: usize) -> Self {
        Self {
            displacement: std::array::from_fn(|_| vec![0.0; particles]),
            variance: Matrix2::zeros(),
            cross: SMatrix::zeros(),
            elapsed_s: 0.0,
            at: vec![None; vehicles],
            before: Default::default(),
        }
    }

    /// The linear states as they stand before a step.
    pub fn before(&mut self, linear: &[Vec<f64>; K]) {
        for (kept, current) in self.before.iter_mut().zip(linear) {
            kept.clear();
            kept.extend_from_slice(current);
        }
    }

    /// The `step` of `dt_s` that the particles have made since, none before they have a place; `covariance` is that of the
    /// linear states before it.
    pub fn after(
        &mut self,
        linear: &[Vec<f64>; K],
        covariance: &SMatrix<f64, K, K>,
        step: Option<&ParticleStep<K>>,
        dt_s: f64,
    ) {
        self.elapsed_s += dt_s;
        let Some(step) = step else { return };
        let back = self.correct(covariance, step, dt_s);
        let [east, north] = &mut self.displacement;
        let now = linear[0].iter().zip(&linear[1]);
        let before = self.before[0].iter().zip(&self.before[1]);
        for ((east, north), ((e1, n1), (e0, n0))) in east.iter_mut().zip(north).zip(now.zip(before)) {
            let (de, dn) = (e1 - e0, n1 - n0);
            *east += dt_s * e0 + back.m11 * de + back.m12 * dn;
            *north += dt_s * n0 + back.m21 * de + back.m22 * dn;
        }
    }

    /// Moves the covariances on; what a change of the current by the step's displacement says of the displacement so far, m/(m/s).
    fn correct(
        &mut self,
        covariance: &SMatrix<f64, K, K>,
        step: &ParticleStep<K>,
        dt_s: f64,
    ) -> Matrix2<f64> {
        let grown = self.cross.fixed_view::<2, 2>(0, 0) * dt_s;
        self.variance += grown + grown.transpose() + covariance.fixed_view::<2, 2>(0, 0) * (dt_s * dt_s);
        self.cross += covariance.fixed_view::<2, K>(0, 0) * dt_s;
        let [ee, en, nn] = step.innovation_m2;
        let Some(inverse) = Matrix2::new(ee, en, en, nn).try_inverse() else { return Matrix2::zeros() };
        let f = SMatrix::<f64, 2, K>::from_fn(|r, c| step.map[r][c]);
        let seen = self.cross * f.transpose();
        self.variance -= seen * inverse * seen.transpose();
        self.cross -= seen * inverse * (f * covariance);
        let current_gain = Matrix2::from_fn(|r, c| step.gain[r][c]);
        // Who is certain of the current learns nothing of it.
        current_gain.try_inverse().map_or_else(Matrix2::zeros, |innovation| seen * inverse * innovation)
    }

    /// Whether the columns have `particles` entries and `vehicles` teammates; a snapshot's may not.
    #[must_use]
    pub fn fits(&self, particles: usize, vehicles: usize) -> bool {
        let kept = self.at.iter().flatten().flat_map(|then| &then.displacement);
        self.at.len() == vehicles && self.displacement.iter().chain(kept).all(|c| c.len() == particles)
    }

    /// Another cloud takes over, of whose way nothing is known: each particle takes the mean of the old ones.
    pub fn pool(&mut self, weights: &[f64]) {
        let kept = self.at.iter_mut().flatten().flat_map(|then| &mut then.displacement);
        for displacement in self.displacement.iter_mut().chain(kept) {
            let mean = weighted_mean(weights, displacement);
            displacement.fill(mean);
        }
    }

    /// Resampling: particle i takes the columns of its ancestor.
    pub fn gather(&mut self, ancestors: &[u32], column: &mut Vec<f64>) {
        let kept = self.at.iter_mut().flatten().flat_map(|then| &mut then.displacement);
        for displacement in self.displacement.iter_mut().chain(kept) {
            gather(displacement, column, ancestors);
        }
    }

    /// Mean current of each particle since the last packet of `vehicle`, up to `ago_s` before now, into `mean`; what is
    /// not known of that displacement, as a walk, m²/s. That instant is kept for the next packet.
    pub fn since(
        &mut self,
        vehicle: VehicleId,
        linear: &[Vec<f64>],
        ago_s: f64,
        mean: &mut [Vec<f64>; 2],
    ) -> f64 {
        let particles = self.displacement[0].len();
        let Some(slot) = self.at.get_mut(usize::from(vehicle)) else { return 0.0 };
        let then_s = self.elapsed_s - ago_s;
        let start = || Then {
            displacement: std::array::from_fn(|_| vec![0.0; particles]),
            variance_m2: 0.0,
            elapsed_s: 0.0,
        };
        let kept = slot.get_or_insert_with(start);
        let span_s = then_s - kept.elapsed_s;
        for axis in 0..2 {
            mean[axis].resize(particles, 0.0);
            let columns = self.displacement[axis].iter().zip(&linear[axis]).zip(&mut kept.displacement[axis]);
            for (out, ((displacement, current), kept)) in mean[axis].iter_mut().zip(columns) {
                let then = displacement - ago_s * current;
                *out = if span_s > LEAST_SPAN_S { (then - *kept) / span_s } else { *current };
                *kept = then;
            }
        }
        let variance_m2 = 0.5 * self.variance.trace();
        let walk =
            if span_s > LEAST_SPAN_S { (variance_m2 - kept.variance_m2).max(0.0) / span_s } else { 0.0 };
        (kept.elapsed_s, kept.variance_m2) = (then_s, variance_m2);
        walk
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::super::super::drift::Drift;
    use super::super::super::particle_core::ParticleCore;
    use super::*;
    use crate::kernels::particles::displacement_map;
    use crate::random::Streams;

    const PARTICLES: usize = 12;
    const DRIFT: Drift = Drift {
        sigma_position_m_per_sqrt_s: 0.15,
        sigma_current_mps_per_sqrt_s: 0.02,
        sigma_current0_mps: 0.3,
        sigma_heading_bias0_rad: 0.05,
        sigma_heading_bias_rad_per_sqrt_s: 1e-3,
        sigma_thrust_bias0_mps: 0.1,
        sigma_thrust_bias_mps_per_sqrt_s: 2e-3,
        dvl: crate::motion::DvlErrors { sigma_scale: 0.0, sigma_misalignment_rad: 0.0, hold_s: 1.0 },
    };

    /// Steps of a mission: duration and commanded velocity.
    fn steps() -> Vec<(f64, [f64; 2])> {
        let heading = |k: usize| 0.4 * k as f64;
        (0..25)
            .map(|k| (0.5 + 0.25 * (k % 4) as f64, [1.5 * heading(k).cos(), 1.5 * heading(k).sin()]))
            .collect()
    }

    /// Mean (a row for each particle) and covariance of the way, by one regression on all displacements at once.
    fn regression<const K: usize>(moved: &[Vec<[f64; 2]>]) -> (DMatrix<f64>, DMatrix<f64>) {
        let steps = steps();
        let n = steps.len();
        let walk: SMatrix<f64, K, K> = DRIFT.walk(1.0);
        // Covariance of all linear states at all steps: what they share is the prior and the walk up to the earlier one.
        let prior: SMatrix<f64, K, K> = DRIFT.prior();
        let ages: Vec<f64> = (0..n).map(|k| steps[..k].iter().map(|s| s.0).sum()).collect();
        let states = DMatrix::from_fn(n * K, n * K, |r, c| {
            let (earlier, a, b) = (ages[r / K].min(ages[c / K]), r % K, c % K);
            prior[(a, b)] + earlier * walk[(a, b)]
        });
        let mut seen = DMatrix::zeros(2 * n, n * K);
        let mut displacement = DMatrix::zeros(2, n * K);
        let mut noise = DMatrix::zeros(2 * n, 2 * n);
        for (k, (dt_s, velocity)) in steps.iter().enumerate() {
            let map = displacement_map::<K>(*velocity, *dt_s);
            for axis in 0..2 {
                (0..K).for_each(|j| seen[(2 * k + axis, k * K + j)] = map[axis][j]);
                displacement[(axis, k * K + axis)] = *dt_s;
                noise[(2 * k + axis, 2 * k + axis)] = DRIFT.position_walk(*dt_s)[0];
            }
        }
        let inverse = (&seen * &states * seen.transpose() + noise).try_inverse().unwrap();
        let gain = &displacement * &states * seen.transpose() * inverse;
        let covariance = &displacement * &states * displacement.transpose()
            - &gain * &seen * &states * displacement.transpose();
        let means = DMatrix::from_fn(moved.len(), 2, |i, axis| {
            let displaced = DVector::from_fn(2 * n, |r, _| {
                let (dt_s, velocity) = steps[r / 2];
                moved[i][r / 2][r % 2] - dt_s * velocity[r % 2]
            });
            (&gain * displaced)[axis]
        });
        (means, covariance)
    }

    fn smoothed_is_regressed<const K: usize>() {
        let mut core = ParticleCore::<K>::new(PARTICLES, DRIFT, Streams::new(7, 0)).unwrap();
        core.advance(0);
        core.fix([10.0, 20.0], [25.0, 0.0, 25.0]);
        let mut common = SharedCurrent::new(PARTICLES, 2);
        let mut moved = vec![Vec::new(); PARTICLES];
        let mut t_s = 0.0;
        for (dt_s, velocity) in steps() {
            core.velocity_mps = velocity;
            let at = [core.cloud.east.clone(), core.cloud.north.clone()];
            common.before(&core.cloud.linear);
            let covariance = core.covariance;
            t_s += dt_s;
            let step = core.advance((t_s * 1e9) as i64);
            common.after(&core.cloud.linear, &covariance, step.as_ref(), dt_s);
            for (i, moved) in moved.iter_mut().enumerate() {
                moved.push([core.cloud.east[i] - at[0][i], core.cloud.north[i] - at[1][i]]);
            }
        }
        let (means, covariance) = regression::<K>(&moved);
        for i in 0..PARTICLES {
            for axis in 0..2 {
                assert!((common.displacement[axis][i] - means[(i, axis)]).abs() < 1e-9, "particle {i}");
            }
        }
        for (r, c) in [(0, 0), (0, 1), (1, 1)] {
            assert!((common.variance[(r, c)] - covariance[(r, c)]).abs() < 1e-9, "{r}{c}");
        }
        let mut mean = [Vec::new(), Vec::new()];
        let walk = common.since(1, &core.cloud.linear, 0.0, &mut mean);
        assert!((walk * t_s - 0.5 * covariance.trace()).abs() < 1e-9);
        assert!((mean[0][3] * t_s - means[(3, 0)]).abs() < 1e-9);
        // An instant later there is no span to divide by: the current itself.
        assert_eq!(common.since(1, &core.cloud.linear, 0.0, &mut mean), 0.0);
        assert_eq!(mean[1], core.cloud.linear[1]);
    }

    #[test]
    fn the_way_is_what_a_regression_on_all_displacements_says() {
        smoothed_is_regressed::<2>();
        smoothed_is_regressed::<4>();
    }
}
