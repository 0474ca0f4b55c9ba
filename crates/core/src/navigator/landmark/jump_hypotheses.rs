//! Recovery by hypotheses: that the vehicle was displaced without its odometry measuring it, tracked in parallel.
//!
//! After each positioning an alternative starts as a copy of the estimate with a small unmeasured motion at that
//! time; each complete positioning starts another one, initialised from it, for a motion of any size. All
//! alternatives and the estimate itself are corrected by the same measurements with the same outlier mixture; each
//! keeps the logarithm of its odds against the estimate, the prior of a motion included. The mixture explains an
//! outlier at the price of its share, so one outlier does not reverse the odds; several measurements that agree with
//! one motion do. A replaced estimate stays among the alternatives with its odds, so a false alarm is reversed when
//! the next measurements support it.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::joint::{Channels, Joint};
use super::model::Measurement;
use super::odometry::Increment;

/// Alternatives with less than e^−30 of the estimate's odds are dropped.
const LOG_ODDS_LEAST: f64 = -30.0;

/// The model of an unmeasured motion (a jump), and the odds at which it is accepted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct JumpRule {
    /// Positionings for which an alternative is kept.
    pub window: u32,
    /// Sigma of a jump per axis, m.
    pub sigma_m: f64,
    /// Sigma of its turn, rad.
    pub sigma_rad: f64,
    /// Prior odds of a jump between two positionings.
    pub share: f64,
    /// Posterior odds at which a jump is accepted.
    pub odds: f64,
}

/// An alternative estimate, and its odds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Alternative {
    joint: Joint,
    log_odds: f64,
    age: u32,
}

/// All alternatives to the belief.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JumpHypotheses {
    alternatives: VecDeque<Alternative>,
}

impl JumpHypotheses {
    /// Forgets everything: another landmark, another core.
    pub fn clear(&mut self) {
        self.alternatives.clear();
    }

    /// All alternatives, to be moved as the belief is.
    pub fn joints(&mut self) -> impl Iterator<Item = &mut Joint> {
        self.alternatives.iter_mut().map(|a| &mut a.joint)
    }

    /// Starts an alternative: a copy of the belief that jumped now.
    pub fn branch(&mut self, belief: &Joint, rule: &JumpRule) {
        let mut joint = belief.clone();
        joint.disturb(rule.sigma_m, rule.sigma_rad);
        self.alternatives.push_back(Alternative { joint, log_odds: rule.share.ln(), age: 0 });
    }

    /// Starts an alternative from a positioning whose log-evidence under the belief is `believed`: its pose may be
    /// any, so that each channel had the density of an outlier.
    pub fn found(
        &mut self,
        before: &Joint,
        (pose, covariance): &(Vector3<f64>, Matrix3<f64>),
        believed: f64,
        widths: [f64; 3],
        rule: &JumpRule,
    ) {
        let mut joint = before.clone();
        joint.place_own(pose, covariance);
        let anywhere: f64 = widths.into_iter().map(f64::ln).sum();
        let log_odds = rule.share.ln() - anywhere - believed;
        self.alternatives.push_back(Alternative { joint, log_odds, age: 0 });
    }

    /// Corrects all alternatives by the measurement that corrected the belief with the log-evidence `believed`. Where
    /// the odds of the most likely alternative suffice, it replaces the belief; returned is then the logarithm of its
    /// odds.
    pub fn weigh(
        &mut self,
        belief: &mut Joint,
        believed: f64,
        measured: &Measurement,
        delay: &Increment,
        channels: &Channels,
        rule: &JumpRule,
    ) -> Option<f64> {
        for a in &mut self.alternatives {
            a.log_odds += a.joint.correct(measured, delay, channels).log_evidence - believed;
            a.age += 1;
        }
        self.alternatives.retain(|a| a.age <= rule.window && a.log_odds > LOG_ODDS_LEAST);
        let likeliest =
            self.alternatives.iter().enumerate().max_by(|a, b| a.1.log_odds.total_cmp(&b.1.log_odds));
        let (k, gained) = likeliest.map(|(k, a)| (k, a.log_odds))?;
        if gained < rule.odds.ln() {
            return None;
        }
        for a in &mut self.alternatives {
            a.log_odds -= gained;
        }
        let taken = &mut self.alternatives[k];
        std::mem::swap(&mut taken.joint, belief);
        (taken.log_odds, taken.age) = (-gained, 0);
        Some(gained)
    }
}
