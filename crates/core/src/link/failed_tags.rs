//! How often a receiver tries tags in one slot: what is not limited can be guessed.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Counts tags that failed, by slot: after [`MOST`](Self::MOST) of them a receiver is deaf until the slot is over.
///
/// A slot carries one packet, and echoes of it. More tries are a forger's, each of which passes with probability 2^(−8n).
/// With the limit their rate is that of the slots, whatever the forger's modem can do. The price is that a forger who
/// fills the limit silences the slot, which noise does as well.
///
/// The [`SLOTS`](Self::SLOTS) newest slots of each sender that saw a failure are remembered; older ones count as
/// exhausted then, so that going back to them gains no tries.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailedTags {
    failures: Vec<BTreeMap<i64, u32>>,
}

impl FailedTags {
    /// Failed tags after which a receiver is deaf for the slot.
    pub const MOST: u32 = 4;
    /// Slots of each sender that are remembered.
    pub const SLOTS: usize = 8;

    /// For a team of so many vehicles.
    #[must_use]
    pub fn new(vehicles: usize) -> Self {
        Self { failures: vec![BTreeMap::new(); vehicles] }
    }

    /// Whether nothing is heard any more in the slot of `sender` at `tol_ns`.
    #[must_use]
    pub fn is_deaf(&self, sender: u16, tol_ns: i64) -> bool {
        let Some(slots) = self.failures.get(usize::from(sender)) else { return true };
        match slots.get(&tol_ns) {
            Some(&failures) => failures >= Self::MOST,
            None => slots.len() >= Self::SLOTS && slots.keys().next().is_some_and(|&oldest| tol_ns < oldest),
        }
    }

    /// Counts one tag that failed.
    pub fn count(&mut self, sender: u16, tol_ns: i64) {
        let Some(slots) = self.failures.get_mut(usize::from(sender)) else { return };
        let failures = slots.entry(tol_ns).or_default();
        *failures = failures.saturating_add(1);
        while slots.len() > Self::SLOTS {
            slots.pop_first();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_slot_is_deaf_after_four_failures_and_others_are_not() {
        let mut failed = FailedTags::new(2);
        for _ in 0..FailedTags::MOST {
            assert!(!failed.is_deaf(1, 10));
            failed.count(1, 10);
        }
        assert!(failed.is_deaf(1, 10));
        assert!(!failed.is_deaf(1, 11));
        assert!(!failed.is_deaf(0, 10));
        assert!(failed.is_deaf(2, 10), "a vehicle that the team does not have");
    }

    proptest! {
        /// In whatever order slots are tried, none gets more than its tries, and memory stays bounded.
        #[test]
        fn no_slot_gets_more_tries_than_the_limit(slots in prop::collection::vec(0_i64..30, 0..400)) {
            let mut failed = FailedTags::new(1);
            let mut tries = BTreeMap::new();
            for tol_ns in slots {
                if !failed.is_deaf(0, tol_ns) {
                    *tries.entry(tol_ns).or_insert(0) += 1;
                    failed.count(0, tol_ns);
                }
                prop_assert!(failed.failures[0].len() <= FailedTags::SLOTS);
            }
            prop_assert!(tries.values().all(|&count| count <= FailedTags::MOST));
        }
    }
}
