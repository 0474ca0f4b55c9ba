//! Pose graphs as packets: rounded forms that never claim more than was sent.

use super::graph::GraphForm;
use super::{BitReader, BitWriter, PacketError};
use crate::information::replica::GraphPacket;

pub(super) fn write_rounded(
    _writer: &mut BitWriter,
    _form: GraphForm,
    _graph: &GraphPacket,
) -> Result<(), PacketError> {
    Err(PacketError::InvalidCode { field: "todo", code: 0 })
}

pub(super) fn read_rounded(
    _reader: &mut BitReader,
    _form: GraphForm,
    _id: u64,
    _tol_ns: i64,
) -> Result<GraphPacket, PacketError> {
    Err(PacketError::InvalidCode { field: "todo", code: 0 })
}
