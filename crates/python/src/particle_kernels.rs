//! `uwcoop.kernels` of particles and their weights: pure functions of their draws, on the scalar f64 path.

use nalgebra::SMatrix;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;
use uwcoop_core::kernels::likelihood::{self, RangeBelief};
use uwcoop_core::kernels::particles;
use uwcoop_core::kernels::weights;
use uwcoop_core::measurement::range::LateArrivals;

use crate::arrays::{Column, Matrix, columns, points, same, symmetric};
use crate::errors::argument;

/// What `propagate` returns: positions (N, 2), Kalman means (N, K), covariance (K, K).
type Propagated<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// One time update (5)–(8). K = 2 (current) or 4 (and compass bias, thrust bias).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn propagate<'py>(
    py: Python<'py>,
    positions_m: Matrix<'py>,
    kalman: Matrix<'py>,
    covariance: Matrix<'py>,
    control_mps: [f64; 2],
    dt_s: f64,
    q_position: Matrix<'py>,
    q_kalman: Matrix<'py>,
    normals: Matrix<'py>,
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
    positions_m: &Matrix<'py>,
    kalman: &Matrix<'py>,
    covariance: &Matrix<'py>,
    control_mps: [f64; 2],
    dt_s: f64,
    q_position: &Matrix<'py>,
    q_kalman: &Matrix<'py>,
    normals: &Matrix<'py>,
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
    let square = |m: &Matrix<'_>| SMatrix::<f64, K, K>::from_fn(|r, c| m.as_array()[[r, c]]);
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

/// Range log-likelihood of (N, 2) positions to a belief: `eq17` against (M, 2) samples of it, or `gaussian`.
#[pyfunction]
#[pyo3(signature = (positions_m, mean_m, covariance_m2, range_m, sigma_m, method, samples = None))]
#[allow(clippy::too_many_arguments)]
fn range_log_likelihood<'py>(
    py: Python<'py>,
    positions_m: Matrix<'py>,
    mean_m: [f64; 2],
    covariance_m2: Matrix<'py>,
    range_m: f64,
    sigma_m: f64,
    method: &str,
    samples: Option<Matrix<'py>>,
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

/// A range that may be late: ln Z, and mean and variance of a state with the variance `gain_m2` that the range sees with
/// coefficient one, each (N,).
#[pyfunction]
#[pyo3(signature = (innovation_m, variance_m2, gain_m2, late_share, lateness_m, floor_per_m))]
#[allow(clippy::type_complexity)]
fn late_range<'py>(
    py: Python<'py>,
    innovation_m: Column<'py>,
    variance_m2: Column<'py>,
    gain_m2: Column<'py>,
    late_share: f64,
    lateness_m: f64,
    floor_per_m: f64,
) -> PyResult<[Bound<'py, PyArray1<f64>>; 3]> {
    let n = innovation_m.len();
    same("variance_m2", variance_m2.len(), n)?;
    same("gain_m2", gain_m2.len(), n)?;
    let bounds = [
        ("late_share", late_share, (0.0..=1.0).contains(&late_share), "0 to 1"),
        ("lateness_m", lateness_m, lateness_m.is_finite() && lateness_m > 0.0, "above 0"),
        ("floor_per_m", floor_per_m, floor_per_m.is_finite() && floor_per_m >= 0.0, "0 or more"),
    ];
    for (name, value, good, bound) in bounds {
        if !good {
            return Err(argument(format!("{name} is {value}, outside {bound}")));
        }
    }
    let model = LateArrivals { share: late_share, mean_m: lateness_m, floor_per_m };
    let mut out = [(); 3].map(|()| Vec::with_capacity(n));
    let (innovations, variances) = (innovation_m.as_array(), variance_m2.as_array());
    for ((innovation, variance), gain) in innovations.iter().zip(variances).zip(gain_m2.as_array()) {
        if !(*variance > 0.0 && variance.is_finite()) {
            return Err(argument(format!("variance_m2 is {variance}, outside above 0")));
        }
        let update = model.likelihood(*innovation, *variance);
        out[0].push(update.log_z);
        out[1].push(-gain * update.slope);
        out[2].push(gain + gain * gain * update.curvature);
    }
    Ok(out.map(|column| column.into_pyarray(py)))
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
    positions_m: Matrix<'py>,
    ancestors: PyReadonlyArray1<'py, i64>,
    counts: PyReadonlyArray1<'py, i64>,
    variance_m2: f64,
    normals: Matrix<'py>,
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
    states: Matrix<'py>,
    bandwidth: f64,
    normals: Matrix<'py>,
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
    states: &Matrix<'py>,
    bandwidth: f64,
    normals: &Matrix<'py>,
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
fn moments<'py>(py: Python<'py>, weights: Column<'py>, positions_m: Matrix<'py>) -> PyResult<Moments<'py>> {
    let [e, n] = columns(&positions_m, "positions_m")?;
    let w = weights.as_array().to_vec();
    same("weights", w.len(), e.len())?;
    let (mean, [ee, en, nn]) = weights::moments(&w, &e, &n);
    Ok((mean.to_vec().into_pyarray(py), vec![ee, en, en, nn].into_pyarray(py).reshape([2, 2])?))
}

/// Effective sample size (13) of normalised weights.
#[pyfunction]
fn effective_sample_size(weights: Column<'_>) -> f64 {
    weights::effective_sample_size(&weights.as_array().to_vec())
}

/// Kernel entropy (20)–(21), nat.
#[pyfunction]
fn kernel_entropy(weights: Column<'_>, positions_m: Matrix<'_>, sigma_m: f64) -> PyResult<f64> {
    let [e, n] = columns(&positions_m, "positions_m")?;
    let w = weights.as_array().to_vec();
    same("weights", w.len(), e.len())?;
    Ok(weights::kernel_entropy(&w, &e, &n, sigma_m))
}

/// Adds the kernels to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(propagate, module)?)?;
    module.add_function(wrap_pyfunction!(range_log_likelihood, module)?)?;
    module.add_function(wrap_pyfunction!(late_range, module)?)?;
    module.add_function(wrap_pyfunction!(normalize, module)?)?;
    module.add_function(wrap_pyfunction!(residual_resample, module)?)?;
    module.add_function(wrap_pyfunction!(roughen, module)?)?;
    module.add_function(wrap_pyfunction!(liu_west, module)?)?;
    module.add_function(wrap_pyfunction!(moments, module)?)?;
    module.add_function(wrap_pyfunction!(effective_sample_size, module)?)?;
    module.add_function(wrap_pyfunction!(kernel_entropy, module)?)
}
