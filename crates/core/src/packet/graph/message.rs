//! The packet of `mdeif`: header, acknowledgements, and a node of the sender's pose graph.

use super::exact::{read_exact, write_exact};
use super::form::GraphForm;
use super::rounded::{read_rounded, write_rounded};
use crate::information::graph_packet::GraphPacket;
use crate::link::AckBitmap;
use crate::packet::header::{Header, HeardBitmap, PacketKind};
use crate::packet::{BitReader, BitWriter, FloatField, PacketError, append_crc, check_crc};

const DEPTH: FloatField = FloatField { name: "sender's depth" };

/// What the two ends agree on beside the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GraphLink {
    /// Layout.
    pub form: GraphForm,
    /// Who sent it (index in the team).
    pub sender: u16,
    /// Launch, ns.
    pub tol_ns: i64,
    /// How many bitmaps it carries: one for each teammate whose packets the sender uses, in the team's order.
    pub bitmaps: usize,
}

/// A packet of `mdeif`: a node of the sender's graph, and what it received.
///
/// ```text
/// | kind 4 | sequence 8 | depth 10 | bitmaps: newest 8, received 16 or 32, each | body … | zero bits | CRC 16 |
/// ```
///
/// Body in float64: depth again, 64 bits; 1 bit whether the node is the origin; 8 bits of the origin's sequence; 4 bits
/// of lags n; the joint marginal over (node, origin) as 36 + 8 numbers, or 10 + 4 of the origin alone; then for each of
/// the n transmissions before this one (the origin left out) the joint marginal with it, 36 + 8 numbers. A packet that
/// only acknowledges ends after the bitmaps.
#[derive(Debug, Clone, PartialEq)]
pub struct GraphMessage {
    /// The sender's packet counter, modulo 256.
    pub sequence: u8,
    /// The sender's depth at launch, m.
    pub depth_m: f64,
    /// What the sender received.
    pub bitmaps: Vec<AckBitmap>,
    /// The graph's part; none in a packet that only acknowledges.
    pub graph: Option<GraphPacket>,
}

impl GraphMessage {
    /// The packet's bytes.
    ///
    /// # Errors
    /// [`PacketError`] naming the field that cannot hold its value.
    pub fn encode(&self, link: &GraphLink) -> Result<Vec<u8>, PacketError> {
        let mut writer = BitWriter::with_capacity(64);
        let kind = if self.graph.is_some() { link.form.kind() } else { PacketKind::Acknowledgement };
        let heard = HeardBitmap::default();
        Header { kind, sequence: self.sequence, depth_m: self.depth_m, heard }.write(&mut writer, 0)?;
        self.bitmaps.iter().try_for_each(|bitmap| bitmap.write(&mut writer))?;
        if let Some(graph) = &self.graph {
            match link.form {
                GraphForm::F64 => {
                    DEPTH.write(&mut writer, self.depth_m)?;
                    write_exact(&mut writer, graph)?;
                }
                rounded => write_rounded(&mut writer, rounded, graph)?,
            }
        }
        Ok(append_crc(writer.finish(), link.sender, link.tol_ns))
    }

    /// Reads a packet. `last_sent` is the reader's own newest packet, `own_bitmap` the place of the bitmap about it (other
    /// bitmaps are left out); `counter` extends the sequence.
    ///
    /// # Errors
    /// [`PacketError`] for what a correct sender never sends.
    pub fn decode(
        bytes: &[u8],
        link: &GraphLink,
        own_bitmap: Option<usize>,
        last_sent: Option<u64>,
        counter: impl Fn(u8) -> u64,
    ) -> Result<Self, PacketError> {
        let payload = check_crc(bytes, link.sender, link.tol_ns)?;
        let kind = Header::peek_kind(payload)?;
        if kind != link.form.kind() && kind != PacketKind::Acknowledgement {
            return Err(PacketError::InvalidCode { field: "packet kind", code: u64::from(kind.code()) });
        }
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, 0)?;
        let (mut depth_m, mut bitmaps) = (header.depth_m, Vec::new());
        let length = link.form.acknowledged();
        for place in 0..link.bitmaps {
            if own_bitmap == Some(place) {
                bitmaps.push(AckBitmap::read(&mut reader, length, last_sent)?);
            } else {
                reader.take("acknowledgement of another vehicle", 8 + length)?;
            }
        }
        let graph = if kind == PacketKind::Acknowledgement {
            None
        } else {
            let id = counter(header.sequence);
            Some(match link.form {
                GraphForm::F64 => {
                    depth_m = DEPTH.read(&mut reader)?;
                    read_exact(&mut reader, id, link.tol_ns)?
                }
                rounded => read_rounded(&mut reader, rounded, id, link.tol_ns)?,
            })
        };
        reader.finish()?;
        Ok(Self { sequence: header.sequence, depth_m, bitmaps, graph })
    }
}
