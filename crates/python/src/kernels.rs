//! `uwcoop.kernels`: the core's inner loops as pure functions of their draws, on the scalar f64 path.

use nalgebra::{Matrix2, SMatrix, Vector2};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::kernels::likelihood::{self, OffsetModel, RangeBelief};
use uwcoop_core::kernels::lookup::{self, Grid};
use uwcoop_core::kernels::particles;
use uwcoop_core::kernels::pattern::{self, Pattern};
use uwcoop_core::kernels::weights;
use uwcoop_core::mixture::fit;
use uwcoop_core::packet::{Belief, BeliefPacket, Header, HeardBitmap, PacketKind};

use crate::chart::Chart;
use crate::errors::{argument, navigator};

type Points<'py> = PyReadonlyArray2<'py, f64>;
type Column<'py> = PyReadonlyArray1<'py, f64>;

/// The two columns of an (N, 2) array.
pub fn columns(points: &Points<'_>, name: &str) -> PyResult<[Vec<f64>; 2]> {
    if points.shape()[1] != 2 {
        return Err(argument(format!("{name} has shape {:?}, not (N, 2)", points.shape())));
    }
    let a = points.as_array();
    Ok([a.column(0).to_vec(), a.column(1).to_vec()])
}

fn same(name: &str, found: usize, expected: usize) -> PyResult<()> {
    if found != expected {
        return Err(argument(format!("{name} has {found} entries where {expected} are expected")));
    }
    Ok(())
}

fn points<'py>(py: Python<'py>, east: &[f64], north: &[f64]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = east.iter().zip(north).flat_map(|(e, n)| [*e, *n]).collect();
    flat.into_pyarray(py).reshape([east.len(), 2])
}

fn symmetric(name: &str, matrix: &PyReadonlyArray2<'_, f64>) -> PyResult<[f64; 3]> {
    if matrix.shape() != [2, 2] {
        return Err(argument(format!("{name} has shape {:?}, not (2, 2)", matrix.shape())));
    }
    let m = matrix.as_array();
    Ok([m[[0, 0]], m[[0, 1]], m[[1, 1]]])
}

fn grid_of<'a>(
    values: &'a [f64],
    shape: &[usize],
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
) -> PyResult<Grid<'a, f64>> {
    if shape.len() != 2 || shape[0] < 2 || shape[1] < 2 {
        return Err(argument(format!("grid has shape {shape:?}, smaller than (2, 2)")));
    }
    if cell_m.is_nan() || cell_m <= 0.0 {
        return Err(argument(format!("cell_m is {cell_m}, not above 0")));
    }
    Ok(Grid { values, rows: shape[0], cols: shape[1], east0_m, north0_m, cell_m })
}

/// Depths of the bilinear surface at (N, 2) points; NaN off the grid or beside a NaN node.
#[pyfunction]
fn bilinear_depth<'py>(
    py: Python<'py>,
    grid: PyReadonlyArray2<'py, f64>,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
    points_m: Points<'py>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let values: Vec<f64> = grid.as_array().iter().copied().collect();
    let g = grid_of(&values, grid.shape(), east0_m, north0_m, cell_m)?;
    let [e, n] = columns(&points_m, "points_m")?;
    let out: Vec<f64> = e.iter().zip(&n).map(|(e, n)| lookup::bilinear(&g, *e, *n)).collect();
    Ok(out.into_pyarray(py))
}

/// Gradient ∂depth/∂(east, north) at (N, 2) points, (N, 2); NaN where there is no depth.
#[pyfunction]
fn bilinear_gradient<'py>(
    py: Python<'py>,
    grid: PyReadonlyArray2<'py, f64>,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
    points_m: Points<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let values: Vec<f64> = grid.as_array().iter().copied().collect();
    let g = grid_of(&values, grid.shape(), east0_m, north0_m, cell_m)?;
    let [e, n] = columns(&points_m, "points_m")?;
    let flat: Vec<f64> = e.iter().zip(&n).flat_map(|(e, n)| lookup::gradient(&g, *e, *n)).collect();
    flat.into_pyarray(py).reshape([e.len(), 2])
}

/// What `propagate` returns: positions (N, 2), Kalman means (N, K), covariance (K, K).
type Propagated<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// One time update (5)–(8). K = 2 (current) or 4 (and compass bias, thrust bias).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn propagate<'py>(
    py: Python<'py>,
    positions_m: Points<'py>,
    kalman: Points<'py>,
    covariance: PyReadonlyArray2<'py, f64>,
    control_mps: [f64; 2],
    dt_s: f64,
    q_position: PyReadonlyArray2<'py, f64>,
    q_kalman: PyReadonlyArray2<'py, f64>,
    normals: Points<'py>,
) -> PyResult<Propagated<'py>> {
    match kalman.shape()[1] {
        2 => propagate_k::<2>(
            py,
            &positions_m,
            &kalman,
            &covariance,
            control_mps,
            dt_s,
            &q_position,
            &q_kalman,
            &normals,
        ),
        4 => propagate_k::<4>(
            py,
            &positions_m,
            &kalman,
            &covariance,
            control_mps,
            dt_s,
            &q_position,
            &q_kalman,
            &normals,
        ),
        k => Err(argument(format!("kalman has {k} columns, not 2 or 4"))),
    }
}

#[allow(clippy::too_many_arguments)]
fn propagate_k<'py, const K: usize>(
    py: Python<'py>,
    positions_m: &Points<'py>,
    kalman: &Points<'py>,
    covariance: &Points<'py>,
    control_mps: [f64; 2],
    dt_s: f64,
    q_position: &Points<'py>,
    q_kalman: &Points<'py>,
    normals: &Points<'py>,
) -> PyResult<Propagated<'py>> {
    let [mut east, mut north] = columns(positions_m, "positions_m")?;
    let [a, b] = columns(normals, "normals")?;
    same("kalman", kalman.shape()[0], east.len())?;
    same("normals", a.len(), east.len())?;
    for (name, m) in [("covariance", covariance), ("q_kalman", q_kalman)] {
        if m.shape() != [K, K] {
            return Err(argument(format!("{name} has shape {:?}, not ({K}, {K})", m.shape())));
        }
    }
    let square = |m: &Points<'_>| SMatrix::<f64, K, K>::from_fn(|r, c| m.as_array()[[r, c]]);
    let mut linear: [Vec<f64>; K] = std::array::from_fn(|k| kalman.as_array().column(k).to_vec());
    let mut p = square(covariance);
    let q = symmetric("q_position", q_position)?;
    let step = particles::prepare_step(&mut p, control_mps, dt_s, q, &square(q_kalman));
    particles::propagate(&step, &mut east, &mut north, &mut linear, &a, &b);
    let kalman_flat: Vec<f64> = (0..east.len()).flat_map(|i| linear.iter().map(move |c| c[i])).collect();
    let p_flat: Vec<f64> = (0..K).flat_map(|r| (0..K).map(move |c| (r, c))).map(|i| p[i]).collect();
    Ok((
        points(py, &east, &north)?,
        kalman_flat.into_pyarray(py).reshape([east.len(), K])?,
        p_flat.into_pyarray(py).reshape([K, K])?,
    ))
}

/// Log-likelihood (15) of ℓ depth differences along a rigid segment of ℓ + 1 offsets, (N,).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn terrain_log_likelihood<'py>(
    py: Python<'py>,
    grid: PyReadonlyArray2<'py, f64>,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
    positions_m: Points<'py>,
    offsets_m: Points<'py>,
    differences_m: Column<'py>,
    sigma_m: f64,
    missing: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let values: Vec<f64> = grid.as_array().iter().copied().collect();
    let g = grid_of(&values, grid.shape(), east0_m, north0_m, cell_m)?;
    let [e, n] = columns(&positions_m, "positions_m")?;
    let [oe, on] = columns(&offsets_m, "offsets_m")?;
    let differences = differences_m.as_array().to_vec();
    same("differences_m", differences.len() + 1, oe.len())?;
    if sigma_m.is_nan() || sigma_m <= 0.0 {
        return Err(argument(format!("sigma_m is {sigma_m}, not above 0")));
    }
    let offsets: Vec<[f64; 2]> = oe.iter().zip(&on).map(|(e, n)| [*e, *n]).collect();
    let mut out = vec![0.0; e.len()];
    likelihood::terrain_log_likelihood(&g, &e, &n, &offsets, &differences, sigma_m, missing, &mut out);
    Ok(out.into_pyarray(py))
}

/// Particles whose columns are unpacked at a time: they stay in the nearest cache.
const UNPACKED: usize = 1024;

/// Depths of (N, 2) positions plus each of (L, 2) offsets on the navigators' float32 path, (L, N) float32; a pattern that
/// comes within two cells of the chart's edge is refused. With `out`, a C-contiguous (L, N) array, nothing is allocated
/// and `out` is returned; what it holds after an error is not defined.
#[pyfunction]
#[pyo3(signature = (chart, positions_m, offsets_m, out = None))]
fn pattern_depths<'py>(
    py: Python<'py>,
    chart: &Chart,
    positions_m: Points<'py>,
    offsets_m: Points<'py>,
    out: Option<Bound<'py, PyArray2<f32>>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    if positions_m.shape()[1] != 2 {
        return Err(argument(format!("positions_m has shape {:?}, not (N, 2)", positions_m.shape())));
    }
    let [oe, on] = columns(&offsets_m, "offsets_m")?;
    let (points, n) = (oe.len(), positions_m.shape()[0]);
    let out = out.unwrap_or_else(|| PyArray2::zeros(py, [points, n], false));
    let mut depths = out.try_readwrite().map_err(|e| argument(format!("out cannot be written: {e}")))?;
    if depths.shape() != [points, n] {
        return Err(argument(format!("out has shape {:?}, not ({points}, {n})", depths.shape())));
    }
    let contiguous = depths.is_c_contiguous().then(|| depths.as_slice_mut().ok()).flatten();
    let depths = contiguous.ok_or_else(|| argument("out is not a C-contiguous array".to_string()))?;
    let grid = chart.inner.grid();
    let mut pattern = Pattern::default();
    pattern.set(&grid, oe.iter().zip(&on).map(|(e, n)| [*e, *n]));
    let (mut east, mut north) = ([0.0; UNPACKED], [0.0; UNPACKED]);
    let positions = positions_m.as_array();
    for start in (0..n).step_by(UNPACKED) {
        let here = UNPACKED.min(n - start);
        if let Some(flat) = positions.as_slice() {
            let pairs = flat[2 * start..2 * (start + here)].as_chunks::<2>().0;
            for ((e, n), p) in east.iter_mut().zip(&mut north).zip(pairs) {
                (*e, *n) = (p[0], p[1]);
            }
        } else {
            for (i, (e, n)) in east.iter_mut().zip(&mut north).take(here).enumerate() {
                (*e, *n) = (positions[[start + i, 0]], positions[[start + i, 1]]);
            }
        }
        let (e, n_) = (&east[..here], &north[..here]);
        if !pattern::pattern_rows(&grid, &pattern, e, n_, depths, n, start) {
            return Err(argument(
                "positions_m plus offsets_m leave the chart or come within two cells of its edge".into(),
            ));
        }
    }
    Ok(out)
}

/// What `offset_update` returns, each (N,).
type Updated<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// One absolute sounding against charted depths with a datum offset: (log-likelihood, offset, offset variance).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn offset_update<'py>(
    py: Python<'py>,
    water_depth_m: f64,
    depths_m: Column<'py>,
    offset_m: Column<'py>,
    offset_variance_m2: Column<'py>,
    sigma_m: f64,
    q_offset_m: f64,
    sigma_map_m: f64,
    shared: f64,
    student_dof: f64,
) -> PyResult<Updated<'py>> {
    let depths = depths_m.as_array();
    same("offset_m", offset_m.as_array().len(), depths.len())?;
    same("offset_variance_m2", offset_variance_m2.as_array().len(), depths.len())?;
    let model = OffsetModel { sigma_m, shared, dof: student_dof };
    let (mut l, mut b, mut p) = (Vec::new(), Vec::new(), Vec::new());
    for ((h, offset), variance) in depths.iter().zip(offset_m.as_array()).zip(offset_variance_m2.as_array()) {
        let (log_likelihood, correction, updated) =
            model.update(water_depth_m - h - offset, variance + q_offset_m * q_offset_m, sigma_map_m);
        l.push(log_likelihood);
        b.push(offset + correction);
        p.push(updated);
    }
    Ok((l.into_pyarray(py), b.into_pyarray(py), p.into_pyarray(py)))
}

/// Range log-likelihood of (N, 2) positions to a belief: `eq17` against (M, 2) samples of it, or `gaussian`.
#[pyfunction]
#[pyo3(signature = (positions_m, mean_m, covariance_m2, range_m, sigma_m, method, samples = None))]
#[allow(clippy::too_many_arguments)]
fn range_log_likelihood<'py>(
    py: Python<'py>,
    positions_m: Points<'py>,
    mean_m: [f64; 2],
    covariance_m2: PyReadonlyArray2<'py, f64>,
    range_m: f64,
    sigma_m: f64,
    method: &str,
    samples: Option<Points<'py>>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let [e, n] = columns(&positions_m, "positions_m")?;
    let mut out = vec![0.0; e.len()];
    match (method, samples) {
        ("gaussian", _) => {
            let covariance_m2 = symmetric("covariance_m2", &covariance_m2)?;
            let belief = RangeBelief { mean_m, covariance_m2, range_m, sigma_m };
            likelihood::add_range_gaussian(&belief, 1.0, &e, &n, &mut out);
        }
        ("eq17", Some(samples)) => {
            let [se, sn] = columns(&samples, "samples")?;
            likelihood::range_eq17(range_m, &se, &sn, &vec![1.0; se.len()], &e, &n, &mut out);
        }
        ("eq17", None) => return Err(argument("method eq17 needs samples of the belief".into())),
        (other, _) => return Err(argument(format!("method is {other:?}, not eq17 or gaussian"))),
    }
    Ok(out.into_pyarray(py))
}

/// Normalised weights of log-weights, (N,).
#[pyfunction]
fn normalize<'py>(py: Python<'py>, log_weights: Column<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let mut logs = log_weights.as_array().to_vec();
    let mut out = vec![0.0; logs.len()];
    weights::normalise(&mut logs, &mut out).ok_or_else(|| argument("no log-weight is finite".into()))?;
    Ok(out.into_pyarray(py))
}

/// Ancestors and copies, each (N,).
type Resampled<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>);

/// Residual resampling: (ancestors ascending, copies of each), from one uniform for each of the R left copies.
#[pyfunction]
fn residual_resample<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    uniforms: Column<'py>,
) -> PyResult<Resampled<'py>> {
    let w = weights.as_array().to_vec();
    let u = uniforms.as_array().to_vec();
    let sum: f64 = w.iter().sum();
    if w.is_empty() || (sum - 1.0).abs() > 1e-9 || w.iter().any(|x| x.is_nan() || *x < 0.0) {
        return Err(argument(format!("weights sum to {sum}, not to 1, or one is negative or NaN")));
    }
    let left = w.len() - w.iter().map(|x| (x * w.len() as f64).floor() as usize).sum::<usize>().min(w.len());
    if u.len() < left {
        return Err(argument(format!("{} uniforms where {left} are needed", u.len())));
    }
    let n = w.len();
    let (mut cdf, mut counts, mut ancestors) = (vec![0.0; n], vec![0u32; n], vec![0u32; n]);
    uwcoop_core::kernels::weights::residual_resample(&w, &u, &mut cdf, &mut counts, &mut ancestors);
    let wide = |v: Vec<u32>| v.into_iter().map(i64::from).collect::<Vec<_>>().into_pyarray(py);
    Ok((wide(ancestors), wide(counts)))
}

/// The paper's roughening: particles whose ancestor has more than one copy move by √variance · n, (N, 2).
#[pyfunction]
fn roughen<'py>(
    py: Python<'py>,
    positions_m: Points<'py>,
    ancestors: PyReadonlyArray1<'py, i64>,
    counts: PyReadonlyArray1<'py, i64>,
    variance_m2: f64,
    normals: Points<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [mut e, mut n] = columns(&positions_m, "positions_m")?;
    let [a, b] = columns(&normals, "normals")?;
    let narrow = |name: &str, values: &PyReadonlyArray1<'_, i64>| -> PyResult<Vec<u32>> {
        same(name, values.as_array().len(), e.len())?;
        values
            .as_array()
            .iter()
            .map(|v| u32::try_from(*v).map_err(|_| argument(format!("{name} holds {v}"))))
            .collect()
    };
    let (ancestors, counts) = (narrow("ancestors", &ancestors)?, narrow("counts", &counts)?);
    same("normals", a.len(), e.len())?;
    if let Some(bad) = ancestors.iter().find(|a| **a as usize >= counts.len()) {
        return Err(argument(format!("ancestors holds {bad}, beyond {} particles", counts.len())));
    }
    particles::roughen(&mut e, &mut n, &ancestors, &counts, variance_m2, &a, &b);
    points(py, &e, &n)
}

/// Liu–West on the joint (N, D) state of equally weighted particles, D = 2 to 7, with (N, D) normals.
#[pyfunction]
fn liu_west<'py>(
    py: Python<'py>,
    states: Points<'py>,
    bandwidth: f64,
    normals: Points<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    if states.shape() != normals.shape() {
        return Err(argument(format!("normals has shape {:?}, not {:?}", normals.shape(), states.shape())));
    }
    if !(0.0..=1.0).contains(&bandwidth) {
        return Err(argument(format!("bandwidth is {bandwidth}, outside 0 to 1")));
    }
    match states.shape()[1] {
        2 => liu_west_d::<2>(py, &states, bandwidth, &normals),
        3 => liu_west_d::<3>(py, &states, bandwidth, &normals),
        4 => liu_west_d::<4>(py, &states, bandwidth, &normals),
        5 => liu_west_d::<5>(py, &states, bandwidth, &normals),
        6 => liu_west_d::<6>(py, &states, bandwidth, &normals),
        7 => liu_west_d::<7>(py, &states, bandwidth, &normals),
        d => Err(argument(format!("states has {d} columns, outside 2 to 7"))),
    }
}

fn liu_west_d<'py, const D: usize>(
    py: Python<'py>,
    states: &Points<'py>,
    bandwidth: f64,
    normals: &Points<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let mut x: [Vec<f64>; D] = std::array::from_fn(|d| states.as_array().column(d).to_vec());
    let z: [Vec<f64>; D] = std::array::from_fn(|d| normals.as_array().column(d).to_vec());
    let rows = x[0].len();
    particles::liu_west(
        &mut x.each_mut().map(|c| c.as_mut_slice()),
        bandwidth,
        &z.each_ref().map(|c| c.as_slice()),
    );
    let flat: Vec<f64> = (0..rows).flat_map(|i| x.iter().map(move |c| c[i])).collect();
    flat.into_pyarray(py).reshape([rows, D])
}

/// Mean (2,) and covariance (2, 2).
type Moments<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// Weighted mean (2,) and covariance (2, 2) of positions (10)–(11).
#[pyfunction]
fn moments<'py>(py: Python<'py>, weights: Column<'py>, positions_m: Points<'py>) -> PyResult<Moments<'py>> {
    let [e, n] = columns(&positions_m, "positions_m")?;
    let w = weights.as_array().to_vec();
    same("weights", w.len(), e.len())?;
    let (mean, [ee, en, nn]) = weights::moments(&w, &e, &n);
    Ok((mean.to_vec().into_pyarray(py), vec![ee, en, en, nn].into_pyarray(py).reshape([2, 2])?))
}

/// What `fit_mixture` returns: weights (k,), means (k, 2), covariances (k, 2, 2).
type Mixture<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// A mixture of `modes` Gaussians fitted to weighted positions by `iterations` of EM.
#[pyfunction]
fn fit_mixture<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    positions_m: Points<'py>,
    modes: usize,
    iterations: usize,
) -> PyResult<Mixture<'py>> {
    let [e, n] = columns(&positions_m, "positions_m")?;
    let w = weights.as_array().to_vec();
    same("weights", w.len(), e.len())?;
    let points: Vec<Vector2<f64>> = e.iter().zip(&n).map(|(e, n)| Vector2::new(*e, *n)).collect();
    let fitted = fit(&points, &w, modes, iterations)
        .ok_or_else(|| argument(format!("{modes} modes on {} points: no mixture", points.len())))?;
    let mean: Vec<f64> = fitted.iter().flat_map(|m| [m.mean.x, m.mean.y]).collect();
    let covariance: Vec<f64> = fitted
        .iter()
        .flat_map(|m| [m.covariance.m11, m.covariance.m12, m.covariance.m21, m.covariance.m22])
        .collect();
    Ok((
        fitted.iter().map(|m| m.weight).collect::<Vec<_>>().into_pyarray(py),
        mean.into_pyarray(py).reshape([modes, 2])?,
        covariance.into_pyarray(py).reshape([modes, 2, 2])?,
    ))
}

/// Effective sample size (13) of normalised weights.
#[pyfunction]
fn effective_sample_size(weights: Column<'_>) -> f64 {
    weights::effective_sample_size(&weights.as_array().to_vec())
}

/// Kernel entropy (20)–(21), nat.
#[pyfunction]
fn kernel_entropy(weights: Column<'_>, positions_m: Points<'_>, sigma_m: f64) -> PyResult<f64> {
    let [e, n] = columns(&positions_m, "positions_m")?;
    let w = weights.as_array().to_vec();
    same("weights", w.len(), e.len())?;
    Ok(weights::kernel_entropy(&w, &e, &n, sigma_m))
}

fn kind(packet: &str) -> PyResult<PacketKind> {
    match packet {
        "rounded" => Ok(PacketKind::Belief),
        "f64" => Ok(PacketKind::BeliefF64),
        other => Err(argument(format!("packet is {other:?}, not rounded or f64"))),
    }
}

/// A position belief as a sealed packet: 15 bytes (`rounded`) or 47 (`f64`).
#[pyfunction]
#[pyo3(signature = (mean_m, covariance_m2, *, depth_m, sequence, heard, sender, tol_ns, packet))]
#[allow(clippy::too_many_arguments)]
fn encode_belief<'py>(
    py: Python<'py>,
    mean_m: [f64; 2],
    covariance_m2: PyReadonlyArray2<'py, f64>,
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

/// What a sealed belief packet of this sender and launch time says: a dict of its fields.
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

/// Adds all kernels to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bilinear_depth, module)?)?;
    module.add_function(wrap_pyfunction!(bilinear_gradient, module)?)?;
    module.add_function(wrap_pyfunction!(propagate, module)?)?;
    module.add_function(wrap_pyfunction!(terrain_log_likelihood, module)?)?;
    module.add_function(wrap_pyfunction!(pattern_depths, module)?)?;
    module.add_function(wrap_pyfunction!(offset_update, module)?)?;
    module.add_function(wrap_pyfunction!(range_log_likelihood, module)?)?;
    module.add_function(wrap_pyfunction!(normalize, module)?)?;
    module.add_function(wrap_pyfunction!(residual_resample, module)?)?;
    module.add_function(wrap_pyfunction!(roughen, module)?)?;
    module.add_function(wrap_pyfunction!(liu_west, module)?)?;
    module.add_function(wrap_pyfunction!(moments, module)?)?;
    module.add_function(wrap_pyfunction!(fit_mixture, module)?)?;
    module.add_function(wrap_pyfunction!(effective_sample_size, module)?)?;
    module.add_function(wrap_pyfunction!(kernel_entropy, module)?)?;
    module.add_function(wrap_pyfunction!(encode_belief, module)?)?;
    module.add_function(wrap_pyfunction!(decode_belief, module)?)
}
