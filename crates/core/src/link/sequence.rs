//! Packet counters: the sender's own, and what a receiver has admitted from one peer.

use super::LinkError;
use serde::{Deserialize, Serialize};

/// Counts the packets that a vehicle sends. Eight bits of the counter travel; the rest follows at the receiver.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sequencer {
    next: u64,
}

impl Sequencer {
    /// A sequencer whose first packet is number 0.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The counter of the packet to be sent next.
    #[must_use]
    pub fn peek(&self) -> u64 {
        self.next
    }

    /// The eight bits of it that travel.
    #[must_use]
    pub fn residue(&self) -> u8 {
        residue(self.next)
    }

    /// Takes the counter for a packet that is sent now.
    ///
    /// # Errors
    /// [`LinkError::CounterExhausted`] after 2⁶⁴ − 1 packets; nothing has changed then.
    pub fn take(&mut self) -> Result<u64, LinkError> {
        let counter = self.next;
        self.next = counter.checked_add(1).ok_or(LinkError::CounterExhausted { counter })?;
        Ok(counter)
    }

    /// The last packet sent, if any.
    #[must_use]
    pub fn last(&self) -> Option<u64> {
        self.next.checked_sub(1)
    }
}

/// A packet that a [`ReceiveWindow`] is ready to accept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Admission {
    /// The sender's counter, extended from eight bits.
    pub counter: u64,
    /// Launch time, ns.
    pub tol_ns: i64,
}

/// Keeps packets of *one* peer from being used twice.
///
/// Each packet has a counter, of which eight bits travel, and a launch time, which its slot implies and its checksum
/// (or tag) covers; both grow together. The window remembers the last [`ReceiveWindow::LENGTH`] accepted packets.
///
/// * Launched after the newest one: accepted; its counter is the next one with those eight bits. So a peer that falls
///   silent for any time is heard again at once, while a gap of more than 256 lost packets counts as too few.
/// * Launched between two remembered ones (overtaken on the way): accepted once, if its counter fits between theirs.
/// * Launched when another one was: a duplicate. Launched before all that are remembered: too old.
///
/// Rejection changes nothing. [`check`](Self::check) decides and [`commit`](Self::commit) records, so that a
/// navigator can validate a packet's content in between; [`accept`](Self::accept) does both.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Admission>", into = "Vec<Admission>")]
pub struct ReceiveWindow {
    /// Oldest first; counters and launch times both strictly increase.
    accepted: Vec<Admission>,
}

impl ReceiveWindow {
    /// Accepted packets that are remembered.
    pub const LENGTH: usize = 32;

    /// A window that has accepted nothing. Allocates once, for its whole life.
    #[must_use]
    pub fn new() -> Self {
        Self { accepted: Vec::with_capacity(Self::LENGTH) }
    }

    /// The newest accepted packet.
    #[must_use]
    pub fn newest(&self) -> Option<Admission> {
        self.accepted.last().copied()
    }

    /// Whether the packet launched at `tol_ns` was accepted and is remembered.
    #[must_use]
    pub fn contains(&self, tol_ns: i64) -> bool {
        self.accepted.binary_search_by_key(&tol_ns, |packet| packet.tol_ns).is_ok()
    }

    /// Decides about a packet with these eight bits of its counter, launched at `tol_ns`. Changes nothing.
    ///
    /// # Errors
    /// [`LinkError::Duplicate`], [`LinkError::TooOld`], [`LinkError::OutOfSequence`], each a reason to reject it;
    /// [`LinkError::CounterExhausted`].
    pub fn check(&self, sequence: u8, tol_ns: i64) -> Result<Admission, LinkError> {
        let after = self.accepted.partition_point(|packet| packet.tol_ns < tol_ns);
        let lower = after.checked_sub(1).and_then(|index| self.accepted.get(index));
        let upper = self.accepted.get(after);
        let counter = match (lower, upper) {
            (None, None) => u64::from(sequence),
            (_, Some(upper)) if upper.tol_ns == tol_ns => {
                return Err(LinkError::Duplicate { sequence, tol_ns });
            }
            (None, Some(upper)) => {
                return Err(LinkError::TooOld { sequence, tol_ns, oldest_ns: upper.tol_ns });
            }
            (Some(lower), _) => {
                let counter = successor(lower.counter, sequence)?;
                if let Some(upper) = upper
                    && counter >= upper.counter
                {
                    let (lower, upper) = (lower.counter, upper.counter);
                    return Err(LinkError::OutOfSequence { sequence, tol_ns, lower, upper });
                }
                counter
            }
        };
        Ok(Admission { counter, tol_ns })
    }

    /// Records a packet that [`check`](Self::check) admitted.
    ///
    /// # Errors
    /// [`LinkError::StaleAdmission`] when the window would not admit it now; nothing has changed then.
    pub fn commit(&mut self, admission: Admission) -> Result<(), LinkError> {
        let Admission { counter, tol_ns } = admission;
        if self.check(residue(counter), tol_ns) != Ok(admission) {
            return Err(LinkError::StaleAdmission { counter, tol_ns });
        }
        if self.accepted.len() >= Self::LENGTH {
            self.accepted.remove(0);
        }
        let place = self.accepted.partition_point(|packet| packet.tol_ns < tol_ns);
        self.accepted.insert(place, admission);
        Ok(())
    }

    /// Decides and records in one step; gives the extended counter.
    ///
    /// # Errors
    /// As [`check`](Self::check); nothing has changed then.
    pub fn accept(&mut self, sequence: u8, tol_ns: i64) -> Result<u64, LinkError> {
        let admission = self.check(sequence, tol_ns)?;
        self.commit(admission)?;
        Ok(admission.counter)
    }
}

impl TryFrom<Vec<Admission>> for ReceiveWindow {
    type Error = LinkError;

    fn try_from(packets: Vec<Admission>) -> Result<Self, LinkError> {
        super::error::within("packets in a receive window", packets.len() as f64, 0.0, Self::LENGTH as f64)?;
        for (lower, upper) in packets.iter().zip(packets.iter().skip(1)) {
            if lower.tol_ns >= upper.tol_ns || lower.counter >= upper.counter {
                return Err(LinkError::OutOfSequence {
                    sequence: residue(upper.counter),
                    tol_ns: upper.tol_ns,
                    lower: lower.counter,
                    upper: upper.counter,
                });
            }
        }
        let mut window = Self::new();
        window.accepted.extend(packets);
        Ok(window)
    }
}

impl From<ReceiveWindow> for Vec<Admission> {
    fn from(window: ReceiveWindow) -> Self {
        window.accepted
    }
}

/// The low eight bits.
pub(super) fn residue(counter: u64) -> u8 {
    (counter & 0xFF) as u8
}

/// The next counter after `newest` with these low bits, 1 to 256 further.
fn successor(newest: u64, sequence: u8) -> Result<u64, LinkError> {
    let step = match sequence.wrapping_sub(residue(newest)) {
        0 => 256,
        step => u64::from(step),
    };
    newest.checked_add(step).ok_or(LinkError::CounterExhausted { counter: newest })
}
