//! The packet of a role exchange, encoded and decoded from Python, and the particles that a receiver makes of it.

use nalgebra::SVector;
use numpy::{PyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::navigator::landmark::paper_cloud::expand;
use uwcoop_core::packet::landmark::ExchangePacket;

use crate::arrays::{Column, Matrix, flat, rows};
use crate::errors::navigator;
use crate::landmark_words::{exchange_format, exchange_size};
use crate::mixture_kernels::{modes_dict, modes_of};

/// Particles (N, 6) of a mixture in polar form with (N, 6) normals; the particles of a mode stand together.
#[pyfunction]
fn expand_exchange<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    means: Matrix<'py>,
    covariances: PyReadonlyArray3<'py, f64>,
    normals: Matrix<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let modes = modes_of(&weights, &means, &covariances)?;
    let z: Vec<SVector<f64, 6>> = rows::<6>(&normals, "normals")?.into_iter().map(SVector::from).collect();
    let (m, l) = expand(&modes, &z);
    flat(py, (0..z.len()).map(|i| [m[0][i], m[1][i], m[2][i], l[0][i], l[1][i], l[2][i]]))
}

/// An exchange packet of 8, 16, 32, 40, 64 or 128 bytes from a mixture in polar form.
#[pyfunction]
#[pyo3(signature = (weights, means, covariances, *, packet_bytes, packet_format, sequence, sender, tol_ns))]
#[allow(clippy::too_many_arguments)]
fn encode_exchange<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    means: Matrix<'py>,
    covariances: PyReadonlyArray3<'py, f64>,
    packet_bytes: usize,
    packet_format: usize,
    sequence: u8,
    sender: u16,
    tol_ns: i64,
) -> PyResult<Bound<'py, PyBytes>> {
    let mut modes = modes_of(&weights, &means, &covariances)?;
    modes.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let packet = ExchangePacket { sequence: Some(sequence), modes };
    let bytes = packet
        .encode(exchange_format(packet_format)?, exchange_size(packet_bytes)?, sender, tol_ns)
        .map_err(|e| navigator(e.into()))?;
    Ok(PyBytes::new(py, &bytes))
}

/// What an exchange packet says: weights, means, covariances, sequence (None in 8 bytes). `landmark_m` is where the
/// receiver takes the landmark to be.
#[pyfunction]
#[pyo3(signature = (packet, *, packet_format, landmark_m, sender, tol_ns))]
fn decode_exchange<'py>(
    py: Python<'py>,
    packet: &[u8],
    packet_format: usize,
    landmark_m: [f64; 2],
    sender: u16,
    tol_ns: i64,
) -> PyResult<Bound<'py, PyDict>> {
    let got = ExchangePacket::decode(packet, exchange_format(packet_format)?, landmark_m, sender, tol_ns)
        .map_err(|e| navigator(e.into()))?;
    let out = modes_dict(py, &got.modes)?;
    out.set_item("sequence", got.sequence)?;
    Ok(out)
}

/// Adds the functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(expand_exchange, module)?)?;
    module.add_function(wrap_pyfunction!(encode_exchange, module)?)?;
    module.add_function(wrap_pyfunction!(decode_exchange, module)?)
}
