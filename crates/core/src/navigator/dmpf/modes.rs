//! The cloud as a few modes, for a broadcast of more than one (section 7 of the paper).

use nalgebra::Vector2;

use super::Dmpf;
use crate::mixture::{Mode, fit};
use crate::packet::{Belief, PacketKind};

/// Iterations of EM for a broadcast: more change a mode by less than its rounding.
const EM_ITERATIONS: usize = 8;

impl Dmpf {
    /// The modes at `tol_ns`; `None` where one belief is asked for.
    pub(super) fn modes(&self, tol_ns: i64) -> Option<Vec<(f64, Belief)>> {
        if self.options.packet != PacketKind::Mixture {
            return None;
        }
        let particles = self.state.core.particles_at(tol_ns);
        let points: Vec<Vector2<f64>> =
            particles.east.iter().zip(&particles.north).map(|(e, n)| Vector2::new(*e, *n)).collect();
        let modes = fit(&points, &particles.weights, self.options.modes, EM_ITERATIONS)?;
        let belief = |m: &Mode<2>| Belief { mean_m: m.mean, covariance_m2: m.covariance };
        Some(modes.iter().map(|m| (m.weight, belief(m))).collect())
    }
}
