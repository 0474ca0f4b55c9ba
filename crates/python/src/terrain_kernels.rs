//! `uwcoop.kernels` of depth grids and soundings, on the scalar f64 path.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use uwcoop_core::kernels::likelihood::{self, OffsetModel};
use uwcoop_core::kernels::lookup::{self, Grid};
use uwcoop_core::kernels::pattern::{self, Pattern};

use crate::arrays::{Column, Matrix, columns, same};
use crate::chart::Chart;
use crate::errors::argument;

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
    Grid::new(values, shape[0], shape[1], east0_m, north0_m, cell_m).map_err(|e| argument(e.to_string()))
}

/// Depths of the bilinear surface at (N, 2) points; NaN off the grid or beside a NaN node.
#[pyfunction]
fn bilinear_depth<'py>(
    py: Python<'py>,
    grid: Matrix<'py>,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
    points_m: Matrix<'py>,
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
    grid: Matrix<'py>,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
    points_m: Matrix<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let values: Vec<f64> = grid.as_array().iter().copied().collect();
    let g = grid_of(&values, grid.shape(), east0_m, north0_m, cell_m)?;
    let [e, n] = columns(&points_m, "points_m")?;
    let flat: Vec<f64> = e.iter().zip(&n).flat_map(|(e, n)| lookup::gradient(&g, *e, *n)).collect();
    flat.into_pyarray(py).reshape([e.len(), 2])
}

/// Log-likelihood (15) of ℓ depth differences along a rigid segment of ℓ + 1 offsets, (N,).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn terrain_log_likelihood<'py>(
    py: Python<'py>,
    grid: Matrix<'py>,
    east0_m: f64,
    north0_m: f64,
    cell_m: f64,
    positions_m: Matrix<'py>,
    offsets_m: Matrix<'py>,
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
    positions_m: Matrix<'py>,
    offsets_m: Matrix<'py>,
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

/// Adds the kernels to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bilinear_depth, module)?)?;
    module.add_function(wrap_pyfunction!(bilinear_gradient, module)?)?;
    module.add_function(wrap_pyfunction!(terrain_log_likelihood, module)?)?;
    module.add_function(wrap_pyfunction!(pattern_depths, module)?)?;
    module.add_function(wrap_pyfunction!(offset_update, module)?)
}
