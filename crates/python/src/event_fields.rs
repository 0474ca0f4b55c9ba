//! The payload of an event from its fields by name.

use pyo3::prelude::*;
use uwcoop_core::event::Payload;

use crate::errors::argument;
use crate::event::vehicle;

/// Gives the fields of one event by name; `None` for a field that is missing.
pub trait Fields {
    fn number(&self, name: &str) -> PyResult<f64>;
    fn integer(&self, name: &str) -> PyResult<i64>;
}

/// An optional measurement: NaN stands for none.
fn some_finite(value: f64) -> Option<f64> {
    (!value.is_nan()).then_some(value)
}

/// The payload of an event kind; field names are the columns of `uwcoop.missionlog.EVENT_COLUMNS`.
pub fn payload(kind: &str, f: &impl Fields) -> PyResult<Payload> {
    let pair = |a: &str, b: &str| -> PyResult<[f64; 2]> { Ok([f.number(a)?, f.number(b)?]) };
    Ok(match kind {
        "motion" => Payload::Motion { velocity_mps: pair("velocity_e_mps", "velocity_n_mps")? },
        "odometry" => {
            let mut covariance = [0.0; 6];
            for (value, name) in
                covariance.iter_mut().zip(["cov_ff", "cov_fl", "cov_fy", "cov_ll", "cov_ly", "cov_yy"])
            {
                *value = f.number(name)?;
            }
            Payload::Odometry {
                displacement_m: pair("forward_m", "left_m")?,
                yaw_change_rad: f.number("yaw_change_rad")?,
                covariance,
            }
        }
        "water_depth" => {
            Payload::WaterDepth { water_depth_m: f.number("water_depth_m")?, sigma_m: f.number("sigma_m")? }
        }
        "depth" => Payload::Depth { depth_m: f.number("depth_m")?, sigma_m: f.number("sigma_m")? },
        "heading" => Payload::Heading { yaw_rad: f.number("yaw_rad")?, sigma_rad: f.number("sigma_rad")? },
        "turn_rate" => Payload::TurnRate {
            yaw_rate_radps: f.number("yaw_rate_radps")?,
            sigma_radps: f.number("sigma_radps")?,
        },
        "ground_velocity" => Payload::GroundVelocity {
            velocity_mps: pair("forward_mps", "left_mps")?,
            sigma_mps: f.number("sigma_mps")?,
        },
        "fix" => Payload::Fix {
            position_m: pair("e_m", "n_m")?,
            covariance_m2: [f.number("cov_ee_m2")?, f.number("cov_en_m2")?, f.number("cov_nn_m2")?],
        },
        "acoustic_fix" => Payload::AcousticFix {
            peer: vehicle(f.integer("peer")?)?,
            transmit_ns: f.integer("transmit_ns")?,
            range_m: some_finite(f.number("range_m")?),
            own_bearing_rad: some_finite(f.number("own_bearing_rad")?),
            peer_bearing_rad: some_finite(f.number("peer_bearing_rad")?),
            peer_depth_m: some_finite(f.number("peer_depth_m")?),
        },
        "water_velocity" => Payload::WaterVelocity {
            velocity_mps: pair("forward_mps", "left_mps")?,
            sigma_mps: f.number("sigma_mps")?,
        },
        "beacon_range" => Payload::BeaconRange {
            measured_ns: f.integer("measured_ns")?,
            beacon_m: pair("beacon_e_m", "beacon_n_m")?,
            beacon_depth_m: f.number("beacon_depth_m")?,
            range_m: f.number("range_m")?,
            sigma_m: f.number("sigma_m")?,
            one_way: f.integer("one_way")? != 0,
        },
        "usbl" => Payload::Usbl {
            measured_ns: f.integer("measured_ns")?,
            position_m: pair("e_m", "n_m")?,
            covariance_m2: [f.number("cov_ee_m2")?, f.number("cov_en_m2")?, f.number("cov_nn_m2")?],
        },
        "landed" => Payload::Landed,
        "lifted_off" => Payload::LiftedOff,
        "role_taken" => Payload::RoleTaken { landmark: f.integer("landmark")? != 0 },
        _ => return Err(argument(format!("event kind {kind:?} is unknown"))),
    })
}
