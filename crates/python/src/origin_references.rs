//! What navigators that exchange pose graphs are compared with.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use uwcoop_core::navigator::origin::belief::{BeliefNavigator, BeliefOptions, Correlation};
use uwcoop_core::navigator::origin::central::{Cekf, CentralOptions, Received};
use uwcoop_core::navigator::origin::interleaved::{Interleaved, InterleavedOptions};
use uwcoop_core::navigator::origin::local_options::LocalOptions;
use uwcoop_core::packet::PacketKind;

use crate::central_estimator::CentralEstimator;
use crate::errors::{argument, navigator};
use crate::navigators::{Navigator, Options};

/// The model of own motion and sensors that the whole family shares.
pub(crate) fn local(options: &Options<'_, '_>) -> PyResult<LocalOptions> {
    Ok(LocalOptions {
        process_noise_m2_per_s3: options.number("process_noise_m2_per_s3")?,
        process_noise_dvl_m2_per_s3: options.number("process_noise_dvl_m2_per_s3")?,
        sigma_velocity0_mps: options.number("sigma_velocity0_mps")?,
        sigma_range_m: options.number("sigma_range_m")?,
        gate_sigmas: options.number("gate_sigmas")?,
    })
}

/// `cekf`: the whole team in one filter; `ranging`: by vehicle, whether its ranges are used.
#[pyfunction]
pub fn cekf(
    options: &Bound<'_, PyDict>,
    ranging: Vec<bool>,
    sound_speed_mps: f64,
) -> PyResult<CentralEstimator> {
    let options = Options(options);
    let fed = options.word("fed")?;
    let central = CentralOptions {
        local: local(&options)?,
        ranging,
        sound_speed_mps,
        packet_bytes: options.count("assumed_packet_bytes")?,
    };
    match fed.as_str() {
        "everything" => Cekf::new(central).map(CentralEstimator::of).map_err(navigator),
        "received" => Received::new(central).map(CentralEstimator::of).map_err(navigator),
        other => Err(argument(format!("fed is {other:?}, not everything or received"))),
    }
}

/// `nekf`, `covariance-intersection`, or own sensors alone (`ranging` false).
#[pyfunction]
pub fn belief_exchange(
    vehicle: u16,
    vehicles: usize,
    options: &Bound<'_, PyDict>,
    ranging: bool,
    sound_speed_mps: f64,
) -> PyResult<Navigator> {
    let options = Options(options);
    let correlation = match options.word("correlation")?.as_str() {
        "ignored" => Correlation::Ignored,
        "unknown" => Correlation::Unknown,
        other => return Err(argument(format!("correlation is {other:?}, not ignored or unknown"))),
    };
    let packet = match options.word("packet_form")?.as_str() {
        "f64" => PacketKind::BeliefF64,
        _ => PacketKind::Belief,
    };
    let cooperates = options.flag("use_ranges")?;
    let belief = BeliefOptions {
        local: local(&options)?,
        correlation,
        process_noise_factor: options.number("process_noise_factor")?,
        ranging: ranging && cooperates,
        talking: cooperates,
        packet,
    };
    BeliefNavigator::new(vehicle, vehicles, belief, sound_speed_mps).map(Navigator::of).map_err(navigator)
}

/// `interleaved`: a bank of filters with a table of origins.
#[pyfunction]
pub fn interleaved(
    vehicle: u16,
    vehicles: usize,
    options: &Bound<'_, PyDict>,
    ranging: bool,
    sound_speed_mps: f64,
) -> PyResult<Navigator> {
    let options = InterleavedOptions { local: local(&Options(options))?, ranging };
    Interleaved::new(vehicle, vehicles, options, sound_speed_mps).map(Navigator::of).map_err(navigator)
}
