//! What every packet starts with.

use super::{BitReader, BitWriter, FixedField, ModuloField, PacketError, Rounding, UnsignedField};
use serde::{Deserialize, Serialize};

/// Most vehicles in a team that a [`HeardBitmap`] can name.
pub const TEAM_MAX: u16 = 16;

const KIND: UnsignedField = UnsignedField { name: "packet kind", bits: 4 };
const SEQUENCE: ModuloField = ModuloField { name: "sequence", bits: 8 };
const DEPTH: FixedField = FixedField {
    name: "sender's depth",
    unit: "m",
    bits: 10,
    steps_per_unit: 10.0,
    signed: false,
    rounding: Rounding::Nearest,
};
const HEARD: &str = "heard bitmap";

/// What a packet's body holds. Code 0 is never given out, so that zeros are not a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum PacketKind {
    /// 1: a rounded position belief, [`BeliefPacket`](super::BeliefPacket).
    Belief,
    /// 2: the same as `f64`.
    BeliefF64,
    /// 3: all particles with their weights, [`CloudPacket`](super::CloudPacket).
    Cloud,
    /// 4: a few modes, [`MixturePacket`](super::MixturePacket).
    Mixture,
    /// 14: a bank of beliefs, each with those whose information is in it, [`BankPacket`](super::BankPacket).
    Bank,
}

impl PacketKind {
    /// The four bits that stand for it, 1 to 15.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Belief => 1,
            Self::BeliefF64 => 2,
            Self::Cloud => 3,
            Self::Mixture => 4,
            Self::Bank => 14,
        }
    }

    fn from_code(code: u64) -> Result<Self, PacketError> {
        match code {
            1 => Ok(Self::Belief),
            2 => Ok(Self::BeliefF64),
            3 => Ok(Self::Cloud),
            4 => Ok(Self::Mixture),
            14 => Ok(Self::Bank),
            _ => Err(PacketError::InvalidCode { field: KIND.name, code }),
        }
    }
}

/// Whom the sender heard: bit v is set when it accepted a packet of vehicle v since its own previous packet. The sender's
/// own bit stays zero.
///
/// In a round robin that is v's last slot, so one bit per teammate acknowledges. Navigators that must know about older
/// packets add an [`AckBitmap`](crate::link::AckBitmap) to their body.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct HeardBitmap(u16);

impl HeardBitmap {
    /// From bits: vehicle 0 is the least significant.
    #[must_use]
    pub fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// The bits: vehicle 0 is the least significant.
    #[must_use]
    pub fn bits(self) -> u16 {
        self.0
    }

    /// Sets the bit of `vehicle`.
    ///
    /// # Errors
    /// [`PacketError::OutOfRange`] for a vehicle index of [`TEAM_MAX`] or more.
    pub fn insert(&mut self, vehicle: u16) -> Result<(), PacketError> {
        if vehicle >= TEAM_MAX {
            return Err(PacketError::OutOfRange {
                field: "vehicle index",
                unit: "",
                value: f64::from(vehicle),
                minimum: 0.0,
                maximum: f64::from(TEAM_MAX - 1),
            });
        }
        self.0 |= 1 << vehicle;
        Ok(())
    }

    /// Whether `vehicle` was heard; false for an index of [`TEAM_MAX`] or more.
    #[must_use]
    pub fn contains(self, vehicle: u16) -> bool {
        vehicle < TEAM_MAX && self.0 & (1 << vehicle) != 0
    }
}

/// What every packet starts with: 22 bits and one bit for each vehicle of the team.
///
/// ```text
/// bit  0      4          12           22          22 + n
///      | kind | sequence | depth      | heard     |  body …
///      | 4    | 8        | 10 × 0.1 m | n         |
/// ```
///
/// The width n of the bitmap (0 to 16) belongs to the layout of the body that follows: 16 where the layout is the
/// same for any team, the number of vehicles where bits are scarce.
/// The sender's index and the launch time are implied by the slot, cost no bits, and are covered by the checksum.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// What the body holds.
    pub kind: PacketKind,
    /// The sender's packet counter modulo 256; [`ReceiveWindow`](crate::link::ReceiveWindow) extends it.
    pub sequence: u8,
    /// The sender's depth below the surface at launch, m, 0 to 102.3 in steps of 0.1 (so off by up to 0.05 m), with
    /// which slant ranges are reduced.
    pub depth_m: f64,
    /// Whom the sender heard.
    pub heard: HeardBitmap,
}

impl Header {
    /// A depth as it arrives: rounded to the header's steps, 0 to 102.3 m.
    #[must_use]
    pub fn carried_depth_m(depth_m: f64) -> f64 {
        let most = DEPTH.decode((1 << DEPTH.bits) - 1);
        DEPTH.encode(depth_m.clamp(0.0, most)).map_or(f64::NAN, |steps| DEPTH.decode(steps))
    }

    /// Bits of a header with a bitmap of `heard_bits`.
    #[must_use]
    pub const fn bits(heard_bits: u32) -> u32 {
        (KIND.bits + SEQUENCE.bits + DEPTH.bits).saturating_add(heard_bits)
    }

    /// Writes the header with a bitmap of `heard_bits` (0 to 16) vehicles.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`], [`PacketError::OutOfRange`] for a depth outside 0 to 102.3 m;
    /// [`PacketError::TooManyBits`] when a vehicle beyond `heard_bits` was heard.
    pub fn write(&self, writer: &mut BitWriter, heard_bits: u32) -> Result<(), PacketError> {
        KIND.write(writer, u64::from(self.kind.code()))?;
        SEQUENCE.write(writer, u64::from(self.sequence))?;
        DEPTH.write(writer, self.depth_m)?;
        writer.push(HEARD, u64::from(self.heard.bits()), heard_bits)
    }

    /// Reads a header with a bitmap of `heard_bits` (0 to 16) vehicles.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] at the end of the packet, [`PacketError::InvalidCode`] for an unknown kind,
    /// [`PacketError::Definition`] for more than 16 bits of bitmap.
    pub fn read(reader: &mut BitReader, heard_bits: u32) -> Result<Self, PacketError> {
        if heard_bits > u32::from(TEAM_MAX) {
            return Err(PacketError::Definition {
                field: HEARD,
                quantity: "width in bits",
                value: f64::from(heard_bits),
                minimum: 0.0,
                maximum: f64::from(TEAM_MAX),
            });
        }
        let kind = PacketKind::from_code(KIND.read(reader)?)?;
        // Both conversions are exact: the fields have 8 and at most 16 bits.
        let sequence = SEQUENCE.read(reader)? as u8;
        let depth_m = DEPTH.read(reader)?;
        let heard = HeardBitmap(reader.take(HEARD, heard_bits)? as u16);
        Ok(Self { kind, sequence, depth_m, heard })
    }

    /// The kind of an opened packet, from its first bits, to choose who reads it.
    ///
    /// # Errors
    /// [`PacketError::Truncated`] for no bytes, [`PacketError::InvalidCode`] for an unknown kind.
    pub fn peek_kind(payload: &[u8]) -> Result<PacketKind, PacketError> {
        PacketKind::from_code(KIND.read(&mut BitReader::new(payload))?)
    }
}
