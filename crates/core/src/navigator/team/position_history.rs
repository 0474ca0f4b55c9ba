//! Positions of each particle: over the last seconds, because a packet is decoded some time after its arrival, and at
//! the last launch, because teammates measure their ranges to that position.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::kernels::particles::gather;
use crate::kernels::weights::weighted_mean;

/// Seconds that are kept: a frame of 64 bytes at 80 bit/s.
const KEPT_NS: i64 = 8_000_000_000;
/// Instants are at least so far apart.
const APART_NS: i64 = 900_000_000;

/// Positions of all particles at one time.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Places {
    /// When.
    pub t_ns: i64,
    /// Easting, m.
    pub east: Vec<f64>,
    /// Northing, m.
    pub north: Vec<f64>,
}

impl Places {
    fn set(&mut self, t_ns: i64, east: &[f64], north: &[f64]) {
        self.t_ns = t_ns;
        for (kept, now) in [(&mut self.east, east), (&mut self.north, north)] {
            kept.clear();
            kept.extend_from_slice(now);
        }
    }
}

/// Recent positions of all particles.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct PositionHistory {
    recent: VecDeque<Places>,
    /// Positions at the last launch, with that packet's counter.
    pub launch: Option<(u8, Places)>,
    /// Shortest time between two launches, ns.
    pub cycle_ns: Option<i64>,
    #[serde(skip)]
    spare: Vec<Places>,
}

impl PositionHistory {
    /// Stores the particles' positions at `t_ns`.
    pub fn remember(&mut self, t_ns: i64, east: &[f64], north: &[f64]) {
        // The newest always stays; the one before it only if it is far enough from its own predecessor.
        let n = self.recent.len();
        if n >= 2 && self.recent[n - 1].t_ns.saturating_sub(self.recent[n - 2].t_ns) < APART_NS {
            self.spare.extend(self.recent.pop_back());
        }
        while self.recent.len() >= 2 && t_ns.saturating_sub(self.recent[1].t_ns) > KEPT_NS {
            self.spare.extend(self.recent.pop_front());
        }
        let mut places = self.spare.pop().unwrap_or_default();
        places.set(t_ns, east, north);
        self.recent.push_back(places);
    }

    /// Writes the positions at `t_ns`, interpolated, into `at`; false for a time outside the stored span.
    pub fn at(&self, t_ns: i64, at: &mut [Vec<f64>; 2]) -> bool {
        let after = self.recent.partition_point(|p| p.t_ns < t_ns);
        let (Some(later), Some(earlier)) = (self.recent.get(after), self.recent.get(after.saturating_sub(1)))
        else {
            return false;
        };
        if earlier.t_ns > t_ns {
            return false;
        }
        let span_ns = later.t_ns.saturating_sub(earlier.t_ns).max(1);
        let share = t_ns.saturating_sub(earlier.t_ns) as f64 / span_ns as f64;
        let columns = [(&earlier.east, &later.east), (&earlier.north, &later.north)];
        for (out, (earlier, later)) in at.iter_mut().zip(columns) {
            out.clear();
            out.extend(earlier.iter().zip(later).map(|(a, b)| a + share * (b - a)));
        }
        true
    }

    /// Removes all positions.
    pub fn clear(&mut self) {
        self.spare.extend(self.recent.drain(..));
        self.launch = None;
    }

    /// Whether all columns have `particles` entries; a snapshot's may not.
    #[must_use]
    pub fn fits(&self, particles: usize) -> bool {
        let launch = self.launch.iter().map(|(_, places)| places);
        self.recent.iter().chain(launch).all(|p| p.east.len() == particles && p.north.len() == particles)
    }

    fn all(&mut self) -> impl Iterator<Item = &mut Places> {
        self.recent.iter_mut().chain(self.launch.iter_mut().map(|(_, places)| places))
    }

    /// Resampling: particle i takes the history of its ancestor.
    pub fn gather(&mut self, ancestors: &[u32], column: &mut Vec<f64>) {
        for places in self.all() {
            gather(&mut places.east, column, ancestors);
            gather(&mut places.north, column, ancestors);
        }
    }

    /// Shifts each particle's history by the correction that the particle received, `before` to [`east`, `north`].
    pub fn shift(&mut self, before: &[Vec<f64>; 2], east: &[f64], north: &[f64]) {
        for places in self.all() {
            let columns = [(&mut places.east, east), (&mut places.north, north)];
            for ((then, now), before) in columns.into_iter().zip(before) {
                for ((then, now), before) in then.iter_mut().zip(now).zip(before) {
                    *then += now - before;
                }
            }
        }
    }

    /// Another cloud, of which each particle is `now - from` from where the old one was on average, takes over: where it
    /// was is where the old one was on average, as far off.
    pub fn follow(&mut self, weights: &[f64], from_m: [f64; 2], east: &[f64], north: &[f64]) {
        for places in self.all() {
            let columns = [(&mut places.east, east, from_m[0]), (&mut places.north, north, from_m[1])];
            for (then, now, from_m) in columns {
                let mean = weighted_mean(weights, then);
                then.iter_mut().zip(now).for_each(|(then, now)| *then = mean + now - from_m);
            }
        }
    }

    /// Stores positions as those of a launch.
    pub fn launched(&mut self, sequence: u8, t_ns: i64, place: impl Fn(usize) -> [f64; 2], particles: usize) {
        if let Some((_, last)) = &self.launch {
            let cycle_ns = t_ns.saturating_sub(last.t_ns);
            self.cycle_ns = Some(self.cycle_ns.map_or(cycle_ns, |shortest| shortest.min(cycle_ns)));
        }
        let (kept, places) = self.launch.get_or_insert_with(Default::default);
        *kept = sequence;
        places.t_ns = t_ns;
        places.east.clear();
        places.north.clear();
        for [east, north] in (0..particles).map(place) {
            places.east.push(east);
            places.north.push(north);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    /// Two particles at t, t + 100 east; 2t, 2t + 100 north.
    fn history() -> PositionHistory {
        let mut history = PositionHistory::default();
        for k in 0..=40 {
            let t = 0.5 * f64::from(k);
            history.remember((t * 1e9) as i64, &[t, t + 100.0], &[2.0 * t, 2.0 * t + 100.0]);
        }
        history
    }

    #[test]
    fn places_are_interpolated_within_what_is_kept() {
        let history = history();
        let mut at = [Vec::new(), Vec::new()];
        for t_ns in [20 * SECOND, 19_750_000_000, 15_300_000_000, 12 * SECOND] {
            assert!(history.at(t_ns, &mut at));
            let t = t_ns as f64 * 1e-9;
            for (found, expected) in at.iter().flatten().zip([t, t + 100.0, 2.0 * t, 2.0 * t + 100.0]) {
                assert!((found - expected).abs() < 1e-9, "{found} at {t} s");
            }
        }
        assert!(!history.at(10 * SECOND, &mut at), "too long ago");
        assert!(!history.at(20 * SECOND + 1, &mut at), "not yet");
        assert!(history.recent.len() <= 11, "{} instants", history.recent.len());
    }

    #[test]
    fn places_follow_and_move_with_their_particle() {
        let mut history = history();
        history.launched(3, 18 * SECOND, |i| [i as f64, 5.0], 2);
        history.gather(&[1, 1], &mut vec![0.0; 2]);
        history.shift(&[vec![0.0, 0.0], vec![0.0, 0.0]], &[0.5, -0.5], &[0.0, 1.0]);
        let mut at = [Vec::new(), Vec::new()];
        assert!(history.at(20 * SECOND, &mut at));
        assert_eq!(at, [vec![120.5, 119.5], vec![140.0, 141.0]]);
        let (sequence, launch) = history.launch.as_ref().unwrap();
        assert_eq!((*sequence, launch.t_ns), (3, 18 * SECOND));
        assert_eq!((&launch.east, &launch.north), (&vec![1.5, 0.5], &vec![5.0, 6.0]));
        assert!(history.fits(2) && !history.fits(3));
        history.clear();
        assert!(history.launch.is_none() && !history.at(20 * SECOND, &mut at));
    }
}
