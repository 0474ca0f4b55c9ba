//! What goes through the water: bounded fields to bits and back.
//!
//! * [`BitWriter`], [`BitReader`]: bits, most significant first.
//! * [`UnsignedField`], [`FixedField`], [`ModuloField`], [`SigmaField`], [`CorrelationField`], [`AngleField`],
//!   [`FloatField`]: one value each. A value that does not fit is a [`PacketError`] at the sender, never a clip.
//!   Sigmas round up and correlations toward zero, so that rounding never overstates knowledge.
//! * [`Header`]: what every packet starts with.
//! * [`BeliefPacket`]: mean and covariance of a position, in 15 bytes or as `f64`.
//! * [`append_crc`], [`check_crc`]: the checksum at the end.
//!
//! # A packet on the channel
//!
//! ```text
//! | header | body | zero bits up to a whole byte | CRC-16, high byte first |
//! '---------------- payload ---------------------'
//! CRC over: payload | sender, u16 big-endian | tol_ns, i64 big-endian
//!                     '------ implied by the slot: cost no bytes ------'
//! ```
//!
//! The checksum is CRC-16/IBM-3740 (polynomial 0x1021, start 0xFFFF, no reflection, no final XOR; check value of
//! `123456789` 0x29B1). It finds every error of one, two or three bits in packets of up to 4,093 bytes (the implied
//! ten counted) and every burst of up to 16 bits, so every wrong sender; other damage, a wrong launch time among
//! it, passes with probability 2⁻¹⁶.
//!
//! # Where an authentication tag goes
//!
//! A checksum finds accidents, not forgers. A tag, computed with the team's key over the payload and
//! [`implied_bytes`], finds both, so it takes the checksum's place on the channel:
//! [`Authenticated`](crate::navigator::authenticated::Authenticated) puts a [`link::Authenticator`](crate::link::Authenticator) around any
//! navigator, no layout knows of it, and a tag of n bytes costs n − [`CRC_BYTES`].

mod bank;
mod belief;
mod bits;
mod cloud;
mod covering;
mod depth;
mod error;
mod field;
pub mod graph;
mod header;
pub mod landmark;
pub mod layout;
mod mixture;
mod team;
#[cfg(test)]
mod tests;
mod uncertainty;

pub use bank::{BankPacket, Member, Origins};
pub use belief::{BELIEF_BYTES, BELIEF_F64_BYTES, Belief, BeliefPacket};
pub use bits::{BitReader, BitWriter};
pub use cloud::CloudPacket;
pub use error::PacketError;
pub use field::{AngleField, FixedField, FloatField, ModuloField, Rounding, UnsignedField};
pub use header::{Header, HeardBitmap, PacketKind, TEAM_MAX};
pub use mixture::{MODES_MAX, MixturePacket};
pub use team::{
    FixContent, KNOTS_MAX, ReportedFix, ReportedRange, ReportedSounding, SOUNDINGS_MAX, SPACINGS_S,
    TeamLayout, TeamReport,
};
pub use uncertainty::{CorrelationField, SigmaField};

use crc::{CRC_16_IBM_3740, Crc};

/// Bytes that [`append_crc`] adds to a payload.
pub const CRC_BYTES: usize = 2;

const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);

/// The fields that both ends know from the slot, in the form that checksums (and tags) take them:
/// sender index as big-endian `u16`, then launch time in ns as big-endian `i64`.
#[must_use]
pub fn implied_bytes(sender: u16, tol_ns: i64) -> [u8; 10] {
    let [s0, s1] = sender.to_be_bytes();
    let [t0, t1, t2, t3, t4, t5, t6, t7] = tol_ns.to_be_bytes();
    [s0, s1, t0, t1, t2, t3, t4, t5, t6, t7]
}

fn checksum(payload: &[u8], sender: u16, tol_ns: i64) -> u16 {
    let mut digest = CRC.digest();
    digest.update(payload);
    digest.update(&implied_bytes(sender, tol_ns));
    digest.finalize()
}

/// Appends the CRC-16 over `payload` and the implied fields `sender` (index in the team) and `tol_ns` (launch time).
#[must_use]
pub fn append_crc(mut payload: Vec<u8>, sender: u16, tol_ns: i64) -> Vec<u8> {
    let crc = checksum(&payload, sender, tol_ns);
    layout::note_end_of_payload(payload.len());
    payload.extend_from_slice(&crc.to_be_bytes());
    payload
}

/// Checks what [`append_crc`] appended, for the sender and launch time that the slot implies, and returns the payload.
///
/// # Errors
/// [`PacketError::Length`] when there is no room for a checksum, [`PacketError::Checksum`] when it disagrees.
pub fn check_crc(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<&[u8], PacketError> {
    let Some((payload, tail)) = bytes.split_last_chunk::<CRC_BYTES>() else {
        return Err(PacketError::Length { bytes: bytes.len(), expected: CRC_BYTES });
    };
    let received = u16::from_be_bytes(*tail);
    let computed = checksum(payload, sender, tol_ns);
    if received == computed { Ok(payload) } else { Err(PacketError::Checksum { received, computed }) }
}
