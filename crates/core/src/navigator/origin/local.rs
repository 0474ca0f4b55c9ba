//! Own sensors and ranges, as every navigator of this family uses them.
//!
//! A node is [x, y, ẋ, ẏ] with white acceleration. Fixes observe the position; a DVL's body-frame velocity is rotated
//! by the last heading and observes ẋ, ẏ. Both are linear, so filters that differ only in what they keep of the past
//! agree to rounding. A range is linearised at the means of the sender's node at launch and of the receiver's at
//! arrival.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use super::odometry::{self, Move, Odometer};
use crate::error::{Error, non_negative, positive};
use crate::event::{Event, Payload, VehicleId};
use crate::information::{Gaussian, Joint, NODE, NodeMatrix, NodeVector, Term, process};
use crate::link::{range_m, slant_to_horizontal};
use crate::navigator::common::{check_event, seconds};
use crate::navigator::{Estimate, Outcome, Status};

/// Longest pause between two events of one vehicle, s: a longer one is a clock that stepped.
const PAUSE_MAX_S: f64 = 21_600.0;
/// A heading older than this does not rotate a DVL's velocity any more, ns.
const HEADING_AGE_MAX_NS: i64 = 10_000_000_000;
/// Nothing that these navigators are for goes faster over ground, m/s.
const GROUND_SPEED_MAX_MPS: f64 = 30.0;
/// So many fixes in a row that contradict the belief are believed: a lost vehicle must be able to find back.
const FIXES_BELIEVED: u32 = 3;
/// A slant range this many sigmas shorter than the difference of the depths is refused.
const SLANT_GATES: f64 = 4.0;

/// How a vehicle's own motion and sensors are modelled, and ranges weighed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LocalOptions {
    /// Spectral density of the acceleration per axis, m²/s³, of a vehicle that does not measure its velocity.
    pub process_noise_m2_per_s3: f64,
    /// The same of one that does (from its first DVL velocity on).
    pub process_noise_dvl_m2_per_s3: f64,
    /// Prior of the velocity per axis, m/s.
    pub sigma_velocity0_mps: f64,
    /// Of a (slant) range, m.
    pub sigma_range_m: f64,
    /// Fixes and ranges that contradict the belief by more sigmas are gated and counted.
    pub gate_sigmas: f64,
}

impl LocalOptions {
    /// Refuses what cannot be.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        positive("process_noise_m2_per_s3", self.process_noise_m2_per_s3)?;
        positive("process_noise_dvl_m2_per_s3", self.process_noise_dvl_m2_per_s3)?;
        positive("sigma_velocity0_mps", self.sigma_velocity0_mps)?;
        positive("sigma_range_m", self.sigma_range_m)?;
        positive("gate_sigmas", self.gate_sigmas)?;
        Ok(())
    }
}

/// Which half of a node a linear measurement observes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Half {
    /// [x, y].
    Position,
    /// [ẋ, ẏ].
    Velocity,
}

/// A linear measurement of a vehicle's own node, world frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Linear {
    /// What it observes.
    pub half: Half,
    /// m or m/s.
    pub value: Vector2<f64>,
    /// m² or m²/s².
    pub noise: Matrix2<f64>,
}

impl Linear {
    /// First observed row of the node.
    #[must_use]
    pub fn first(&self) -> usize {
        match self.half {
            Half::Position => 0,
            Half::Velocity => 2,
        }
    }

    /// H.
    #[must_use]
    pub fn observe(&self) -> SMatrix<f64, 2, NODE> {
        let first = self.first();
        SMatrix::from_fn(|r, c| f64::from(u8::from(c == first + r)))
    }
}

/// What a sensor event comes to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// Kept for later (heading, depth), or of no use here.
    Nothing,
    /// It cannot be used: counted.
    Refused,
    /// A measurement of the own node.
    Linear(Linear),
}

/// A vehicle's sensors: what must be remembered to read them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Sensors {
    /// Stamp in ns, yaw and its sigma in rad.
    heading: Option<(i64, f64, f64)>,
    depth_m: f64,
    measures_velocity: bool,
}

impl Sensors {
    /// Own depth, m; a sensor at the surface may read a little above it.
    #[must_use]
    pub fn depth_m(&self) -> f64 {
        self.depth_m
    }

    /// Spectral density of the acceleration that holds for this vehicle, m²/s³.
    #[must_use]
    pub fn process_noise_m2_per_s3(&self, options: &LocalOptions) -> f64 {
        if self.measures_velocity {
            options.process_noise_dvl_m2_per_s3
        } else {
            options.process_noise_m2_per_s3
        }
    }

    /// Reads a validated sensor event.
    pub fn read(&mut self, t_ns: i64, payload: &Payload) -> Reading {
        match *payload {
            Payload::Heading { yaw_rad, sigma_rad } => {
                self.heading = Some((t_ns, yaw_rad, sigma_rad));
                Reading::Nothing
            }
            Payload::Depth { depth_m, .. } => {
                self.depth_m = depth_m.max(0.0);
                Reading::Nothing
            }
            Payload::Fix { position_m, covariance_m2: [ee, en, nn] } => Reading::Linear(Linear {
                half: Half::Position,
                value: Vector2::from(position_m),
                noise: Matrix2::new(ee, en, en, nn),
            }),
            Payload::GroundVelocity { velocity_mps, sigma_mps } => {
                self.ground_velocity(t_ns, Vector2::from(velocity_mps), sigma_mps)
            }
            _ => Reading::Nothing,
        }
    }

    /// R(ψ) v, with σ² I and (|v| σ_ψ)² across the track.
    fn ground_velocity(&mut self, t_ns: i64, body_mps: Vector2<f64>, sigma_mps: f64) -> Reading {
        let Some((heading_ns, yaw_rad, sigma_rad)) = self.heading else { return Reading::Nothing };
        if body_mps.norm() > GROUND_SPEED_MAX_MPS || t_ns.saturating_sub(heading_ns) > HEADING_AGE_MAX_NS {
            return Reading::Refused;
        }
        let (s, c) = yaw_rad.sin_cos();
        let value = Vector2::new(c * body_mps.x - s * body_mps.y, s * body_mps.x + c * body_mps.y);
        let across = Vector2::new(-value.y, value.x) * sigma_rad;
        self.measures_velocity = true;
        let noise = Matrix2::identity() * (sigma_mps * sigma_mps) + across * across.transpose();
        Reading::Linear(Linear { half: Half::Velocity, value, noise })
    }
}

/// Gates fixes, but believes a few in a row.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FixGate {
    contradicting: u32,
}

impl FixGate {
    /// Whether a linear measurement with this normalised innovation squared may be fused. Velocities always may: a
    /// turn contradicts them harder than most faults do.
    pub fn admits(&mut self, half: Half, squared: f64, options: &LocalOptions) -> bool {
        if half == Half::Velocity {
            return true;
        }
        if squared <= options.gate_sigmas * options.gate_sigmas {
            self.contradicting = 0;
            return true;
        }
        self.contradicting += 1;
        if self.contradicting < FIXES_BELIEVED {
            return false;
        }
        self.contradicting = 0;
        true
    }
}

/// Whose event it is, whether it is in order, and whether the clock stepped.
///
/// # Errors
/// What [`check_event`] says; [`Error::OutOfBound`] for a pause of more than six hours, or an arrival after the end of
/// its decoding.
pub fn check_local_event(event: &Event, own: VehicleId, now_ns: Option<i64>) -> Result<(), Error> {
    check_event(event, own, now_ns)?;
    if let Some(now_ns) = now_ns {
        let pause_s = seconds(event.t_ns.saturating_sub(now_ns));
        if pause_s > PAUSE_MAX_S {
            return Err(Error::OutOfBound {
                quantity: "pause since the last event, s",
                value: pause_s,
                bound: "0 to 21600",
            });
        }
    }
    if let Payload::Reception { toa_ns, .. } = event.payload
        && toa_ns > event.t_ns
    {
        return Err(Error::OutOfBound {
            quantity: "arrival before the end of decoding, s",
            value: seconds(event.t_ns.saturating_sub(toa_ns)),
            bound: "0 and above",
        });
    }
    Ok(())
}

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

/// A Kalman filter over the own node that hears nothing but own sensors.
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
    /// The step that odometry told, linearised at this filter's node.
    pub step: Option<odometry::Step>,
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
        self.sense_and_tell(t_ns, payload).0
    }

    /// As [`LocalFilter::sense`], and what was fused.
    pub fn sense_and_tell(&mut self, t_ns: i64, payload: &Payload) -> (Outcome, Option<Fused>) {
        self.advance(t_ns);
        let q_m2_per_s3 = self.sensors.process_noise_m2_per_s3(&self.options);
        let started = self.node.is_some();
        if let Some(told) = self.odometer.told(payload, started) {
            let step = self.node.map(|node| told.step(&node.mean));
            self.node = self.node.zip(step).map(|(node, step)| step.applied(&node));
            return (Outcome::Fused, Some(Fused { q_m2_per_s3, change: Change::Moved(told), step }));
        }
        let linear = match self.sensors.read(t_ns, payload) {
            Reading::Nothing => return (Outcome::Noted, None),
            Reading::Refused => {
                self.rejected += 1;
                return (Outcome::Gated, None);
            }
            // The node of a vehicle with odometry has no velocity to be measured.
            Reading::Linear(linear) if linear.half == Half::Velocity && self.odometer.moves() => {
                return (Outcome::Noted, None);
            }
            Reading::Linear(linear) => linear,
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

/// A horizontal range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// m.
    pub range_m: f64,
    /// Its standard deviation, m: that of the slant range times slant over horizontal.
    pub sigma_m: f64,
}

impl Range {
    /// From the travel time, reduced by both depths; `None` for one so steep that it says nothing about the horizontal.
    ///
    /// # Errors
    /// [`Error::Link`] for a travel time that is none, or a slant range too short for the depths.
    pub fn measured(
        tol_ns: i64,
        toa_ns: i64,
        sound_speed_mps: f64,
        own_depth_m: f64,
        sender_depth_m: f64,
        sigma_range_m: f64,
    ) -> Result<Option<Self>, Error> {
        non_negative("sender's depth, m", sender_depth_m)?;
        let slant_m = range_m(tol_ns, toa_ns, sound_speed_mps)?;
        let horizontal =
            slant_to_horizontal(slant_m, own_depth_m, sender_depth_m, sigma_range_m, SLANT_GATES)?;
        if horizontal.clamped || horizontal.range_m <= sigma_range_m {
            return Ok(None);
        }
        let sigma_m = sigma_range_m * slant_m / horizontal.range_m;
        Ok(Some(Self { range_m: horizontal.range_m, sigma_m }))
    }

    /// Fuses it between the sender's node at launch and the receiver's at arrival, linearised at their means. Gated (and
    /// nothing changed) when it contradicts the joint by more than `gate_sigmas`, or the means coincide.
    pub fn fuse(&self, joint: &mut Joint, sender: usize, receiver: usize, gate_sigmas: f64) -> Outcome {
        let between = (joint.node_mean(receiver) - joint.node_mean(sender)).fixed_rows::<2>(0).into_owned();
        let distance_m = between.norm();
        if distance_m <= f64::MIN_POSITIVE {
            return Outcome::Gated;
        }
        let mut observe = SMatrix::<f64, 1, NODE>::zeros();
        observe.fixed_view_mut::<1, 2>(0, 0).copy_from(&(between / distance_m).transpose());
        let terms = [Term { node: receiver, observe }, Term { node: sender, observe: -observe }];
        let noise = SMatrix::<f64, 1, 1>::new(self.sigma_m * self.sigma_m);
        let (value, predicted) = (SVector::<f64, 1>::new(self.range_m), SVector::<f64, 1>::new(distance_m));
        match joint.innovation(&terms, &value, &predicted, &noise) {
            Some(innovation) if innovation.squared <= gate_sigmas * gate_sigmas => {
                joint.fuse(&innovation);
                Outcome::Fused
            }
            _ => Outcome::Gated,
        }
    }
}
