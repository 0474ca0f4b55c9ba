//! Packaged navigators: what there is, what options they have, and how one is made. Options come as JSON text, a form
//! that both sides have a parser for; a dict would need a crate of its own.

use pyo3::prelude::*;
use serde_json::{Value, json};
use uwcoop_core::navigator::packaged::{self as core, Options, PACKAGED, TakesPart};
use uwcoop_core::navigator::settings::{Context, DriftPreset, PRESET_OPTIONS};

use crate::central_estimator::CentralEstimator;
use crate::chart::Chart;
use crate::errors::{argument, navigator};
use crate::navigators::Navigator;

/// Options of JSON text.
pub fn options(text: &str) -> PyResult<Options> {
    serde_json::from_str(text).map_err(|error| argument(format!("options: {error}")))
}

/// The packaged navigators as JSON: a list of `name`, `summary`, `method`, `central`, `takes_part` (`always`,
/// `with bandwidth`, `listed`), `realisable`, `fixed`.
#[pyfunction]
fn packaged_navigators() -> PyResult<String> {
    let mut all = Vec::new();
    for one in PACKAGED {
        all.push(json!({
            "name": one.name,
            "summary": one.summary,
            "method": one.method.name,
            "central": one.method.central,
            "takes_part": match one.takes_part {
                TakesPart::Always => "always",
                TakesPart::WithBandwidth => "with bandwidth",
                TakesPart::Listed => "listed",
            },
            "realisable": one.realisable,
            "fixed": one.fixed().map_err(navigator)?,
        }));
    }
    Ok(Value::Array(all).to_string())
}

/// Options of the navigators' methods as JSON: by method, `defaults`, `bounds` (`gt`, `ge`, `lt`, `le`), and `without`:
/// options of related methods that it does not have, each with the reason.
#[pyfunction]
fn navigator_options() -> PyResult<String> {
    let mut all = Options::new();
    for one in PACKAGED {
        all.insert(one.method.name.into(), one.method.describe().map_err(navigator)?);
    }
    Ok(Value::Object(all).to_string())
}

/// Drift by class of vehicle as JSON: by name, the options that it states.
#[pyfunction]
fn drift_presets() -> String {
    let all: Options = DriftPreset::ALL
        .into_iter()
        .map(|(name, preset)| {
            let stated: Options =
                PRESET_OPTIONS.into_iter().map(str::to_owned).zip(preset.values().map(Value::from)).collect();
            (name.to_owned(), Value::Object(stated))
        })
        .collect();
    Value::Object(all).to_string()
}

/// Options that have no effect on this navigator as the stated ones stand: pairs of option and reason.
#[pyfunction]
fn unread_options(name: &str, stated: &str) -> PyResult<Vec<(&'static str, &'static str)>> {
    let stated = options(stated)?;
    core::packaged(name).and_then(|one| one.unread(&stated)).map_err(navigator)
}

/// A packaged navigator of one vehicle; `stated`: the options that are stated, as JSON; `ranging`: by vehicle, whether it
/// uses ranges; empty: all do.
#[pyfunction]
#[pyo3(signature = (name, vehicle, vehicles, sound_speed_mps, seed, ranging, stated, chart))]
#[allow(clippy::too_many_arguments)]
fn make_navigator(
    name: &str,
    vehicle: u16,
    vehicles: usize,
    sound_speed_mps: f64,
    seed: u64,
    ranging: Vec<bool>,
    stated: &str,
    chart: Option<&Chart>,
) -> PyResult<Navigator> {
    let context = Context { vehicle, vehicles, sound_speed_mps, seed, ranging: &ranging };
    let chart = chart.map(|c| c.inner.clone());
    core::make_navigator(name, &context, &options(stated)?, chart).map(Navigator::of).map_err(navigator)
}

/// A packaged centralised reference for a team; as `make_navigator`.
#[pyfunction]
fn make_central(
    name: &str,
    vehicles: usize,
    sound_speed_mps: f64,
    ranging: Vec<bool>,
    stated: &str,
) -> PyResult<CentralEstimator> {
    let context = Context { vehicle: 0, vehicles, sound_speed_mps, seed: 0, ranging: &ranging };
    core::make_central(name, &context, &options(stated)?).map(CentralEstimator::of).map_err(navigator)
}

/// Adds the functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(packaged_navigators, module)?)?;
    module.add_function(wrap_pyfunction!(navigator_options, module)?)?;
    module.add_function(wrap_pyfunction!(drift_presets, module)?)?;
    module.add_function(wrap_pyfunction!(unread_options, module)?)?;
    module.add_function(wrap_pyfunction!(make_navigator, module)?)?;
    module.add_function(wrap_pyfunction!(make_central, module)?)
}
