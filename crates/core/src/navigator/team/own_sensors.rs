//! What the own sensors say: the own particles move, fixes and soundings weigh them and go into the next packet.

use super::Team;
use super::shared_current::SharedCurrent;
use crate::event::{Payload, seconds};
use crate::navigator::{Outcome, Status};

impl<const K: usize> Team<K> {
    /// The own particles make a step, and so do the records that depend on it.
    pub(super) fn advance(&mut self, t_ns: i64) {
        let Some(before_ns) = self.terrain.state.core.now_ns().filter(|now_ns| *now_ns < t_ns) else {
            self.terrain.advance(t_ns);
            return;
        };
        let covariance = self.terrain.state.core.covariance;
        if let Some(current) = &mut self.state.current {
            current.before(&self.terrain.state.core.cloud.linear);
        }
        let step = self.terrain.advance(t_ns);
        let core = &self.terrain.state.core;
        if let Some(current) = &mut self.state.current {
            let dt_s = seconds(t_ns.saturating_sub(before_ns));
            current.after(&core.cloud.linear, &covariance, step.as_ref(), dt_s);
        }
        if step.is_some() && self.options.use_ranges && !self.terrain.acquiring() {
            self.state.history.remember(t_ns, &core.cloud.east, &core.cloud.north);
        }
    }

    /// Share of a teammate's current that is its own.
    pub(super) fn current_difference(&self) -> f64 {
        if self.state.current.is_some() { self.options.current_difference.min(1.0) } else { 1.0 }
    }

    /// What says something of the motion.
    pub(super) fn motion(&mut self, t_ns: i64, payload: &Payload) -> Outcome {
        let (outcome, shift) = self.terrain.take_motion(t_ns, payload);
        if let Some(by_m) = shift {
            self.state.outgoing.shift(by_m);
        }
        if self.terrain.state.core.over_ground() {
            // The error of a DVL is no current that teammates could share.
            self.state.current_given_up |= self.state.current.take().is_some();
        }
        outcome
    }

    /// What a fixed station tells. A position goes into the next packet as a fix does, a range to a beacon does not.
    pub(super) fn station(&mut self, t_ns: i64, payload: &Payload) -> Outcome {
        if let Payload::Usbl { measured_ns, position_m, covariance_m2 } = *payload {
            let core = &mut self.terrain.state.core;
            let Some((position_m, covariance_m2)) =
                core.brought_forward(measured_ns, position_m, covariance_m2)
            else {
                core.rejected += 1;
                return Outcome::Rejected;
            };
            return self.fix(t_ns, position_m, covariance_m2);
        }
        let outcome = self.terrain.weigh_station(payload);
        self.resample();
        outcome
    }

    pub(super) fn fix(&mut self, t_ns: i64, position_m: [f64; 2], covariance_m2: [f64; 3]) -> Outcome {
        let restarts = self.terrain.state.core.restarts;
        let acquiring = self.terrain.acquiring();
        let outcome = self.terrain.weigh_fix(position_m, covariance_m2);
        // Nobody is told of a start before it is found.
        if outcome == Outcome::Fused && !self.terrain.acquiring() {
            self.state.outgoing.fix(t_ns, position_m, covariance_m2);
        }
        if acquiring && !self.terrain.acquiring() {
            self.found(t_ns);
        }
        if self.terrain.state.core.restarts != restarts {
            self.forget();
            self.state.history.clear();
        }
        self.resample();
        outcome
    }

    pub(super) fn sounding(&mut self, t_ns: i64, water_depth_m: f64, sigma_m: f64) -> Outcome {
        // What is no sounding of this seabed is not broadcast either.
        if self.terrain.possible(water_depth_m, sigma_m) {
            self.state.outgoing.sounding(t_ns, water_depth_m);
        }
        self.state.sigma_sounding_m = Some(sigma_m);
        let acquiring = self.terrain.acquiring();
        let (outcome, health) = self.terrain.weigh_sounding(water_depth_m, sigma_m);
        if acquiring && !self.terrain.acquiring() {
            self.found(t_ns);
        }
        if let Some(statistic) = health {
            self.remember_own();
            if self.terrain.watch(statistic) {
                self.move_past();
                self.forget();
            } else {
                self.resample();
            }
        }
        self.judge();
        outcome
    }

    /// The search for the own position has ended: the particles are others than before, and what was found is a start.
    fn found(&mut self, t_ns: i64) {
        self.forget();
        self.state.history.clear();
        if let Some(current) = &mut self.state.current {
            *current = SharedCurrent::new(self.options.terrain.particles, self.state.mates.len());
        }
        let found = self.terrain.state.core.status == Status::Navigating;
        if found && !self.state.outgoing.started() {
            let (mean, covariance) = self.terrain.state.core.cloud.position_moments();
            self.state.outgoing.fix(t_ns, mean, covariance);
        }
    }
}
