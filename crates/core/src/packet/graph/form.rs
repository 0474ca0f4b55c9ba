//! How a pose graph's packet is laid out.

use crate::packet::header::PacketKind;

/// Layout of a pose graph's packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum GraphForm {
    /// Float64 throughout.
    F64,
    /// Rounded, for one frame of 32 bytes; only where x and y have identical, decoupled filters.
    Frame32,
    /// Rounded, for one frame of 64 bytes.
    Frame64,
    /// Rounded, for one frame of 256 bytes.
    Frame256,
}

impl GraphForm {
    /// The step in which a packet of this form carries a depth, m, where it counts in the noise of a range.
    pub fn depth_step_m(self, depth_m: f64) -> f64 {
        if self == Self::F64 { 0.0 } else { crate::packet::Header::coarse_depth_step_m(depth_m) }
    }

    /// Packets that an acknowledgement bitmap looks back on.
    #[must_use]
    pub fn acknowledged(self) -> u32 {
        match self {
            Self::F64 | Self::Frame256 => 32,
            Self::Frame64 | Self::Frame32 => 16,
        }
    }

    pub(in crate::packet) fn kind(self) -> PacketKind {
        match self {
            Self::F64 => PacketKind::GraphF64,
            Self::Frame32 => PacketKind::Graph32,
            Self::Frame64 => PacketKind::Graph64,
            Self::Frame256 => PacketKind::Graph256,
        }
    }
}
