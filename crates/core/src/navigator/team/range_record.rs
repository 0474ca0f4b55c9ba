//! What became of ranges: counts, the last one as it was judged, and how noisy they are by what they show.

use serde::{Deserialize, Serialize};

use crate::measurement::range::{CloudInnovation, LateArrivals};

/// Ranges over which what they show of their noise is averaged.
const MEMORY: f64 = 80.0;
/// What the stated noise counts for at the start, in ranges.
const BELIEVED: f64 = 20.0;
/// Mean square of the normalised innovations from which on ranges are taken to be noisier than told: with the memory, three
/// standard deviations above 1.
const MISFIT: f64 = 1.5;
/// … and by how much at most.
const MOST_TIMES: f64 = 6.0;
/// A square counts at most so many times its variance.
const CLIP: f64 = 25.0;

/// Counts of ranges that were not used, and the last own range.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct RangeRecord {
    /// Own ranges that the particles contradict.
    pub gated: u64,
    /// Reported ranges that they contradict.
    pub reported_gated: u64,
    /// Reported ranges to a launch that the sender cannot have heard since its last broadcast.
    pub reported_stale: u64,
    /// Ranges that are none: not above zero, or shorter than the difference of the depths.
    pub impossible: u64,
    /// Innovation of the last own range, its standard deviation, and the posterior share of a late arrival.
    last: Option<[f64; 3]>,
    noise: Option<NoiseAverage>,
}

/// Moving averages over own ranges of the squared innovation and of the variance that is not the range's own, m².
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct NoiseAverage {
    square_m2: f64,
    rest_m2: f64,
    ranges: f64,
}

impl NoiseAverage {
    /// How many times `told_m2` the variance of a range is, by covariance matching (Mehra 1972); 1 while it fits.
    fn variance_factor(&self, told_m2: f64) -> f64 {
        if self.square_m2 <= MISFIT * (self.rest_m2 + told_m2) {
            return 1.0;
        }
        ((self.square_m2 - self.rest_m2) / told_m2).clamp(1.0, MOST_TIMES * MOST_TIMES)
    }
}

impl RangeRecord {
    /// Remembers how the last own range was judged.
    /// It was weighed with the variance `used_m2`, where a range is told to have `told_m2`.
    pub fn judged(
        &mut self,
        seen: &CloudInnovation,
        late: Option<&LateArrivals>,
        told_m2: f64,
        used_m2: f64,
    ) {
        let share = late.map_or(0.0, |l| l.likelihood(seen.mean_m, seen.variance_m2).late_share);
        self.last = Some([seen.mean_m, seen.variance_m2.sqrt(), share]);
        let rest_m2 = (seen.variance_m2 - used_m2).max(0.0);
        let square_m2 = (seen.mean_m * seen.mean_m).min(CLIP * seen.variance_m2);
        if !seen.mean_m.is_finite() || !rest_m2.is_finite() || !share.is_finite() {
            return;
        }
        let average = self.noise.get_or_insert(NoiseAverage {
            square_m2: rest_m2 + told_m2,
            rest_m2,
            ranges: BELIEVED,
        });
        average.ranges = (average.ranges + 1.0).min(MEMORY);
        // One that is late by a longer way says nothing of the noise.
        let weight = (1.0 - share) / average.ranges;
        average.square_m2 += weight * (square_m2 - average.square_m2);
        average.rest_m2 += weight * (rest_m2 - average.rest_m2);
    }

    /// How many times larger than `told_m2` the variance of a range is taken to be.
    #[must_use]
    pub fn variance_factor(&self, told_m2: f64) -> f64 {
        self.noise.as_ref().map_or(1.0, |noise| noise.variance_factor(told_m2))
    }

    /// By name; the share of late arrivals where there are any.
    pub fn diagnostics(&self, late: bool, told_m2: f64) -> Vec<(&'static str, f64)> {
        let [innovation_m, sigma_m, share] = self.last.unwrap_or([f64::NAN; 3]);
        let counts = [
            ("ranges_gated", self.gated),
            ("reported_ranges_gated", self.reported_gated),
            ("reported_ranges_stale", self.reported_stale),
            ("ranges_impossible", self.impossible),
        ];
        let last = [
            ("range_innovation_m", innovation_m),
            ("range_innovation_sigma_m", sigma_m),
            ("range_noise_factor", self.variance_factor(told_m2).sqrt()),
        ];
        let share = late.then_some(("range_late_share", share));
        counts.into_iter().map(|(name, count)| (name, count as f64)).chain(last).chain(share).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, Streams};

    /// The factor of the standard deviation that is found for ranges of `sigma_m`, told 1 m, with 1.5 m² beside it.
    fn found(sigma_m: f64, seed: u64, count: usize) -> f64 {
        let (mut z, mut unused) = (vec![0.0; count], vec![0.0; count]);
        Streams::new(seed, 0).at(Purpose::Jitter, 0).normal_pairs(0, &mut z, &mut unused);
        let mut record = RangeRecord::default();
        for normal in z {
            let used_m2 = record.variance_factor(1.0);
            let seen = CloudInnovation {
                mean_m: normal * (1.5 + sigma_m * sigma_m).sqrt(),
                variance_m2: 1.5 + used_m2,
            };
            record.judged(&seen, None, 1.0, used_m2);
        }
        record.variance_factor(1.0).sqrt()
    }

    #[test]
    fn noisier_ranges_are_found_and_honest_ones_left_as_they_are() {
        let honest = (0..50).filter(|seed| found(1.0, *seed, 300) > 1.0).count();
        assert!(honest <= 3, "{honest} of 50 honest records");
        for seed in 0..50 {
            let three = found(3.0, seed, 300);
            assert!((2.2..4.2).contains(&three), "seed {seed}: {three}");
        }
    }

    #[test]
    fn late_arrivals_and_what_is_not_finite_say_nothing_of_the_noise() {
        let late = LateArrivals { share: 0.2, mean_m: 20.0, floor_per_m: 1e-6 };
        let mut record = RangeRecord::default();
        for mean_m in [25.0, 40.0, f64::NAN, f64::INFINITY].repeat(100) {
            record.judged(&CloudInnovation { mean_m, variance_m2: 2.5 }, Some(&late), 1.0, 1.0);
        }
        assert_eq!(record.variance_factor(1.0), 1.0);
    }
}
