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

use serde::{Deserialize, Serialize};

use crate::event::{GROUND_SPEED_MAX_MPS, Payload, seconds};
use crate::navigator::drift::Drift;
use body_error::BodyError;
use current::LearntCurrent;
use heading::HeadingFilter;

/// A vector in the plane.
type Plane = [f64; 2];
/// [ee, en, nn] of a covariance.
type Triangle = [f64; 3];

/// A sigma above this is no velocity, m/s.
const USELESS_SIGMA_MPS: f64 = 5.0;
/// A velocity of a lock changes by no more than this between two readings a second apart, m/s …
const SURPRISE_MPS: f64 = 1.0;
/// … and this many sigmas; so many in a row that do are believed.
const SURPRISE_SIGMAS: f64 = 6.0;
const SURPRISES_BELIEVED: u32 = 3;
/// White noise of the position under bottom lock beside what the sensors state, m/√s, and walk of the slow error, m/s/√s.
const FLOOR_M_PER_SQRT_S: f64 = 0.02;
const GROUND_WALK_MPS_PER_SQRT_S: f64 = 1e-3;
/// Slower than this a direction of motion says nothing, m/s.
const LEAST_SPEED_MPS: f64 = 0.1;
/// Without anything that tells the velocity it is wrong by so much, and by such a share of it, m/s.
const HELD_SIGMA_MPS: f64 = 0.05;
const HELD_SHARE: f64 = 0.2;
/// Odometry further apart than this is none, s.
const ODOMETRY_APART_S: f64 = 60.0;

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

    /// Takes up an event; [`follow`](Self::follow) puts in force what follows from it.
    pub fn take(&mut self, t_ns: i64, payload: &Payload) -> Taken {
        match payload {
            Payload::Motion { velocity_mps } => {
                self.command_mps = Some(*velocity_mps);
                Taken::Used
            }
            Payload::Heading { yaw_rad, sigma_rad } => {
                self.heading.heading(t_ns, *yaw_rad, *sigma_rad);
                self.used_if_turned(t_ns)
            }
            Payload::TurnRate { yaw_rate_radps, sigma_radps } => {
                self.heading.turn_rate(t_ns, *yaw_rate_radps, *sigma_radps);
                self.used_if_turned(t_ns)
            }
            Payload::GroundVelocity { velocity_mps, sigma_mps } => {
                let taken = self.lock(t_ns, *velocity_mps, *sigma_mps);
                self.learn_current(t_ns);
                taken
            }
            Payload::WaterVelocity { velocity_mps, sigma_mps } if usable(*velocity_mps, *sigma_mps) => {
                let interval_s = self.water.map_or(1.0, |last| seconds(t_ns.saturating_sub(last.t_ns)));
                let interval_s = interval_s.clamp(0.0, self.errors.hold_s);
                let (body_mps, sigma_mps) = (*velocity_mps, *sigma_mps);
                self.water = Some(Lock { t_ns, body_mps, sigma_mps, interval_s, by_odometry: false });
                if self.heading_at(t_ns).is_some() { Taken::Used } else { Taken::Noted }
            }
            Payload::Odometry { displacement_m, yaw_change_rad, covariance } => {
                self.odometry(t_ns, *displacement_m, *yaw_change_rad, covariance)
            }
            _ => Taken::Noted,
        }
    }

    /// Whether velocities in the body frame are in use, so that a heading counts.
    fn used_if_turned(&self, t_ns: i64) -> Taken {
        let fresh = |lock: Option<Lock>| lock.is_some_and(|lock| self.fresh(&lock, t_ns));
        if fresh(self.ground) || fresh(self.water) || self.odometry.is_some() {
            Taken::Used
        } else {
            Taken::Noted
        }
    }

    fn lock(&mut self, t_ns: i64, body_mps: Plane, sigma_mps: f64) -> Taken {
        if !usable(body_mps, sigma_mps) {
            return Taken::Gated;
        }
        let mut interval_s = 1.0;
        if let Some(last) = self.ground.filter(|last| !last.by_odometry && self.fresh(last, t_ns)) {
            interval_s = seconds(t_ns.saturating_sub(last.t_ns));
            let off = (body_mps[0] - last.body_mps[0]).hypot(body_mps[1] - last.body_mps[1]);
            let sigma = sigma_mps.hypot(last.sigma_mps);
            let surprising = off > SURPRISE_MPS * interval_s.max(1.0) + SURPRISE_SIGMAS * sigma;
            if surprising && self.surprises + 1 < SURPRISES_BELIEVED {
                self.surprises += 1;
                return Taken::Gated;
            }
        }
        self.surprises = 0;
        self.ground = Some(Lock { t_ns, body_mps, sigma_mps, interval_s, by_odometry: false });
        if self.heading_at(t_ns).is_some() { Taken::Used } else { Taken::Noted }
    }

    fn learn_current(&mut self, t_ns: i64) {
        let (Some(ground), Some((through, sigma_mps))) = (self.ground, self.through_water(t_ns)) else {
            return;
        };
        let Some((yaw_rad, yaw_m2)) = self.heading_at(t_ns).filter(|_| ground.t_ns == t_ns) else { return };
        let over = turned(ground.body_mps, yaw_rad);
        let speed2 = over[0] * over[0] + over[1] * over[1];
        let noise_m2ps2 = ground.sigma_mps.powi(2) + speed2 * yaw_m2 + sigma_mps * sigma_mps;
        self.current.learn(t_ns, [over[0] - through[0], over[1] - through[1]], noise_m2ps2);
    }

    fn odometry(&mut self, t_ns: i64, moved_m: Plane, yaw_change_rad: f64, covariance: &[f64; 6]) -> Taken {
        let last = self.odometry.take();
        if last.is_some_and(|last| !self.heading.heard_since(last.t_ns)) {
            self.heading.turned_by(t_ns, yaw_change_rad, covariance[5]);
        }
        let Some((yaw_rad, _)) = self.heading_at(t_ns) else { return Taken::Noted };
        self.odometry = Some(OdometryRecord { t_ns, yaw_rad, reckoned_m: [0.0; 2] });
        let Some(last) = last else { return Taken::Noted };
        let interval_s = seconds(t_ns.saturating_sub(last.t_ns));
        if interval_s <= 0.0 || interval_s > ODOMETRY_APART_S {
            return Taken::Noted;
        }
        // A DVL of its own is fresher.
        if self.ground.is_some_and(|lock| !lock.by_odometry && self.fresh(&lock, t_ns)) {
            return Taken::Noted;
        }
        // At the start of the interval the body frame was another one.
        let body_mps = turned([moved_m[0] / interval_s, moved_m[1] / interval_s], -yaw_change_rad);
        let sigma_mps = (0.5 * (covariance[0] + covariance[3])).sqrt() / interval_s;
        if !usable(body_mps, sigma_mps) {
            return Taken::Gated;
        }
        let continued = self.ground.is_some_and(|lock| self.fresh(&lock, t_ns));
        self.ground = Some(Lock { t_ns, body_mps, sigma_mps, interval_s, by_odometry: true });
        if !continued {
            return Taken::Used;
        }
        let moved = turned(moved_m, last.yaw_rad);
        Taken::Shifted([moved[0] - last.reckoned_m[0], moved[1] - last.reckoned_m[1]])
    }

    /// The position moved by `step_m` with the velocity in force.
    pub fn moved(&mut self, step_m: Plane) {
        if let Some(odometry) = &mut self.odometry {
            odometry.reckoned_m[0] += step_m[0];
            odometry.reckoned_m[1] += step_m[1];
        }
    }

    /// Until when a reading holds.
    fn holds_until(&self, lock: &Lock) -> i64 {
        let hold_s =
            if lock.by_odometry { self.errors.hold_s.max(1.5 * lock.interval_s) } else { self.errors.hold_s };
        lock.t_ns.saturating_add((hold_s * 1e9) as i64)
    }

    fn fresh(&self, lock: &Lock, t_ns: i64) -> bool {
        t_ns < self.holds_until(lock)
    }

    /// Yaw and its variance; the direction of the command where no sensor tells one.
    fn heading_at(&self, t_ns: i64) -> Option<(f64, f64)> {
        let commanded = || {
            let [e, n] = self.command_mps.filter(|[e, n]| e.hypot(*n) > LEAST_SPEED_MPS)?;
            Some((n.atan2(e), 0.0))
        };
        if self.heading.is_known() { self.heading.at(t_ns) } else { commanded() }
    }

    /// World velocity through the water and its sigma, m/s.
    fn through_water(&self, t_ns: i64) -> Option<(Plane, f64)> {
        if let (Some(lock), Some((yaw_rad, _))) = (self.water_lock(t_ns), self.heading_at(t_ns)) {
            return Some((turned(lock.body_mps, yaw_rad), lock.sigma_mps));
        }
        self.command_mps.map(|velocity_mps| (velocity_mps, HELD_SIGMA_MPS))
    }

    fn water_lock(&self, t_ns: i64) -> Option<&Lock> {
        self.water.as_ref().filter(|lock| self.fresh(lock, t_ns))
    }

    /// When, up to `t_ns`, what is in force ends to hold.
    #[must_use]
    pub fn ends_before(&self, t_ns: i64) -> Option<i64> {
        let lock = match self.source {
            Source::Ground => self.ground.as_ref(),
            Source::WaterLock => self.water.as_ref(),
            Source::Command | Source::Held => None,
        };
        lock.map(|lock| self.holds_until(lock)).filter(|end_ns| *end_ns <= t_ns)
    }

    fn best(&self, t_ns: i64) -> Source {
        let heading = self.heading_at(t_ns).is_some();
        if heading && self.ground.is_some_and(|lock| self.fresh(&lock, t_ns)) {
            Source::Ground
        } else if heading && self.water_lock(t_ns).is_some() {
            Source::WaterLock
        } else if self.command_mps.is_some() || self.ground.is_none() {
            Source::Command
        } else {
            Source::Held
        }
    }

    /// Puts in force what the sensors say at `t_ns`, and gives the navigator's error states the meaning that goes with it.
    ///
    /// By how much, m²/s² on each axis, the error may be larger than other copies of these states have it.
    pub fn follow(&mut self, t_ns: i64, states: &mut impl VelocityError) -> Option<f64> {
        let (before, next) = (self.source, self.best(t_ns));
        self.source = next;
        let mut widened = None;
        match (before, next) {
            (Source::Ground, Source::Ground) => {}
            (_, Source::Ground) => {
                let (mean, covariance) = states.moments();
                if before != Source::Held {
                    let offset = self.offset_mps;
                    self.current.set(t_ns, [offset[0] + mean[0], offset[1] + mean[1]], covariance);
                }
                self.body.start();
            }
            (Source::Ground, Source::Held) => {
                let (_, [ee, en, nn]) = states.moments();
                let speed = self.velocity_mps[0].hypot(self.velocity_mps[1]);
                let more = (HELD_SIGMA_MPS + HELD_SHARE * speed).powi(2);
                states.reset([0.0; 2], [ee + more, en, nn + more], self.current.thrust_sigma_mps());
                widened = Some(more);
            }
            (Source::Ground, _) => {
                let (_, error) = states.moments();
                self.body.keep(states.moments());
                let (mean, covariance) = self.current.at(t_ns, error, next == Source::Command);
                self.offset_mps = mean;
                states.reset([0.0; 2], covariance, self.current.thrust_sigma_mps());
                widened = Some(0.5 * (covariance[0] + covariance[2]));
            }
            _ => {}
        }
        self.put_in_force(t_ns, states);
        widened
    }

    fn put_in_force(&mut self, t_ns: i64, states: &mut impl VelocityError) {
        match self.source {
            Source::Ground => {
                let (Some(lock), Some((yaw_rad, _))) = (self.ground, self.heading_at(t_ns)) else { return };
                self.velocity_mps = turned(lock.body_mps, yaw_rad);
                self.body.follow(self.velocity_mps, states);
            }
            Source::WaterLock | Source::Command => {
                let through = self.through_water(t_ns).map_or([0.0; 2], |(through, _)| through);
                self.velocity_mps = [through[0] + self.offset_mps[0], through[1] + self.offset_mps[1]];
            }
            Source::Held => {}
        }
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

fn usable([forward, left]: Plane, sigma_mps: f64) -> bool {
    forward.hypot(left) <= GROUND_SPEED_MAX_MPS && sigma_mps <= USELESS_SIGMA_MPS
}

/// From the body frame into the world's.
fn turned([forward, left]: Plane, yaw_rad: f64) -> Plane {
    let (sin, cos) = yaw_rad.sin_cos();
    [cos * forward - sin * left, sin * forward + cos * left]
}
