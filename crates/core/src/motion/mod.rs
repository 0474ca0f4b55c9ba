//! The motion front end: from what a vehicle's sensors say of its motion to one world velocity with its errors.
//!
//! | in force | velocity | its error, a slow state \[east, north\], m/s |
//! |---|---|---|
//! | bottom lock or odometry | R(yaw) v | scale, misalignment and heading bias: turns and grows with the velocity |
//! | water lock, else command | R(yaw) w, or u, plus the current that was learnt under bottom lock | what is left of the current |
//! | nothing | the last velocity over ground | grows with the speed |
//!
//! A navigator carries the error as two of its states, of which its position has the coefficient Δt in every case. When what
//! is in force changes, [`FrontEnd::follow`] exchanges their meaning. A vehicle that only has a command never changes it.

mod body_error;
mod current;
mod heading;
mod held_velocity;
mod in_force;
mod readings;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use crate::navigator::drift::Drift;
use body_error::BodyError;
use current::LearntCurrent;
use heading::HeadingFilter;
use held_velocity::HeldVelocity;

/// A vector in the plane.
type Plane = [f64; 2];
/// [ee, en, nn] of a covariance.
type Triangle = [f64; 3];

/// White noise of the position under bottom lock beside what the sensors state, m/√s, and walk of the slow error, m/s/√s.
const FLOOR_M_PER_SQRT_S: f64 = 0.02;
const GROUND_WALK_MPS_PER_SQRT_S: f64 = 1e-3;
/// A command, or a velocity that nothing tells any more, is wrong by so much at least, m/s.
const HELD_SIGMA_MPS: f64 = 0.05;
/// Slower than this a direction of motion says nothing, m/s.
const LEAST_SPEED_MPS: f64 = 0.1;
/// What the front end believes of the sensors beyond what they state.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DvlErrors {
    /// Standard deviation of the scale of velocities over ground.
    pub sigma_scale: f64,
    /// Of the angle between DVL and compass, rad.
    pub sigma_misalignment_rad: f64,
    /// A velocity holds for so long after its reading, s.
    pub hold_s: f64,
}

impl Default for DvlErrors {
    fn default() -> Self {
        Self { sigma_scale: 0.005, sigma_misalignment_rad: 0.5_f64.to_radians(), hold_s: 3.0 }
    }
}

/// The two states of a navigator that hold the error of the velocity.
pub trait VelocityError {
    /// Mean and covariance, m/s and m²/s².
    fn moments(&self) -> (Plane, Triangle);

    /// Takes these; what the states had in common with others is lost. `thrust_sigma_mps` is that of a thrust bias, where it
    /// is a state of its own.
    fn reset(&mut self, mean_mps: Plane, covariance_m2ps2: Triangle, thrust_sigma_mps: f64);

    /// Multiplied as complex numbers by `re + i im`: turned and scaled.
    fn turn(&mut self, re: f64, im: f64);
}

/// What became of an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Taken {
    /// It says nothing of the motion, or nothing that can be used.
    Noted,
    /// It counts.
    Used,
    /// It contradicts what came before it.
    Gated,
    /// Odometry: the position is so far from where the velocity in force has brought it, m.
    Shifted(Plane),
}

/// Where the velocity in force comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Source {
    Command,
    WaterLock,
    Ground,
    Held,
}

/// A velocity in the body frame, as last read.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Lock {
    t_ns: i64,
    body_mps: Plane,
    sigma_mps: f64,
    /// Since the reading before it, s.
    interval_s: f64,
    by_odometry: bool,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct OdometryRecord {
    t_ns: i64,
    /// Yaw at that time, rad.
    yaw_rad: f64,
    /// What the velocity in force has brought since, m.
    reckoned_m: Plane,
}

/// State of the front end.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct FrontEnd {
    errors: DvlErrors,
    command_mps: Option<Plane>,
    held: HeldVelocity,
    heading: HeadingFilter,
    ground: Option<Lock>,
    water: Option<Lock>,
    odometry: Option<OdometryRecord>,
    surprises: u32,
    source: Source,
    velocity_mps: Plane,
    /// Added to a velocity through the water.
    offset_mps: Plane,
    current: LearntCurrent,
    body: BodyError,
}

impl FrontEnd {
    /// Without a velocity yet; `drift` holds for a command.
    #[must_use]
    pub fn new(drift: &Drift) -> Self {
        Self {
            errors: drift.dvl,
            command_mps: None,
            held: HeldVelocity::default(),
            heading: HeadingFilter::default(),
            ground: None,
            water: None,
            odometry: None,
            surprises: 0,
            source: Source::Command,
            velocity_mps: [0.0; 2],
            offset_mps: [0.0; 2],
            current: LearntCurrent::new(drift),
            body: BodyError::new(drift),
        }
    }

    /// World velocity in force, [east, north], m/s.
    #[must_use]
    pub fn velocity_mps(&self) -> Plane {
        self.velocity_mps
    }

    /// Whether the velocity in force is one over ground.
    #[must_use]
    pub fn over_ground(&self) -> bool {
        self.source == Source::Ground
    }

    /// What the position's variance grows by on each axis between two instants because the command is too old to be
    /// believed, m².
    #[must_use]
    pub fn out_of_force_m2(&self, from_ns: i64, to_ns: i64) -> f64 {
        if self.source == Source::Command { self.held.drift_m2(from_ns, to_ns) } else { 0.0 }
    }

    /// How the position drifts with what is in force: `drift` for a velocity through the water.
    #[must_use]
    pub fn drift(&self, t_ns: i64, drift: &Drift) -> Drift {
        let (Source::Ground, Some(lock)) = (self.source, self.ground) else { return *drift };
        let speed2 = self.velocity_mps[0].powi(2) + self.velocity_mps[1].powi(2);
        let yaw_m2_s = self.heading.white_m2_s(t_ns);
        let white = lock.sigma_mps.powi(2) * lock.interval_s + speed2 * yaw_m2_s;
        Drift {
            sigma_position_m_per_sqrt_s: (FLOOR_M_PER_SQRT_S.powi(2) + white).sqrt(),
            sigma_current_mps_per_sqrt_s: GROUND_WALK_MPS_PER_SQRT_S,
            ..*drift
        }
    }
}
