//! Own sensors and ranges, as every navigator of this family uses them.
//!
//! A node is [x, y, ẋ, ẏ] with white acceleration. Fixes observe the position; a DVL's body-frame velocity is rotated
//! by the last heading and observes ẋ, ẏ. Both are linear, so filters that differ only in what they keep of the past
//! agree to rounding. A range is linearised at the means of the sender's node at launch and of the receiver's at
//! arrival.

use serde::{Deserialize, Serialize};

use super::local_options::LocalOptions;
use super::odometry::{self, Move, Odometer};
use super::sensors::{FixGate, Half, Linear, SensorReading, Sensors};
use crate::error::Error;
use crate::event::{Payload, seconds};
use crate::information::{Gaussian, NODE, NodeMatrix, NodeVector, process};
use crate::navigator::{Estimate, Outcome, Status};

/// The first fix as a node: position as measured, velocity unknown.
#[must_use]
pub fn start(fix: &Linear, options: &LocalOptions) -> Gaussian<NODE> {
    let mut mean = NodeVector::zeros();
    mean.fixed_rows_mut::<2>(0).copy_from(&fix.value);
    let mut covariance = NodeMatrix::identity() * (options.sigma_velocity0_mps * options.sigma_velocity0_mps);
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&fix.noise);
    Gaussian { mean, covariance }
}

/// A node moved by `dt_s` under white acceleration (looking back: without taking noise away).
#[must_use]
pub fn predicted(node: &Gaussian<NODE>, dt_s: f64, q_m2_per_s3: f64) -> Gaussian<NODE> {
    let mut moved = *node;
    moved.predict(&process::transition(dt_s), &process::noise(dt_s, q_m2_per_s3));
    moved
}

/// A node as an estimate; none yet: not started.
#[must_use]
pub fn estimate(node: Option<&Gaussian<NODE>>, t_ns: i64, rejected: u64) -> Estimate {
    let (mean_m, covariance_m2, status) = match node {
        Some(Gaussian { mean, covariance }) => (
            [mean[0], mean[1]],
            [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]],
            Status::Navigating,
        ),
        None => ([f64::NAN; 2], [f64::INFINITY, 0.0, f64::INFINITY], Status::NotStarted),
    };
    Estimate { t_ns, mean_m, covariance_m2, yaw: None, ess: None, rejected, status }
}

/// A Kalman filter over the own node, with own sensors only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LocalFilter {
    options: LocalOptions,
    /// What must be remembered to read the sensors.
    pub sensors: Sensors,
    /// Time that it has advanced to, ns.
    pub now_ns: Option<i64>,
    /// The own node; none before the first fix.
    pub node: Option<Gaussian<NODE>>,
    /// Measurements gated.
    pub rejected: u64,
    /// Of a vehicle that is told how it moved.
    pub odometer: Odometer,
    gate: FixGate,
}

/// What an own sensor does to the own node.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Change {
    /// The first fix.
    Start(Linear),
    /// A measurement.
    Sensed(Linear),
    /// Odometry.
    Moved(Move),
}

/// A sensor event that a filter took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fused {
    /// Spectral density of the acceleration before it, m²/s³.
    pub q_m2_per_s3: f64,
    /// What it did.
    pub change: Change,
    /// The step of an odometry event, linearised at this filter's node.
    pub step: Option<odometry::OdometryStep>,
}

impl LocalFilter {
    /// A filter that waits for its first fix.
    ///
    /// # Errors
    /// What [`LocalOptions::validate`] says.
    pub fn new(options: LocalOptions) -> Result<Self, Error> {
        options.validate()?;
        Ok(Self {
            options,
            sensors: Sensors::default(),
            now_ns: None,
            node: None,
            rejected: 0,
            odometer: Odometer::default(),
            gate: FixGate::default(),
        })
    }

    /// The options.
    #[must_use]
    pub fn options(&self) -> &LocalOptions {
        &self.options
    }

    /// Moves to `t_ns`, never back.
    pub fn advance(&mut self, t_ns: i64) {
        let now_ns = self.now_ns.unwrap_or(t_ns);
        if t_ns > now_ns && !self.odometer.moves() {
            let q = self.sensors.process_noise_m2_per_s3(&self.options);
            self.node = self.node.map(|node| predicted(&node, seconds(t_ns.saturating_sub(now_ns)), q));
        }
        self.now_ns = Some(t_ns.max(now_ns));
    }

    /// Advances to a checked sensor event and fuses it.
    pub fn sense(&mut self, t_ns: i64, payload: &Payload) -> Outcome {
        self.sense_with_change(t_ns, payload).0
    }

    /// As [`LocalFilter::sense`], and what was fused.
    pub fn sense_with_change(&mut self, t_ns: i64, payload: &Payload) -> (Outcome, Option<Fused>) {
        self.advance(t_ns);
        let q_m2_per_s3 = self.sensors.process_noise_m2_per_s3(&self.options);
        let started = self.node.is_some();
        if let Some(movement) = self.odometer.movement(payload, started, self.options.sigma_odometry_scale) {
            let gyro_rad2 = self.odometer.gyro_rad2(t_ns, self.options.sigma_gyro_bias_radps);
            let step = self.node.map(|node| {
                let mut step = movement.step(&node.mean);
                step.noise[(2, 2)] += gyro_rad2;
                step
            });
            self.node = self.node.zip(step).map(|(node, step)| step.applied(&node));
            return (Outcome::Fused, Some(Fused { q_m2_per_s3, change: Change::Moved(movement), step }));
        }
        let linear = match self.sensors.read(t_ns, payload) {
            SensorReading::Nothing => return (Outcome::Noted, None),
            SensorReading::Refused => {
                self.rejected += 1;
                return (Outcome::Gated, None);
            }
            // The node of a vehicle with odometry has no velocity to be measured.
            SensorReading::Linear(linear) if linear.half == Half::Velocity && self.odometer.moves() => {
                return (Outcome::Noted, None);
            }
            SensorReading::Linear(linear) => linear,
        };
        let fused = |change| Some(Fused { q_m2_per_s3, change, step: None });
        let Some(node) = &mut self.node else {
            if linear.half == Half::Velocity {
                return (Outcome::Noted, None);
            }
            self.node = Some(start(&linear, &self.options));
            return (Outcome::Fused, fused(Change::Start(linear)));
        };
        let observe = linear.observe();
        let squared = node.innovation_squared(&observe, &linear.value, &linear.noise);
        let admitted = squared.is_some_and(|squared| self.gate.admits(linear.half, squared, &self.options));
        if admitted && node.update(&observe, &linear.value, &linear.noise).is_ok() {
            return (Outcome::Fused, fused(Change::Sensed(linear)));
        }
        self.rejected += 1;
        (Outcome::Gated, None)
    }
}
