//! Recovery by hypotheses: that the vehicle was displaced without its odometry measuring it, tracked in parallel.
//!
//! After each positioning a copy of the belief is set apart whose own pose jumps just then, by little; and each complete
//! positioning founds another one that stands where it says: a jump to anywhere. All copies and the belief itself are
//! corrected by the same measurements with the same outlier mixture; each keeps the logarithm of its odds against the
//! belief, the prior of a jump included. The mixture explains an outlier at the price of its share, so one wild
//! measurement does not turn the odds; a few that agree with one jump do. The belief that gave way stays among the
//! alternatives with its odds, so a false alarm is taken back when the next measurements speak for it.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::joint::{Channels, Joint};
use super::model::Measurement;
use super::odometry::Increment;

/// Alternatives with less than e^−30 of the belief's odds are forgotten.
const LOG_ODDS_LEAST: f64 = -30.0;

/// What a jump is, and when it is believed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct JumpRule {
    /// Positionings that an alternative is followed for.
    pub window: u32,
    /// How far a jump goes, per axis, m.
    pub sigma_m: f64,
    /// How far it turns, rad.
    pub sigma_rad: f64,
    /// Prior odds of a jump between two positionings.
    pub share: f64,
    /// Posterior odds from which a jump is believed.
    pub odds: f64,
}

/// A belief, and what speaks for it.
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

    /// Sets a copy of the belief apart that jumped now.
    pub fn branch(&mut self, belief: &Joint, rule: &JumpRule) {
        let mut joint = belief.clone();
        joint.disturb(rule.sigma_m, rule.sigma_rad);
        self.alternatives.push_back(Alternative { joint, log_odds: rule.share.ln(), age: 0 });
    }

    /// Founds an alternative on a positioning that the belief expected with the log-evidence `believed`: its pose may be
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

    /// Corrects all alternatives by what the belief, with the log-evidence `believed`, was corrected by, and puts the
    /// likeliest in the belief's place where its odds suffice: then the logarithm of these.
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
