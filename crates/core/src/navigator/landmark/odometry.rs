//! Ground velocity and yaw rate, pre-integrated between positionings.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Rotation2, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::event::seconds;

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
}

/// How far back positionings may reach, ns.
const MEMORY_NS: i64 = 20_000_000_000;

/// The vehicle's clock and odometry.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Odometer {
    now_ns: Option<i64>,
    rates: Rates,
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
        let Some(now_ns) = self.now_ns.replace(t_ns) else { return };
        if t_ns <= now_ns || self.landed {
            return;
        }
        self.since.extend(&self.rates, seconds(t_ns.saturating_sub(now_ns)));
        self.remember(Stretch { start_ns: now_ns, end_ns: t_ns, rates: self.rates });
    }

    fn remember(&mut self, stretch: Stretch) {
        self.recent.push_back(stretch);
        while self.recent.front().is_some_and(|s| s.end_ns < stretch.end_ns.saturating_sub(MEMORY_NS)) {
            self.recent.pop_front();
        }
    }

    /// A DVL reading; one of a landed vehicle is of the ground it stands on.
    pub fn velocity(&mut self, velocity_mps: [f64; 2], sigma_mps: f64) {
        if !self.landed {
            self.rates.velocity_mps = velocity_mps;
            self.rates.sigma_mps = sigma_mps;
            self.afloat = true;
        }
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
        self.afloat = true;
        self.since.extend(&rates, dt_s);
        self.remember(Stretch { start_ns, end_ns: now_ns, rates });
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
                motion.extend(&stretch.rates, seconds(stretch.end_ns.saturating_sub(start_ns)));
            }
        }
        motion
    }
}
