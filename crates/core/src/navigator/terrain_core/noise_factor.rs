//! How many times noisier the soundings are than their sensor states.
//!
//! The difference of two innovations in a row says it: where the vehicle is, the tide and the chart's error are nearly the
//! same for both, the sensor's noise is not. A cloud at a wrong place misfits by much, but nearly alike twice in a row, so
//! it stays the health monitor's to notice. The factor is the posterior mean over a few values, with a memory of
//! [`MEMORY`] soundings.

use serde::{Deserialize, Serialize};

use super::TerrainCore;
use super::sounding::SoundingFit;

/// The factors that are weighed against each other.
const FACTORS: [f64; 6] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0];
/// Soundings after which what was learned counts 1/e.
const MEMORY: f64 = 60.0;
/// Log-weight of each factor above 1 before anything is known: a sensor is believed at first, nat.
const DOUBT_NAT: f64 = -3.0;
/// One difference says no more against a factor than this, nat.
const MOST_NAT: f64 = 8.0;

/// What was learned of a sounder's noise.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct NoiseFactor {
    /// Log-weights of the factors, the largest 0.
    log_weights: [f64; FACTORS.len()],
    /// The last innovation and the variance of all but the sensor's noise, m and m².
    last: Option<(f64, f64)>,
    learned: bool,
}

impl Default for NoiseFactor {
    fn default() -> Self {
        let mut log_weights = [DOUBT_NAT; FACTORS.len()];
        log_weights[0] = 0.0;
        Self { log_weights, last: None, learned: false }
    }
}

impl NoiseFactor {
    /// The factor of the standard deviation; 1 before anything was learned.
    pub fn factor(&self) -> f64 {
        if !self.learned {
            return 1.0;
        }
        let (mut sum, mut squares) = (0.0, 0.0);
        for (log_weight, factor) in self.log_weights.iter().zip(FACTORS) {
            let weight = log_weight.exp();
            sum += weight;
            squares += weight * factor * factor;
        }
        (squares / sum).sqrt()
    }

    /// Takes up a sounding whose sensor states `sigma_m`; factors above `most` are not considered.
    pub fn learn(&mut self, fit: &SoundingFit, sigma_m: f64, most: f64) {
        let noise_m2 = (sigma_m * self.factor()).powi(2);
        let rest_m2 = (fit.variance_m2 - noise_m2).max(0.0);
        if !fit.innovation_m.is_finite() || !rest_m2.is_finite() {
            self.last = None;
            return;
        }
        if let Some((before_m, before_m2)) = self.last {
            let square = (fit.innovation_m - before_m).powi(2);
            let rest = 0.5 * (rest_m2 + before_m2);
            let mut best = f64::NEG_INFINITY;
            let mut evidence = [0.0; FACTORS.len()];
            for (nat, factor) in evidence.iter_mut().zip(FACTORS) {
                let variance = 2.0 * (factor * sigma_m).powi(2) + rest;
                *nat = -0.5 * (variance.ln() + square / variance);
                if factor <= most {
                    best = best.max(*nat);
                }
            }
            let mut largest = f64::NEG_INFINITY;
            for ((log_weight, nat), factor) in self.log_weights.iter_mut().zip(evidence).zip(FACTORS) {
                // Differences in a row share a sounding: each counts half.
                *log_weight = *log_weight * (1.0 - 1.0 / MEMORY) + 0.5 * (nat - best).max(-MOST_NAT);
                if factor > most {
                    *log_weight = f64::NEG_INFINITY;
                }
                largest = largest.max(*log_weight);
            }
            self.log_weights.iter_mut().for_each(|l| *l -= largest);
            self.learned = true;
        }
        self.last = Some((fit.innovation_m, rest_m2));
    }

    /// The next innovation is not of the same cloud as the last.
    pub fn forget_last(&mut self) {
        self.last = None;
    }
}

impl<const K: usize> TerrainCore<K> {
    /// How many times noisier the soundings are taken to be than their sensor states.
    #[must_use]
    pub fn noise_factor(&self) -> f64 {
        self.options.depth_noise_factor_max.map_or(1.0, |_| self.state.noise.factor())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, Streams};

    fn learned(noise: impl Fn(usize) -> f64, misfit: impl Fn(usize) -> f64, count: usize) -> f64 {
        let mut state = NoiseFactor::default();
        for k in 0..count {
            let variance_m2 = (0.05 * state.factor()).powi(2) + 0.02f64.powi(2);
            let innovation_m = noise(k) + misfit(k);
            let fit = SoundingFit { innovation_m, variance_m2, statistic: 0.0 };
            state.learn(&fit, 0.05, 6.0);
        }
        state.factor()
    }

    fn normals(seed: u64, count: usize) -> Vec<f64> {
        let (mut a, mut b) = (vec![0.0; count], vec![0.0; count]);
        Streams::new(seed, 0).at(Purpose::Jitter, 0).normal_pairs(0, &mut a, &mut b);
        a
    }

    #[test]
    fn the_factor_is_found_and_honest_noise_is_left_as_it_is() {
        for seed in 0..20 {
            let z = normals(seed, 400);
            for factor in [1.0, 1.5, 2.0, 3.0, 4.0] {
                let found = learned(|k| 0.05 * factor * z[k], |_| 0.0, 400);
                assert!((found / factor - 1.0).abs() < 0.25, "seed {seed}: {found} for {factor}");
            }
            let before = learned(|k| 0.05 * z[k], |_| 0.0, 30);
            assert!(before < 1.6, "seed {seed}: {before} after thirty honest soundings");
        }
    }

    #[test]
    fn a_misfit_that_stays_is_no_noise() {
        for seed in 0..20 {
            let z = normals(seed, 300);
            let found = learned(|k| 0.05 * z[k], |k| 2.0 + 0.5 * (k as f64 / 20.0).sin(), 300);
            assert!(found < 1.4, "seed {seed}: {found}");
        }
    }

    #[test]
    fn no_factor_above_the_most_and_none_from_what_is_not_finite() {
        let mut state = NoiseFactor::default();
        let fit = |innovation_m| SoundingFit { innovation_m, variance_m2: 0.0029, statistic: 0.0 };
        for k in 0..100 {
            state.learn(&fit(if k % 2 == 0 { 5.0 } else { -5.0 }), 0.05, 2.0);
        }
        assert!((state.factor() - 2.0).abs() < 1e-6, "{}", state.factor());
        for bad in [f64::NAN, f64::INFINITY] {
            let mut state = NoiseFactor::default();
            state.learn(&fit(bad), 0.05, 4.0);
            state.learn(&fit(0.1), 0.05, 4.0);
            assert_eq!(state.factor(), 1.0);
        }
    }
}
