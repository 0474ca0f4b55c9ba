//! Yaw from a compass, and from a gyro between its readings: a Kalman filter of one state.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use crate::event::seconds;

/// A yaw rate holds for so long after its reading, s.
const RATE_HOLDS_S: f64 = 2.0;
/// Walk of the yaw with a gyro and without, rad/√s.
const WALK_WITH_GYRO: f64 = 0.003;
const WALK_WITHOUT: f64 = 0.1;
/// A yaw of a larger variance is none, rad².
const USELESS_RAD2: f64 = 0.1;
/// Readings that hold longer than this do not make the noise slower, s.
const LONGEST_INTERVAL_S: f64 = 5.0;

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Rate {
    t_ns: i64,
    radps: f64,
    sigma_radps: f64,
}

/// The filter.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct HeadingFilter {
    t_ns: i64,
    /// Yaw and its variance; none before the first reading of a compass.
    yaw: Option<(f64, f64)>,
    rate: Option<Rate>,
    /// Of the compass: its last reading, variance and the time between its last two.
    read_ns: i64,
    read_m2: f64,
    interval_s: f64,
    /// The last reading of compass or gyro.
    heard_ns: Option<i64>,
}

/// To within half a turn of zero.
fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

impl HeadingFilter {
    /// Whether a compass has spoken.
    pub fn is_known(&self) -> bool {
        self.yaw.is_some()
    }

    /// Whether compass or gyro spoke after `t_ns`.
    pub fn heard_since(&self, t_ns: i64) -> bool {
        self.heard_ns.is_some_and(|heard_ns| heard_ns > t_ns)
    }

    fn predicted(&self, t_ns: i64) -> Option<(f64, f64)> {
        let (yaw_rad, variance) = self.yaw?;
        let dt_s = seconds(t_ns.saturating_sub(self.t_ns)).max(0.0);
        let fresh = |rate: &Rate| seconds(t_ns.saturating_sub(rate.t_ns)) <= RATE_HOLDS_S;
        let Some(rate) = self.rate.filter(fresh) else {
            return Some((yaw_rad, variance + WALK_WITHOUT.powi(2) * dt_s));
        };
        let walk2 = WALK_WITH_GYRO.powi(2) + rate.sigma_radps.powi(2) * dt_s;
        Some((wrapped(yaw_rad + rate.radps * dt_s), variance + walk2 * dt_s))
    }

    /// A reading of the compass.
    pub fn heading(&mut self, t_ns: i64, yaw_rad: f64, sigma_rad: f64) {
        let noise = sigma_rad.powi(2).max(1e-8);
        let updated = match self.predicted(t_ns) {
            None => (wrapped(yaw_rad), noise),
            Some((before, variance)) => {
                let gain = variance / (variance + noise);
                (wrapped(before + gain * wrapped(yaw_rad - before)), (1.0 - gain) * variance)
            }
        };
        if self.yaw.is_some() {
            self.interval_s = seconds(t_ns.saturating_sub(self.read_ns)).clamp(0.0, LONGEST_INTERVAL_S);
        }
        (self.t_ns, self.yaw) = (t_ns, Some(updated));
        (self.read_ns, self.read_m2) = (t_ns, noise);
        self.heard_ns = Some(t_ns);
    }

    /// A reading of the gyro.
    pub fn turn_rate(&mut self, t_ns: i64, radps: f64, sigma_radps: f64) {
        self.yaw = self.predicted(t_ns);
        self.t_ns = t_ns;
        self.rate = Some(Rate { t_ns, radps, sigma_radps: sigma_radps.min(1.0) });
        self.heard_ns = Some(t_ns);
    }

    /// Odometry's turn since its last reading, where nothing else has told it.
    pub fn turned_by(&mut self, t_ns: i64, change_rad: f64, variance: f64) {
        if let Some((yaw_rad, before)) = self.yaw {
            self.yaw = Some((wrapped(yaw_rad + change_rad), before + variance.min(1e3)));
            self.t_ns = t_ns;
        }
    }

    /// Yaw and its variance at `t_ns`; none that is known too little.
    pub fn at(&self, t_ns: i64) -> Option<(f64, f64)> {
        self.predicted(t_ns).filter(|(_, variance)| *variance < USELESS_RAD2)
    }

    /// Variance that the noise of the compass adds to the integral of the yaw error, for each second, rad² s.
    pub fn white_m2_s(&self, t_ns: i64) -> f64 {
        let silent_s = seconds(t_ns.saturating_sub(self.read_ns)).clamp(0.0, LONGEST_INTERVAL_S);
        if self.yaw.is_some() { self.read_m2.min(USELESS_RAD2) * self.interval_s.max(silent_s) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn a_gyro_carries_the_yaw_between_readings_and_over_the_seam() {
        let mut filter = HeadingFilter::default();
        assert!(filter.at(0).is_none());
        filter.heading(0, 3.0, 0.02);
        filter.turn_rate(0, 0.2, 1e-3);
        let (yaw, variance) = filter.at(SECOND).unwrap();
        assert!((yaw - (3.2 - TAU)).abs() < 1e-12 && variance < 5e-4, "{yaw} {variance}");
        filter.heading(SECOND, 3.2, 0.02);
        assert!((filter.at(SECOND).unwrap().0 - (3.2 - TAU)).abs() < 1e-9);
        // The gyro falls silent, and the compass too.
        assert!(filter.at(2 * SECOND).is_some());
        assert!(filter.at(15 * SECOND).is_none());
    }

    #[test]
    fn noise_of_the_compass_averages_out_with_a_gyro() {
        let mut filter = HeadingFilter::default();
        for second in 0..200 {
            let noise = if second % 2 == 0 { 0.05 } else { -0.05 };
            filter.heading(second * SECOND, 1.0 + noise, 0.05);
            filter.turn_rate(second * SECOND, 0.0, 1e-3);
        }
        let (yaw, variance) = filter.at(199 * SECOND).unwrap();
        assert!((yaw - 1.0).abs() < 0.01 && variance < 4e-4, "{yaw} {variance}");
    }
}
