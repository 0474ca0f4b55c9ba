//! Pose graphs in float64, for studies: information matrices as they are.

use nalgebra::{SMatrix, SVector};

use super::origin_field::{decoded_lag_ids, read_origin, write_origin};
use crate::information::graph_packet::{GraphPacket, Lag, OriginCorrelation};
use crate::information::reconstruct::filtered;
use crate::information::{Gaussian, Information, Node, symmetrized};
use crate::packet::{BitReader, BitWriter, FloatField, PacketError, UnsignedField};

const MATRIX: FloatField = FloatField { name: "information matrix" };
const VECTOR: FloatField = FloatField { name: "information vector" };
const LAGS: UnsignedField = UnsignedField { name: "exact joints", bits: 4 };

pub(super) fn write_information<const D: usize>(
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

pub(super) fn read_information<const D: usize>(
    reader: &mut BitReader,
) -> Result<Information<D>, PacketError> {
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

pub(super) fn write_exact(writer: &mut BitWriter, graph: &GraphPacket) -> Result<(), PacketError> {
    write_origin(writer, graph)?;
    LAGS.write(writer, graph.lags.len() as u64)?;
    match &graph.tie {
        OriginCorrelation::Begin => {
            write_information(writer, &graph.node.filtered.information().map_err(indefinite)?)?;
        }
        OriginCorrelation::Joint(joint) => write_information(writer, joint)?,
        OriginCorrelation::Correlation(_) => {
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

pub(super) fn read_exact(reader: &mut BitReader, id: u64, tol_ns: i64) -> Result<GraphPacket, PacketError> {
    let (begin, origin) = read_origin(reader, id)?;
    let count = LAGS.read(reader)?;
    let (tie, marginal) = if begin {
        let own: Gaussian<4> = read_information::<4>(reader)?.gaussian().map_err(indefinite)?;
        (OriginCorrelation::Begin, own)
    } else {
        let joint = read_information::<8>(reader)?;
        (OriginCorrelation::Joint(joint), filtered(&joint).map_err(indefinite)?.0)
    };
    let mut lags = Vec::with_capacity(count as usize);
    for lag in decoded_lag_ids(LAGS.name, id, begin, count)? {
        // The one that is used is checked then: it must leave a step that data can give.
        lags.push((lag, Lag::Joint(read_information::<8>(reader)?)));
    }
    let filtered = Gaussian { mean: marginal.mean, covariance: symmetrized(&marginal.covariance) };
    Ok(GraphPacket { node: Node { id, tol_ns, filtered }, origin, tie, lags })
}
