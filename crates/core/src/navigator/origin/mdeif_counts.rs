//! What became of the packets that `mdeif` received.

use serde::{Deserialize, Serialize};

/// How packets were taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Counts {
    pub(super) begun: u64,
    pub(super) exact_joint: u64,
    pub(super) equation_6: u64,
    pub(super) filtered_error: u64,
    pub(super) unknown_origin: u64,
    pub(super) unread: u64,
    pub(super) unsound: u64,
}

impl Counts {
    /// Each count with its name in the diagnostics.
    pub(super) fn by_name(&self) -> [(&'static str, f64); 7] {
        [
            ("begun", self.begun),
            ("exact_joint", self.exact_joint),
            ("equation_6", self.equation_6),
            ("filtered_error", self.filtered_error),
            ("unknown_origin", self.unknown_origin),
            ("unread", self.unread),
            ("unsound", self.unsound),
        ]
        .map(|(name, count)| (name, count as f64))
    }
}
