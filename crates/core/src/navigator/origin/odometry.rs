//! Odometry: displacement and yaw change between events, in place of white acceleration.
//!
//! A vehicle with odometry needs no velocity in its node. The node's second half then holds the errors of its heading
//! and of its odometer's scale:
//!
//! ```text
//! [x, y, δψ, δs]      x' = x + (1 + δs) R(ψ + δψ) d        ψ: first heading, then yaw changes summed up
//! ```

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::event::{Payload, seconds};
use crate::information::{Gaussian, NODE, NodeMatrix, NodeVector, process};

/// Prior of the heading's error, rad, where the heading comes without a sigma.
const SIGMA_HEADING0_RAD: f64 = 0.01;
/// Headings that are known better than this, rad, have an error that can be linearised: 20°.
pub const KNOWN_RAD: f64 = 0.35;

/// A linearised step of a node: x ← F x + offset + N(0, noise).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryStep {
    /// F.
    pub transition: NodeMatrix,
    /// The constant part of the displacement.
    pub offset: NodeVector,
    /// Q.
    pub noise: NodeMatrix,
}

impl OdometryStep {
    /// Nothing moves.
    #[must_use]
    pub fn rest() -> Self {
        Self { transition: NodeMatrix::identity(), offset: NodeVector::zeros(), noise: NodeMatrix::zeros() }
    }

    /// With the first odometry: the position stays, and the priors of heading error and scale replace the velocity.
    #[must_use]
    pub fn begin(sigma_heading_rad: f64, sigma_scale: f64) -> Self {
        let mut step = Self::rest();
        for (entry, sigma) in [(2, sigma_heading_rad), (3, sigma_scale)] {
            step.transition[(entry, entry)] = 0.0;
            step.noise[(entry, entry)] = sigma * sigma;
        }
        step
    }

    /// This step, then another.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let f = next.transition;
        Self {
            transition: f * self.transition,
            offset: f * self.offset + next.offset,
            noise: f * self.noise * f.transpose() + next.noise,
        }
    }

    /// Q by a factor, but for the priors that a first step brings.
    #[must_use]
    pub fn noise_scaled(&self, factor: f64) -> NodeMatrix {
        if factor == 1.0 || self.transition[(3, 3)] == 0.0 { self.noise } else { self.noise * factor }
    }

    /// One node moved.
    #[must_use]
    pub fn applied(&self, node: &Gaussian<NODE>) -> Gaussian<NODE> {
        let mut moved = *node;
        moved.predict(&self.transition, &self.noise);
        moved.mean += self.offset;
        moved
    }
}

/// Sigma of the motion between two launches that odometry does not measure: a millimetre, and as little of the
/// heading error and scale. Without it a vehicle at rest would launch the same node twice, which makes the
/// information matrix singular.
const SIGMA_REST: [f64; 4] = [1e-3, 1e-3, 1e-4, 1e-5];

/// Covariance of the motion between two launches that odometry does not measure.
#[must_use]
pub fn unrest() -> NodeMatrix {
    NodeMatrix::from_diagonal(&NodeVector::from(SIGMA_REST).map(|sigma| sigma * sigma))
}

/// An odometry event with the yaw that its displacement starts from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Move {
    body_m: Vector2<f64>,
    yaw_rad: f64,
    covariance: [f64; 6],
    /// Of the vehicle's first odometry event, which replaces the velocity in the node: sigmas of its heading, rad, and of
    /// its odometer's scale.
    first: Option<(f64, f64)>,
}

impl Move {
    /// Its step, linearised at the node's mean.
    #[must_use]
    pub fn step(&self, node: &NodeVector) -> OdometryStep {
        let fresh = self
            .first
            .map_or_else(OdometryStep::rest, |(heading_rad, scale)| OdometryStep::begin(heading_rad, scale));
        fresh.then(&step(&self.body_m, self.yaw_rad, &self.covariance, &(fresh.transition * node)))
    }
}

/// State of a vehicle's odometry.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometer {
    yaw_rad: Option<f64>,
    /// Of the heading that yaw changes are counted from, rad; 0: it was not stated.
    sigma_rad: f64,
    moves: bool,
    /// Of the first and of the last odometry, ns.
    moved_ns: Option<(i64, i64)>,
}

impl Odometer {
    /// Whether the vehicle moves by odometry: from its first such event on.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.moves
    }

    /// Sigma of the heading at the start, rad.
    #[must_use]
    pub fn sigma_heading_rad(&self) -> f64 {
        if self.sigma_rad > 0.0 { self.sigma_rad } else { SIGMA_HEADING0_RAD }
    }

    /// Refuses the first odometry of a vehicle whose heading is not known.
    ///
    /// # Errors
    /// [`Error::OutOfBound`].
    pub fn check_heading(&self, payload: &Payload) -> Result<(), Error> {
        if !self.moves && matches!(payload, Payload::Odometry { .. }) && self.sigma_rad > KNOWN_RAD {
            return Err(Error::OutOfBound {
                quantity: "sigma of the heading that odometry starts from, rad (mdeif alone can find a heading)",
                value: self.sigma_rad,
                bound: "at most 0.35",
            });
        }
        Ok(())
    }

    /// By how much a constant error of the gyro of `sigma_radps` makes the variance of the heading grow with the odometry
    /// at `t_ns`, rad²: σ²t² from one event to the next.
    pub fn gyro_rad2(&mut self, t_ns: i64, sigma_radps: f64) -> f64 {
        let (first_ns, last_ns) = self.moved_ns.unwrap_or((t_ns, t_ns));
        self.moved_ns = Some((first_ns, t_ns));
        let [before_s, now_s] = [last_ns, t_ns].map(|at_ns| seconds(at_ns.saturating_sub(first_ns)));
        sigma_radps * sigma_radps * (now_s * now_s - before_s * before_s)
    }

    /// As [`Odometer::read`] for a vehicle that `started`; one that has no node yet only sums up its yaw.
    pub fn movement(&mut self, payload: &Payload, started: bool, sigma_scale: f64) -> Option<Move> {
        match *payload {
            Payload::Odometry { displacement_m, yaw_change_rad, covariance } => {
                let yaw_rad = self.yaw_rad?;
                self.yaw_rad = Some(yaw_rad + yaw_change_rad);
                let first = (!self.moves).then(|| (self.sigma_heading_rad(), sigma_scale));
                self.moves |= started;
                started.then(|| Move { body_m: Vector2::from(displacement_m), yaw_rad, covariance, first })
            }
            _ => {
                self.read(payload, None);
                None
            }
        }
    }

    /// Reads a heading, the first of which is where yaw changes are counted from, or an odometry event; the latter,
    /// once there is a heading and a `node`, gives its step.
    pub fn read(&mut self, payload: &Payload, node: Option<&NodeVector>) -> Option<OdometryStep> {
        match *payload {
            Payload::Heading { yaw_rad, sigma_rad } if !self.moves => {
                self.yaw_rad = Some(yaw_rad);
                self.sigma_rad = sigma_rad;
                None
            }
            Payload::Odometry { displacement_m, yaw_change_rad, covariance } => {
                let yaw_rad = self.yaw_rad?;
                self.moves = true;
                self.yaw_rad = Some(yaw_rad + yaw_change_rad);
                node.map(|node| step(&Vector2::from(displacement_m), yaw_rad, &covariance, node))
            }
            _ => None,
        }
    }
}

/// The step of a displacement in the body frame, linearised at the node's heading error and scale.
fn step(body_m: &Vector2<f64>, yaw_rad: f64, covariance: &[f64; 6], node: &NodeVector) -> OdometryStep {
    let [ff, fl, fy, ll, ly, yy] = *covariance;
    let (s, c) = (yaw_rad + node[2]).sin_cos();
    let turn = Matrix2::new(c, -s, s, c);
    let world = turn * body_m;
    let moved = world * (1.0 + node[3]);
    let across = Vector2::new(-moved.y, moved.x);
    let mut transition = NodeMatrix::identity();
    transition.fixed_view_mut::<2, 1>(0, 2).copy_from(&across);
    transition.fixed_view_mut::<2, 1>(0, 3).copy_from(&world);
    let shift = moved - across * node[2] - world * node[3];
    let mut noise = NodeMatrix::zeros();
    noise.fixed_view_mut::<2, 2>(0, 0).copy_from(&(turn * Matrix2::new(ff, fl, fl, ll) * turn.transpose()));
    let with_yaw = turn * Vector2::new(fy, ly);
    noise.fixed_view_mut::<2, 1>(0, 2).copy_from(&with_yaw);
    noise.fixed_view_mut::<1, 2>(2, 0).copy_from(&with_yaw.transpose());
    noise[(2, 2)] = yy;
    OdometryStep { transition, offset: NodeVector::new(shift.x, shift.y, 0.0, 0.0), noise }
}

/// The prediction step: white acceleration of this spectral density, or rest for a vehicle with odometry.
#[must_use]
pub fn drift(moves_by_odometry: bool, dt_s: f64, q_m2_per_s3: f64) -> OdometryStep {
    if moves_by_odometry {
        return OdometryStep::rest();
    }
    OdometryStep {
        transition: process::transition(dt_s),
        offset: NodeVector::zeros(),
        noise: process::noise(dt_s, q_m2_per_s3),
    }
}
