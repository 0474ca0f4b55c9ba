//! The filter without ranges as referee: a vehicle in a team must not be worse than alone.
//!
//! Beside the team's cloud runs `mpf` without ranges, fed everything but receptions. Both explain the own soundings; Page's
//! cumulative sum (Biometrika 41, 1954) of the difference of their log evidence says when the lone filter does so for
//! good: then a range or a teammate has led the team's cloud astray, and it starts anew from the lone one. Where that happens
//! again soon, what is believed of ranges or teammates is wrong in itself: for a while, twice as long each time, the lone filter
//! speaks for the vehicle, packets weigh no particle, and then it takes over once more.

use serde::{Deserialize, Serialize};

use super::Team;
use super::group::Widening;
use crate::event::seconds;

/// One sounding counts for or against the lone filter by at most this, nat.
const CLIP_NAT: f64 = 5.0;
/// A take-over is a repeated one so long after the last, or after the silence that followed it, s.
const SOON_S: f64 = 300.0;
/// The first silence, s.
const SILENCE_S: f64 = 120.0;
/// Doublings of it at most.
const MOST_DOUBLINGS: u32 = 4;
/// Variances by which teammates are widened: a position by 15 m, what drifts as after an alarm.
const WIDENED: [f64; 7] = [225.0, 225.0, 0.25, 0.01, 0.01, 0.0, 0.0];

/// The cumulative sum, and how often it has decided.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Referee {
    evidence_nat: f64,
    takeovers: u64,
    last_ns: Option<i64>,
    silent_until_ns: Option<i64>,
    repeated: u32,
}

impl Referee {
    /// Whether packets weigh no particle, and the lone filter speaks for the vehicle.
    pub fn silences(&self) -> bool {
        self.silent_until_ns.is_some()
    }

    /// Ends a silence whose time has come; true if it did.
    fn ends_silence(&mut self, t_ns: i64) -> bool {
        let ended = self.silent_until_ns.is_some_and(|until| t_ns >= until);
        if ended {
            self.silent_until_ns = None;
            self.last_ns = Some(t_ns);
        }
        ended
    }

    /// The lone filter took over at `t_ns`.
    fn took_over(&mut self, t_ns: i64) {
        if self.last_ns.is_some_and(|last| seconds(t_ns.saturating_sub(last)) < SOON_S) {
            let silence_s = SILENCE_S * f64::from(1_u32 << self.repeated.min(MOST_DOUBLINGS));
            self.silent_until_ns = Some(t_ns.saturating_add((silence_s * 1e9) as i64));
            self.repeated = self.repeated.saturating_add(1);
        } else {
            self.repeated = 0;
        }
        self.last_ns = Some(t_ns);
    }

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
    pub fn diagnostics(&self) -> [(&'static str, f64); 3] {
        [
            ("referee_takeovers", self.takeovers as f64),
            ("referee_evidence_nat", self.evidence_nat),
            ("ranges_silenced", f64::from(self.silences())),
        ]
    }
}

impl<const K: usize> Team<K> {
    /// After a sounding that both filters have taken up.
    pub(super) fn judge(&mut self) {
        let (Some(lone), Some(now_ns)) = (&self.lone, self.terrain.state.core.now_ns()) else { return };
        if self.state.referee.silences() {
            if self.state.referee.ends_silence(now_ns) {
                self.take_over();
            }
            return;
        }
        let (Some(lone_nat), Some(team_nat)) = (lone.evidence_nat(), self.terrain.evidence_nat()) else {
            return;
        };
        if self.state.referee.judge(lone_nat, team_nat, self.options.referee_nat) {
            self.take_over();
            self.state.referee.took_over(now_ns);
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
    fn repeated_take_overs_silence_ranges_for_longer_each_time() {
        const SECOND: i64 = 1_000_000_000;
        let mut referee = Referee::default();
        let silence = |referee: &mut Referee, from_s: i64, to_s: i64| {
            referee.took_over(from_s * SECOND);
            assert!(referee.silences() && !referee.ends_silence((to_s - 1) * SECOND));
            assert!(referee.ends_silence(to_s * SECOND) && !referee.silences());
        };
        referee.took_over(400 * SECOND);
        assert!(!referee.silences(), "one take-over may be chance");
        silence(&mut referee, 600, 720);
        silence(&mut referee, 1000, 1240);
        // Long after, it is a first one again.
        referee.took_over(1600 * SECOND);
        assert!(!referee.silences());
        silence(&mut referee, 1700, 1820);
    }

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
