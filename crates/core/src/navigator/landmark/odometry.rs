//! Ground velocity and yaw rate, pre-integrated between positionings.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Rotation2, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::event::{GROUND_SPEED_MAX_MPS, seconds};

/// Motion since an instant, in the body frame of that instant, with its noise and what sensor biases would change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Increment {
    /// Duration, s.
    pub dt_s: f64,
    /// [forward, left], m.
    pub displacement_m: Vector2<f64>,
    /// rad, not wrapped.
    pub yaw_rad: f64,
    /// Covariance of (forward, left, yaw).
    pub covariance: Matrix3<f64>,
    /// Derivative of (forward, left, yaw) by (gyro bias, DVL scale, DVL misalignment).
    pub by_bias: Matrix3<f64>,
}

/// What the sensors say while nothing new arrives.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Rates {
    /// [forward, left], m/s.
    pub velocity_mps: [f64; 2],
    /// Per axis, m/s.
    pub sigma_mps: f64,
    /// rad/s.
    pub yaw_rate_radps: f64,
    /// rad/s.
    pub sigma_radps: f64,
}

impl Default for Increment {
    fn default() -> Self {
        Self {
            dt_s: 0.0,
            displacement_m: Vector2::zeros(),
            yaw_rad: 0.0,
            covariance: Matrix3::zeros(),
            by_bias: Matrix3::zeros(),
        }
    }
}

impl Increment {
    /// Goes on for `dt_s` at these rates: (5) and (7) in the frame of the increment's start.
    ///
    /// True velocity = (1 + scale) v + misalignment × v rotated by 90°; true yaw rate = measured − bias.
    pub fn extend(&mut self, rates: &Rates, dt_s: f64) {
        let turn = Rotation2::new(self.yaw_rad);
        let [forward, left] = rates.velocity_mps;
        let step = turn * Vector2::new(forward, left) * dt_s;
        let across = Vector2::new(-step.y, step.x);
        let mut transition = Matrix3::identity();
        transition[(0, 2)] = across.x;
        transition[(1, 2)] = across.y;
        let q = rates.sigma_mps * rates.sigma_mps * dt_s * dt_s;
        let w = rates.sigma_radps * rates.sigma_radps * dt_s * dt_s;
        self.covariance = transition * self.covariance * transition.transpose()
            + Matrix3::from_diagonal(&Vector3::new(q, q, w));
        self.by_bias = transition * self.by_bias
            + Matrix3::new(0.0, step.x, across.x, 0.0, step.y, across.y, -dt_s, 0.0, 0.0);
        self.displacement_m += step;
        self.yaw_rad += rates.yaw_rate_radps * dt_s;
        self.dt_s += dt_s;
    }

    /// Adds what the position's variance grew by per axis, m²; the same in any frame.
    pub fn drift(&mut self, variance_m2: f64) {
        self.covariance[(0, 0)] += variance_m2;
        self.covariance[(1, 1)] += variance_m2;
    }

    /// (displacement, yaw change) for these biases, to first order.
    #[must_use]
    pub fn corrected(&self, bias: &Vector3<f64>) -> (Vector2<f64>, f64) {
        let change = self.by_bias * bias;
        (self.displacement_m + change.fixed_rows::<2>(0), self.yaw_rad + change.z)
    }
}

/// A stretch of time at constant rates.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Stretch {
    start_ns: i64,
    end_ns: i64,
    rates: Rates,
    /// What the position's variance grew by, per axis, because the velocity was not measured any more, m².
    drift_m2: f64,
}

/// How far back positionings may reach, ns.
const MEMORY_NS: i64 = 20_000_000_000;

/// For so long a velocity holds, s: DVLs of 0.5 Hz and more are not told apart from continuous ones.
const VELOCITY_HELD_S: f64 = 2.0;
/// Spectral density of the acceleration per axis from then on, m²/s³: what `local-only` takes for a vehicle with a DVL.
const ACCELERATION_M2_PER_S3: f64 = 1e-2;

/// What the position's variance grows by per axis from `from_ns` to `to_ns`, with a velocity measured at `velocity_ns`
/// and held since, m².
///
/// The velocity walks away from the one held: `q a³ / 3` over an age `a` beyond what a reading holds for.
#[must_use]
pub fn held_velocity_drift_m2(velocity_ns: i64, from_ns: i64, to_ns: i64) -> f64 {
    let late_s = |t_ns: i64| (seconds(t_ns.saturating_sub(velocity_ns)) - VELOCITY_HELD_S).max(0.0);
    ACCELERATION_M2_PER_S3 / 3.0 * (late_s(to_ns).powi(3) - late_s(from_ns).powi(3))
}

/// The vehicle's clock and odometry.
///
/// A velocity is held until the next one; where that is late, [`held_velocity_drift_m2`] counts.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Odometer {
    now_ns: Option<i64>,
    rates: Rates,
    /// Since when the velocity in force holds, at first 0 m/s; none for a vehicle whose odometry another system sums up.
    velocity_ns: Option<i64>,
    landed: bool,
    /// Whether it was ever off the ground with its sensors on.
    afloat: bool,
    since: Increment,
    recent: VecDeque<Stretch>,
    last_odometry_ns: Option<i64>,
}

impl Odometer {
    /// Time advanced to.
    #[must_use]
    pub fn now_ns(&self) -> Option<i64> {
        self.now_ns
    }

    /// Whether the vehicle stands on the seabed.
    #[must_use]
    pub fn landed(&self) -> bool {
        self.landed
    }

    /// Goes on to `t_ns`.
    pub fn advance(&mut self, t_ns: i64) {
        let Some(now_ns) = self.now_ns.replace(t_ns) else {
            self.velocity_ns = Some(t_ns);
            return;
        };
        if t_ns <= now_ns || self.landed {
            return;
        }
        let drift_m2 = self.drift_m2(now_ns, t_ns);
        self.since.extend(&self.rates, seconds(t_ns.saturating_sub(now_ns)));
        self.since.drift(drift_m2);
        self.remember(Stretch { start_ns: now_ns, end_ns: t_ns, rates: self.rates, drift_m2 });
    }

    /// What the position's variance grows by between two instants, per axis, with a velocity that nobody measures, m².
    fn drift_m2(&self, from_ns: i64, to_ns: i64) -> f64 {
        self.velocity_ns.map_or(0.0, |velocity_ns| held_velocity_drift_m2(velocity_ns, from_ns, to_ns))
    }

    fn remember(&mut self, stretch: Stretch) {
        self.recent.push_back(stretch);
        while self.recent.front().is_some_and(|s| s.end_ns < stretch.end_ns.saturating_sub(MEMORY_NS)) {
            self.recent.pop_front();
        }
    }

    /// A DVL reading; one of a landed vehicle is of the ground it stands on. False: faster than any vehicle, as a DVL
    /// without bottom track writes (-32.768 m/s); nothing changes.
    pub fn velocity(&mut self, velocity_mps: [f64; 2], sigma_mps: f64) -> bool {
        if velocity_mps[0].hypot(velocity_mps[1]) > GROUND_SPEED_MAX_MPS {
            return false;
        }
        if !self.landed {
            self.rates.velocity_mps = velocity_mps;
            self.rates.sigma_mps = sigma_mps;
            self.velocity_ns = self.now_ns;
            self.afloat = true;
        }
        true
    }

    /// A gyro reading.
    pub fn yaw_rate(&mut self, yaw_rate_radps: f64, sigma_radps: f64) {
        if !self.landed {
            self.rates.yaw_rate_radps = yaw_rate_radps;
            self.rates.sigma_radps = sigma_radps;
        }
    }

    /// Odometry since the last one, as logged by another system; the time between has no rates of its own.
    pub fn odometry(&mut self, displacement_m: [f64; 2], yaw_change_rad: f64, covariance: [f64; 6]) {
        let (Some(now_ns), false) = (self.now_ns, self.landed) else { return };
        let start_ns = self.last_odometry_ns.replace(now_ns).unwrap_or(now_ns.saturating_sub(1));
        let dt_s = seconds(now_ns.saturating_sub(start_ns)).max(1e-9);
        let rates = Rates {
            velocity_mps: displacement_m.map(|d| d / dt_s),
            sigma_mps: (0.5 * (covariance[0] + covariance[3])).sqrt() / dt_s,
            yaw_rate_radps: yaw_change_rad / dt_s,
            sigma_radps: covariance[5].sqrt() / dt_s,
        };
        self.rates = Rates::default();
        self.velocity_ns = None;
        self.afloat = true;
        self.since.extend(&rates, dt_s);
        self.remember(Stretch { start_ns, end_ns: now_ns, rates, drift_m2: 0.0 });
    }

    /// Landing: true if the vehicle had been afloat.
    pub fn land(&mut self) -> bool {
        let was_afloat = self.afloat && !self.landed;
        self.landed = true;
        self.afloat = false;
        self.rates.velocity_mps = [0.0; 2];
        self.rates.yaw_rate_radps = 0.0;
        was_afloat
    }

    /// Lifting off.
    pub fn lift_off(&mut self) {
        self.landed = false;
        self.afloat = true;
        // It stood still until now, which was as good as a reading.
        self.velocity_ns = self.velocity_ns.and(self.now_ns);
    }

    /// Motion since the last call, which then starts anew.
    pub fn take(&mut self) -> Increment {
        std::mem::take(&mut self.since)
    }

    /// Motion since the last [`Odometer::take`], foreseen to `t_ns` at the rates in force.
    #[must_use]
    pub fn ahead(&self, t_ns: i64) -> Increment {
        let mut since = self.since;
        if let Some(now_ns) = self.now_ns
            && t_ns > now_ns
            && !self.landed
        {
            since.extend(&self.rates, seconds(t_ns.saturating_sub(now_ns)));
            since.drift(self.drift_m2(now_ns, t_ns));
        }
        since
    }

    /// Motion from `from_ns` to now; none where that is longer ago than is remembered.
    #[must_use]
    pub fn since_ns(&self, from_ns: i64) -> Increment {
        let mut motion = Increment::default();
        for stretch in &self.recent {
            let start_ns = stretch.start_ns.max(from_ns);
            if stretch.end_ns > start_ns {
                let lasted_s = seconds(stretch.end_ns.saturating_sub(start_ns));
                motion.extend(&stretch.rates, lasted_s);
                let share = lasted_s / seconds(stretch.end_ns.saturating_sub(stretch.start_ns));
                motion.drift(stretch.drift_m2 * share);
            }
        }
        motion
    }
}
