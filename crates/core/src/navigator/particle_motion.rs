//! The particle core and the motion front end: which velocity moves the particles, and what their error states mean.

use nalgebra::SMatrix;

use super::Outcome;
use super::drift::Drift;
use super::particle_core::ParticleCore;
use crate::cloud::Cloud;
use crate::event::Payload;
use crate::kernels::particles::MAX_LINEAR;
use crate::kernels::weights::weighted_covariance;
use crate::motion::{Taken, VelocityError};

/// The first two linear states of the particles: the current, or the error of a velocity over ground.
struct LinearPair<'a, const K: usize> {
    cloud: &'a mut Cloud<K>,
    covariance: &'a mut SMatrix<f64, K, K>,
}

impl<const K: usize> VelocityError for LinearPair<'_, K> {
    fn moments(&self) -> ([f64; 2], [f64; 3]) {
        let (w, mean, columns) = (self.cloud.weights(), self.cloud.linear_mean(), &self.cloud.linear);
        let of = |r: usize, c: usize| {
            self.covariance[(r, c)] + weighted_covariance(w, &columns[r], mean[r], &columns[c], mean[c])
        };
        ([mean[0], mean[1]], [of(0, 0), of(0, 1), of(1, 1)])
    }

    fn reset(&mut self, mean_mps: [f64; 2], [ee, en, nn]: [f64; 3], thrust_sigma_mps: f64) {
        let mut forget = |k: usize, mean: f64, variance: f64| {
            self.cloud.linear[k].fill(mean);
            for other in 0..K {
                self.covariance[(k, other)] = 0.0;
                self.covariance[(other, k)] = 0.0;
            }
            self.covariance[(k, k)] = variance;
        };
        forget(0, mean_mps[0], ee);
        forget(1, mean_mps[1], nn);
        if K == MAX_LINEAR {
            forget(MAX_LINEAR - 1, 0.0, thrust_sigma_mps * thrust_sigma_mps);
        }
        self.covariance[(0, 1)] = en;
        self.covariance[(1, 0)] = en;
    }

    fn turn(&mut self, re: f64, im: f64) {
        let (east, rest) = self.cloud.linear.split_at_mut(1);
        for (e, n) in east[0].iter_mut().zip(&mut rest[0]) {
            (*e, *n) = (re * *e - im * *n, im * *e + re * *n);
        }
        let mut turn = SMatrix::<f64, K, K>::identity();
        turn[(0, 0)] = re;
        turn[(0, 1)] = -im;
        turn[(1, 0)] = im;
        turn[(1, 1)] = re;
        *self.covariance = turn * *self.covariance * turn.transpose();
    }
}

impl<const K: usize> ParticleCore<K> {
    /// How the position drifts with the velocity in force.
    #[must_use]
    pub fn drift_in_force(&self) -> &Drift {
        &self.drift_in_force
    }

    /// Whether that velocity is one over ground.
    #[must_use]
    pub fn over_ground(&self) -> bool {
        self.motion.over_ground()
    }

    /// When, up to `t_ns`, what is in force ends to hold.
    #[must_use]
    pub fn motion_ends_before(&self, t_ns: i64) -> Option<i64> {
        let now_ns = self.now_ns()?;
        self.motion.ends_before(t_ns).filter(|end_ns| *end_ns > now_ns)
    }

    /// Advances to `t_ns`; on the way, what is in force ends to hold.
    pub fn advance_following(&mut self, t_ns: i64) {
        if let Some(end_ns) = self.motion_ends_before(t_ns) {
            self.advance(end_ns);
            self.follow_motion(end_ns);
        }
        self.advance(t_ns);
    }

    /// Puts in force what the sensors say now; see [`FrontEnd::follow`](crate::motion::FrontEnd::follow).
    pub fn follow_motion(&mut self, t_ns: i64) -> Option<f64> {
        let mut pair = LinearPair { cloud: &mut self.cloud, covariance: &mut self.covariance };
        let widened = self.motion.follow(t_ns, &mut pair);
        self.velocity_mps = self.motion.velocity_mps();
        self.drift_in_force = self.motion.drift(t_ns, &self.drift);
        widened
    }

    /// Takes up what an event says of the motion: its outcome, what [`follow_motion`](Self::follow_motion) gives, and by how
    /// much the particles were moved by odometry, m.
    pub fn take_motion(&mut self, t_ns: i64, payload: &Payload) -> (Outcome, Option<f64>, Option<[f64; 2]>) {
        let (mut outcome, mut shift) = (Outcome::Fused, None);
        match self.motion.take(t_ns, payload) {
            Taken::Noted => outcome = Outcome::Noted,
            Taken::Used => {}
            Taken::Gated => {
                self.rejected += 1;
                outcome = Outcome::Gated;
            }
            Taken::Shifted(by_m) => {
                self.cloud.east.iter_mut().for_each(|e| *e += by_m[0]);
                self.cloud.north.iter_mut().for_each(|n| *n += by_m[1]);
                if let Some(trajectory) = &mut self.trajectory {
                    trajectory.shift(by_m);
                }
                shift = Some(by_m);
            }
        }
        (outcome, self.follow_motion(t_ns), shift)
    }
}
