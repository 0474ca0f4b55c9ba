//! The team's Cramér–Rao bound from columns.

use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, Value};
use uwcoop_core::bound::{self as core, BoundModel, Observation, TrueTracks};
use uwcoop_core::error::Error;
use uwcoop_core::event::Payload;
use uwcoop_core::navigator::settings::{LateSettings, MpfSettings, Settings, TeamSettings};

use crate::chart::Chart;
use crate::errors::{argument, navigator};
use crate::event::{Table, vehicle};
use crate::packaged::options as stated;

fn integers(columns: &Bound<'_, PyDict>, name: &str) -> PyResult<Vec<i64>> {
    let column = columns.get_item(name)?.ok_or_else(|| argument(format!("column {name} is missing")))?;
    Ok(column.extract::<PyReadonlyArray1<'_, i64>>()?.as_array().to_vec())
}

/// Options of a method as stated, without those of late events: the bound takes everything in its place.
fn own(name: &'static str, json: &str) -> PyResult<Map<String, Value>> {
    let split = |all: Map<String, Value>| -> Result<_, Error> { LateSettings::split(name, &all) };
    Ok(split(stated(json)?).map_err(navigator)?.1)
}

/// What events and ranges tell the team, with their times.
fn observations(events: &Bound<'_, PyDict>, ranges: &Bound<'_, PyDict>) -> PyResult<Vec<(i64, Observation)>> {
    let mut all = Vec::new();
    for (kind, columns) in events.iter() {
        for event in Table::new(kind.extract()?, columns.cast_into::<PyDict>()?).events()? {
            let vehicle = event.vehicle;
            let observation = match event.payload {
                Payload::Fix { covariance_m2, .. } => Observation::Fix { vehicle, covariance_m2 },
                Payload::WaterDepth { sigma_m, .. } => Observation::Sounding { vehicle, sigma_m },
                Payload::Motion { velocity_mps } => Observation::Motion { vehicle, velocity_mps },
                _ => continue,
            };
            all.push((event.t_ns, observation));
        }
    }
    let (sender, receiver) = (integers(ranges, "sender")?, integers(ranges, "receiver")?);
    let (tol, toa) = (integers(ranges, "tol_ns")?, integers(ranges, "toa_ns")?);
    if [receiver.len(), tol.len(), toa.len()].iter().any(|n| *n != sender.len()) {
        return Err(argument("columns of ranges differ in length".into()));
    }
    for k in 0..sender.len() {
        let (sender, receiver) = (vehicle(sender[k])?, vehicle(receiver[k])?);
        all.push((toa[k], Observation::Range { sender, tol_ns: tol[k], receiver }));
    }
    Ok(all)
}

/// Posterior Cramér–Rao bound of every vehicle's position, (vehicles, samples, 3): ee, en, nn in m²; NaN before a
/// vehicle's first fix. `truth_m` is (vehicles, instants, 2) at `truth_ns`; `events` are the log's tables `fix`,
/// `water_depth`, `motion`; `ranges` has `sender`, `receiver`, `tol_ns`, `toa_ns`; `options` those that are stated of `mpf` and
/// of `team`, as JSON; `counted`: soundings, ranges, and whether it is statistically linearised.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn bound<'py>(
    py: Python<'py>,
    chart: Option<&Chart>,
    truth_ns: PyReadonlyArray1<'py, i64>,
    truth_m: PyReadonlyArray3<'py, f64>,
    events: &Bound<'py, PyDict>,
    ranges: &Bound<'py, PyDict>,
    options: (&str, &str),
    counted: (bool, bool, bool),
    sample_ns: PyReadonlyArray1<'py, i64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let mpf = MpfSettings::complete(&own("mpf", options.0)?).map_err(navigator)?;
    let team = TeamSettings::complete(&own("team", options.1)?).map_err(navigator)?;
    let (terrain, ranges_count, linearised) = counted;
    let chart = chart.map(|c| c.inner.clone());
    let model = BoundModel {
        terrain,
        ranges: ranges_count,
        linearised,
        ..BoundModel::of(&mpf, &team, chart.as_deref())
    };
    let observations = observations(events, ranges)?;
    if truth_m.shape()[2] != 2 {
        return Err(argument(format!("truth_m has {} axes, not 2", truth_m.shape()[2])));
    }
    let tracks = truth_m
        .as_array()
        .outer_iter()
        .map(|track| track.outer_iter().map(|at| [at[0], at[1]]).collect())
        .collect();
    let truth = TrueTracks::new(truth_ns.as_array().to_vec(), tracks).map_err(navigator)?;
    let samples = sample_ns.as_array().to_vec();
    let shape = [truth.vehicles(), samples.len(), 3];
    let found = py
        .detach(|| core::bound(&model, chart.as_deref(), &truth, observations, &samples))
        .map_err(navigator)?;
    found.into_iter().flatten().flatten().collect::<Vec<_>>().into_pyarray(py).reshape(shape)
}
