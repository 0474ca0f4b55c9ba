//! `uwcoop.kernels` of Gaussian mixtures: fitting and selection.

use nalgebra::{SMatrix, SVector, Vector2};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use uwcoop_core::mixture::{FitOptions, Fitted, Mode, fit, fit_best, fit_from, select};
use uwcoop_core::random::{Purpose, Streams};

use crate::arrays::{Column, Matrix, columns, rows, same};
use crate::errors::argument;
use crate::landmark_words::criterion;

/// What `fit_mixture` returns: weights (k,), means (k, 2), covariances (k, 2, 2).
type Mixture<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// A mixture of `modes` Gaussians fitted to weighted positions by `iterations` of EM.
#[pyfunction]
fn fit_mixture<'py>(
    py: Python<'py>,
    weights: Column<'py>,
    positions_m: Matrix<'py>,
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

fn fitted_dict<'py, const D: usize>(py: Python<'py>, fitted: &Fitted<D>) -> PyResult<Bound<'py, PyDict>> {
    let out = modes_dict(py, &fitted.modes)?;
    out.set_item("log_likelihood", fitted.log_likelihood)?;
    out.set_item("bic", fitted.bic)?;
    out.set_item("aic", fitted.aic)?;
    out.set_item("points", fitted.points)?;
    out.set_item("converged", fitted.converged)?;
    Ok(out)
}

/// A dict of a mixture's weights (K,), means (K, D) and covariances (K, D, D).
pub fn modes_dict<'py, const D: usize>(py: Python<'py>, modes: &[Mode<D>]) -> PyResult<Bound<'py, PyDict>> {
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
    points: &Matrix<'py>,
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
    points: Matrix<'py>,
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
type First<'py> = (Column<'py>, Matrix<'py>, PyReadonlyArray3<'py, f64>);

/// A mixture of arrays (K,), (K, D) and (K, D, D).
pub fn modes_of<const D: usize>(
    weights: &Column<'_>,
    means: &Matrix<'_>,
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

/// Adds the kernels to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(fit_mixture, module)?)?;
    module.add_function(wrap_pyfunction!(fit_gaussian_mixture, module)?)
}
