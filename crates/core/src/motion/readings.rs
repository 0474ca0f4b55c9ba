//! What the sensors say: readings that contradict what came before are refused, the others kept until they are too old.

use super::{FrontEnd, HELD_SIGMA_MPS, LEAST_SPEED_MPS, Lock, OdometryRecord, Plane, Taken};
use crate::event::{GROUND_SPEED_MAX_MPS, Payload, seconds};

/// A sigma above this is no velocity, m/s.
const USELESS_SIGMA_MPS: f64 = 5.0;
/// A velocity of a lock changes by no more than this between two readings a second apart, m/s …
const SURPRISE_MPS: f64 = 1.0;
/// … and this many sigmas; so many in a row that do are believed.
const SURPRISE_SIGMAS: f64 = 6.0;
const SURPRISES_BELIEVED: u32 = 3;
/// Odometry further apart than this is none, s.
const ODOMETRY_APART_S: f64 = 60.0;

impl FrontEnd {
    /// Takes up an event; [`follow`](Self::follow) puts in force what follows from it.
    pub fn take(&mut self, t_ns: i64, payload: &Payload) -> Taken {
        match payload {
            Payload::Motion { velocity_mps } => {
                self.command_mps = Some(*velocity_mps);
                self.held.renew(t_ns, *velocity_mps);
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
    pub(super) fn holds_until(&self, lock: &Lock) -> i64 {
        let hold_s =
            if lock.by_odometry { self.errors.hold_s.max(1.5 * lock.interval_s) } else { self.errors.hold_s };
        lock.t_ns.saturating_add((hold_s * 1e9) as i64)
    }

    pub(super) fn fresh(&self, lock: &Lock, t_ns: i64) -> bool {
        t_ns < self.holds_until(lock)
    }

    /// Yaw and its variance; the direction of the command where no sensor tells one.
    pub(super) fn heading_at(&self, t_ns: i64) -> Option<(f64, f64)> {
        let commanded = || {
            let [e, n] = self.command_mps.filter(|[e, n]| e.hypot(*n) > LEAST_SPEED_MPS)?;
            Some((n.atan2(e), 0.0))
        };
        if self.heading.is_known() { self.heading.at(t_ns) } else { commanded() }
    }

    /// World velocity through the water and its sigma, m/s.
    pub(super) fn through_water(&self, t_ns: i64) -> Option<(Plane, f64)> {
        if let (Some(lock), Some((yaw_rad, _))) = (self.water_lock(t_ns), self.heading_at(t_ns)) {
            return Some((turned(lock.body_mps, yaw_rad), lock.sigma_mps));
        }
        self.command_mps.map(|velocity_mps| (velocity_mps, HELD_SIGMA_MPS))
    }

    pub(super) fn water_lock(&self, t_ns: i64) -> Option<&Lock> {
        self.water.as_ref().filter(|lock| self.fresh(lock, t_ns))
    }
}

fn usable([forward, left]: Plane, sigma_mps: f64) -> bool {
    forward.hypot(left) <= GROUND_SPEED_MAX_MPS && sigma_mps <= USELESS_SIGMA_MPS
}

/// From the body frame into the world's.
pub(super) fn turned([forward, left]: Plane, yaw_rad: f64) -> Plane {
    let (sin, cos) = yaw_rad.sin_cos();
    [cos * forward - sin * left, sin * forward + cos * left]
}
