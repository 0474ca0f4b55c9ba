//! The packet of a role exchange: the mover's belief on itself and the landmark, in 8 to 128 bytes.
//!
//! # Coordinates
//!
//! u = [x_L, y_L, ψ_L, ρ, β, γ]: the landmark's pose, the distance to the mover M, and M's bearing and yaw as the
//! landmark sees them. They wrap cleanly, and what positioning knows well (ρ, β, γ) stays apart from what drifts.
//!
//! # Format 2, the default
//!
//! | bytes | type 3 | seq 4 | modes − 1 | x_L, y_L | ψ_L | ρ | β | γ | six σ | fifteen correlations | check |
//! |---|---|---|---|---|---|---|---|---|---|---|---|
//! | 8 | 0 | – | – | 8 at 1/8 m modulo 32 m | 9 | 9 at 1/8 m | 9 | 8 | class, 2 together | – | CRC-8 |
//! | 16 | 1 | yes | – | 18 at 1/64 m | 12 | 12 at 1/32 m | 11 | 10 | 4, ¾ octave, up | – | CRC-16 |
//! | 32 | 2 | yes | – | 17 at 1/32 m | 12 | 12 at 1/32 m | 13 | 12 | L: 9, 1/32 octave; M: 7, ⅛ octave | L: 9, tanh(q/64); M: 7, tanh(q/16); L–M: 6, tanh(q/8) | CRC-16 |
//! | 40 | 5 | yes | – | 20 at 1/64 m | 16 | 14 at 1/64 m | 16 | 16 | 9, 1/32 octave | 9, tanh(q/64) | CRC-16 |
//! | 64 | 3 | yes | 2 | as 32 for the first of two modes | | | | | | | CRC-16 |
//! | 128 | 4 | yes | 2 | as 32 for the first of four modes | | | | | | | CRC-16 |
//!
//! L stands for (x_L, y_L, ψ_L), M for (ρ, β, γ). Over many exchanges the landmark's σ grow by a few percent each time:
//! steps of ⅛ octave would round every such growth away and the belief would become certain of itself.
//!
//! A further mode has six differences to the first one's mean, 12 bits each in the same steps, its share in 1/256
//! (8 bits), then σ and correlations as the first. Zero bits fill up to the check.
//!
//! * Angles are of 2π / 2^bits, means to the nearest step. What rounding does to a mean is added to the variance by the
//!   receiver (step²/12), so a chain of exchanges stays honest.
//! * σ = σ₀ 2^(q/n): σ₀ = 0.5 mm and 1/256° (16 bytes: 1 cm and 0.02°), nearest; smaller ones become σ₀.
//!   The class c of 8 bytes means [0.15 m, 0.15 m, 0.35°, 0.075 m, 0.15°, 0.5°] · 2^c, the least that covers all six.
//! * Correlations are the partial ones of the Cholesky factor, in the order (2,1), (3,1), (3,2), (4,1), …, so any bits
//!   give a positive definite matrix.
//! * The check covers the sender and the launch time, which the slot implies ([`append_crc`]); 8 bytes have room for
//!   CRC-8/SMBUS only. A value that does not fit is an error at the sender.
//! * 8 and 16 bytes have no correlations, 8 bytes no sequence either: x_L, y_L and ψ_L are correlated after some
//!   exchanges, and what is lost there shows as overconfidence. They are for a few exchanges.
//!
//! # Format 1
//!
//! The layout of the reference cases: 16 bytes have 6 bits per σ (¼ octave, base as 32 bytes) and, like 8 bytes
//! (x_L, y_L 9 bits at 1/16 m modulo 32 m; ψ_L 10; ρ 10 at 1/16 m; β 11; γ 10; class 2, nearest to the geometric mean),
//! no check at all; 32, 64 and 128 bytes have x_L, y_L 18 bits at 1/64 m, ρ 13 at 1/64 m, ψ_L, β, γ 12, σ 7 (⅛ octave),
//! correlations 7 (tanh(q/16)), a CRC that does not know sender or launch time, and no variance of rounding. There is
//! none of 40 bytes.

mod checks;
mod correlation;
mod layout;
mod reading;
#[cfg(test)]
mod tests;

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::{PacketError, append_crc, check_crc};
use crate::mixture::Mode;
use layout::Layout;

/// Which layout a team uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ExchangeFormat {
    /// That of the reference cases.
    One,
    /// The default: check over the implied fields, honest variances.
    Two,
}

/// Sizes of the packet: whole ALOC signals of 8 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ExchangeSize {
    /// 8 bytes, one signal.
    B8,
    /// 16 bytes.
    B16,
    /// 32 bytes.
    B32,
    /// 40 bytes.
    B40,
    /// 64 bytes, up to two modes.
    B64,
    /// 128 bytes, up to four modes.
    B128,
}

impl ExchangeSize {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::B8, Self::B16, Self::B32, Self::B40, Self::B64, Self::B128];

    /// Bytes.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::B8 => 8,
            Self::B16 => 16,
            Self::B32 => 32,
            Self::B40 => 40,
            Self::B64 => 64,
            Self::B128 => 128,
        }
    }

    /// The size of so many bytes.
    ///
    /// # Errors
    /// [`PacketError::Length`].
    pub fn from_bytes(bytes: usize) -> Result<Self, PacketError> {
        Self::ALL
            .into_iter()
            .find(|s| s.bytes() == bytes)
            .ok_or(PacketError::Length { bytes, expected: Self::B32.bytes() })
    }

    /// Most modes that it carries.
    #[must_use]
    pub fn modes(self) -> usize {
        match self {
            Self::B64 => 2,
            Self::B128 => 4,
            _ => 1,
        }
    }

    /// The shortest size for so many modes: a belief of one mode gains nothing from the bytes that others would need, and
    /// each further signal may be lost.
    #[must_use]
    pub fn least_for(self, modes: usize) -> Self {
        [Self::B32, Self::B64, Self::B128]
            .into_iter()
            .find(|least| self.modes() > 1 && least.modes() >= modes && *least != self)
            .map_or(self, |least| if least.bytes() < self.bytes() { least } else { self })
    }

    /// Whether a sender of this size may send so many bytes.
    #[must_use]
    pub fn admits(self, bytes: usize) -> bool {
        (1..=self.modes()).any(|modes| self.least_for(modes).bytes() == bytes)
    }

    fn code(self) -> u64 {
        match self {
            Self::B8 => 0,
            Self::B16 => 1,
            Self::B32 => 2,
            Self::B64 => 3,
            Self::B128 => 4,
            Self::B40 => 5,
        }
    }
}

/// What a role exchange says.
#[derive(Debug, Clone, PartialEq)]
pub struct ExchangePacket {
    /// The sender's exchange counter modulo 16; `None` in 8 bytes.
    pub sequence: Option<u8>,
    /// Modes of u, in rad and m.
    pub modes: Vec<Mode<6>>,
}

impl ExchangePacket {
    /// The packet's bytes for `sender` and `tol_ns`.
    ///
    /// # Errors
    /// [`PacketError::OutOfRange`] for a value, a share or a number of modes that the size does not hold,
    /// [`PacketError::NotFinite`], [`PacketError::NotDefinite`], [`PacketError::Length`] for format 1 in 40 bytes.
    pub fn encode(
        &self,
        format: ExchangeFormat,
        size: ExchangeSize,
        sender: u16,
        tol_ns: i64,
    ) -> Result<Vec<u8>, PacketError> {
        let layout = Layout::of(format, size)?;
        let writer = layout.write(self)?;
        match (format, size) {
            (ExchangeFormat::One, ExchangeSize::B8 | ExchangeSize::B16) => Ok(writer.finish()),
            (ExchangeFormat::One, ExchangeSize::B32) => checks::finish_shifted(self, &layout),
            (ExchangeFormat::One, _) => {
                let mut bytes = writer.finish();
                bytes.resize(size.bytes() - 2, 0);
                let crc = super::CRC.checksum(&bytes);
                bytes.extend_from_slice(&crc.to_be_bytes());
                Ok(bytes)
            }
            (ExchangeFormat::Two, ExchangeSize::B8) => {
                let mut bytes = writer.finish();
                bytes.push(checks::check_8(&bytes, sender, tol_ns));
                super::layout::note("check over sender and launch time", 8);
                Ok(bytes)
            }
            (ExchangeFormat::Two, _) => {
                let mut bytes = writer.finish();
                bytes.resize(size.bytes() - 2, 0);
                Ok(append_crc(bytes, sender, tol_ns))
            }
        }
    }

    /// Reads what `sender` launched at `tol_ns`. `landmark_m` is where the receiver takes the landmark to be: positions
    /// in 8 bytes are modulo 32 m, the others ignore it. Any bytes give a typed result.
    ///
    /// # Errors
    /// [`PacketError::Length`], [`PacketError::Checksum`], [`PacketError::InvalidCode`], [`PacketError::Padding`].
    pub fn decode(
        bytes: &[u8],
        format: ExchangeFormat,
        landmark_m: [f64; 2],
        sender: u16,
        tol_ns: i64,
    ) -> Result<Self, PacketError> {
        let size = ExchangeSize::from_bytes(bytes.len())?;
        let layout = Layout::of(format, size)?;
        match (format, size) {
            (ExchangeFormat::One, ExchangeSize::B8 | ExchangeSize::B16) => layout.read(bytes, 0, landmark_m),
            (ExchangeFormat::One, ExchangeSize::B32) => {
                let packet = layout.read(bytes, 17, landmark_m)?;
                // The check is over the bits read, so it is made anew and compared.
                checks::compare_shifted(bytes)?;
                Ok(packet)
            }
            (ExchangeFormat::One, _) => {
                let (payload, tail) = checks::split_tail(bytes)?;
                let computed = super::CRC.checksum(payload);
                if computed != tail {
                    return Err(PacketError::Checksum { received: tail, computed });
                }
                layout.read(payload, 0, landmark_m)
            }
            (ExchangeFormat::Two, ExchangeSize::B8) => {
                checks::compare_8(bytes, sender, tol_ns)?;
                layout.read(&bytes[..7], 0, landmark_m)
            }
            (ExchangeFormat::Two, _) => layout.read(check_crc(bytes, sender, tol_ns)?, 0, landmark_m),
        }
    }
}

/// The covariance with a floor for what is known exactly, so that correlations are defined.
fn floored(covariance: &SMatrix<f64, 6, 6>, floor: &SVector<f64, 6>) -> SMatrix<f64, 6, 6> {
    let mut out = (covariance + covariance.transpose()) * 0.5;
    for k in 0..6 {
        out[(k, k)] += floor[k] * floor[k];
    }
    out
}
