//! `uwcoop._native`: checks arguments, releases the GIL, calls the core, maps errors. No arithmetic.

use pyo3::prelude::*;

mod arrays;
mod authentication;
mod belief_packet;
mod bound;
mod central_estimator;
mod chart;
mod errors;
mod event;
mod event_fields;
mod exchange_packet;
mod graph_packet;
mod information;
mod landmark_kernels;
mod landmark_words;
mod mission;
mod mixture_kernels;
mod navigators;
mod packaged;
mod particle_kernels;
mod python_navigator;
mod replay;
mod terrain_kernels;

/// The compiled core of uwcoop.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<authentication::Authenticator>()?;
    module.add_class::<chart::Chart>()?;
    module.add_function(wrap_pyfunction!(bound::bound, module)?)?;
    module.add_class::<event::Event>()?;
    module.add_function(wrap_pyfunction!(event::event_bounds, module)?)?;
    module.add_class::<navigators::Estimate>()?;
    module.add_class::<navigators::Navigator>()?;
    module.add_class::<mission::Mission>()?;
    module.add_class::<replay::Replay>()?;
    module.add_class::<central_estimator::CentralEstimator>()?;
    module.add_function(wrap_pyfunction!(replay::run_all, module)?)?;
    information::register(module)?;
    graph_packet::register(module)?;
    packaged::register(module)?;
    landmark_kernels::register(module)?;
    mixture_kernels::register(module)?;
    exchange_packet::register(module)?;
    belief_packet::register(module)?;
    terrain_kernels::register(module)?;
    particle_kernels::register(module)
}
