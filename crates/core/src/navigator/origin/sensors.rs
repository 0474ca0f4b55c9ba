//! Own sensors as linear measurements of the own node, and their gates.

use nalgebra::{Matrix2, SMatrix, Vector2};
use serde::{Deserialize, Serialize};

use super::local_options::LocalOptions;
use crate::error::Error;
use crate::event::{Event, GROUND_SPEED_MAX_MPS, Kind, Payload, VehicleId, seconds};
use crate::information::NODE;
use crate::navigator::{Kinds, check_event};

/// Longest pause between two events of one vehicle, s: a longer one is a clock that stepped.
const PAUSE_MAX_S: f64 = 21_600.0;
/// A heading older than this does not rotate a DVL's velocity any more, ns.
const HEADING_AGE_MAX_NS: i64 = 10_000_000_000;
/// After so many gated fixes in a row the next one is used: a lost vehicle must be able to recover.
const FIXES_BELIEVED: u32 = 3;

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

/// Use of a sensor event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SensorReading {
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
    pub fn read(&mut self, t_ns: i64, payload: &Payload) -> SensorReading {
        match *payload {
            Payload::Heading { yaw_rad, sigma_rad } => {
                self.heading = Some((t_ns, yaw_rad, sigma_rad));
                SensorReading::Nothing
            }
            Payload::Depth { depth_m, .. } => {
                self.depth_m = depth_m.max(0.0);
                SensorReading::Nothing
            }
            Payload::Fix { position_m, covariance_m2: [ee, en, nn] } => SensorReading::Linear(Linear {
                half: Half::Position,
                value: Vector2::from(position_m),
                noise: Matrix2::new(ee, en, en, nn),
            }),
            Payload::GroundVelocity { velocity_mps, sigma_mps } => {
                self.ground_velocity(t_ns, Vector2::from(velocity_mps), sigma_mps)
            }
            _ => SensorReading::Nothing,
        }
    }

    /// R(ψ) v, with σ² I and (|v| σ_ψ)² across the track.
    fn ground_velocity(&mut self, t_ns: i64, body_mps: Vector2<f64>, sigma_mps: f64) -> SensorReading {
        let Some((heading_ns, yaw_rad, sigma_rad)) = self.heading else { return SensorReading::Nothing };
        if body_mps.norm() > GROUND_SPEED_MAX_MPS || t_ns.saturating_sub(heading_ns) > HEADING_AGE_MAX_NS {
            return SensorReading::Refused;
        }
        let (s, c) = yaw_rad.sin_cos();
        let value = Vector2::new(c * body_mps.x - s * body_mps.y, s * body_mps.x + c * body_mps.y);
        let across = Vector2::new(-value.y, value.x) * sigma_rad;
        self.measures_velocity = true;
        let noise = Matrix2::identity() * (sigma_mps * sigma_mps) + across * across.transpose();
        SensorReading::Linear(Linear { half: Half::Velocity, value, noise })
    }
}

/// Gates fixes, but not several in a row.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FixGate {
    contradicting: u32,
}

impl FixGate {
    /// Whether a linear measurement with this normalised innovation squared may be fused. Velocities always may: a
    /// turn causes larger innovations than most faults.
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

/// Kinds of own sensors that these navigators read.
pub const LOCAL_SENSORS: Kinds =
    Kinds::of(&[Kind::Odometry, Kind::Depth, Kind::Heading, Kind::GroundVelocity, Kind::Fix]);

/// Whose event it is, whether it is in order, and whether the clock stepped.
///
/// # Errors
/// What [`check_event`] says; [`Error::OutOfBound`] for a pause of more than six hours.
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
    Ok(())
}
