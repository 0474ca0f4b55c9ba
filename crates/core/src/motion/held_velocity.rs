//! How long a velocity that is not told any more is believed.

use serde::{Deserialize, Serialize};

use crate::event::seconds;

/// Shortest time for which a velocity holds, s.
const HELD_S: f64 = 5.0;
/// It holds for so many of its own periods, where these are longer.
const PERIODS: f64 = 3.0;

/// A long period is forgotten by this share with each velocity: commands that change at the ends of legs come in no rhythm.
const REMEMBERED: f64 = 0.9;

/// When the velocity in force was told, how often it is told, and the fastest one so far.
///
/// A velocity is in force until the next one. Once velocities have come with a period, one that stays away for longer than
/// 5 s and three periods is out of force: the vehicle may have turned to anywhere. Then the position's variance grows per
/// axis by `v² a²` over an age `a` beyond that, the mean square of a course that is drawn anew at the fastest speed so far.
/// A single velocity that nothing follows is a command, and holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct HeldVelocity {
    told_ns: Option<i64>,
    period_s: Option<f64>,
    fastest_mps: f64,
}

impl HeldVelocity {
    /// A velocity is told at `t_ns`.
    pub fn renew(&mut self, t_ns: i64, velocity_mps: [f64; 2]) {
        if let Some(told_ns) = self.told_ns
            && t_ns > told_ns
        {
            let gap_s = seconds(t_ns.saturating_sub(told_ns));
            self.period_s = Some(self.period_s.map_or(gap_s, |period_s| gap_s.max(REMEMBERED * period_s)));
        }
        self.told_ns = Some(t_ns);
        self.fastest_mps = self.fastest_mps.max(velocity_mps[0].hypot(velocity_mps[1]));
    }

    /// What the position's variance grows by per axis between two instants, m²; 0 while the velocity holds.
    #[must_use]
    pub fn drift_m2(&self, from_ns: i64, to_ns: i64) -> f64 {
        let (Some(told_ns), Some(period_s)) = (self.told_ns, self.period_s) else { return 0.0 };
        let held_s = HELD_S.max(PERIODS * period_s);
        let beyond_m =
            |t_ns: i64| self.fastest_mps * (seconds(t_ns.saturating_sub(told_ns)) - held_s).max(0.0);
        (beyond_m(to_ns).powi(2) - beyond_m(from_ns).powi(2)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn told(times_s: &[i64]) -> HeldVelocity {
        let mut held = HeldVelocity::default();
        for t in times_s {
            held.renew(t * SECOND, [1.2, 1.6]);
        }
        held
    }

    #[test]
    fn a_velocity_holds_for_five_seconds_or_three_periods_and_then_drifts_with_the_square_of_its_age() {
        let held = told(&[0, 1]);
        assert!(held.drift_m2(SECOND, 6 * SECOND) < 1e-20);
        assert!((held.drift_m2(6 * SECOND, 16 * SECOND) - 400.0).abs() < 1e-9);
        assert!(told(&[0, 20]).drift_m2(20 * SECOND, 80 * SECOND) < 1e-20);
    }

    #[test]
    fn the_drift_of_parts_is_that_of_the_whole() {
        let held = told(&[0, 1, 2]);
        let parts: f64 = (2..40).map(|t| held.drift_m2(t * SECOND, (t + 1) * SECOND)).sum();
        assert!((parts - held.drift_m2(2 * SECOND, 40 * SECOND)).abs() < 1e-9 * parts);
        assert!(parts > 1000.0);
    }

    #[test]
    fn a_command_that_nothing_follows_holds() {
        assert_eq!(told(&[0]).drift_m2(0, 3600 * SECOND), 0.0);
        assert_eq!(HeldVelocity::default().drift_m2(0, 3600 * SECOND), 0.0);
    }
}
