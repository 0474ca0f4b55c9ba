//! Counter-based random streams (Philox4x32-10, Salmon et al. 2011).
//!
//! A draw is a pure function of (seed, vehicle, purpose, step, lane, index): it does not depend on which thread
//! asks, nor on what was drawn before, and a new vehicle does not shift another one's noise.

use serde::{Deserialize, Serialize};

use crate::kernels::philox::{self, StreamKey};

/// What a draw is for; part of the counter, so that two uses never share a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u16)]
pub enum Purpose {
    /// Spread of the first cloud.
    Initial = 1,
    /// Process noise.
    Process = 2,
    /// Residual resampling.
    Resample = 3,
    /// Roughening or Liu–West jitter.
    Jitter = 4,
    /// Samples of a teammate's belief (eq 17).
    Belief = 5,
    /// Spread after an alarm of the health monitor.
    Recovery = 6,
    /// Everything about the particles of an acquisition.
    Acquisition = 7,
}

/// The random streams of one navigator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Streams {
    seed: u64,
    vehicle: u16,
}

/// One stream: fixed purpose and step; lanes and indices are left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stream {
    key: StreamKey,
}

impl Streams {
    /// Streams of `vehicle` under `seed`.
    #[must_use]
    pub fn new(seed: u64, vehicle: u16) -> Self {
        Self { seed, vehicle }
    }

    /// The stream for `purpose` at `step`.
    #[must_use]
    pub fn at(&self, purpose: Purpose, step: u32) -> Stream {
        let who = (u32::from(self.vehicle) << 16) | purpose as u32;
        Stream { key: StreamKey { seed: [self.seed as u32, (self.seed >> 32) as u32], step, who } }
    }
}

impl Stream {
    /// What the kernels draw by.
    #[must_use]
    pub fn key(&self) -> &StreamKey {
        &self.key
    }

    /// Standard normals: entry i of `a` and `b` are the two draws with index i of `lane`.
    pub fn normal_pairs(&self, lane: u32, a: &mut [f64], b: &mut [f64]) {
        philox::normal_pairs(&self.key, lane, a, b);
    }

    /// Uniforms in (0, 1).
    pub fn uniforms(&self, lane: u32, out: &mut [f64]) {
        philox::uniforms(&self.key, lane, out);
    }

    /// As many uniforms in (0, 1) in ascending order; how many are asked for changes all of them.
    pub fn sorted_uniforms(&self, lane: u32, out: &mut [f64]) {
        philox::sorted_uniforms(&self.key, lane, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_have_the_moments_of_normals() {
        let n = 200_000;
        let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
        Streams::new(7, 3).at(Purpose::Process, 11).normal_pairs(0, &mut a, &mut b);
        let all = a.iter().chain(&b);
        let m = |p: i32| all.clone().map(|x| x.powi(p)).sum::<f64>() / (2 * n) as f64;
        let tolerance = |variance: f64| 4.5 * (variance / (2 * n) as f64).sqrt();
        assert!(m(1).abs() < tolerance(1.0), "{}", m(1));
        assert!((m(2) - 1.0).abs() < tolerance(2.0), "{}", m(2));
        assert!(m(3).abs() < tolerance(15.0), "{}", m(3));
        assert!((m(4) - 3.0).abs() < tolerance(96.0), "{}", m(4));
        let cross = a.iter().zip(&b).map(|(x, y)| x * y).sum::<f64>() / n as f64;
        assert!(cross.abs() < 4.5 / (n as f64).sqrt());
    }

    #[test]
    fn uniforms_fill_the_open_unit_interval_evenly() {
        let mut u = vec![0.0; 100_000];
        Streams::new(1, 0).at(Purpose::Resample, 0).uniforms(0, &mut u);
        assert!(u.iter().all(|&x| x > 0.0 && x < 1.0));
        let mut bins = [0.0f64; 50];
        for x in &u {
            bins[(x * 50.0) as usize] += 1.0;
        }
        let chi2: f64 = bins.iter().map(|c| (c - 2000.0).powi(2) / 2000.0).sum();
        assert!(chi2 < 95.0, "chi² of 49 degrees of freedom is {chi2}");
    }

    #[test]
    fn sorted_uniforms_are_order_statistics() {
        // One draw of many: Kolmogorov–Smirnov at 0.1 %.
        let mut u = vec![0.0; 100_000];
        Streams::new(1, 0).at(Purpose::Resample, 0).sorted_uniforms(0, &mut u);
        assert!(u.windows(2).all(|p| p[0] <= p[1]) && u[0] > 0.0 && u[99_999] < 1.0);
        let furthest =
            u.iter().enumerate().map(|(i, u)| (u - (i as f64 + 0.5) / 1e5).abs()).fold(0.0, f64::max);
        assert!(furthest < 1.95 / 1e5f64.sqrt(), "{furthest}");
        // Many draws of a few, across block borders: Beta(k, R + 1 − k).
        for r in [1usize, 3, 63, 64, 65] {
            let (runs, mut u) = (4000, vec![0.0; r]);
            let mut moments = vec![[0.0; 2]; r];
            for run in 0..runs {
                Streams::new(2, 0).at(Purpose::Resample, run).sorted_uniforms(0, &mut u);
                for (m, u) in moments.iter_mut().zip(&u) {
                    *m = [m[0] + u / f64::from(runs), m[1] + u * u / f64::from(runs)];
                }
            }
            for (k, [mean, square]) in moments.iter().enumerate() {
                let (a, all) = (k as f64 + 1.0, r as f64 + 1.0);
                let variance = a * (all - a) / (all * all * (all + 1.0));
                let sigmas = (mean - a / all) / (variance / f64::from(runs)).sqrt();
                assert!(sigmas.abs() < 4.5, "{k} of {r}: mean {mean}");
                assert!(((square - mean * mean) / variance - 1.0).abs() < 0.15, "{k} of {r}: variance");
            }
        }
    }

    #[test]
    fn a_draw_depends_on_who_asks_and_not_on_how_many() {
        let streams = Streams::new(42, 1);
        let draw = |s: &Stream, lane, n: usize| {
            let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
            s.normal_pairs(lane, &mut a, &mut b);
            (a, b)
        };
        let s = streams.at(Purpose::Process, 5);
        let (long, _) = draw(&s, 0, 1000);
        let (short, _) = draw(&s, 0, 37);
        assert_eq!(long[..37], short[..]);
        for other in [
            draw(&s, 1, 37),
            draw(&streams.at(Purpose::Process, 6), 0, 37),
            draw(&streams.at(Purpose::Jitter, 5), 0, 37),
            draw(&Streams::new(42, 2).at(Purpose::Process, 5), 0, 37),
            draw(&Streams::new(43, 1).at(Purpose::Process, 5), 0, 37),
        ] {
            assert_ne!(other.0, short);
        }
    }
}
