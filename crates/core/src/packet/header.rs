//! What every packet starts with.

use super::depth::DepthField;
use super::{BitReader, BitWriter, ModuloField, PacketError, UnsignedField};
use serde::{Deserialize, Serialize};

/// Most vehicles in a team that a [`HeardBitmap`] can name.
pub const TEAM_MAX: u16 = 16;

const KIND: UnsignedField = UnsignedField { name: "packet kind", bits: 4 };
const SEQUENCE: ModuloField = ModuloField { name: "sequence", bits: 8 };
const DEPTH: DepthField = DepthField { name: "sender's depth" };
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
    /// 8: a node of a pose graph in float64, [`GraphMessage`](super::graph::GraphMessage).
    GraphF64,
    /// 9: the same, rounded for 32 bytes.
    Graph32,
    /// 10: the same, rounded for 64 bytes.
    Graph64,
    /// 11: the same, rounded for 256 bytes.
    Graph256,
    /// 12: only what the sender received, [`GraphMessage`](super::graph::GraphMessage).
    Acknowledgement,
    /// 13: delta information, [`DeltaMessage`](super::graph::DeltaMessage).
    GraphDelta,
    /// 14: a bank of beliefs, each with those whose information is in it, [`BankPacket`](super::BankPacket).
    Bank,
    /// 5: local data of a vehicle, [`TeamReport`](super::TeamReport).
    Team,
    /// 6: the same with a position fix.
    TeamFix,
    /// 7: the same as `f64`.
    TeamF64,
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
            Self::GraphF64 => 8,
            Self::Graph32 => 9,
            Self::Graph64 => 10,
            Self::Graph256 => 11,
            Self::Acknowledgement => 12,
            Self::GraphDelta => 13,
            Self::Bank => 14,
            Self::Team => 5,
            Self::TeamFix => 6,
            Self::TeamF64 => 7,
        }
    }

    fn from_code(code: u64) -> Result<Self, PacketError> {
        match code {
            1 => Ok(Self::Belief),
            2 => Ok(Self::BeliefF64),
            3 => Ok(Self::Cloud),
            4 => Ok(Self::Mixture),
            8 => Ok(Self::GraphF64),
            9 => Ok(Self::Graph32),
            10 => Ok(Self::Graph64),
            11 => Ok(Self::Graph256),
            12 => Ok(Self::Acknowledgement),
            13 => Ok(Self::GraphDelta),
            14 => Ok(Self::Bank),
            5 => Ok(Self::Team),
            6 => Ok(Self::TeamFix),
            7 => Ok(Self::TeamF64),
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
///      | 4    | 8        | 10         | n         |
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
    /// The sender's depth below the surface at launch, m, with which slant ranges are reduced: 0 to 13,004.8 in steps of
    /// 0.1 down to 51.2 m and of 1/64 to 1/128 of the depth below ([`Header::depth_step_m`]).
    pub depth_m: f64,
    /// Whom the sender heard.
    pub heard: HeardBitmap,
}

impl Header {
    /// A depth as it arrives: rounded to the header's steps, 0 to 13,004.8 m.
    #[must_use]
    pub fn carried_depth_m(depth_m: f64) -> f64 {
        DEPTH.encode(depth_m.clamp(0.0, DepthField::DEEPEST_M)).map_or(f64::NAN, DepthField::decode)
    }

    /// Distance between neighbouring depths that a header can hold, at `depth_m`: a depth arrives off by half of it at
    /// most.
    #[must_use]
    pub fn depth_step_m(depth_m: f64) -> f64 {
        DepthField::step_m(depth_m)
    }

    /// The step that counts in the noise of a range: that of [`Header::depth_step_m`] from 51.2 m on, zero above, where
    /// the steps of a decimetre are below the noise of a depth sensor.
    #[must_use]
    pub fn coarse_depth_step_m(depth_m: f64) -> f64 {
        let step_m = Self::depth_step_m(depth_m);
        if step_m > Self::depth_step_m(0.0) { step_m } else { 0.0 }
    }

    /// Bits of a header with a bitmap of `heard_bits`.
    #[must_use]
    pub const fn bits(heard_bits: u32) -> u32 {
        (KIND.bits + SEQUENCE.bits + DepthField::BITS).saturating_add(heard_bits)
    }

    /// Writes the header with a bitmap of `heard_bits` (0 to 16) vehicles.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`], [`PacketError::OutOfRange`] for a depth outside 0 to 13,004.8 m;
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
