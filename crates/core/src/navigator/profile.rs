//! What a navigator asks of the mission around it.

use serde::{Deserialize, Serialize};

use crate::event::Kind;

/// A set of kinds of events.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Kinds(u32);

impl Kinds {
    /// These kinds.
    #[must_use]
    pub const fn of(kinds: &[Kind]) -> Self {
        let (mut bits, mut k) = (0, 0);
        while k < kinds.len() {
            bits |= 1 << kinds[k] as u16;
            k += 1;
        }
        Self(bits)
    }

    /// Every kind.
    #[must_use]
    pub const fn all() -> Self {
        Self::of(&Kind::ALL)
    }

    /// This set and one kind more, if `wanted`.
    #[must_use]
    pub const fn with(self, kind: Kind, wanted: bool) -> Self {
        if wanted { Self(self.0 | 1 << kind as u16) } else { self }
    }

    /// Whether a kind is in the set.
    #[must_use]
    pub const fn contains(self, kind: Kind) -> bool {
        self.0 & (1 << kind as u16) != 0
    }
}

/// What a navigator asks of the mission around it, and what it uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Profile {
    /// Whether it has a use for ranges; one that has none never polls for one.
    pub takes_ranges: bool,
    /// Whether its packets end in the checksum of [`append_crc`](crate::packet::append_crc), which a tag then replaces.
    pub has_checksum: bool,
    /// Whether it must be told which of its packets arrived; no real link can.
    pub needs_delivery_oracle: bool,
    /// Kinds of events that can change its estimate or its packets. An event of any other kind only moves its clock.
    pub uses: Kinds,
}
