//! Which velocity is in force, and what the error states of a navigator mean with it.

use super::readings::turned;
use super::{FrontEnd, HELD_SIGMA_MPS, Source, VelocityError};

/// Without anything that tells the velocity it is wrong by such a share of it.
const HELD_SHARE: f64 = 0.2;
impl FrontEnd {
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
}
