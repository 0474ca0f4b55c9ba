//! The packet of a position belief, encoded and decoded from Python.

use nalgebra::{Matrix2, Vector2};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::packet::{Belief, BeliefPacket, Header, HeardBitmap, PacketKind};

use crate::arrays::{Matrix, symmetric};
use crate::errors::{argument, navigator};

fn kind(packet: &str) -> PyResult<PacketKind> {
    match packet {
        "rounded" => Ok(PacketKind::Belief),
        "f64" => Ok(PacketKind::BeliefF64),
        other => Err(argument(format!("packet is {other:?}, not rounded or f64"))),
    }
}

/// A position belief as a packet: 15 bytes (`rounded`) or 47 (`f64`).
#[pyfunction]
#[pyo3(signature = (mean_m, covariance_m2, *, depth_m, sequence, heard, sender, tol_ns, packet))]
#[allow(clippy::too_many_arguments)]
fn encode_belief<'py>(
    py: Python<'py>,
    mean_m: [f64; 2],
    covariance_m2: Matrix<'py>,
    depth_m: f64,
    sequence: u8,
    heard: u16,
    sender: u16,
    tol_ns: i64,
    packet: &str,
) -> PyResult<Bound<'py, PyBytes>> {
    let [ee, en, nn] = symmetric("covariance_m2", &covariance_m2)?;
    let packet = BeliefPacket {
        header: Header { kind: kind(packet)?, sequence, depth_m, heard: HeardBitmap::from_bits(heard) },
        belief: Belief { mean_m: Vector2::from(mean_m), covariance_m2: Matrix2::new(ee, en, en, nn) },
    };
    let bytes = packet.encode(sender, tol_ns).map_err(|e| navigator(e.into()))?;
    Ok(PyBytes::new(py, &bytes))
}

/// What a belief packet of this sender and launch time says: a dict of its fields.
#[pyfunction]
fn decode_belief<'py>(
    py: Python<'py>,
    packet: &[u8],
    sender: u16,
    tol_ns: i64,
) -> PyResult<Bound<'py, PyDict>> {
    let BeliefPacket { header, belief } =
        BeliefPacket::decode(packet, sender, tol_ns).map_err(|e| navigator(e.into()))?;
    let p = belief.covariance_m2;
    let fields = PyDict::new(py);
    fields.set_item("mean_m", vec![belief.mean_m.x, belief.mean_m.y].into_pyarray(py))?;
    fields.set_item("covariance_m2", vec![p.m11, p.m12, p.m21, p.m22].into_pyarray(py).reshape([2, 2])?)?;
    fields.set_item("depth_m", header.depth_m)?;
    fields.set_item("sequence", header.sequence)?;
    fields.set_item("heard", header.heard.bits())?;
    Ok(fields)
}

/// Adds both functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(encode_belief, module)?)?;
    module.add_function(wrap_pyfunction!(decode_belief, module)?)
}
