//! The packet of the DEIF: delta informations between transmissions, in float64.

use super::exact::{read_information, write_information};
use crate::information::Information;
use crate::packet::header::{Header, HeardBitmap, PacketKind};
use crate::packet::{BitReader, BitWriter, FloatField, PacketError, UnsignedField, append_crc, check_crc};

/// Bytes of an origin-state joint marginal, or of a delta information, in float64: 36 + 8 numbers.
pub const JOINT_F64_BYTES: usize = 44 * 8;

const DEPTH: FloatField = FloatField { name: "sender's depth" };
const FIRST: UnsignedField = UnsignedField { name: "whether the node is the origin", bits: 1 };
const DELTAS: UnsignedField = UnsignedField { name: "delta informations", bits: 5 };
const BASE: UnsignedField = UnsignedField { name: "age of the delta's earlier node", bits: 8 };

/// A packet of the DEIF: the delta information since a node that the client is known to hold, and, for `deif-redundant`,
/// the ones before it.
#[derive(Debug, Clone, PartialEq)]
pub struct DeltaMessage {
    /// The sender's packet counter, modulo 256.
    pub sequence: u8,
    /// The sender's depth at launch, m.
    pub depth_m: f64,
    /// How many transmissions before this one the earlier node of the newest delta is; 0: the first packet.
    pub base_age: u8,
    /// The first packet: the marginal of its node.
    pub first: Option<Information<4>>,
    /// Delta informations (1), newest first, each from the node that the next one leads to.
    pub deltas: Vec<Information<8>>,
}

impl DeltaMessage {
    /// The packet's bytes: header, depth, base age, 1 bit whether the first node's marginal is there, 5 bits of deltas,
    /// then 10 + 4 numbers of the first node, and 36 + 8 numbers a delta.
    ///
    /// # Errors
    /// [`PacketError`] naming the field that cannot hold its value.
    pub fn encode(&self, sender: u16, tol_ns: i64) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(16 + JOINT_F64_BYTES * self.deltas.len());
        let (kind, heard) = (PacketKind::GraphDelta, HeardBitmap::default());
        Header { kind, sequence: self.sequence, depth_m: self.depth_m, heard }.write(&mut writer, 0)?;
        DEPTH.write(&mut writer, self.depth_m)?;
        BASE.write(&mut writer, u64::from(self.base_age))?;
        FIRST.write(&mut writer, u64::from(self.first.is_some()))?;
        DELTAS.write(&mut writer, self.deltas.len() as u64)?;
        if let Some(first) = &self.first {
            write_information(&mut writer, first)?;
        }
        self.deltas.iter().try_for_each(|delta| write_information(&mut writer, delta))?;
        Ok(append_crc(writer.finish(), sender, tol_ns))
    }

    /// Reads a packet.
    ///
    /// # Errors
    /// [`PacketError`] for what a correct sender never sends.
    pub fn decode(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<Self, PacketError> {
        let payload = check_crc(bytes, sender, tol_ns)?;
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, 0)?;
        if header.kind != PacketKind::GraphDelta {
            let code = u64::from(header.kind.code());
            return Err(PacketError::InvalidCode { field: "packet kind", code });
        }
        let depth_m = DEPTH.read(&mut reader)?;
        let base_age = BASE.read(&mut reader)? as u8;
        let begin = FIRST.read(&mut reader)? == 1;
        let count = DELTAS.read(&mut reader)?;
        let first = if begin { Some(read_information(&mut reader)?) } else { None };
        let mut deltas = Vec::with_capacity(count as usize);
        for _ in 0..count {
            deltas.push(read_information(&mut reader)?);
        }
        reader.finish()?;
        Ok(Self { sequence: header.sequence, depth_m, base_age, first, deltas })
    }
}
