//! The error of a velocity over ground: a scale s and an angle a, the same while the vehicle turns.
//!
//! A velocity u that is wrong by a factor 1 + s and turned by a is off by c = [[u_e, −u_n], [u_n, u_e]] [s, a]ᵀ, which turns
//! and grows with u: as complex numbers, c' / c = u' / u.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::{LEAST_SPEED_MPS, Plane, Triangle, VelocityError};
use crate::navigator::drift::Drift;

/// What is left of the error however slow the vehicle is, m/s.
const FLOOR_MPS: f64 = 0.01;

/// The error as it was when the lock was lost, and the velocity that the states are turned with.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct BodyError {
    prior: Triangle,
    mean: Plane,
    covariance: Triangle,
    /// Velocity that the states belong to; none while the lock begins or the vehicle has hardly moved since.
    reference_mps: Option<Plane>,
    begins: bool,
}

fn map([e, n]: Plane) -> Matrix2<f64> {
    Matrix2::new(e, -n, n, e)
}

fn triangle(m: Matrix2<f64>) -> Triangle {
    [m[(0, 0)], 0.5 * (m[(0, 1)] + m[(1, 0)]), m[(1, 1)]]
}

fn matrix([xx, xy, yy]: Triangle) -> Matrix2<f64> {
    Matrix2::new(xx, xy, xy, yy)
}

impl BodyError {
    pub fn new(drift: &Drift) -> Self {
        let angle = drift.sigma_heading_bias0_rad.hypot(drift.dvl.sigma_misalignment_rad);
        let prior = [drift.dvl.sigma_scale.powi(2), 0.0, angle * angle];
        Self { prior, mean: [0.0; 2], covariance: prior, reference_mps: None, begins: false }
    }

    /// The lock begins: the next velocity gives the states their meaning.
    pub fn start(&mut self) {
        self.begins = true;
        self.reference_mps = None;
    }

    /// The lock is lost: what the states hold is kept.
    pub fn keep(&mut self, (mean, covariance): (Plane, Triangle)) {
        let Some(inverse) = self.reference_mps.and_then(|u| map(u).try_inverse()) else { return };
        let kept = inverse * (matrix(covariance)) * inverse.transpose();
        let [scale, _, angle] = triangle(kept);
        // It is never known worse than before the first reading.
        if scale <= self.prior[0] && angle <= self.prior[2] {
            self.mean = (inverse * Vector2::from(mean)).into();
            self.covariance = triangle(kept);
        }
    }

    /// The velocity over ground is `velocity_mps` now.
    pub fn follow(&mut self, velocity_mps: Plane, states: &mut impl VelocityError) {
        let [e, n] = velocity_mps;
        let moves = e.hypot(n) >= LEAST_SPEED_MPS;
        match self.reference_mps {
            Some([re, rn]) if moves => {
                let square = re * re + rn * rn;
                states.turn((e * re + n * rn) / square, (n * re - e * rn) / square);
                self.reference_mps = Some(velocity_mps);
            }
            None if moves || self.begins => {
                let u = map(velocity_mps);
                let floor = Matrix2::identity() * (FLOOR_MPS * FLOOR_MPS);
                let covariance = u * matrix(self.covariance) * u.transpose() + floor;
                states.reset((u * Vector2::from(self.mean)).into(), triangle(covariance), 0.0);
                self.reference_mps = moves.then_some(velocity_mps);
                self.begins = false;
            }
            _ => {}
        }
    }
}
