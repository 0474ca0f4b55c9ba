//! A whole cloud of particles as a packet, for studies without a limit on bandwidth.

use super::header::{Header, PacketKind, TEAM_MAX};
use super::{BitReader, BitWriter, CRC_BYTES, FloatField, PacketError, UnsignedField, append_crc, check_crc};

const HEARD_BITS: u32 = TEAM_MAX as u32;
const COUNT: UnsignedField = UnsignedField { name: "number of particles", bits: 24 };
const EAST: FloatField = FloatField { name: "particle easting" };
const NORTH: FloatField = FloatField { name: "particle northing" };
const WEIGHT: FloatField = FloatField { name: "particle weight" };
/// Bits of one particle.
const PARTICLE_BITS: usize = 3 * 64;

/// A vehicle's particles with their weights (Tan, Chitre & Hover 2016, section 5.1).
///
/// ```text
/// | header 38 bits | count 24 bits | count × (e, n, weight as f64) | 2 zero bits | CRC 16 |
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct CloudPacket {
    /// Sequence, depth, acknowledgements; its kind is [`PacketKind::Cloud`].
    pub header: Header,
    /// Easting, m.
    pub east: Vec<f64>,
    /// Northing, m.
    pub north: Vec<f64>,
    /// Weights, summing to one.
    pub weights: Vec<f64>,
}

impl CloudPacket {
    /// The packet's bytes, checksum included, for `sender` and `tol_ns`.
    ///
    /// # Errors
    /// [`PacketError::NotFinite`], [`PacketError::OutOfRange`] naming the field.
    pub fn encode(&self, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(8 + self.east.len() * PARTICLE_BITS / 8 + CRC_BYTES);
        self.header.write(&mut writer, HEARD_BITS)?;
        COUNT.write(&mut writer, self.east.len() as u64)?;
        for ((e, n), w) in self.east.iter().zip(&self.north).zip(&self.weights) {
            EAST.write(&mut writer, *e)?;
            NORTH.write(&mut writer, *n)?;
            WEIGHT.write(&mut writer, *w)?;
        }
        Ok(append_crc(writer.finish(), sender, tol_ns))
    }

    /// Reads what `sender` launched at `tol_ns`. Any bytes give a typed result.
    ///
    /// # Errors
    /// [`PacketError::Checksum`], [`PacketError::Length`], [`PacketError::InvalidCode`], [`PacketError::NotFinite`], or
    /// [`PacketError::OutOfRange`] for weights that are negative or do not sum to one.
    pub fn decode(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<Self, PacketError> {
        let payload = check_crc(bytes, sender, tol_ns)?;
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, HEARD_BITS)?;
        if header.kind != PacketKind::Cloud {
            return Err(PacketError::InvalidCode {
                field: "packet kind",
                code: u64::from(header.kind.code()),
            });
        }
        let count = COUNT.read(&mut reader)? as usize;
        if reader.left_bits() / PARTICLE_BITS < count {
            let expected = (count * PARTICLE_BITS).div_ceil(8) + 8 + CRC_BYTES;
            return Err(PacketError::Length { bytes: bytes.len(), expected });
        }
        let mut cloud = Self {
            header,
            east: Vec::with_capacity(count),
            north: Vec::with_capacity(count),
            weights: Vec::with_capacity(count),
        };
        for _ in 0..count {
            cloud.east.push(EAST.read(&mut reader)?);
            cloud.north.push(NORTH.read(&mut reader)?);
            cloud.weights.push(WEIGHT.read(&mut reader)?);
        }
        reader.finish()?;
        let sum: f64 = cloud.weights.iter().sum();
        if (sum - 1.0).abs() > 1e-6 || cloud.weights.iter().any(|w| *w < 0.0) {
            return Err(PacketError::OutOfRange {
                field: "sum of particle weights",
                unit: "",
                value: sum,
                minimum: 1.0 - 1e-6,
                maximum: 1.0 + 1e-6,
            });
        }
        Ok(cloud)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packet::HeardBitmap;

    fn packet(count: usize) -> CloudPacket {
        CloudPacket {
            header: Header {
                kind: PacketKind::Cloud,
                sequence: 7,
                depth_m: 3.0,
                heard: HeardBitmap::default(),
            },
            east: (0..count).map(|i| i as f64 * 1.25 - 3.0).collect(),
            north: (0..count).map(|i| -(i as f64)).collect(),
            weights: vec![1.0 / count as f64; count],
        }
    }

    #[test]
    fn a_cloud_comes_back_to_the_bit() {
        let sent = packet(600);
        let bytes = sent.encode(1, 5).expect("it fits");
        assert_eq!(CloudPacket::decode(&bytes, 1, 5), Ok(sent));
        assert!(CloudPacket::decode(&bytes, 2, 5).is_err());
        for cut in 0..40 {
            assert!(CloudPacket::decode(&bytes[..bytes.len() - cut - 1], 1, 5).is_err());
        }
    }

    #[test]
    fn weights_that_are_none_are_refused() {
        for weights in [vec![0.5, 0.6], vec![1.5, -0.5]] {
            let mut bad = packet(2);
            bad.weights = weights;
            let bytes = bad.encode(0, 0).expect("finite numbers encode");
            assert!(matches!(CloudPacket::decode(&bytes, 0, 0), Err(PacketError::OutOfRange { .. })));
        }
        let mut bad = packet(2);
        bad.east[0] = f64::NAN;
        assert!(bad.encode(0, 0).is_err());
    }
}
