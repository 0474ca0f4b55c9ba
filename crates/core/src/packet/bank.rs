//! A bank of beliefs as a packet: what a vehicle knows by each set of sources.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::header::{Header, PacketKind, TEAM_MAX};
use super::{
    Belief, BitReader, BitWriter, CRC_BYTES, FloatField, PacketError, UnsignedField, append_crc, check_crc,
};

const HEARD_BITS: u32 = TEAM_MAX as u32;
const COUNT: UnsignedField = UnsignedField { name: "number of beliefs", bits: 10 };
const ORIGINS: UnsignedField = UnsignedField { name: "origins of a belief", bits: TEAM_MAX as u32 };
const EAST: FloatField = FloatField { name: "belief's easting" };
const NORTH: FloatField = FloatField { name: "belief's northing" };
const VARIANCE_E: FloatField = FloatField { name: "belief's variance of easting" };
const COVARIANCE: FloatField = FloatField { name: "belief's covariance" };
const VARIANCE_N: FloatField = FloatField { name: "belief's variance of northing" };
/// Bits of one belief.
const MEMBER_BITS: usize = TEAM_MAX as usize + 5 * 64;

/// A set of vehicles: those whose own sensors something is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Origins(u16);

impl Origins {
    /// Of one vehicle.
    ///
    /// # Errors
    /// [`PacketError::OutOfRange`] for an index of [`TEAM_MAX`] or more.
    pub fn of(vehicle: u16) -> Result<Self, PacketError> {
        if vehicle < TEAM_MAX {
            return Ok(Self(1 << vehicle));
        }
        Err(PacketError::OutOfRange {
            field: "vehicle index",
            unit: "",
            value: f64::from(vehicle),
            minimum: 0.0,
            maximum: f64::from(TEAM_MAX - 1),
        })
    }

    /// Bit v stands for vehicle v.
    #[must_use]
    pub fn bits(self) -> u16 {
        self.0
    }

    /// Whether no vehicle is in both.
    #[must_use]
    pub fn disjoint(self, other: Self) -> bool {
        self.0 & other.0 == 0
    }

    /// Those in either.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether all of `other` is in it.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// One belief of a bank.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Member {
    /// Whose sensors it is made from.
    pub origins: Origins,
    /// The sender's position.
    pub belief: Belief,
}

/// The whole bank of an interleaved update (Bahr, Walter & Leonard 2009).
///
/// ```text
/// | header 38 bits | count 10 | count × (origins 16, e, n, ee, en, nn as f64) | zero bits | CRC 16 |
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct BankPacket {
    /// Sequence, depth, acknowledgements; its kind is [`PacketKind::Bank`].
    pub header: Header,
    /// The beliefs, each of other origins.
    pub members: Vec<Member>,
}

impl BankPacket {
    /// The packet's bytes, checksum included, for `sender` and `tol_ns`.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`], [`PacketError::NotCovariance`], [`PacketError::OutOfRange`] for too many beliefs.
    pub fn encode(&self, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(8 + self.members.len() * MEMBER_BITS / 8 + CRC_BYTES);
        self.header.write(&mut writer, HEARD_BITS)?;
        COUNT.write(&mut writer, self.members.len() as u64)?;
        for Member { origins, belief } in &self.members {
            belief.check()?;
            ORIGINS.write(&mut writer, u64::from(origins.bits()))?;
            EAST.write(&mut writer, belief.mean_m.x)?;
            NORTH.write(&mut writer, belief.mean_m.y)?;
            VARIANCE_E.write(&mut writer, belief.covariance_m2.m11)?;
            COVARIANCE.write(&mut writer, belief.covariance_m2.m12)?;
            VARIANCE_N.write(&mut writer, belief.covariance_m2.m22)?;
        }
        Ok(append_crc(writer.finish(), sender, tol_ns))
    }

    /// Reads what `sender` launched at `tol_ns`. Any bytes give a typed result.
    ///
    /// # Errors
    /// [`PacketError::Checksum`], [`PacketError::Length`], [`PacketError::InvalidCode`], [`PacketError::NotFinite`],
    /// [`PacketError::NotCovariance`], [`PacketError::Padding`].
    pub fn decode(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<Self, PacketError> {
        let payload = check_crc(bytes, sender, tol_ns)?;
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, HEARD_BITS)?;
        if header.kind != PacketKind::Bank {
            let code = u64::from(header.kind.code());
            return Err(PacketError::InvalidCode { field: "packet kind", code });
        }
        let count = COUNT.read(&mut reader)? as usize;
        if reader.left_bits() / MEMBER_BITS < count {
            let expected = (count * MEMBER_BITS).div_ceil(8) + 6 + CRC_BYTES;
            return Err(PacketError::Length { bytes: bytes.len(), expected });
        }
        let mut members = Vec::with_capacity(count);
        for _ in 0..count {
            // The field has 16 bits.
            let origins = Origins(ORIGINS.read(&mut reader)? as u16);
            let mean_m = Vector2::new(EAST.read(&mut reader)?, NORTH.read(&mut reader)?);
            let ee = VARIANCE_E.read(&mut reader)?;
            let en = COVARIANCE.read(&mut reader)?;
            let nn = VARIANCE_N.read(&mut reader)?;
            let belief = Belief { mean_m, covariance_m2: Matrix2::new(ee, en, en, nn) };
            belief.check()?;
            members.push(Member { origins, belief });
        }
        reader.finish()?;
        Ok(Self { header, members })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packet::HeardBitmap;

    fn packet() -> BankPacket {
        let header =
            Header { kind: PacketKind::Bank, sequence: 9, depth_m: 2.0, heard: HeardBitmap::default() };
        let member = |origins, x: f64| Member {
            origins: Origins(origins),
            belief: Belief {
                mean_m: Vector2::new(x, -x),
                covariance_m2: Matrix2::new(2.0 + x, 0.5, 0.5, 3.0),
            },
        };
        BankPacket { header, members: vec![member(1, 0.125), member(5, 7.0)] }
    }

    #[test]
    fn a_bank_comes_back_to_the_bit_and_damage_does_not() {
        let sent = packet();
        let bytes = sent.encode(2, 77).expect("it fits");
        assert_eq!(BankPacket::decode(&bytes, 2, 77), Ok(sent));
        assert!(BankPacket::decode(&bytes, 1, 77).is_err());
        for cut in 1..bytes.len() {
            assert!(BankPacket::decode(&bytes[..cut], 2, 77).is_err());
        }
    }

    #[test]
    fn an_indefinite_belief_is_refused_at_both_ends() {
        let mut bad = packet();
        bad.members[1].belief.covariance_m2 = Matrix2::new(1.0, 2.0, 2.0, 1.0);
        assert!(matches!(bad.encode(0, 0), Err(PacketError::NotCovariance { .. })));
    }

    #[test]
    fn origins_are_sets() {
        let (a, b) = (Origins::of(0).expect("known"), Origins::of(3).expect("known"));
        assert!(a.disjoint(b) && !a.union(b).disjoint(b));
        assert!(a.union(b).contains(a) && !a.contains(b));
        assert_eq!(a.union(b).bits(), 0b1001);
        assert!(Origins::of(TEAM_MAX).is_err());
    }
}
