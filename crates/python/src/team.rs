//! The native navigator `team`.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use uwcoop_core::navigator::drift::Drift;
use uwcoop_core::navigator::team::{Team, TeamOptions};

use crate::chart::Chart;
use crate::errors::{argument, navigator};
use crate::navigators::{Navigator, Options};

/// The navigator `team` of one vehicle.
#[pyfunction]
#[pyo3(signature = (vehicle, vehicles, options, chart, sound_speed_mps, seed))]
fn team_navigator(
    vehicle: u16,
    vehicles: usize,
    options: &Bound<'_, PyDict>,
    chart: Option<&Chart>,
    sound_speed_mps: f64,
    seed: u64,
) -> PyResult<Navigator> {
    let named = Options(options);
    let drifts: Vec<Bound<'_, PyDict>> =
        options.get_item("drifts")?.ok_or_else(|| argument("option drifts is missing".into()))?.extract()?;
    let drifts = drifts.iter().map(|d| Options(d).drift()).collect::<PyResult<Vec<Drift>>>()?;
    let terrain = named.terrain(drifts.get(usize::from(vehicle)).copied())?;
    let team = TeamOptions {
        terrain,
        drifts,
        use_ranges: named.flag("use_ranges")?,
        sigma_range_m: named.number("sigma_range_m")?,
        range_gate_sigmas: named.maybe("range_gate_sigmas")?.unwrap_or(f64::INFINITY),
        clock: named.clock()?,
        referee_nat: named.number("referee_nat")?,
        frame_bytes: named.count("frame_bytes")?,
        tag_bytes: named.count("tag_bytes")?,
        packet_f64: match named.word("packet")?.as_str() {
            "rounded" => false,
            "f64" => true,
            other => return Err(argument(format!("packet is {other:?}, not rounded or f64"))),
        },
        packet_spacing_m: named.number("packet_spacing_m")?,
        group_size: named.count("group_size")?,
        least_ess_share: named.number("packet_least_ess_share")?,
        current_difference: named.number("current_difference")?,
        offset_difference_m: named.maybe("offset_difference_m")?.unwrap_or(f64::INFINITY),
        fill_reach_m: named.number("fill_reach_m")?,
    };
    let chart = chart.map(|c| c.inner.clone());
    if named.flag("bias_states")? {
        Team::<4>::new(vehicle, vehicles, team, chart, sound_speed_mps, seed).map(Navigator::of)
    } else {
        Team::<2>::new(vehicle, vehicles, team, chart, sound_speed_mps, seed).map(Navigator::of)
    }
    .map_err(navigator)
}

/// Adds what this file has.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(team_navigator, module)?)
}
