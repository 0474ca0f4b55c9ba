//! Recovery by consensus: several positionings that agree with each other against a belief that they contradict.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::odometry::Increment;
use super::pose_algebra::carried;
use crate::measurement::angle::wrap;

/// When the positionings replace the estimate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ConsensusRule {
    /// Positionings that are looked at.
    pub window: usize,
    /// Of these, how many must agree.
    pub quorum: usize,
    /// Largest χ² (three degrees of freedom) between two that agree.
    pub agree: f64,
    /// Least χ² between their mean and the belief for a reset.
    pub disagree: f64,
}

/// Poses in the landmark's frame, one for each of the last positionings, carried to now by odometry.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Consensus {
    poses: VecDeque<(Vector3<f64>, Matrix3<f64>)>,
}

impl Consensus {
    /// Clears the window: another landmark, or a new estimate.
    pub fn clear(&mut self) {
        self.poses.clear();
    }

    /// Carries all poses along the vehicle's motion.
    pub fn advance(&mut self, increment: &Increment, bias: &Vector3<f64>) {
        for (pose, covariance) in &mut self.poses {
            (*pose, *covariance) = carried(pose, covariance, increment, bias);
        }
    }

    /// Adds a pose seen now.
    pub fn push(&mut self, pose: Vector3<f64>, covariance: Matrix3<f64>, rule: &ConsensusRule) {
        self.poses.push_back((pose, covariance));
        while self.poses.len() > rule.window {
            self.poses.pop_front();
        }
    }

    /// The mean of the largest group that agrees, where it is a quorum and contradicts the belief.
    #[must_use]
    pub fn verdict(
        &self,
        belief: &Vector3<f64>,
        belief_covariance: &Matrix3<f64>,
        rule: &ConsensusRule,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let (centre, members) = self
            .poses
            .iter()
            .map(|centre| {
                let near = |other: &&(Vector3<f64>, Matrix3<f64>)| {
                    chi2(&apart(&other.0, &centre.0), &(other.1 + centre.1)) < rule.agree
                };
                (centre, self.poses.iter().filter(near).collect::<Vec<_>>())
            })
            .max_by_key(|(_, members)| members.len())?;
        // The one seen last must be of the group: the belief is compared with what holds now.
        let last = self.poses.back()?;
        if members.len() < rule.quorum || !members.iter().any(|m| std::ptr::eq(*m, last)) {
            return None;
        }
        let (mut information, mut vector) = (Matrix3::zeros(), Vector3::zeros());
        for (pose, covariance) in members {
            let inverse = covariance.try_inverse()?;
            information += inverse;
            vector += inverse * apart(pose, &centre.0);
        }
        let covariance = information.try_inverse()?;
        let shift = covariance * vector;
        let mean = Vector3::new(centre.0.x + shift.x, centre.0.y + shift.y, wrap(centre.0.z + shift.z));
        let contradiction = chi2(&apart(&mean, belief), &(covariance + belief_covariance));
        (contradiction > rule.disagree).then_some((mean, covariance))
    }
}

fn apart(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(a.x - b.x, a.y - b.y, wrap(a.z - b.z))
}

/// Squared Mahalanobis length; infinite where the covariance cannot be inverted.
fn chi2(d: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    covariance.try_inverse().map_or(f64::INFINITY, |inverse| d.dot(&(inverse * d)))
}
