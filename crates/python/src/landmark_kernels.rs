//! `uwcoop.kernels` of the alternating landmark method and of mixtures: pure functions of their draws.

use nalgebra::{SMatrix, SVector};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use uwcoop_core::kernels::landmark::{OdometryStep, predict, systematic_resample as systematic};
use uwcoop_core::mixture::{FitOptions, Fitted, Mode, fit_best, fit_from, select};
use uwcoop_core::navigator::landmark::model::{self, Acoustics, Measurement, Monitor, MonitorRule, Pose};
use uwcoop_core::navigator::landmark::paper_cloud::expand;
use uwcoop_core::noise::{Purpose, Streams};
use uwcoop_core::packet::landmark::ExchangePacket;

use crate::errors::{argument, navigator};
use crate::landmark::{criterion, exchange_format, exchange_size, gate, reading};

type Rows<'py> = PyReadonlyArray2<'py, f64>;
type Column<'py> = PyReadonlyArray1<'py, f64>;

/// Rows of exactly `D` numbers.
fn rows<const D: usize>(values: &Rows<'_>, name: &str) -> PyResult<Vec<[f64; D]>> {
    if values.shape()[1] != D {
        return Err(argument(format!("{name} has shape {:?}, not (N, {D})", values.shape())));
    }
    Ok(values.as_array().rows().into_iter().map(|r| std::array::from_fn(|k| r[k])).collect())
}

fn same(name: &str, found: usize, expected: usize) -> PyResult<()> {
    if found != expected {
        return Err(argument(format!("{name} has {found} entries where {expected} are expected")));
    }
    Ok(())
}

fn flat<'py, const D: usize>(
    py: Python<'py>,
    values: impl ExactSizeIterator<Item = [f64; D]>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let n = values.len();
    values.flatten().collect::<Vec<f64>>().into_pyarray(py).reshape([n, D])
}

fn measurement(values: [f64; 3]) -> Measurement {
    let some = |v: f64| (!v.is_nan()).then_some(v);
    Measurement { range_m: some(values[0]), own_rad: some(values[1]), peer_rad: some(values[2]) }
}

fn mover(row: &[f64; 6]) -> Pose {
    [row[0], row[1], row[2]]
}

fn landmark(row: &[f64; 6]) -> Pose {
    [row[3], row[4], row[5]]
}

/// Prediction (5)-(8) of (N, 6) particles [mover x, y, yaw, landmark x, y, yaw] with (N, 3) normals.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn landmark_predict<'py>(
    py: Python<'py>,
    particles: Rows<'py>,
    velocity_mps: [f64; 2],
    yaw_rate_radps: f64,
    dt_s: f64,
    sigma_mps: f64,
    sigma_radps: f64,
    normals: Rows<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (mut p, z) = (rows::<6>(&particles, "particles")?, rows::<3>(&normals, "normals")?);
    same("normals", z.len(), p.len())?;
    let column = |k: usize| -> Vec<f64> { z.iter().map(|r| r[k]).collect() };
    let mut own: [Vec<f64>; 3] = std::array::from_fn(|k| p.iter().map(|r| r[k]).collect());
    let [x, y, yaw] = &mut own;
    let step = OdometryStep { velocity_mps, sigma_mps, yaw_rate_radps, sigma_radps, dt_s };
    predict(&step, x, y, yaw, &column(0), &column(1), &column(2));
    for (i, row) in p.iter_mut().enumerate() {
        (row[0], row[1], row[2]) = (own[0][i], own[1][i], own[2][i]);
    }
    flat(py, p.into_iter())
}

/// Offsets (10), (11), (13) of (N, 6) particles, (3, N): range m, own and peer direction rad; NaN where not measured.
#[pyfunction]
fn landmark_offsets<'py>(
    py: Python<'py>,
    particles: Rows<'py>,
    at_transmit: Rows<'py>,
    measured: [f64; 3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (p, t) = (rows::<6>(&particles, "particles")?, rows::<3>(&at_transmit, "at_transmit")?);
    same("at_transmit", t.len(), p.len())?;
    let z = measurement(measured);
    let all: Vec<[f64; 3]> =
        p.iter().zip(&t).map(|(p, t)| model::offsets(mover(p), *t, landmark(p), &z)).collect();
    let columns: Vec<f64> = (0..3).flat_map(|c| all.iter().map(move |o| o[c])).collect();
    columns.into_pyarray(py).reshape([3, p.len()])
}

/// ln L_ML (N,), ln L_LM (N,), ln L_max.
type Likelihoods<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, f64);

/// Log-likelihoods (12), (14) and ln L_max (16)-(18) from (3, N) offsets; `gate`: joint, separate, none or mixture.
#[pyfunction]
#[pyo3(signature = (offsets, sigma, threshold, gate_name, outlier_share = 0.05, widths = [60.0, std::f64::consts::TAU, std::f64::consts::TAU]))]
fn landmark_log_likelihood<'py>(
    py: Python<'py>,
    offsets: Rows<'py>,
    sigma: [f64; 3],
    threshold: [f64; 3],
    gate_name: &str,
    outlier_share: f64,
    widths: [f64; 3],
) -> PyResult<Likelihoods<'py>> {
    let o = offsets.as_array();
    same("offsets", o.nrows(), 3)?;
    let gate = gate(gate_name, outlier_share, widths)?;
    let acoustics = Acoustics { sigma, threshold };
    acoustics.validate().map_err(navigator)?;
    let (ml, lm): (Vec<f64>, Vec<f64>) = (0..o.ncols())
        .map(|i| model::log_likelihoods([o[[0, i]], o[[1, i]], o[[2, i]]], &acoustics, &gate))
        .map(|[a, b]| (a, b))
        .unzip();
    let present = |c: usize| o.ncols() > 0 && !o[[c, 0]].is_nan();
    let z = measurement([0, 1, 2].map(|c| if present(c) { 0.0 } else { f64::NAN }));
    let most = model::log_likelihood_max(&z, &acoustics, &gate);
    Ok((ml.into_pyarray(py), lm.into_pyarray(py), most))
}

/// Systematic resampling: `count` indices, the least j with C_j > (u0 + i) / count.
#[pyfunction]
fn systematic_resample<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    u0: f64,
    count: usize,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let w = weights.as_array().to_vec();
    let sum: f64 = w.iter().sum();
    if sum.is_nan() || sum <= 0.0 || w.iter().any(|x| *x < 0.0) || !(0.0..1.0).contains(&u0) {
        return Err(argument(format!(
            "weights sum to {sum} or one is negative, or u0 {u0} is outside 0 to 1"
        )));
    }
    let mut out = vec![0u32; count];
    systematic(&w, u0, &mut out);
    Ok(out.into_iter().map(i64::from).collect::<Vec<_>>().into_pyarray(py))
}

/// (low, fire) for each positioning of a sequence; `monitor_reading`: linear or log.
type Alarms<'py> = (Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>);

/// The monitor over a sequence of ln L̄ and ln L_max.
#[pyfunction]
fn landmark_monitor<'py>(
    py: Python<'py>,
    log_mean: Column<'py>,
    log_max: Column<'py>,
    ratio: f64,
    trials: u32,
    monitor_reading: &str,
) -> PyResult<Alarms<'py>> {
    let rule = MonitorRule { ratio, trials, reading: reading(monitor_reading)? };
    let (mean, most) = (log_mean.as_array(), log_max.as_array());
    same("log_max", most.len(), mean.len())?;
    let mut monitor = Monitor::default();
    let (low, fire): (Vec<bool>, Vec<bool>) =
        mean.iter().zip(most.iter()).map(|(a, b)| monitor.observe(*a, *b, &rule)).unzip();
    Ok((low.into_pyarray(py), fire.into_pyarray(py)))
}

/// How many particles a reconstruction replaces (19) of Matsuda et al. (2017), from the mean and greatest log-likelihood.
#[pyfunction]
fn landmark_new_particles(count: usize, share: f64, log_mean: f64, log_max: f64) -> usize {
    model::new_particles(count, share, log_mean, log_max)
}

/// Particles (N, 6), who was replaced, ancestors of the survivors.
type Observed<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>);

/// Replacement of the `new` least likely (20)-(25) and systematic resampling of the others among themselves.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn landmark_reconstruct<'py>(
    py: Python<'py>,
    particles: Rows<'py>,
    at_transmit: Rows<'py>,
    log_likelihood: Column<'py>,
    measured: [f64; 3],
    sigma: [f64; 3],
    new: usize,
    normals: Rows<'py>,
    u0: f64,
) -> PyResult<Observed<'py>> {
    let (p, t) = (rows::<6>(&particles, "particles")?, rows::<3>(&at_transmit, "at_transmit")?);
    let z = rows::<3>(&normals, "normals")?;
    let logs = log_likelihood.as_array().to_vec();
    same("at_transmit", t.len(), p.len())?;
    same("normals", z.len(), p.len())?;
    same("log_likelihood", logs.len(), p.len())?;
    if measured.iter().any(|v| !v.is_finite()) || new >= p.len() {
        return Err(argument(format!("{new} new of {} particles need all of {measured:?}", p.len())));
    }
    let replaced = model::least_likely(&logs, new);
    let survivors = model::survivors(p.len(), &replaced);
    let ancestors = model::ancestors_among(&survivors, &logs, u0, p.len());
    let mut out: Vec<[f64; 6]> = ancestors.iter().map(|a| p[*a as usize]).collect();
    for i in replaced.iter().map(|i| *i as usize) {
        let pose = model::reconstruct(landmark(&p[i]), mover(&p[i]), t[i], measured, sigma, z[i]);
        out[i][..3].copy_from_slice(&pose);
    }
    let wide = |v: Vec<u32>| v.into_iter().map(i64::from).collect::<Vec<_>>().into_pyarray(py);
    let of_survivors = survivors.iter().map(|i| ancestors[*i as usize]).collect();
    Ok((flat(py, out.into_iter())?, wide(replaced), wide(of_survivors)))
}

/// Polar form [x_L, y_L, yaw_L, distance, bearing of M, relative yaw] of (N, 6) particles.
#[pyfunction]
fn landmark_polar<'py>(py: Python<'py>, particles: Rows<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let p = rows::<6>(&particles, "particles")?;
    flat(py, p.iter().map(|r| model::to_polar(mover(r), landmark(r))))
}

/// Particles (N, 6) of a polar form.
#[pyfunction]
fn landmark_from_polar<'py>(py: Python<'py>, polar: Rows<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let p = rows::<6>(&polar, "polar")?;
    flat(py, p.iter().map(|u| joined(model::from_polar(*u))))
}

fn joined((m, l): (Pose, Pose)) -> [f64; 6] {
    [m[0], m[1], m[2], l[0], l[1], l[2]]
}

fn fitted_dict<'py, const D: usize>(py: Python<'py>, fitted: &Fitted<D>) -> PyResult<Bound<'py, PyDict>> {
    let out = modes_dict(py, &fitted.modes)?;
    out.set_item("log_likelihood", fitted.log_likelihood)?;
    out.set_item("bic", fitted.bic)?;
    out.set_item("aic", fitted.aic)?;
    out.set_item("points", fitted.points)?;
    out.set_item("converged", fitted.converged)?;
    Ok(out)
}

fn modes_dict<'py, const D: usize>(py: Python<'py>, modes: &[Mode<D>]) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let k = modes.len();
    out.set_item("weights", modes.iter().map(|m| m.weight).collect::<Vec<_>>().into_pyarray(py))?;
    let means: Vec<f64> = modes.iter().flat_map(|m| m.mean.iter().copied().collect::<Vec<_>>()).collect();
    out.set_item("means", means.into_pyarray(py).reshape([k, D])?)?;
    let all: Vec<f64> =
        modes.iter().flat_map(|m| m.covariance.transpose().iter().copied().collect::<Vec<_>>()).collect();
    let covariances: Bound<'py, PyArray3<f64>> = all.into_pyarray(py).reshape([k, D, D])?;
    out.set_item("covariances", covariances)?;
    Ok(out)
}

#[allow(clippy::too_many_arguments)]
fn fit_of<'py, const D: usize>(
    py: Python<'py>,
    weights: &[f64],
    points: &Rows<'py>,
    circular: &[bool],
    modes: usize,
    choose_by: Option<&str>,
    options: &FitOptions,
    seed: u64,
    first: Option<&First<'py>>,
) -> PyResult<Bound<'py, PyDict>> {
    let x: Vec<SVector<f64, D>> = rows::<D>(points, "points")?.into_iter().map(SVector::from).collect();
    same("weights", weights.len(), x.len())?;
    same("circular", circular.len(), D)?;
    let wraps: [bool; D] = std::array::from_fn(|k| circular[k]);
    let stream = Streams::new(seed, 0).at(Purpose::Belief, 0);
    let first = match first {
        Some((w, means, covariances)) => Some(modes_of::<D>(w, means, covariances)?),
        None => None,
    };
    let fitted = match (choose_by, first) {
        (_, Some(modes)) => fit_from(&x, weights, wraps, &modes, options),
        (None, None) => fit_best(&x, weights, wraps, modes, options, &stream),
        (Some(word), None) => select(&x, weights, wraps, modes, criterion(word)?, options, x.len(), &stream),
    };
    let fitted =
        fitted.ok_or_else(|| argument(format!("{modes} modes on {} points: no mixture", x.len())))?;
    fitted_dict(py, &fitted)
}

/// A Gaussian mixture of weighted (N, D) points, D = 2, 3 or 6, by EM with k-means++ starts; `circular` says which
/// coordinates are angles. With `choose_by` = bic or aic, `modes` is the most, counted on distinct points; with
/// `first` = (weights, means, covariances) EM climbs from those modes and nowhere else.
#[pyfunction]
#[pyo3(signature = (weights, points, circular, modes, *, choose_by = None, starts = 3, iterations = 200, tolerance = 1e-9, ridge_one = 1e-9, ridge_many = 1e-3, seed = 0, first = None))]
#[allow(clippy::too_many_arguments)]
fn fit_gaussian_mixture<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    points: Rows<'py>,
    circular: Vec<bool>,
    modes: usize,
    choose_by: Option<&str>,
    starts: usize,
    iterations: usize,
    tolerance: f64,
    ridge_one: f64,
    ridge_many: f64,
    seed: u64,
    first: Option<First<'py>>,
) -> PyResult<Bound<'py, PyDict>> {
    let w = weights.as_array().to_vec();
    let options = FitOptions { starts, iterations, tolerance, ridge_one, ridge_many };
    let first = first.as_ref();
    match points.shape()[1] {
        2 => fit_of::<2>(py, &w, &points, &circular, modes, choose_by, &options, seed, first),
        3 => fit_of::<3>(py, &w, &points, &circular, modes, choose_by, &options, seed, first),
        6 => fit_of::<6>(py, &w, &points, &circular, modes, choose_by, &options, seed, first),
        d => Err(argument(format!("points has {d} columns, not 2, 3 or 6"))),
    }
}

/// Weights, means, covariances.
type First<'py> = (Column<'py>, Rows<'py>, PyReadonlyArray3<'py, f64>);

fn modes_of<const D: usize>(
    weights: &Column<'_>,
    means: &Rows<'_>,
    covariances: &PyReadonlyArray3<'_, f64>,
) -> PyResult<Vec<Mode<D>>> {
    let (w, mu) = (weights.as_array().to_vec(), rows::<D>(means, "means")?);
    same("means", mu.len(), w.len())?;
    if covariances.shape() != [w.len(), D, D] {
        return Err(argument(format!("covariances has shape {:?}, not (K, {D}, {D})", covariances.shape())));
    }
    let s = covariances.as_array();
    Ok((0..w.len())
        .map(|k| Mode {
            weight: w[k],
            mean: SVector::from(mu[k]),
            covariance: SMatrix::from_fn(|r, c| s[[k, r, c]]),
        })
        .collect())
}

/// Particles (N, 6) of a mixture in polar form with (N, 6) normals; the particles of a mode stand together.
#[pyfunction]
fn expand_exchange<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    means: Rows<'py>,
    covariances: PyReadonlyArray3<'py, f64>,
    normals: Rows<'py>,
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
    means: Rows<'py>,
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

/// Adds the kernels to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(landmark_predict, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_offsets, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_log_likelihood, module)?)?;
    module.add_function(wrap_pyfunction!(systematic_resample, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_monitor, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_new_particles, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_reconstruct, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_polar, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_from_polar, module)?)?;
    module.add_function(wrap_pyfunction!(fit_gaussian_mixture, module)?)?;
    module.add_function(wrap_pyfunction!(expand_exchange, module)?)?;
    module.add_function(wrap_pyfunction!(encode_exchange, module)?)?;
    module.add_function(wrap_pyfunction!(decode_exchange, module)?)
}
