//! Packets of pose graphs.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::information::graph_packet::OriginCorrelation;
use uwcoop_core::information::{Gaussian, Node, NodeVector};
use uwcoop_core::packet::PacketError;
use uwcoop_core::packet::graph::rounded::{UnroundedPacket, node_bits, rounded};
use uwcoop_core::packet::graph::{GraphForm, GraphLink, GraphMessage};

use crate::errors::{argument, raise};
use crate::information::{column, column_out, square, square_out};

/// Layout by the name that scenarios give it.
fn form(name: &str) -> PyResult<GraphForm> {
    match name {
        "f64" => Ok(GraphForm::F64),
        "32" => Ok(GraphForm::Frame32),
        "64" => Ok(GraphForm::Frame64),
        "256" => Ok(GraphForm::Frame256),
        other => Err(argument(format!("packet form is {other:?}, not f64, 32, 64 or 256"))),
    }
}

fn packet_failed(error: PacketError) -> PyErr {
    argument(error.to_string())
}

/// A rounded packet of one node (`packet` 32, 64 or 256), without exact lags: the node's mean (4,) and covariance (4, 4);
/// for one that is not its own origin, the origin's sequence, its covariance as it was decoded, and how its filtered
/// error lives on in the node's, Φ (4, 4).
#[pyfunction]
#[pyo3(signature = (mean, covariance, origin_covariance = None, transition = None, *, packet, sequence, origin, depth_m, sender, tol_ns))]
#[allow(clippy::too_many_arguments)]
fn encode_graph<'py>(
    py: Python<'py>,
    mean: PyReadonlyArray1<'py, f64>,
    covariance: PyReadonlyArray2<'py, f64>,
    origin_covariance: Option<PyReadonlyArray2<'py, f64>>,
    transition: Option<PyReadonlyArray2<'py, f64>>,
    packet: &str,
    sequence: u8,
    origin: u8,
    depth_m: f64,
    sender: u16,
    tol_ns: i64,
) -> PyResult<Bound<'py, PyBytes>> {
    let filtered =
        Gaussian { mean: column::<4>("mean", &mean)?, covariance: square::<4>("covariance", &covariance)? };
    let origin = match (origin_covariance, transition) {
        (Some(known), Some(transition)) => {
            let known =
                Gaussian { mean: NodeVector::zeros(), covariance: square::<4>("origin_covariance", &known)? };
            Some((u64::from(origin), known, square::<4>("transition", &transition)?))
        }
        (None, None) => None,
        _ => return Err(argument("origin_covariance and transition belong together".into())),
    };
    let node = Node { id: u64::from(sequence), tol_ns, filtered };
    let form = form(packet)?;
    let graph = rounded(&UnroundedPacket { node, origin, lags: Vec::new() }, form).map_err(packet_failed)?;
    let message = GraphMessage { sequence, depth_m, bitmaps: Vec::new(), graph: Some(graph) };
    let link = GraphLink { form, sender, tol_ns, bitmaps: 0 };
    Ok(PyBytes::new(py, &message.encode(&link).map_err(packet_failed)?))
}

/// Reads a packet of `encode_graph`. A dict: `sequence`, `origin`, `depth_m`, `mean` (4,), `root` L (4, 4) with covariance
/// L Lᵀ, `correlation` M (4, 4) or None for a node that is its own origin, and `bits` of node and M.
#[pyfunction]
#[pyo3(signature = (bytes, *, packet, sender, tol_ns))]
fn decode_graph<'py>(
    py: Python<'py>,
    bytes: &[u8],
    packet: &str,
    sender: u16,
    tol_ns: i64,
) -> PyResult<Bound<'py, PyDict>> {
    let link = GraphLink { form: form(packet)?, sender, tol_ns, bitmaps: 0 };
    let message = GraphMessage::decode(bytes, &link, None, None, u64::from).map_err(packet_failed)?;
    let graph = message.graph.ok_or_else(|| argument("the packet holds no graph".into()))?;
    let filtered = graph.node.filtered;
    let singular = || raise("NumericalError", "the packet's covariance is not positive definite".into());
    let root = filtered.covariance.cholesky().ok_or_else(singular)?.l();
    let dict = PyDict::new(py);
    dict.set_item("sequence", message.sequence)?;
    dict.set_item("origin", graph.origin & 0xFF)?;
    dict.set_item("depth_m", message.depth_m)?;
    dict.set_item("mean", column_out(py, &filtered.mean))?;
    dict.set_item("root", square_out(py, &root)?)?;
    match graph.tie {
        OriginCorrelation::Correlation(scaled) => {
            let back = root.try_inverse().ok_or_else(singular)?;
            dict.set_item("correlation", square_out(py, &(back * scaled))?)?;
        }
        OriginCorrelation::Begin | OriginCorrelation::Joint(_) => dict.set_item("correlation", py.None())?,
    }
    dict.set_item("bits", node_bits(link.form, matches!(graph.tie, OriginCorrelation::Begin)))?;
    Ok(dict)
}

/// Adds the functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(encode_graph, module)?)?;
    module.add_function(wrap_pyfunction!(decode_graph, module)?)
}
