//! The chart as navigators see it.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use uwcoop_core::chart::{Chart as CoreChart, SigmaMap};

use crate::errors;

/// An immutable depth grid: float32 (rows, cols), southernmost row first, positive down, NaN for holes.
#[pyclass(frozen, module = "uwcoop._native")]
pub struct Chart {
    pub inner: Arc<CoreChart>,
}

/// `sigma_map_m`: one number, or one for each node with a fallback where that is not finite.
#[derive(FromPyObject)]
enum Sigma<'py> {
    Uniform(f64),
    PerNode(PyReadonlyArray2<'py, f32>),
}

#[pymethods]
impl Chart {
    #[new]
    #[pyo3(signature = (depth_m, east0_m, north0_m, cell_m, sigma_map_m, sigma_map_fallback_m, correlation_length_m))]
    fn new(
        depth_m: PyReadonlyArray2<'_, f32>,
        east0_m: f64,
        north0_m: f64,
        cell_m: f64,
        sigma_map_m: Sigma<'_>,
        sigma_map_fallback_m: f64,
        correlation_length_m: f64,
    ) -> PyResult<Self> {
        let [rows, cols] = [depth_m.shape()[0], depth_m.shape()[1]];
        let depths = depth_m.as_array().iter().copied().collect();
        let sigma_map = match sigma_map_m {
            Sigma::Uniform(sigma) => SigmaMap::Uniform(sigma),
            Sigma::PerNode(sigma) => SigmaMap::PerNode {
                sigma_m: sigma.as_array().iter().copied().collect(),
                fallback: sigma_map_fallback_m,
            },
        };
        let chart =
            CoreChart::new(depths, rows, cols, east0_m, north0_m, cell_m, sigma_map, correlation_length_m)
                .map_err(errors::chart)?;
        Ok(Self { inner: Arc::new(chart) })
    }

    /// Depths at (N, 2) points [east, north], NaN off the chart or beside a hole.
    fn depth_at<'py>(
        &self,
        py: Python<'py>,
        points_m: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let points = crate::arrays::columns(&points_m, "points_m")?;
        let depths: Vec<f64> = points[0]
            .iter()
            .zip(&points[1])
            .map(|(e, n)| self.inner.depth_at(*e, *n).unwrap_or(f64::NAN))
            .collect();
        Ok(depths.into_pyarray(py))
    }

    /// Distance over which the chart's error stays itself, m.
    #[getter]
    fn correlation_length_m(&self) -> f64 {
        self.inner.correlation_length_m()
    }

    /// Mean depth of all nodes, m.
    #[getter]
    fn mean_depth_m(&self) -> f64 {
        self.inner.mean_depth_m()
    }
}
