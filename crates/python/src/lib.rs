//! `uwcoop._native`: checks arguments, releases the GIL, calls the core, maps errors. No arithmetic.

use pyo3::prelude::*;

mod authentication;
mod bound;
mod chart;
mod errors;
mod event;
mod information;
mod kernels;
mod landmark;
mod landmark_kernels;
mod mission;
mod navigators;
mod origin;
mod origin_references;
mod python_navigator;
mod replay;
mod team;
mod team_estimator;

/// The compiled core of uwcoop.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<authentication::Authenticator>()?;
    module.add_class::<chart::Chart>()?;
    module.add_function(wrap_pyfunction!(bound::bound, module)?)?;
    module.add_class::<event::Event>()?;
    module.add_class::<navigators::Estimate>()?;
    module.add_class::<navigators::Navigator>()?;
    module.add_class::<mission::Mission>()?;
    module.add_class::<replay::Replay>()?;
    module.add_class::<team_estimator::TeamEstimator>()?;
    module.add_function(wrap_pyfunction!(replay::run_all, module)?)?;
    information::register(module)?;
    origin::register(module)?;
    module.add_function(wrap_pyfunction!(origin_references::cekf, module)?)?;
    module.add_function(wrap_pyfunction!(origin_references::belief_exchange, module)?)?;
    module.add_function(wrap_pyfunction!(origin_references::interleaved, module)?)?;
    landmark::register(module)?;
    landmark_kernels::register(module)?;
    team::register(module)?;
    kernels::register(module)
}
