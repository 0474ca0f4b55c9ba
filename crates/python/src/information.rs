//! `uwcoop.kernels`: pose graphs in information form. Nodes are [x, y, ẋ, ẏ], graphs newest node first.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use uwcoop_core::error::Error;
use uwcoop_core::information::graph_packet::{GraphPacket, OriginCorrelation};
use uwcoop_core::information::replica::{Method, Methods, Replica};
use uwcoop_core::information::{
    Chain, Gaussian, GraphStep, Information, Node, NodeMatrix, NodeVector, dense, process, reconstruct,
};

use crate::errors::{argument, raise};

type Matrix<'py> = PyReadonlyArray2<'py, f64>;
type Column<'py> = PyReadonlyArray1<'py, f64>;
type Pair<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// A failed factorisation is numerical; everything else is a bad argument.
fn failed(error: Error) -> PyErr {
    match error {
        Error::NotPositiveDefinite { .. } => raise("NumericalError", error.to_string()),
        other => argument(other.to_string()),
    }
}

/// A finite D × D array.
pub(crate) fn square<const D: usize>(name: &str, matrix: &Matrix<'_>) -> PyResult<SMatrix<f64, D, D>> {
    if matrix.shape() != [D, D] {
        return Err(argument(format!("{name} has shape {:?}, not ({D}, {D})", matrix.shape())));
    }
    let view = matrix.as_array();
    let all = SMatrix::<f64, D, D>::from_fn(|r, c| view[[r, c]]);
    if all.iter().any(|value| !value.is_finite()) {
        return Err(argument(format!("{name} is not finite")));
    }
    Ok(all)
}

/// A finite array of D.
pub(crate) fn column<const D: usize>(name: &str, vector: &Column<'_>) -> PyResult<SVector<f64, D>> {
    if vector.shape() != [D] {
        return Err(argument(format!("{name} has shape {:?}, not ({D},)", vector.shape())));
    }
    let view = vector.as_array();
    let all = SVector::<f64, D>::from_fn(|r, _| view[r]);
    if all.iter().any(|value| !value.is_finite()) {
        return Err(argument(format!("{name} is not finite")));
    }
    Ok(all)
}

/// Row-major R × C.
pub(crate) fn square_out<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    matrix: &SMatrix<f64, R, C>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = (0..R * C).map(|i| matrix[(i / C, i % C)]).collect();
    flat.into_pyarray(py).reshape([R, C])
}

/// An array of D.
pub(crate) fn column_out<'py, const D: usize>(
    py: Python<'py>,
    vector: &SVector<f64, D>,
) -> Bound<'py, PyArray1<f64>> {
    vector.iter().copied().collect::<Vec<_>>().into_pyarray(py)
}

fn graph_out<'py>(py: Python<'py>, chain: &Chain) -> PyResult<Pair<'py>> {
    let (matrix, vector) = chain.information().map_err(failed)?;
    let n = vector.len();
    let flat: Vec<f64> = (0..n * n).map(|i| matrix[(i / n, i % n)]).collect();
    let vector: Vec<f64> = vector.iter().copied().collect();
    Ok((flat.into_pyarray(py).reshape([n, n])?, vector.into_pyarray(py)))
}

/// Schur complement: (matrix, vector) over the entries `keep`, in their order, with all others marginalised out.
#[pyfunction]
fn schur_marginalize<'py>(
    py: Python<'py>,
    matrix: Matrix<'py>,
    vector: Column<'py>,
    keep: Vec<usize>,
) -> PyResult<Pair<'py>> {
    let n = vector.shape()[0];
    if matrix.shape() != [n, n] {
        return Err(argument(format!("matrix has shape {:?}, not ({n}, {n})", matrix.shape())));
    }
    let values: Vec<f64> = matrix.as_array().iter().copied().collect();
    let vector: Vec<f64> = vector.as_array().to_vec();
    let (stays, told) = if n == 8 && keep == [0, 1, 2, 3] {
        let all = |v: &f64| v.is_finite();
        if !values.iter().all(all) || !vector.iter().all(all) {
            return Err(argument("information is not finite".into()));
        }
        let joint = Information::<8> {
            matrix: SMatrix::from_row_slice(&values),
            vector: SVector::from_column_slice(&vector),
        };
        let marginal = joint.marginal().map_err(failed)?;
        (marginal.matrix.transpose().as_slice().to_vec(), marginal.vector.as_slice().to_vec())
    } else {
        dense::marginalize(&values, &vector, &keep).map_err(failed)?
    };
    let m = keep.len();
    Ok((stays.into_pyarray(py).reshape([m, m])?, told.into_pyarray(py)))
}

fn joints(
    client_matrix: &Matrix<'_>,
    client_vector: &Column<'_>,
    server_matrix: &Matrix<'_>,
    server_vector: &Column<'_>,
) -> PyResult<(Information<8>, Information<8>)> {
    let client = Information {
        matrix: square("client_matrix", client_matrix)?,
        vector: column("client_vector", client_vector)?,
    };
    let server = Information {
        matrix: square("server_matrix", server_matrix)?,
        vector: column("server_vector", server_vector)?,
    };
    Ok((client, server))
}

/// Equation (6) of Walls & Eustice (2012), corrected: from the client's joint marginal over (t2, origin) and the
/// server's over (t3, origin), (8, 8) and (8,) each, to the delta information on (t3, t2).
///
/// A dict: `matrix` (8, 8), `vector` (8,), `omega` (4, 4), `nu` (4,), and `health`, the least eigenvalue of what the
/// packet took from the origin, whitened: rounding takes 2.2e-16 / health of it.
#[pyfunction]
fn origin_delta<'py>(
    py: Python<'py>,
    client_matrix: Matrix<'py>,
    client_vector: Column<'py>,
    server_matrix: Matrix<'py>,
    server_vector: Column<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let (client, server) = joints(&client_matrix, &client_vector, &server_matrix, &server_vector)?;
    let solved = reconstruct::origin_delta(&client, &server).map_err(failed)?;
    let dict = PyDict::new(py);
    dict.set_item("matrix", square_out(py, &solved.delta.matrix)?)?;
    dict.set_item("vector", column_out(py, &solved.delta.vector))?;
    dict.set_item("omega", square_out(py, &solved.omega)?)?;
    dict.set_item("nu", column_out(py, &solved.nu))?;
    dict.set_item("health", reconstruct::health(&client, &server))?;
    Ok(dict)
}

/// The filtered-error model from the same two joint marginals as `origin_delta`.
///
/// A dict: `matrix` (8, 8) and `vector` (8,) on (t3, t2), `transition` G (4, 4) and `noise` W (4, 4).
#[pyfunction]
fn filtered_error_delta<'py>(
    py: Python<'py>,
    client_matrix: Matrix<'py>,
    client_vector: Column<'py>,
    server_matrix: Matrix<'py>,
    server_vector: Column<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let (client, server) = joints(&client_matrix, &client_vector, &server_matrix, &server_vector)?;
    let (earlier, earlier_cross) = reconstruct::filtered(&client).map_err(failed)?;
    let (later, later_cross) = reconstruct::filtered(&server).map_err(failed)?;
    let transition = reconstruct::filtered_error_transition(&earlier, &earlier_cross, &later_cross, 1e-6)
        .map_err(failed)?;
    let step = reconstruct::filtered_error_step(&earlier, &later, &transition).map_err(failed)?;
    let delta = step.information().map_err(failed)?;
    let dict = PyDict::new(py);
    dict.set_item("matrix", square_out(py, &delta.matrix)?)?;
    dict.set_item("vector", column_out(py, &delta.vector))?;
    dict.set_item("transition", square_out(py, &step.transition)?)?;
    dict.set_item("noise", square_out(py, &step.noise)?)?;
    Ok(dict)
}

/// The pose graph of a vehicle that takes position fixes: white acceleration of density `q_m2_per_s3`, state
/// N(mean0, covariance0) at 0 s, positions (N, 2) with `sigma_m` at `times_s`, nodes at `tol_s` (both ascending; a fix
/// at a launch comes first).
///
/// A dict, nodes numbered in the order of `tol_s`: `prior_matrix`, `prior_vector` of node 0; `delta_matrices` (K − 1, 8,
/// 8), `delta_vectors` (K − 1, 8), the DEIF's delta information on (n, n − 1); `matrix`, `vector` of the whole graph,
/// newest node first; `packet_matrices` (K, 8, 8), `packet_vectors` (K, 8), the origin-state packets of each node with
/// the origin that `origins` names (its own: 4 × 4 in the upper left).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn pose_graph<'py>(
    py: Python<'py>,
    mean0: Column<'py>,
    covariance0: Matrix<'py>,
    q_m2_per_s3: f64,
    times_s: Column<'py>,
    positions_m: Matrix<'py>,
    sigma_m: f64,
    tol_s: Column<'py>,
    origins: Vec<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let fixes = times_s.shape()[0];
    if positions_m.shape() != [fixes, 2] {
        return Err(argument(format!("positions_m has shape {:?}, not ({fixes}, 2)", positions_m.shape())));
    }
    if origins.len() != tol_s.shape()[0] || origins.iter().enumerate().any(|(k, origin)| *origin > k) {
        return Err(argument("origins must name a node up to each launch's own".into()));
    }
    let (times, positions, launches) = (times_s.as_array(), positions_m.as_array(), tol_s.as_array());
    let mut now_s = 0.0;
    let mut state =
        Gaussian { mean: column("mean0", &mean0)?, covariance: square("covariance0", &covariance0)? };
    let mut since: GraphStep = GraphStep::identity();
    let mut chain = Chain::new();
    let observe = SMatrix::<f64, 2, 4>::identity();
    let noise = Matrix2::identity() * (sigma_m * sigma_m);
    let mut next = 0;
    for (id, launch) in launches.iter().enumerate() {
        while next <= fixes {
            let fix = (next < fixes && times[next] <= *launch).then_some(next);
            let until = fix.map_or(*launch, |at| times[at]);
            if until < now_s || !until.is_finite() {
                return Err(argument(format!("time {until} s is before {now_s} s")));
            }
            let (f, q) = (process::transition(until - now_s), process::noise(until - now_s, q_m2_per_s3));
            state.predict(&f, &q);
            since.predict(&f, &q);
            now_s = until;
            let Some(at) = fix else { break };
            let z = Vector2::new(positions[[at, 0]], positions[[at, 1]]);
            state.update(&observe, &z, &noise).map_err(failed)?;
            since.update(&observe, &z, &noise).map_err(failed)?;
            next += 1;
        }
        chain.push(since, Node { id: id as u64, tol_ns: id as i64, filtered: state });
        since = GraphStep::identity();
    }
    graph_dict(py, &chain, &origins)
}

fn graph_dict<'py>(py: Python<'py>, chain: &Chain, origins: &[usize]) -> PyResult<Bound<'py, PyDict>> {
    let k = origins.len();
    let (mut deltas, mut delta_vectors) = (Vec::<f64>::new(), Vec::<f64>::new());
    let (mut packets, mut packet_vectors) = (vec![0.0; k * 64], vec![0.0; k * 8]);
    for (id, origin) in origins.iter().enumerate() {
        if id > 0 {
            let delta = chain.between(id - 1, id).and_then(|s| s.information()).map_err(failed)?;
            deltas.extend(delta.matrix.transpose().iter());
            delta_vectors.extend(delta.vector.iter());
        }
        if *origin == id {
            let own = chain.nodes()[id].filtered.information().map_err(failed)?;
            for (r, c) in (0..16).map(|i| (i / 4, i % 4)) {
                packets[id * 64 + r * 8 + c] = own.matrix[(r, c)];
            }
            (0..4).for_each(|r| packet_vectors[id * 8 + r] = own.vector[r]);
        } else {
            let joint = chain.joint_marginal(*origin, id).map_err(failed)?;
            packets[id * 64..(id + 1) * 64].copy_from_slice(joint.matrix.transpose().as_slice());
            packet_vectors[id * 8..(id + 1) * 8].copy_from_slice(joint.vector.as_slice());
        }
    }
    let dict = PyDict::new(py);
    if let Some(first) = chain.nodes().first() {
        let prior = first.filtered.information().map_err(failed)?;
        dict.set_item("prior_matrix", square_out(py, &prior.matrix)?)?;
        dict.set_item("prior_vector", column_out(py, &prior.vector))?;
    }
    let steps = k.saturating_sub(1);
    dict.set_item("delta_matrices", deltas.into_pyarray(py).reshape([steps, 8, 8])?)?;
    dict.set_item("delta_vectors", delta_vectors.into_pyarray(py).reshape([steps, 8])?)?;
    let (matrix, vector) = graph_out(py, chain)?;
    dict.set_item("matrix", matrix)?;
    dict.set_item("vector", vector)?;
    dict.set_item("packet_matrices", packets.into_pyarray(py).reshape([k, 8, 8])?)?;
    dict.set_item("packet_vectors", packet_vectors.into_pyarray(py).reshape([k, 8])?)?;
    Ok(dict)
}

/// Rebuilds a server's pose graph from the origin-state packets that arrived: `ids` and `origins` (K,), `matrices` (K, 8,
/// 8), `vectors` (K, 8). `equation_6` false: by the filtered-error model alone.
///
/// A dict: `ids` newest first, `matrix` and `vector` of their graph (lost nodes marginalised out), and `methods`, one of
/// `begun`, `exact joint`, `equation 6`, `filtered error`, `skipped` for each packet.
#[pyfunction]
#[pyo3(signature = (ids, origins, matrices, vectors, equation_6 = true, loss_max = 1e-4))]
fn reconstruct_graph<'py>(
    py: Python<'py>,
    ids: Vec<u64>,
    origins: Vec<u64>,
    matrices: PyReadonlyArray3<'py, f64>,
    vectors: Matrix<'py>,
    equation_6: bool,
    loss_max: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let k = ids.len();
    if origins.len() != k || matrices.shape() != [k, 8, 8] || vectors.shape() != [k, 8] {
        return Err(argument(format!("ids, origins, matrices and vectors are not all of {k} packets")));
    }
    let (all, told) = (matrices.as_array(), vectors.as_array());
    let methods = Methods { joint: true, lags: 1, equation_6, loss_max };
    let mut replica = Replica::new(false);
    let mut used = Vec::with_capacity(k);
    for (at, (id, origin)) in ids.iter().zip(&origins).enumerate() {
        let (node, tie) = if id == origin {
            let own = Information::<4> {
                matrix: NodeMatrix::from_fn(|r, c| all[[at, r, c]]),
                vector: NodeVector::from_fn(|r, _| told[[at, r]]),
            };
            (own.gaussian().map_err(failed)?, OriginCorrelation::Begin)
        } else {
            let joint = Information::<8> {
                matrix: SMatrix::from_fn(|r, c| all[[at, r, c]]),
                vector: SVector::from_fn(|r, _| told[[at, r]]),
            };
            (reconstruct::filtered(&joint).map_err(failed)?.0, OriginCorrelation::Joint(joint))
        };
        let node = Node { id: *id, tol_ns: *id as i64, filtered: node };
        let packet = GraphPacket { node, origin: *origin, tie, lags: Vec::new() };
        let plan = replica.plan(&packet, &methods).map_err(failed)?;
        used.push(match plan.as_ref().map(|plan| plan.method) {
            Some(Method::Begun) => "begun",
            Some(Method::ExactJoint) => "exact joint",
            Some(Method::Equation6) => "equation 6",
            Some(Method::FilteredError) => "filtered error",
            None => "skipped",
        });
        if let Some(plan) = plan {
            replica.commit(&plan);
        }
    }
    let dict = PyDict::new(py);
    let held: Vec<u64> = replica.chain().nodes().iter().rev().map(|node| node.id).collect();
    dict.set_item("ids", held)?;
    let (matrix, vector) = graph_out(py, replica.chain())?;
    dict.set_item("matrix", matrix)?;
    dict.set_item("vector", vector)?;
    dict.set_item("methods", used)?;
    Ok(dict)
}

/// Adds the functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(schur_marginalize, module)?)?;
    module.add_function(wrap_pyfunction!(origin_delta, module)?)?;
    module.add_function(wrap_pyfunction!(filtered_error_delta, module)?)?;
    module.add_function(wrap_pyfunction!(pose_graph, module)?)?;
    module.add_function(wrap_pyfunction!(reconstruct_graph, module)?)
}
