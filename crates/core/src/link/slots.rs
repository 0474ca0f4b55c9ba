//! Who may launch when (TDMA).

use super::error::within;
use super::{LinkConfig, LinkError};
use serde::{Deserialize, Serialize};

/// One chance to transmit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slot {
    /// Launch time: when the signal starts, ns since the mission's epoch.
    pub tol_ns: i64,
    /// Index of the vehicle whose slot it is.
    pub sender: u16,
    /// Bytes that fit; 0 where nothing does.
    pub capacity_bytes: usize,
}

/// All slots of a mission in the order of their launch times, which are all different.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Slot>", into = "Vec<Slot>")]
pub struct SlotTable {
    slots: Vec<Slot>,
}

impl SlotTable {
    /// More vehicles never share a channel. What a packet can name of them is bounded by its own layout.
    pub const SENDERS_MAX: u16 = 1024;

    /// Checks the order and keeps the slots.
    ///
    /// # Errors
    /// [`LinkError::SlotOrder`] for a slot that does not start after the one before it; [`LinkError::OutOfRange`] for
    /// a sender index of [`SlotTable::SENDERS_MAX`] or more.
    pub fn new(slots: Vec<Slot>) -> Result<Self, LinkError> {
        let mut previous: Option<(usize, i64)> = None;
        for (index, slot) in slots.iter().enumerate() {
            within("sender index", f64::from(slot.sender), 0.0, f64::from(Self::SENDERS_MAX - 1))?;
            if let Some((before, previous_ns)) = previous
                && slot.tol_ns <= previous_ns
            {
                return Err(LinkError::SlotOrder { index, tol_ns: slot.tol_ns, before, previous_ns });
            }
            previous = Some((index, slot.tol_ns));
        }
        Ok(Self { slots })
    }

    /// Checks that a full slot is off the air before the next one starts.
    ///
    /// # Errors
    /// [`LinkError::SlotOverlap`] with the arithmetic; [`LinkError::TooManyFrames`] when a slot is said to hold more
    /// than the modem sends in one go.
    pub fn check_against(&self, link: &LinkConfig) -> Result<(), LinkError> {
        for (slot, next) in self.slots.iter().zip(self.slots.iter().skip(1).map(Some).chain([None])) {
            if slot.capacity_bytes == 0 {
                continue;
            }
            let air_time_ns = link.air_time_ns(slot.capacity_bytes)?;
            let gap_ns = next.map_or(i64::MAX, |next| next.tol_ns.saturating_sub(slot.tol_ns));
            if air_time_ns > gap_ns {
                let Slot { tol_ns, capacity_bytes, .. } = *slot;
                return Err(LinkError::SlotOverlap { tol_ns, capacity_bytes, air_time_ns, gap_ns });
            }
        }
        Ok(())
    }

    /// The slots, earliest first.
    #[must_use]
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// The slot that starts at `tol_ns`.
    #[must_use]
    pub fn at(&self, tol_ns: i64) -> Option<&Slot> {
        self.slots
            .binary_search_by_key(&tol_ns, |slot| slot.tol_ns)
            .ok()
            .and_then(|index| self.slots.get(index))
    }

    /// The last slot of `sender` that starts before `before_ns`.
    #[must_use]
    pub fn previous_of(&self, sender: u16, before_ns: i64) -> Option<&Slot> {
        let end = self.slots.partition_point(|slot| slot.tol_ns < before_ns);
        self.slots.iter().take(end).rfind(|slot| slot.sender == sender)
    }

    /// The first slot of `sender` that starts at `from_ns` or later.
    #[must_use]
    pub fn next_of(&self, sender: u16, from_ns: i64) -> Option<&Slot> {
        let start = self.slots.partition_point(|slot| slot.tol_ns < from_ns);
        self.slots.iter().skip(start).find(|slot| slot.sender == sender)
    }

    /// Checks that `sender` may launch a packet of `bytes` at `tol_ns`, and gives its slot.
    ///
    /// # Errors
    /// [`LinkError::NoSlot`] when it is not this sender's slot, [`LinkError::SlotTooShort`] for too long a packet.
    pub fn check_packet(&self, sender: u16, tol_ns: i64, bytes: usize) -> Result<&Slot, LinkError> {
        let slot = self
            .at(tol_ns)
            .filter(|slot| slot.sender == sender)
            .ok_or(LinkError::NoSlot { sender, tol_ns })?;
        if bytes > slot.capacity_bytes {
            let capacity_bytes = slot.capacity_bytes;
            return Err(LinkError::SlotTooShort { bytes, sender, tol_ns, capacity_bytes });
        }
        Ok(slot)
    }
}

impl TryFrom<Vec<Slot>> for SlotTable {
    type Error = LinkError;

    fn try_from(slots: Vec<Slot>) -> Result<Self, LinkError> {
        Self::new(slots)
    }
}

impl From<SlotTable> for Vec<Slot> {
    fn from(table: SlotTable) -> Self {
        table.slots
    }
}
