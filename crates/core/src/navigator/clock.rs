//! What may be wrong with one-way ranges: clocks that differ, a sound speed that is off, arrivals that come late.

use serde::{Deserialize, Serialize};

use crate::error::{Error, non_negative, positive};
use crate::measurement::range::{FLOOR_PER_M, LateArrivals};

/// Walk of a clock difference beside its drift, m/√s: what temperature does to a crystal in a quarter of an hour is 0.3 m.
const CLOCK_WALK_M_PER_SQRT_S: f64 = 0.01;

/// Priors of clocks and sound speed, and the share of late arrivals; all zero: ranges are Gaussian about the distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockOptions {
    /// Standard deviation of one vehicle's clock error at the start of the mission, s.
    pub offset_sigma_s: f64,
    /// Standard deviation of its drift, millionths.
    pub drift_sigma_ppm: f64,
    /// Standard deviation of the sound speed's error, m/s.
    pub sound_speed_sigma_mps: f64,
    /// Share of ranges that come late by a longer way.
    pub late_share: f64,
    /// Mean lateness of those, m.
    pub lateness_m: f64,
}

impl Default for ClockOptions {
    fn default() -> Self {
        Self::NONE
    }
}

/// Prior of a clock difference as a range: variances of β (m²) and β̇ ((m/s)²), and their covariance.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClockPrior {
    /// Of β, m².
    pub difference_m2: f64,
    /// Of β̇, (m/s)².
    pub rate_m2_per_s2: f64,
    /// Of both, m²/s.
    pub coupled_m2_per_s: f64,
}

impl ClockOptions {
    /// Nothing is wrong with ranges but their noise.
    pub const NONE: Self = Self {
        offset_sigma_s: 0.0,
        drift_sigma_ppm: 0.0,
        sound_speed_sigma_mps: 0.0,
        late_share: 0.0,
        lateness_m: 20.0,
    };

    /// Refuses what is not finite or outside its bounds.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        non_negative("clock.offset_sigma_s", self.offset_sigma_s)?;
        non_negative("clock.drift_sigma_ppm", self.drift_sigma_ppm)?;
        non_negative("clock.sound_speed_sigma_mps", self.sound_speed_sigma_mps)?;
        positive("clock.lateness_m", self.lateness_m)?;
        if !(0.0..=0.9).contains(&self.late_share) {
            let value = self.late_share;
            return Err(Error::OutOfBound { quantity: "clock.late_share", value, bound: "0 to 0.9" });
        }
        Ok(())
    }

    /// Whether clocks may differ at all.
    #[must_use]
    pub fn differ(&self) -> bool {
        self.offset_sigma_s > 0.0 || self.drift_sigma_ppm > 0.0
    }

    /// Prior of the difference of two such clocks, `elapsed_s` after the start of the mission.
    #[must_use]
    pub fn prior(&self, sound_speed_mps: f64, elapsed_s: f64) -> ClockPrior {
        let c2 = 2.0 * sound_speed_mps * sound_speed_mps;
        let rate = c2 * (self.drift_sigma_ppm * 1e-6).powi(2);
        let t = elapsed_s.max(0.0);
        ClockPrior {
            difference_m2: c2 * self.offset_sigma_s.powi(2) + rate * t * t,
            rate_m2_per_s2: rate,
            coupled_m2_per_s: rate * t,
        }
    }

    /// Walk of a clock difference, m²/s.
    #[must_use]
    pub fn walk_m2_per_s(&self) -> f64 {
        CLOCK_WALK_M_PER_SQRT_S * CLOCK_WALK_M_PER_SQRT_S
    }

    /// Standard deviation of the scale error that the sound speed gives every range.
    #[must_use]
    pub fn scale_sigma(&self, sound_speed_mps: f64) -> f64 {
        self.sound_speed_sigma_mps / sound_speed_mps
    }

    /// Variance of what clocks and sound speed do to a range of about `range_m`, `elapsed_s` after the start, for a method
    /// that does not estimate them: an error that stands from one range to the next, m².
    #[must_use]
    pub fn standing_m2(&self, sound_speed_mps: f64, range_m: f64, elapsed_s: f64) -> f64 {
        let scale_m = self.scale_sigma(sound_speed_mps) * range_m;
        self.prior(sound_speed_mps, elapsed_s).difference_m2 + scale_m * scale_m
    }

    /// By how much a range may be wrong, one standard deviation of each source added up, m.
    #[must_use]
    pub fn doubt_m(&self, sound_speed_mps: f64, range_m: f64, elapsed_s: f64) -> f64 {
        let late_m = if self.late_share > 0.0 { 3.0 * self.lateness_m } else { 0.0 };
        self.prior(sound_speed_mps, elapsed_s).difference_m2.sqrt()
            + self.scale_sigma(sound_speed_mps) * range_m
            + late_m
    }

    /// The model of late arrivals, where there are any.
    #[must_use]
    pub fn late(&self) -> Option<LateArrivals> {
        (self.late_share > 0.0).then_some(LateArrivals {
            share: self.late_share,
            mean_m: self.lateness_m,
            floor_per_m: FLOOR_PER_M,
        })
    }
}
