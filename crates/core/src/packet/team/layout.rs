//! How a team's packets are laid out.

use super::report::{KNOTS_MAX, SOUNDINGS_MAX};
use crate::packet::{Header, ModuloField, PacketError};

pub(super) const HEARD_BITS: u32 = 0;
pub(super) const PIECE_BITS: u32 = 9;
pub(super) const DIFFERENCE_BITS: u32 = 7;
const FIX_BITS: usize = 3 + 10 + 1 + 2 * 12 + 5;
/// Header, window, position, scale of the pieces.
const HEAD_BITS: usize = Header::bits(HEARD_BITS) as usize + 7 + 32 + 2;
const SOUNDING_HEAD_BITS: usize = 5 + 3 + 2 + 11;
const RANGE_BITS: usize = 2 + 13;
const PIECE_PAIR_BITS: usize = 2 * PIECE_BITS as usize;
/// A layout keeps at least so many soundings before it carries ranges.
const LEAST_SOUNDINGS: usize = 4;
/// The low bits of the counter of the packet that a range was measured with.
pub(super) const COUNTER: ModuloField = ModuloField { name: "counter of a range", bits: 2 };
/// Spacings of soundings, s.
pub const SPACINGS_S: [f64; 8] = [1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];

/// How a team's packets are laid out: both ends know it from the team's size and the frame.
///
/// `payload_bytes` are what is left of a frame for header and body. The rounded form, V = 3 in 28 bytes:
///
/// | field | bits | step | range | rounding |
/// |---|---|---|---|---|
/// | kind, sequence, depth | 4, 8, 10 | 1, 1, 0.1 m to 1/64 | depth 0 to 13,004.8 m | nearest |
/// | window | 7 | 1 s | 0 to 127 s | up |
/// | dead-reckoned position | 2 × 16 | 1/8 m | modulo 8192 m | nearest |
/// | scale e of the pieces | 2 | | steps of 2^e/8 m | |
/// | M pieces of displacement | 2 × 9 each | 2^e/8 m | ±32 … ±256 m | the sums to the nearest step |
/// | age of the newest sounding | 5 | 1/4 s | 0 to 7.75 s | nearest |
/// | spacing of soundings | 3 | | 1, 2, 3, 4, 6, 8, 12, 16 s | |
/// | scale d of soundings | 2 | | steps of 0.02·4^d m | |
/// | newest sounding | 11 | 0.02·4^d m | modulo 40.94 m·4^d; all ones: none | nearest |
/// | the S − 1 before it | 7 each | 0.02·4^d m | ±1.26 m·4^d from the one after; −64: none | the depths to the nearest step |
/// | a range for each teammate | 2 + 13 | counter, 1/4 m | 0.25 to 2047.75 m; 0: none | nearest |
///
/// A packet with a fix gives up soundings for it: age 3 + 10 (0.25·2^k s), which of the two 1, residual 2 × 12 (1/8 m,
/// ±256 m) or displacement since the start 2 × 12 (4 m, ±8192 m), σ 5 (quarter octaves from 1/4 m to 16 m, whole
/// ones to 2048 m, up).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TeamLayout {
    pub(super) vehicles: usize,
    pub(super) pieces: usize,
    pub(super) soundings: usize,
    ranges: usize,
    bits: usize,
}

impl TeamLayout {
    /// The layout for a team of `vehicles` (2 to 16) whose packets have `payload_bytes` for header and body.
    ///
    /// # Errors
    /// [`PacketError::Length`] where not even displacement, four soundings and a fix fit.
    pub fn new(vehicles: usize, payload_bytes: usize) -> Result<Self, PacketError> {
        let bits = payload_bytes * 8;
        let pieces = (3 + vehicles.saturating_sub(3) / 4).min(KNOTS_MAX);
        let fixed = HEAD_BITS + pieces * PIECE_PAIR_BITS + SOUNDING_HEAD_BITS;
        let soundings = |ranges: usize| {
            let left = bits.checked_sub(fixed + ranges * RANGE_BITS)?;
            Some((1 + left / DIFFERENCE_BITS as usize).min(SOUNDINGS_MAX))
        };
        let all = vehicles.saturating_sub(1);
        let least = LEAST_SOUNDINGS;
        let (ranges, soundings) = match (soundings(all), soundings(0)) {
            (Some(s), _) if s >= least => (all, s),
            (_, Some(s)) if s >= least => (0, s),
            _ => {
                let expected = (fixed + (least - 1) * DIFFERENCE_BITS as usize).div_ceil(8);
                return Err(PacketError::Length { bytes: payload_bytes, expected });
            }
        };
        Ok(Self { vehicles, pieces, soundings, ranges, bits })
    }

    /// M, pieces of the displacement.
    #[must_use]
    pub fn pieces(&self) -> usize {
        self.pieces
    }

    /// S, most soundings of a packet without a fix.
    #[must_use]
    pub fn soundings(&self) -> usize {
        self.soundings
    }

    /// Most soundings of a packet with a fix; 0 where the fix takes the newest sounding's place as well.
    #[must_use]
    pub fn soundings_beside_fix(&self) -> usize {
        let used = HEAD_BITS + self.pieces * PIECE_PAIR_BITS + self.ranges * RANGE_BITS + FIX_BITS;
        match self.bits.checked_sub(used + SOUNDING_HEAD_BITS) {
            Some(left) => (1 + left / DIFFERENCE_BITS as usize).min(self.soundings),
            None => 0,
        }
    }

    /// Whether packets carry ranges.
    #[must_use]
    pub fn has_ranges(&self) -> bool {
        self.ranges > 0
    }

    /// Length of the payload, bytes.
    #[must_use]
    pub fn payload_bytes(&self) -> usize {
        self.bits / 8
    }
}
