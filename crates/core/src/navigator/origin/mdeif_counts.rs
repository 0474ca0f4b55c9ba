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
