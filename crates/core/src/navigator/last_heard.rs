//! The belief that each teammate last broadcast, as far as a later packet or a user asks for it.

use serde::{Deserialize, Serialize};

use crate::event::VehicleId;

/// Launch and covariance of each teammate's last packet that was fused.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LastHeard {
    last: Vec<Option<LastBroadcast>>,
}

/// A broadcast position belief without its mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LastBroadcast {
    /// Launch, ns.
    pub tol_ns: i64,
    /// [ee, en, nn], m².
    pub covariance_m2: [f64; 3],
}

impl LastHeard {
    /// Of a team of `vehicles` in which no packet was received yet.
    #[must_use]
    pub fn new(vehicles: usize) -> Self {
        Self { last: vec![None; vehicles] }
    }

    /// This teammate's last broadcast; `None` before its first one.
    #[must_use]
    pub fn of(&self, sender: VehicleId) -> Option<LastBroadcast> {
        self.last.get(usize::from(sender)).copied().flatten()
    }

    /// The last broadcasts of those that were heard: launch, ns, and covariance [ee, en, nn], m².
    pub fn all(&self) -> impl Iterator<Item = (i64, [f64; 3])> + '_ {
        self.last.iter().flatten().map(|last| (last.tol_ns, last.covariance_m2))
    }

    /// Keeps the covariance of a packet for the next one.
    pub fn keep(&mut self, sender: VehicleId, tol_ns: i64, covariance_m2: [f64; 3]) {
        if let Some(last) = self.last.get_mut(usize::from(sender)) {
            *last = Some(LastBroadcast { tol_ns, covariance_m2 });
        }
    }
}
