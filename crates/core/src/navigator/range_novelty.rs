//! How much of a range to a teammate is new information for a vehicle that has used that teammate's earlier packets.
//!
//! The errors of two positions that one teammate broadcast are correlated, so two ranges to them are less than two
//! independent measurements. If consecutive errors have the correlation ρ, n ranges weigh as n (1 − ρ) / (1 + ρ)
//! independent ones. The receiver computes ρ from the two covariances in the packets and from a model of dead reckoning
//! between them: a prediction is correlated with the estimate that it started from, and a corrected estimate is
//! correlated with its prediction by the square root of the share of the variance that remains.

use crate::measurement::range::along;

/// How a position error grows in dead reckoning, along one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Correlation of the position's error with the drift's, 0 to 1.
    pub correlation: f64,
    /// Variance added by the velocity error, which was there before, m².
    pub drift_m2: f64,
    /// Variance added by process noise, m².
    pub walk_m2: f64,
}

/// Exponent in (0, 1] for the likelihood of a range along `direction` (a unit vector), from the covariances [ee, en, nn]
/// that the teammate broadcast before, `then_m2`, and broadcasts now. A teammate's first packet counts whole.
/// `standing_m2` is the variance of a part of the range's error that is never renewed, as a clock's.
#[must_use]
pub fn share(
    then_m2: [f64; 3],
    now_m2: [f64; 3],
    direction: [f64; 2],
    growth: &Growth,
    standing_m2: f64,
) -> f64 {
    let (then, now) = (along(direction, then_m2), along(direction, now_m2));
    let mut rho = correlation(then, now, growth);
    if standing_m2 > 0.0 {
        let (then, now) = (then.max(0.0), now.max(0.0));
        rho = (rho * (then * now).sqrt() + standing_m2) / ((then + standing_m2) * (now + standing_m2)).sqrt();
    }
    ((1.0 - rho) / (1.0 + rho)).max(LEAST)
}

/// Lower bound of the exponent: a likelihood to this power changes nothing.
const LEAST: f64 = 1e-9;

/// Correlation of two errors of one estimate, from its variances then and now.
fn correlation(then_m2: f64, now_m2: f64, growth: &Growth) -> f64 {
    if !(then_m2 > 0.0 && now_m2 > 0.0) {
        return 1.0;
    }
    let cross = growth.correlation * (then_m2 * growth.drift_m2).sqrt();
    let predicted_m2 = then_m2 + 2.0 * cross + growth.drift_m2 + growth.walk_m2;
    let drifting = (then_m2 + cross) / (then_m2 * predicted_m2).sqrt();
    // A variance above the predicted one is drift that the model does not have, not new information.
    let kept = (now_m2 / predicted_m2).min(1.0).sqrt();
    (drifting * kept).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STILL: Growth = Growth { correlation: 0.0, drift_m2: 0.0, walk_m2: 0.0 };
    const EAST: [f64; 2] = [1.0, 0.0];

    fn share(then: [f64; 3], now: [f64; 3], growth: &Growth) -> f64 {
        super::share(then, now, EAST, growth, 0.0)
    }

    #[test]
    fn an_unchanged_estimate_has_no_weight() {
        assert!(share([9.0, 1.0, 4.0], [9.0, 1.0, 4.0], &STILL) < 1e-6);
    }

    #[test]
    fn the_weight_grows_with_the_share_of_the_error_that_was_renewed() {
        // An estimate with a quarter of the variance correlates with what it was by a half: (1 − ½) / (1 + ½).
        assert!((share([4.0, 0.0, 1.0], [1.0, 0.0, 1.0], &STILL) - 1.0 / 3.0).abs() < 1e-12);
        // The other axis does not matter.
        assert!(share([4.0, 0.0, 9.0], [4.0, 0.0, 0.1], &STILL) < 1e-6);
        let shares =
            [4.0, 3.0, 2.0, 1.0, 0.1, 1e-6].map(|now| share([4.0, 0.0, 1.0], [now, 0.0, 1.0], &STILL));
        assert!(shares.windows(2).all(|pair| pair[0] < pair[1]), "{shares:?}");
        assert!(shares[5] > 0.99);
    }

    #[test]
    fn velocity_error_is_not_new_and_process_noise_is() {
        let grown = |correlation, drift_m2: f64, walk_m2: f64| {
            let now = 4.0 + 2.0 * correlation * (4.0 * drift_m2).sqrt() + drift_m2 + walk_m2;
            share([4.0, 0.0, 1.0], [now, 0.0, 1.0], &Growth { correlation, drift_m2, walk_m2 })
        };
        assert!(grown(1.0, 1.0, 0.0) < 1e-6, "a constant velocity error that made the position's error");
        assert!(grown(0.0, 0.0, 12.0) > 0.3, "a random walk of three times the variance");
        assert!(grown(0.5, 1.0, 0.0) > grown(0.9, 1.0, 0.0));
    }

    /// The exact correlation of two errors of a Kalman filter that drifts and is corrected, against the formula.
    #[test]
    fn the_correlation_is_that_of_a_kalman_filter() {
        let (p, c, pc, dt, walk) = (4.0f64, 0.01f64, 0.12f64, 9.0f64, 0.3f64);
        let (drift_m2, cross) = (c * dt * dt, pc * dt);
        let predicted = p + 2.0 * cross + drift_m2 + walk;
        for noise_m2 in [0.5, 5.0, 50.0, 1e12] {
            let gain = predicted / (predicted + noise_m2);
            let now = (1.0 - gain) * predicted;
            // e_now = (1 − K)(e_then + drift + walk) − K v
            let exact = (1.0 - gain) * (p + cross) / (p * now).sqrt();
            let growth = Growth { correlation: cross / (p * drift_m2).sqrt(), drift_m2, walk_m2: walk };
            assert!((correlation(p, now, &growth) - exact).abs() < 1e-9, "{noise_m2}");
        }
    }

    #[test]
    fn beside_a_standing_error_what_is_renewed_counts_for_less() {
        let shares = [0.0, 1.0, 10.0, 1000.0]
            .map(|m2| super::share([4.0, 0.0, 1.0], [1.0, 0.0, 1.0], EAST, &STILL, m2));
        assert!(shares.windows(2).all(|pair| pair[0] > pair[1]), "{shares:?}");
        assert!(shares[3] < 1e-2 && shares[3] > 0.0);
    }

    #[test]
    fn the_weight_stays_between_0_and_1() {
        for value in [0.0, 1e-12, 1.0, 1e12] {
            for then in [0.0, 1.0, 1e9] {
                for correlation in [0.0, 1.0] {
                    let growth = Growth { correlation, drift_m2: value, walk_m2: value };
                    let share = share([then, 0.0, 1.0], [value, 0.0, 1.0], &growth);
                    assert!(share > 0.0 && share <= 1.0, "{then} {value} {share}");
                }
            }
        }
    }
}
