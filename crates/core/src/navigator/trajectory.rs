//! The vehicle's recent displacement, common to all particles: where it was when a signal arrived or a depth was sounded.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

/// Instants kept: two minutes at 1 Hz with a reception between every two.
const KEPT: usize = 256;

/// Cumulative mean displacement over time.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Trajectory {
    now_ns: i64,
    displacement_m: [f64; 2],
    travelled_m: f64,
    past: VecDeque<(i64, [f64; 2])>,
}

impl Trajectory {
    /// Starts at `t_ns`.
    #[must_use]
    pub fn new(t_ns: i64) -> Self {
        let mut past = VecDeque::with_capacity(KEPT + 1);
        past.push_back((t_ns, [0.0; 2]));
        Self { now_ns: t_ns, displacement_m: [0.0; 2], travelled_m: 0.0, past }
    }

    /// Moves on to `t_ns` by `step_m`.
    pub fn advance(&mut self, t_ns: i64, step_m: [f64; 2]) {
        self.displacement_m[0] += step_m[0];
        self.displacement_m[1] += step_m[1];
        self.travelled_m += step_m[0].hypot(step_m[1]);
        self.now_ns = t_ns;
        if self.past.len() == KEPT {
            self.past.pop_front();
        }
        self.past.push_back((t_ns, self.displacement_m));
    }

    /// Moves the present by `by_m`, not what was before.
    pub fn shift(&mut self, by_m: [f64; 2]) {
        self.displacement_m[0] += by_m[0];
        self.displacement_m[1] += by_m[1];
        if let Some(last) = self.past.back_mut() {
            last.1 = self.displacement_m;
        }
    }

    /// Time of the last step, ns.
    #[must_use]
    pub fn now_ns(&self) -> i64 {
        self.now_ns
    }

    /// Displacement since the start, m.
    #[must_use]
    pub fn displacement_m(&self) -> [f64; 2] {
        self.displacement_m
    }

    /// Length of the track since the start, m.
    #[must_use]
    pub fn travelled_m(&self) -> f64 {
        self.travelled_m
    }

    /// Displacement from `t_ns` to now, m; `None` for a time before what is kept or after now.
    #[must_use]
    pub fn since(&self, t_ns: i64) -> Option<[f64; 2]> {
        let (after, later) = self.past.iter().enumerate().rev().take_while(|(_, p)| p.0 >= t_ns).last()?;
        let then = match after.checked_sub(1).and_then(|i| self.past.get(i)) {
            Some(earlier) => {
                let share =
                    t_ns.saturating_sub(earlier.0) as f64 / later.0.saturating_sub(earlier.0).max(1) as f64;
                [0, 1].map(|a| earlier.1[a] + share * (later.1[a] - earlier.1[a]))
            }
            None if later.0 == t_ns => later.1,
            None => return None,
        };
        Some([self.displacement_m[0] - then[0], self.displacement_m[1] - then[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacement_is_interpolated_and_bounded() {
        let mut t = Trajectory::new(0);
        for s in 1..=10 {
            t.advance(s * 1_000_000_000, [1.0, -0.5]);
        }
        assert_eq!(t.since(10_000_000_000), Some([0.0, 0.0]));
        assert_eq!(t.since(7_500_000_000), Some([2.5, -1.25]));
        assert_eq!(t.since(0), Some([10.0, -5.0]));
        assert_eq!(t.since(-1), None);
        assert_eq!(t.since(10_000_000_001), None);
        for s in 11..1000 {
            t.advance(s * 1_000_000_000, [1.0, 0.0]);
        }
        assert_eq!(t.since(10_000_000_000), None);
        assert!((t.travelled_m() - (10.0 * 1.25f64.sqrt() + 989.0)).abs() < 1e-9);
    }
}
