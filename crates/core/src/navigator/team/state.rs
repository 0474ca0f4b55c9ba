//! What a snapshot of `team` holds beside its own core and radio.

use serde::{Deserialize, Serialize};

use super::group::Group;
use super::outgoing_data::OutgoingData;
use super::position_history::PositionHistory;
use super::range_record::RangeRecord;
use super::referee::Referee;
use super::shared_current::SharedCurrent;
use crate::error::Error;

/// A teammate that was heard.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Teammate {
    /// Where its block stands in time: the launch of its last packet.
    pub tol_ns: i64,
    /// Its dead reckoning then, m.
    pub position_m: [f64; 2],
    /// Low bits of that packet's counter.
    pub sequence: u8,
    /// Distance travelled since its last sounding that was used, m.
    pub since_sounding_m: Option<f64>,
    /// Fixes in a row that it told and that contradict its block.
    pub contradicting_fixes: u32,
}

/// Teammates, own data that is not told yet, counts.
#[derive(Clone, Serialize, Deserialize)]
pub struct TeamState<const K: usize> {
    /// Own data that is not told yet.
    pub outgoing: OutgoingData,
    /// By vehicle, who was heard.
    pub mates: Vec<Option<Teammate>>,
    /// Their Gaussians.
    pub groups: Vec<Group>,
    /// Where each particle was.
    pub history: PositionHistory,
    /// The current as vehicles share it.
    pub current: Option<SharedCurrent<K>>,
    /// It was shared until a velocity over ground came.
    pub current_given_up: bool,
    /// What the own echo sounder states, m.
    pub sigma_sounding_m: Option<f64>,
    /// Whether the lone filter is better.
    pub referee: Referee,
    /// What became of ranges.
    pub ranges: RangeRecord,
}

impl<const K: usize> TeamState<K> {
    /// Refuses the state of another team, or of another number of particles.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check_same(&self, other: &Self, particles: usize, shares_current: bool) -> Result<(), Error> {
        let refused = || Err(Error::Snapshot("made with another team".into()));
        if other.groups.len() != self.groups.len() || other.mates.len() != self.mates.len() {
            return refused();
        }
        for (theirs, own) in other.groups.iter().zip(&self.groups) {
            theirs.check(particles, own.layout)?;
        }
        let shared = other.current.as_ref().map(|c| c.fits(particles, self.mates.len()));
        if !other.history.fits(particles)
            || (shared.is_some() || other.current_given_up) != shares_current
            || shared == Some(false)
        {
            return refused();
        }
        Ok(())
    }
}
