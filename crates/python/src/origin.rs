//! Navigators that exchange pose graphs.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use uwcoop_core::information::replica::Methods;
use uwcoop_core::navigator::origin::deif::{Deif, Repair};
use uwcoop_core::navigator::origin::mdeif::{Mdeif, MdeifOptions};
use uwcoop_core::packet::graph::GraphForm;

use crate::errors::{argument, navigator};
use crate::navigators::{Navigator, Options};
use crate::origin_references::local;

/// Layout by the name that scenarios give it.
pub(crate) fn form(name: &str) -> PyResult<GraphForm> {
    match name {
        "f64" => Ok(GraphForm::F64),
        "32" => Ok(GraphForm::Frame32),
        "64" => Ok(GraphForm::Frame64),
        "256" => Ok(GraphForm::Frame256),
        other => Err(argument(format!("packet form is {other:?}, not f64, 32, 64 or 256"))),
    }
}

/// `mdeif` of one vehicle; `ranging`: by vehicle, whether it uses ranges.
#[pyfunction]
fn mdeif(
    vehicle: u16,
    ranging: Vec<bool>,
    options: &Bound<'_, PyDict>,
    sound_speed_mps: f64,
) -> PyResult<Navigator> {
    let options = Options(options);
    let mdeif = MdeifOptions {
        local: local(&options)?,
        form: form(&options.word("packet_form")?)?,
        exact_lags: options.count("exact_lags")?,
        methods: Methods {
            joint: options.flag("use_joint")?,
            equation_6: options.flag("use_equation_6")?,
            loss_max: options.number("health_loss_max")?,
        },
    };
    Mdeif::new(vehicle, &ranging, mdeif, sound_speed_mps).map(Navigator::of).map_err(navigator)
}

/// `deif` of one vehicle (`repeats` None: told what arrives), or `deif-redundant`.
#[pyfunction]
#[pyo3(signature = (vehicle, ranging, options, repeats, sound_speed_mps))]
fn deif(
    vehicle: u16,
    ranging: Vec<bool>,
    options: &Bound<'_, PyDict>,
    repeats: Option<usize>,
    sound_speed_mps: f64,
) -> PyResult<Navigator> {
    let repair = match repeats {
        None => Repair::Oracle,
        Some(0) => return Err(argument("repeats is 0, not above it".into())),
        Some(repeats) => Repair::Repeat(repeats),
    };
    let local = local(&Options(options))?;
    Deif::new(vehicle, &ranging, local, repair, sound_speed_mps).map(Navigator::of).map_err(navigator)
}

/// Adds the functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(mdeif, module)?)?;
    module.add_function(wrap_pyfunction!(deif, module)?)
}
