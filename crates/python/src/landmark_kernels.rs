//! `uwcoop.kernels` of the alternating landmark method: pure functions of their draws.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use uwcoop_core::kernels::landmark::{OdometryStep, predict, systematic_resample as systematic};
use uwcoop_core::navigator::landmark::model::{self, Acoustics, Measurement, Monitor, MonitorRule, Pose};

use crate::arrays::{Column, Matrix, flat, rows, same};
use crate::errors::{argument, navigator};
use crate::landmark_words::{gate, reading};

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
    particles: Matrix<'py>,
    velocity_mps: [f64; 2],
    yaw_rate_radps: f64,
    dt_s: f64,
    sigma_mps: f64,
    sigma_radps: f64,
    normals: Matrix<'py>,
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
    particles: Matrix<'py>,
    at_transmit: Matrix<'py>,
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
    offsets: Matrix<'py>,
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

/// The monitor over a sequence of ln L̄ and ln L_max of complete positionings.
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
        mean.iter().zip(most.iter()).map(|(a, b)| monitor.observe(*a, *b, true, &rule)).unzip();
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
    particles: Matrix<'py>,
    at_transmit: Matrix<'py>,
    log_likelihood: Column<'py>,
    measured: [f64; 3],
    sigma: [f64; 3],
    new: usize,
    normals: Matrix<'py>,
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
fn landmark_polar<'py>(py: Python<'py>, particles: Matrix<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let p = rows::<6>(&particles, "particles")?;
    flat(py, p.iter().map(|r| model::to_polar(mover(r), landmark(r))))
}

/// Particles (N, 6) of a polar form.
#[pyfunction]
fn landmark_from_polar<'py>(py: Python<'py>, polar: Matrix<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let p = rows::<6>(&polar, "polar")?;
    flat(py, p.iter().map(|u| joined(model::from_polar(*u))))
}

fn joined((m, l): (Pose, Pose)) -> [f64; 6] {
    [m[0], m[1], m[2], l[0], l[1], l[2]]
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
    module.add_function(wrap_pyfunction!(landmark_from_polar, module)?)
}
