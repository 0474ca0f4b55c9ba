//! How packets name nodes of the sender's graph: the origin by the low bits of its sequence, others by their place.

use crate::information::graph_packet::{GraphPacket, OriginCorrelation};
use crate::packet::{BitReader, BitWriter, PacketError, UnsignedField};

const BEGIN: UnsignedField = UnsignedField { name: "whether the node is the origin", bits: 1 };
const ORIGIN: UnsignedField = UnsignedField { name: "origin's sequence", bits: 8 };

pub(super) fn write_origin(writer: &mut BitWriter, graph: &GraphPacket) -> Result<bool, PacketError> {
    let begin = matches!(graph.tie, OriginCorrelation::Begin);
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

/// The transmissions before `id` that a packet may hold exactly: newest first, the origin and what is before it left out.
pub fn lag_ids(id: u64, origin: u64) -> impl Iterator<Item = u64> {
    (origin + 1..id).rev()
}

/// The transmissions that `count` lags of a packet are about, newest first.
pub(super) fn decoded_lag_ids(
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
