//! Native navigators of the alternating landmark method, from complete dicts of options.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use uwcoop_core::mixture::{Criterion, FitOptions};
use uwcoop_core::navigator::landmark::consensus::ConsensusRule;
use uwcoop_core::navigator::landmark::jump_hypotheses::JumpRule;
use uwcoop_core::navigator::landmark::model::{Acoustics, Gate, MonitorRule, RatioReading};
use uwcoop_core::navigator::landmark::{
    BiasModelAverage, Landmark, LandmarkOptions, LandmarkPaper, PacketOptions, PaperOptions,
};
use uwcoop_core::packet::landmark::{ExchangeFormat, ExchangeSize};

use crate::errors::{argument, navigator};
use crate::navigators::{Navigator, Options};

/// Format 1 or 2.
pub fn exchange_format(format: usize) -> PyResult<ExchangeFormat> {
    match format {
        1 => Ok(ExchangeFormat::One),
        2 => Ok(ExchangeFormat::Two),
        other => Err(argument(format!("packet_format is {other}, not 1 or 2"))),
    }
}

/// A size in bytes.
pub fn exchange_size(bytes: usize) -> PyResult<ExchangeSize> {
    ExchangeSize::from_bytes(bytes)
        .map_err(|_| argument(format!("packet_bytes is {bytes}, not 8, 16, 32, 40, 64 or 128")))
}

/// `bic` or `aic`.
pub fn criterion(word: &str) -> PyResult<Criterion> {
    match word {
        "bic" => Ok(Criterion::Bic),
        "aic" => Ok(Criterion::Aic),
        other => Err(argument(format!("criterion is {other:?}, not bic or aic"))),
    }
}

/// The gate of a name.
pub fn gate(word: &str, share: f64, widths: [f64; 3]) -> PyResult<Gate> {
    match word {
        "joint" => Ok(Gate::Joint),
        "separate" => Ok(Gate::Separate),
        "none" => Ok(Gate::None),
        "mixture" => Ok(Gate::Mixture { share, widths }),
        other => Err(argument(format!("gate is {other:?}, not joint, separate, none or mixture"))),
    }
}

/// `linear` or `log`.
pub fn reading(word: &str) -> PyResult<RatioReading> {
    match word {
        "linear" => Ok(RatioReading::Linear),
        "log" => Ok(RatioReading::Log),
        other => Err(argument(format!("monitor_reading is {other:?}, not linear or log"))),
    }
}

fn acoustics(options: &Options<'_, '_>, threshold: [f64; 3]) -> PyResult<Acoustics> {
    Ok(Acoustics {
        sigma: [
            options.number("sigma_range_m")?,
            options.number("sigma_own_bearing_rad")?,
            options.number("sigma_peer_bearing_rad")?,
        ],
        threshold,
    })
}

fn widths(options: &Options<'_, '_>) -> PyResult<[f64; 3]> {
    let angle = options.number("outlier_width_rad")?;
    Ok([options.number("outlier_width_m")?, angle, angle])
}

fn packet(options: &Options<'_, '_>) -> PyResult<PacketOptions> {
    Ok(PacketOptions {
        format: exchange_format(options.count("packet_format")?)?,
        size: exchange_size(options.count("packet_bytes")?)?,
        criterion: criterion(&options.word("clusters_by")?)?,
        fit: FitOptions {
            starts: options.count("cluster_starts")?,
            iterations: options.count("cluster_iterations")?,
            tolerance: options.number("cluster_tolerance")?,
            ridge_one: options.number("cluster_ridge_one")?,
            ridge_many: options.number("cluster_ridge_many")?,
        },
        search_points: options.count("cluster_search_points")?,
    })
}

fn first_landmark(options: &Options<'_, '_>) -> PyResult<[f64; 3]> {
    Ok([
        options.number("landmark0_e_m")?,
        options.number("landmark0_n_m")?,
        options.number("landmark0_yaw_rad")?,
    ])
}

/// `landmark`, `landmark-ekf`, `dead-reckoning-dvl`.
#[pyfunction]
fn landmark_navigator(
    vehicle: u16,
    vehicles: usize,
    options: &Bound<'_, PyDict>,
    seed: u64,
) -> PyResult<Navigator> {
    let o = Options(options);
    let bias = o.flag("bias_states")?;
    let prior = |name: &str| -> PyResult<f64> { if bias { o.number(name) } else { Ok(0.0) } };
    let share = o.number("outlier_share")?;
    let recovery = if o.flag("recovery")? { Some(o.word("recovery_by")?) } else { None };
    let options = LandmarkOptions {
        acoustics: acoustics(&o, [3.0; 3])?,
        outliers: if share > 0.0 { Some((share, widths(&o)?)) } else { None },
        use_fixes: o.flag("use_fixes")?,
        particles: o.count("particles")?,
        resample_share: o.number("resample_share")?,
        roughening: o.number("roughening")?,
        bend_sigmas: o.number("bend_sigmas")?,
        yaw_limit_rad: o.number("yaw_limit_rad")?,
        kurtosis_limit: o.number("kurtosis_limit")?,
        consensus: if recovery.as_deref() == Some("consensus") {
            Some(ConsensusRule {
                window: o.count("consensus_window")?,
                quorum: o.count("consensus_quorum")?,
                agree: o.number("consensus_agree")?,
                disagree: o.number("consensus_disagree")?,
            })
        } else {
            None
        },
        jump: if recovery.as_deref() == Some("odds") {
            Some(JumpRule {
                window: o.count("jump_window")? as u32,
                sigma_m: o.number("jump_sigma_m")?,
                sigma_rad: o.number("jump_sigma_yaw_rad")?,
                share: o.number("jump_share")?,
                odds: o.number("jump_odds")?,
            })
        } else {
            None
        },
        bias_sigma: [
            prior("sigma_gyro_bias0_radps")?,
            prior("sigma_dvl_scale0")?,
            prior("sigma_dvl_misalignment0_rad")?,
        ],
        gyro_bias_walk: o.number("sigma_gyro_bias_radps_per_sqrt_s")?,
        landing_sigma: [o.number("sigma_landing_m")?, o.number("sigma_landing_yaw_rad")?],
        first_landmark: first_landmark(&o)?,
        packet: packet(&o)?,
    };
    let bias_share = o.number("bias_share")?;
    if bias && bias_share < 1.0 {
        let made = BiasModelAverage::new(vehicle, vehicles, options, seed, bias_share);
        return made.map(Navigator::of).map_err(navigator);
    }
    Landmark::new(vehicle, vehicles, options, seed).map(Navigator::of).map_err(navigator)
}

/// `landmark-paper`.
#[pyfunction]
fn landmark_paper(
    vehicle: u16,
    vehicles: usize,
    options: &Bound<'_, PyDict>,
    seed: u64,
) -> PyResult<Navigator> {
    let o = Options(options);
    let threshold = [o.number("k_range")?, o.number("k_own_bearing")?, o.number("k_peer_bearing")?];
    let options = PaperOptions {
        particles: o.count("particles")?,
        acoustics: acoustics(&o, threshold)?,
        gate: gate(&o.word("gate")?, o.number("outlier_share")?, widths(&o)?)?,
        sigma_velocity: [o.number("sigma_velocity_constant_mps")?, o.number("sigma_velocity_root")?],
        speed_bounds_mps: [o.number("speed_min_mps")?, o.number("speed_max_mps")?],
        sigma_yaw_rate_radps: o.number("sigma_yaw_rate_radps")?,
        monitor: if o.flag("reconstruction")? {
            Some(MonitorRule {
                ratio: o.number("monitor_ratio")?,
                trials: u32::try_from(o.count("monitor_trials")?).unwrap_or(u32::MAX),
                reading: reading(&o.word("monitor_reading")?)?,
            })
        } else {
            None
        },
        replace_share: o.number("replace_share")?,
        first_landmark: first_landmark(&o)?,
        packet: packet(&o)?,
    };
    LandmarkPaper::new(vehicle, vehicles, options, seed).map(Navigator::of).map_err(navigator)
}

/// Adds the constructors to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(landmark_navigator, module)?)?;
    module.add_function(wrap_pyfunction!(landmark_paper, module)?)
}
