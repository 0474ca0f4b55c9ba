//! The filter without ranges as referee: a vehicle in a team must not be worse than alone.
//!
//! Beside the team's cloud runs `mpf` without ranges, fed everything but receptions. Both explain the own soundings; Page's
//! cumulative sum (Biometrika 41, 1954) of the difference of their log evidence says when the lone filter does so for
//! good: then a range or a teammate has led the team's cloud astray, and it starts anew from the lone one.

use serde::{Deserialize, Serialize};

use super::Team;
use super::group::Widening;

/// One sounding counts for or against the lone filter by at most this, nat.
const CLIP_NAT: f64 = 5.0;
/// Variances by which teammates are widened: a position by 15 m, what drifts as after an alarm.
const WIDENED: [f64; 7] = [225.0, 225.0, 0.25, 0.01, 0.01, 0.0, 0.0];

/// The cumulative sum, and how often it has decided.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Referee {
    evidence_nat: f64,
    takeovers: u64,
}

impl Referee {
    /// One sounding: log evidence of the lone filter's cloud and of the team's. True when the lone one is to take over.
    fn judge(&mut self, lone_nat: f64, team_nat: f64, threshold_nat: f64) -> bool {
        let gain = (lone_nat - team_nat).clamp(-CLIP_NAT, CLIP_NAT);
        self.evidence_nat = (self.evidence_nat + gain).max(0.0);
        if self.evidence_nat < threshold_nat {
            return false;
        }
        self.evidence_nat = 0.0;
        self.takeovers += 1;
        true
    }

    /// By name.
    pub fn diagnostics(&self) -> [(&'static str, f64); 2] {
        [("referee_takeovers", self.takeovers as f64), ("referee_evidence_nat", self.evidence_nat)]
    }
}

impl<const K: usize> Team<K> {
    /// After a sounding that both filters have taken up.
    pub(super) fn judge(&mut self) {
        let Some(lone) = &self.lone else { return };
        let (Some(lone_nat), Some(team_nat)) = (lone.evidence_nat(), self.terrain.evidence_nat()) else {
            return;
        };
        if self.state.referee.judge(lone_nat, team_nat, self.options.referee_nat) {
            self.take_over();
        }
    }

    /// The lone filter's cloud becomes the own one. What ranges cannot see is common to the team: teammates and places
    /// move rigidly with their particle, from where the old cloud was on average.
    fn take_over(&mut self) {
        let Some(lone) = &self.lone else { return };
        let old = self.terrain.state.core.cloud.position_moments().0;
        let weights = self.terrain.state.core.cloud.weights();
        let widening = Widening { states: WIDENED, clock_m2: self.clock_widening_m2() };
        let (east, north) = (&lone.state.core.cloud.east, &lone.state.core.cloud.north);
        for group in &mut self.state.groups {
            group.forget(&widening, Some(weights));
            group.follow(old, east, north);
        }
        self.state.history.follow(weights, old, east, north);
        if let Some(current) = &mut self.state.current {
            current.pool(weights);
        }
        self.terrain.become_cloud_of(lone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_adds_up_only_while_the_lone_filter_is_better() {
        let mut referee = Referee::default();
        // Worse soundings are not held against it later.
        assert!((0..100).all(|_| !referee.judge(-3.0, -1.0, 10.0)));
        assert!((0..9).all(|_| !referee.judge(-1.0, -2.0, 10.0)));
        assert!(referee.judge(-1.0, -2.0, 10.0));
        assert_eq!(referee.takeovers, 1);
        // No single sounding decides.
        assert!(!referee.judge(0.0, -1e6, 10.0));
        assert!(referee.judge(0.0, f64::NEG_INFINITY, 10.0));
        assert_eq!(referee.diagnostics()[0], ("referee_takeovers", 2.0));
    }
}
