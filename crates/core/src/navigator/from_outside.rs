//! What fixed stations tell a vehicle: positions by an ultra-short baseline, which come late, and ranges to beacons.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::Outcome;
use super::clock::ClockOptions;
use super::particle_core::ParticleCore;
use super::radio::{BroadcastBelief, HeardBelief, SLANT_GATES};
use super::range::{RangeMethod, RangeOptions};
use crate::event::{Payload, seconds};
use crate::kernels::likelihood::RangeBelief;
use crate::link::slant_to_horizontal;
use crate::measurement::range;
use crate::packet::Belief;

/// Ranges to beacons are gated as far off as those to teammates, unless the options say otherwise.
const GATE_SIGMAS: f64 = 6.0;
/// For the clocks of beacons where no team has agreed on a sound speed, m/s.
const SOUND_SPEED_MPS: f64 = 1500.0;

/// What ranges to beacons may have beside their stated noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BeaconOptions {
    /// Of the own clock against the beacons', which agree with each other.
    pub clock: ClockOptions,
    /// Ranges further off than this many standard deviations are gated.
    pub gate_sigmas: f64,
    /// m/s.
    pub sound_speed_mps: f64,
}

impl Default for BeaconOptions {
    fn default() -> Self {
        Self { clock: ClockOptions::NONE, gate_sigmas: GATE_SIGMAS, sound_speed_mps: SOUND_SPEED_MPS }
    }
}

impl BeaconOptions {
    /// As ranges to teammates have it.
    #[must_use]
    pub fn of(clock: ClockOptions, gate_sigmas: f64, sound_speed_mps: f64) -> Self {
        Self {
            clock,
            gate_sigmas: if gate_sigmas.is_finite() { gate_sigmas } else { GATE_SIGMAS },
            sound_speed_mps,
        }
    }
}

/// What a particle core keeps of the stations.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Stations {
    /// Of ranges to beacons.
    pub options: BeaconOptions,
    /// The vehicle's own depth below the surface, as last told, m.
    pub depth_m: Option<f64>,
}

/// A range to a beacon as one to a place that is known exactly.
pub struct SeenBeacon {
    measured_ns: i64,
    place_m: [f64; 2],
    horizontal_m: f64,
    options: RangeOptions,
}

impl SeenBeacon {
    /// Where the vehicle has moved by `moved_m` since: the range as one of now, and its power.
    #[must_use]
    pub fn belief(&self, moved_m: [f64; 2]) -> (RangeBelief, f64) {
        let mean_m = [self.place_m[0] + moved_m[0], self.place_m[1] + moved_m[1]];
        let (range_m, sigma_m) = (self.horizontal_m, self.options.sigma_m);
        let belief = RangeBelief { mean_m, covariance_m2: [0.0; 3], range_m, sigma_m };
        let RangeMethod::Gaussian { temper } = self.options.method else { return (belief, 1.0) };
        (belief, temper)
    }

    /// When it was measured, ns.
    #[must_use]
    pub fn measured_ns(&self) -> i64 {
        self.measured_ns
    }
}

/// Share of a range that counts, beside an error of variance `standing_m2` that is the same in the next one.
///
/// Ranges whose common error is not estimated never make the position along them, which was known to `position_m2`, better
/// known than that error: a Gaussian likelihood of variance V = noise + standing is taken to the power that leaves
/// max(P V / (P + V), S).
fn share_beside(position_m2: f64, noise_m2: f64, standing_m2: f64) -> f64 {
    let whole_m2 = noise_m2 + standing_m2;
    let told_m2 = (position_m2 * whole_m2 / (position_m2 + whole_m2)).max(standing_m2);
    (whole_m2 * (1.0 / told_m2 - 1.0 / position_m2)).clamp(LEAST_SHARE, 1.0)
}

/// No clock against the beacons' is estimated: one-way ranges whose standing error may be larger than this and than their
/// noise are gated, because a vehicle that passes a beacon would take it for a current. m².
const MOST_STANDING_M2: f64 = 1.0;
/// A likelihood to this power changes nothing.
const LEAST_SHARE: f64 = 1e-9;

impl<const K: usize> ParticleCore<K> {
    /// A position that was measured at `measured_ns` as one of now: moved along, and less certain by what the drift may
    /// have done since. `None` where the core does not remember that time.
    #[must_use]
    pub fn brought_forward(
        &self,
        measured_ns: i64,
        position_m: [f64; 2],
        [ee, en, nn]: [f64; 3],
    ) -> Option<([f64; 2], [f64; 3])> {
        let moved = self.displacement_since(measured_ns)?;
        let age_s = seconds(self.now_ns()?.saturating_sub(measured_ns)).max(0.0);
        let (mean, _) = self.cloud.position_moments();
        let (_, _, drift) = self.drift_ahead(mean, age_s);
        let walk = self.drift_in_force.position_walk(age_s);
        Some((
            [position_m[0] + moved[0], position_m[1] + moved[1]],
            [ee + drift[(0, 0)] + walk[0], en + drift[(0, 1)] + walk[1], nn + drift[(1, 1)] + walk[2]],
        ))
    }

    /// A range to a beacon, horizontal and with all that its variance holds. `Err` with what becomes of one that cannot be
    /// used: `Noted` before a start or without a depth of the own, `Gated` where it is shorter than the depths differ, or one-way by
    /// a clock that is known too little.
    pub fn seen_beacon(&mut self, payload: &Payload) -> Result<SeenBeacon, Outcome> {
        let options = self.stations.options;
        let Payload::BeaconRange { measured_ns, beacon_m, beacon_depth_m, range_m, sigma_m, one_way } =
            *payload
        else {
            return Err(Outcome::Noted);
        };
        let (true, Some(depth_m)) = (self.started(), self.stations.depth_m) else {
            return Err(Outcome::Noted);
        };
        if !self.remembers(measured_ns) {
            self.rejected += 1;
            return Err(Outcome::Rejected);
        }
        let noise_m2 = (sigma_m * sigma_m).max(1e-4);
        let Ok(horizontal) =
            slant_to_horizontal(range_m, depth_m, beacon_depth_m, noise_m2.sqrt(), SLANT_GATES)
        else {
            self.rejected += 1;
            return Err(Outcome::Gated);
        };
        // d h / d r = r / h: nearly above a beacon, a range tells little of the horizontal distance.
        let steep = range_m / horizontal.range_m.max(noise_m2.sqrt());
        let noise_m2 = noise_m2 * (steep * steep).max(1.0);
        let clock = options.clock;
        let standing_m2 = if one_way {
            clock.standing_m2(options.sound_speed_mps, range_m, seconds(measured_ns))
        } else {
            (clock.scale_sigma(options.sound_speed_mps) * range_m).powi(2)
        };
        if standing_m2 > noise_m2.max(MOST_STANDING_M2) {
            self.rejected += 1;
            return Err(Outcome::Gated);
        }
        let (mean, covariance) = self.cloud.position_moments();
        let relative = [mean[0] - beacon_m[0], mean[1] - beacon_m[1]];
        let direction = range::expected(relative, [0.0; 3]).direction;
        let share = share_beside(range::along(direction, covariance), noise_m2, standing_m2);
        Ok(SeenBeacon {
            measured_ns,
            place_m: beacon_m,
            horizontal_m: horizontal.range_m,
            options: RangeOptions {
                method: RangeMethod::Gaussian { temper: share },
                sigma_m: (noise_m2 + standing_m2).sqrt(),
                gate_sigmas: options.gate_sigmas,
                entropy_sigma_m: None,
                clock,
            },
        })
    }

    /// Fixes of an ultra-short baseline and ranges to beacons, up to the weights.
    pub fn station(&mut self, payload: &Payload) -> Outcome {
        if let Payload::Usbl { measured_ns, position_m, covariance_m2 } = *payload {
            let Some((position_m, covariance_m2)) =
                self.brought_forward(measured_ns, position_m, covariance_m2)
            else {
                self.rejected += 1;
                return Outcome::Rejected;
            };
            return self.fix(position_m, covariance_m2);
        }
        match self.seen_beacon(payload) {
            Ok(seen) => self.beacon(&seen),
            Err(outcome) => outcome,
        }
    }

    /// Weighs the particles by a range to a beacon; resampling is left to the caller.
    pub fn beacon(&mut self, seen: &SeenBeacon) -> Outcome {
        let place = Belief { mean_m: Vector2::from(seen.place_m), covariance_m2: Matrix2::zeros() };
        let heard = HeardBelief {
            belief: BroadcastBelief::Gaussian(place),
            range_m: seen.horizontal_m,
            depth_rounding_m2: 0.0,
        };
        self.range(&heard, seen.measured_ns, &seen.options)
    }
}

#[cfg(test)]
mod tests {
    use super::share_beside;

    #[test]
    fn a_position_is_never_known_better_than_the_standing_error_of_its_ranges() {
        let mut position_m2 = 900.0;
        for _ in 0..1000 {
            let share = share_beside(position_m2, 1.0, 25.0);
            assert!((0.0..=1.0).contains(&share));
            position_m2 = 1.0 / (1.0 / position_m2 + share / 26.0);
            assert!(position_m2 >= 25.0 - 1e-3, "{position_m2}");
        }
        assert!(position_m2 < 25.1);
        for position_m2 in [1e-3, 1.0, 1e6] {
            assert!(
                (share_beside(position_m2, 4.0, 0.0) - 1.0).abs() < 1e-9,
                "without one, each counts in full"
            );
        }
    }
}
