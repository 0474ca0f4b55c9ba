//! Pose graphs as packets: the float64 forms, for studies.

use super::graph_rounded::{read_rounded, write_rounded};
use super::header::{Header, HeardBitmap, PacketKind};
use super::{BitReader, BitWriter, FloatField, PacketError, UnsignedField, open, seal};
use crate::information::reconstruct::filtered;
use crate::information::replica::{GraphPacket, Lag, Tie};
use crate::information::{Gaussian, Information, Node, symmetrized};
use crate::link::AckBitmap;
use nalgebra::{SMatrix, SVector};

/// Bytes of an origin-state joint marginal, or of a delta information, in float64: 36 + 8 numbers.
pub const JOINT_F64_BYTES: usize = 44 * 8;

const DEPTH: FloatField = FloatField { name: "sender's depth" };
const MATRIX: FloatField = FloatField { name: "information matrix" };
const VECTOR: FloatField = FloatField { name: "information vector" };
const BEGIN: UnsignedField = UnsignedField { name: "whether the node is the origin", bits: 1 };
const ORIGIN: UnsignedField = UnsignedField { name: "origin's sequence", bits: 8 };
const LAGS: UnsignedField = UnsignedField { name: "exact joints", bits: 4 };
const DELTAS: UnsignedField = UnsignedField { name: "delta informations", bits: 5 };

/// How a pose graph's packet is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum GraphForm {
    /// Float64 throughout.
    F64,
    /// Rounded, for one frame of 32 bytes; only where x and y have identical, decoupled filters.
    Frame32,
    /// Rounded, for one frame of 64 bytes.
    Frame64,
    /// Rounded, for one frame of 256 bytes.
    Frame256,
}

impl GraphForm {
    /// Packets that an acknowledgement bitmap looks back on.
    #[must_use]
    pub fn acknowledged(self) -> u32 {
        match self {
            Self::F64 | Self::Frame256 => 32,
            Self::Frame64 | Self::Frame32 => 16,
        }
    }

    pub(super) fn kind(self) -> PacketKind {
        match self {
            Self::F64 => PacketKind::GraphF64,
            Self::Frame32 => PacketKind::Graph32,
            Self::Frame64 => PacketKind::Graph64,
            Self::Frame256 => PacketKind::Graph256,
        }
    }
}

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
                    write_f64(&mut writer, graph)?;
                }
                rounded => write_rounded(&mut writer, rounded, graph)?,
            }
        }
        Ok(seal(writer.finish(), link.sender, link.tol_ns))
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
        let payload = open(bytes, link.sender, link.tol_ns)?;
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
                    read_f64(&mut reader, id, link.tol_ns)?
                }
                rounded => read_rounded(&mut reader, rounded, id, link.tol_ns)?,
            })
        };
        reader.finish()?;
        Ok(Self { sequence: header.sequence, depth_m, bitmaps, graph })
    }
}

pub(super) fn write_origin(writer: &mut BitWriter, graph: &GraphPacket) -> Result<bool, PacketError> {
    let begin = matches!(graph.tie, Tie::Begin);
    BEGIN.write(writer, u64::from(begin))?;
    ORIGIN.write(writer, graph.origin & 0xFF)?;
    Ok(begin)
}

/// Whether the node is the origin, and the origin's id: the last one up to the node's with its eight bits. (Of an origin
/// that is older than 256 packets a receiver knows by what it holds.)
pub(super) fn read_origin(reader: &mut BitReader, id: u64) -> Result<(bool, u64), PacketError> {
    let begin = BEGIN.read(reader)? == 1;
    let code = ORIGIN.read(reader)?;
    let same = id.wrapping_sub(code) & 0xFF == 0;
    let back = if same && !begin { 256 } else { id.wrapping_sub(code) & 0xFF };
    let origin = id.checked_sub(back).ok_or(PacketError::InvalidCode { field: ORIGIN.name, code })?;
    if begin && !same {
        return Err(PacketError::InvalidCode { field: ORIGIN.name, code });
    }
    Ok((begin, origin))
}

fn write_information<const D: usize>(
    writer: &mut BitWriter,
    information: &Information<D>,
) -> Result<(), PacketError> {
    for row in 0..D {
        for column in row..D {
            MATRIX.write(writer, information.matrix[(row, column)])?;
        }
    }
    information.vector.iter().try_for_each(|value| VECTOR.write(writer, *value))
}

fn read_information<const D: usize>(reader: &mut BitReader) -> Result<Information<D>, PacketError> {
    let mut information =
        Information { matrix: SMatrix::<f64, D, D>::zeros(), vector: SVector::<f64, D>::zeros() };
    for row in 0..D {
        for column in row..D {
            let value = MATRIX.read(reader)?;
            information.matrix[(row, column)] = value;
            information.matrix[(column, row)] = value;
        }
    }
    for row in 0..D {
        information.vector[row] = VECTOR.read(reader)?;
    }
    Ok(information)
}

/// A packet that claims a graph which no data can give.
fn indefinite(_: crate::error::Error) -> PacketError {
    PacketError::NotPositiveDefinite { field: MATRIX.name }
}

fn write_f64(writer: &mut BitWriter, graph: &GraphPacket) -> Result<(), PacketError> {
    write_origin(writer, graph)?;
    LAGS.write(writer, graph.lags.len() as u64)?;
    match &graph.tie {
        Tie::Begin => {
            write_information(writer, &graph.node.filtered.information().map_err(indefinite)?)?;
        }
        Tie::Joint(joint) => write_information(writer, joint)?,
        Tie::Correlation(_) => {
            return Err(PacketError::InvalidCode { field: "tie of a float64 packet", code: 0 });
        }
    }
    for (_, lag) in &graph.lags {
        let Lag::Joint(joint) = lag else {
            return Err(PacketError::InvalidCode { field: "lag of a float64 packet", code: 0 });
        };
        write_information(writer, joint)?;
    }
    Ok(())
}

fn read_f64(reader: &mut BitReader, id: u64, tol_ns: i64) -> Result<GraphPacket, PacketError> {
    let (begin, origin) = read_origin(reader, id)?;
    let count = LAGS.read(reader)?;
    let (tie, marginal) = if begin {
        let own: Gaussian<4> = read_information::<4>(reader)?.gaussian().map_err(indefinite)?;
        (Tie::Begin, own)
    } else {
        let joint = read_information::<8>(reader)?;
        (Tie::Joint(joint), filtered(&joint).map_err(indefinite)?.0)
    };
    let mut lags = Vec::with_capacity(count as usize);
    for lag in told_lags(LAGS.name, id, begin, count)? {
        // The one that is used is checked then: it must leave a step that data can give.
        lags.push((lag, Lag::Joint(read_information::<8>(reader)?)));
    }
    let filtered = Gaussian { mean: marginal.mean, covariance: symmetrized(&marginal.covariance) };
    Ok(GraphPacket { node: Node { id, tol_ns, filtered }, origin, tie, lags })
}

/// The transmissions before `id` that a packet may hold exactly: newest first, the origin and what is before it left out.
pub fn lag_ids(id: u64, origin: u64) -> impl Iterator<Item = u64> {
    (origin + 1..id).rev()
}

/// The transmissions that `count` lags of a packet are about, newest first.
pub(super) fn told_lags(
    field: &'static str,
    id: u64,
    begin: bool,
    count: u64,
) -> Result<impl Iterator<Item = u64>, PacketError> {
    let oldest = id.checked_sub(count).filter(|_| !begin || count == 0);
    let oldest = oldest.ok_or(PacketError::InvalidCode { field, code: count })?;
    Ok((oldest..id).rev())
}

/// As [`lag_ids`] for rounded packets, whose tie with the origin is not exact: the origin is among them.
pub fn rounded_lag_ids(id: u64, origin: u64) -> impl Iterator<Item = u64> {
    (origin..id).rev()
}

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

const BASE: UnsignedField = UnsignedField { name: "age of the delta's earlier node", bits: 8 };

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
        BEGIN.write(&mut writer, u64::from(self.first.is_some()))?;
        DELTAS.write(&mut writer, self.deltas.len() as u64)?;
        if let Some(first) = &self.first {
            write_information(&mut writer, first)?;
        }
        self.deltas.iter().try_for_each(|delta| write_information(&mut writer, delta))?;
        Ok(seal(writer.finish(), sender, tol_ns))
    }

    /// Reads a packet.
    ///
    /// # Errors
    /// [`PacketError`] for what a correct sender never sends.
    pub fn decode(bytes: &[u8], sender: u16, tol_ns: i64) -> Result<Self, PacketError> {
        let payload = open(bytes, sender, tol_ns)?;
        let mut reader = BitReader::new(payload);
        let header = Header::read(&mut reader, 0)?;
        if header.kind != PacketKind::GraphDelta {
            let code = u64::from(header.kind.code());
            return Err(PacketError::InvalidCode { field: "packet kind", code });
        }
        let depth_m = DEPTH.read(&mut reader)?;
        let base_age = BASE.read(&mut reader)? as u8;
        let begin = BEGIN.read(&mut reader)? == 1;
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
