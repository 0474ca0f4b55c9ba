//! NumPy arrays to the core's columns and back, with their shapes checked.

use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::argument;

/// A float64 array of two dimensions.
pub type Matrix<'py> = PyReadonlyArray2<'py, f64>;

/// A float64 array of one dimension.
pub type Column<'py> = PyReadonlyArray1<'py, f64>;

/// The two columns of an (N, 2) array.
pub fn columns(points: &Matrix<'_>, name: &str) -> PyResult<[Vec<f64>; 2]> {
    if points.shape()[1] != 2 {
        return Err(argument(format!("{name} has shape {:?}, not (N, 2)", points.shape())));
    }
    let a = points.as_array();
    Ok([a.column(0).to_vec(), a.column(1).to_vec()])
}

/// Rows of exactly `D` numbers.
pub fn rows<const D: usize>(values: &Matrix<'_>, name: &str) -> PyResult<Vec<[f64; D]>> {
    if values.shape()[1] != D {
        return Err(argument(format!("{name} has shape {:?}, not (N, {D})", values.shape())));
    }
    Ok(values.as_array().rows().into_iter().map(|r| std::array::from_fn(|k| r[k])).collect())
}

/// Refuses an array of another length.
pub fn same(name: &str, found: usize, expected: usize) -> PyResult<()> {
    if found != expected {
        return Err(argument(format!("{name} has {found} entries where {expected} are expected")));
    }
    Ok(())
}

/// An (N, 2) array of two columns.
pub fn points<'py>(py: Python<'py>, east: &[f64], north: &[f64]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = east.iter().zip(north).flat_map(|(e, n)| [*e, *n]).collect();
    flat.into_pyarray(py).reshape([east.len(), 2])
}

/// An (N, D) array.
pub fn flat<'py, const D: usize>(
    py: Python<'py>,
    values: impl ExactSizeIterator<Item = [f64; D]>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let n = values.len();
    values.flatten().collect::<Vec<f64>>().into_pyarray(py).reshape([n, D])
}

/// The elements [ee, en, nn] of a symmetric (2, 2) array.
pub fn symmetric(name: &str, matrix: &PyReadonlyArray2<'_, f64>) -> PyResult<[f64; 3]> {
    if matrix.shape() != [2, 2] {
        return Err(argument(format!("{name} has shape {:?}, not (2, 2)", matrix.shape())));
    }
    let m = matrix.as_array();
    Ok([m[[0, 0]], m[[0, 1]], m[[1, 1]]])
}
