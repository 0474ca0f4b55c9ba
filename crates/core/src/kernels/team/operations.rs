//! Which states a group of teammates has, and what a packet does to them.

use serde::{Deserialize, Serialize};

/// States of one teammate without its clock.
pub const BLOCK: usize = 7;

/// Which states a group has: s, then blocks of 7, or of 9 with β and β̇.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct BlockLayout {
    /// The sound speed may be off by a scale that all ranges share.
    pub scale: bool,
    /// The teammates' clocks may differ from the own one.
    pub clock: bool,
}

impl BlockLayout {
    /// States before the first block.
    #[must_use]
    pub const fn head(self) -> usize {
        self.scale as usize
    }

    /// States of one block.
    #[must_use]
    pub const fn stride(self) -> usize {
        if self.clock { BLOCK + 2 } else { BLOCK }
    }

    /// First state of the block at this place.
    #[must_use]
    pub const fn base(self, place: usize) -> usize {
        self.head() + place * self.stride()
    }

    /// β of the block at `base`.
    #[must_use]
    pub const fn clock_of(self, base: usize) -> Option<usize> {
        if self.clock { Some(base + BLOCK) } else { None }
    }
}

/// Elements of a packed lower triangle of `d` rows.
#[must_use]
pub const fn packed_len(d: usize) -> usize {
    d * (d + 1) / 2
}

/// Place of (row, column) in a packed lower triangle; either order.
#[inline(always)]
#[must_use]
pub const fn packed(r: usize, c: usize) -> usize {
    if r >= c { packed_len(r) + c } else { packed_len(c) + r }
}

/// One block moves on by `dt_s`: position += displacement + F [c, heading, thrust].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Commanded displacement, m.
    pub displacement_m: [f64; 2],
    /// Length of the step, s.
    pub dt_s: f64,
    /// Commanded speed, m/s: over it the displacement is what a metre per second of thrust bias adds. Below 5 cm/s a
    /// bias has no direction.
    pub speed_mps: f64,
    /// White noise of the position per axis, m²/s.
    pub position_m2_per_s: f64,
    /// Walks of current (each axis), heading bias and thrust bias, per second.
    pub walk_per_s: [f64; 3],
    /// Walk of the clock difference as a range, m²/s.
    pub clock_m2_per_s: f64,
}

/// A measured horizontal range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeOp {
    /// m.
    pub range_m: f64,
    /// m².
    pub variance_m2: f64,
}

/// One thing that a packet says about the sender's block, in the order of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Op {
    /// Time passes.
    Predict(Prediction),
    /// A sounding of the sender.
    Sounding {
        /// m.
        water_depth_m: f64,
        /// Variance of sounding and rounding, m².
        noise_m2: f64,
        /// Walk of the datum offset, m².
        walk_m2: f64,
        /// Soundings that share one chart error, n_c ≥ 1.
        shared: f64,
    },
    /// A position fix of the sender.
    Fix {
        /// m.
        position_m: [f64; 2],
        /// Variance per axis, m².
        variance_m2: f64,
    },
    /// A range between the sender and where this vehicle was: `own` chooses the columns of [`Own`].
    RangeToOwn {
        /// Which of the two instants.
        own: usize,
        /// Who measured it: +1 this vehicle, whose clock ahead makes it longer; −1 the sender.
        clock_sign: f64,
        /// What was measured.
        range: RangeOp,
    },
    /// A range that the sender measured to another block.
    RangeToBlock {
        /// First state of the other block.
        base: usize,
        /// What was measured.
        range: RangeOp,
    },
}

impl Op {
    /// Whether it has a likelihood.
    #[must_use]
    pub fn weighs(&self) -> bool {
        !matches!(self, Self::Predict(_))
    }

    /// Whether it is a range.
    #[must_use]
    pub fn is_range(&self) -> bool {
        matches!(self, Self::RangeToOwn { .. } | Self::RangeToBlock { .. })
    }
}
