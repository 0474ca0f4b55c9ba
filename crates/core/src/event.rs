//! What can happen to a vehicle, stamped.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::{Error, finite, non_negative, positive};

/// Index of a vehicle in its mission.
pub type VehicleId = u16;

/// Nanoseconds to seconds.
#[must_use]
pub fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// One thing that happened to one vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Time since the mission's epoch, ns. For a reception, the end of decoding.
    pub t_ns: i64,
    /// The vehicle.
    pub vehicle: VehicleId,
    /// What happened.
    pub payload: Payload,
}

/// What an event says. World frame: local east–north, m; body frame: forward–left; yaw counter-clockwise from east.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Payload {
    /// Commanded velocity through the water (thrust model × compass), world frame, valid until the next one.
    Motion {
        /// [east, north], m/s.
        velocity_mps: [f64; 2],
    },
    /// Displacement and yaw change since the last one, body frame at its start.
    Odometry {
        /// [forward, left], m.
        displacement_m: [f64; 2],
        /// rad.
        yaw_change_rad: f64,
        /// Upper triangle of the covariance of (forward, left, yaw).
        covariance: [f64; 6],
    },
    /// Water depth from altimeter and depth sensor.
    WaterDepth {
        /// Surface to seabed, m.
        water_depth_m: f64,
        /// Standard deviation, m.
        sigma_m: f64,
    },
    /// Own depth below the surface.
    Depth {
        /// m.
        depth_m: f64,
        /// Standard deviation, m.
        sigma_m: f64,
    },
    /// Yaw.
    Heading {
        /// rad.
        yaw_rad: f64,
        /// Standard deviation, rad.
        sigma_rad: f64,
    },
    /// Yaw rate.
    TurnRate {
        /// rad/s.
        yaw_rate_radps: f64,
        /// Standard deviation, rad/s.
        sigma_radps: f64,
    },
    /// Velocity over ground from a DVL, body frame.
    GroundVelocity {
        /// [forward, left], m/s.
        velocity_mps: [f64; 2],
        /// Standard deviation per axis, m/s.
        sigma_mps: f64,
    },
    /// Position (GPS, USBL).
    Fix {
        /// [east, north], m.
        position_m: [f64; 2],
        /// [ee, en, nn], m².
        covariance_m2: [f64; 3],
    },
    /// Mutual positioning with one peer; what is missing is `None`.
    AcousticFix {
        /// The peer.
        peer: VehicleId,
        /// When the exchange began, ns.
        transmit_ns: i64,
        /// Two-way range, m.
        range_m: Option<f64>,
        /// Direction to the peer, own body frame, rad.
        own_bearing_rad: Option<f64>,
        /// Direction to this vehicle as the peer's reply tells it, the peer's body frame, rad.
        peer_bearing_rad: Option<f64>,
    },
    /// The vehicle stands on the seabed.
    Landed,
    /// It no longer does.
    LiftedOff,
    /// It took the role of the landmark, or of the mover.
    RoleTaken {
        /// True: landmark.
        landmark: bool,
    },
    /// A packet arrived whole.
    Reception {
        /// Who sent it (implied by the slot).
        sender: VehicleId,
        /// Launch of the signal, ns.
        tol_ns: i64,
        /// Arrival of the signal's start, ns, in the receiver's clock.
        toa_ns: i64,
        /// The packet; empty for a centralised estimator, which reads the sender's events itself.
        bytes: Arc<[u8]>,
    },
    /// A packet of this vehicle reached `to`: only for navigators with `needs_delivery_oracle`.
    Delivered {
        /// Launch of the packet, ns.
        tol_ns: i64,
        /// Who received it.
        to: VehicleId,
    },
}

/// Order of events at one instant (DESIGN: sensors, receptions, transmissions, role changes).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Anything that a sensor says.
    Sensor,
    /// An arriving packet, or word of a delivery.
    Reception,
    /// A transmit slot.
    Transmit,
    /// Landing, lifting off, roles.
    Role,
}

impl Payload {
    /// Where the event stands among others of the same instant.
    #[must_use]
    pub fn class(&self) -> Class {
        match self {
            Self::Reception { .. } | Self::Delivered { .. } => Class::Reception,
            Self::Landed | Self::LiftedOff | Self::RoleTaken { .. } => Class::Role,
            _ => Class::Sensor,
        }
    }

    /// Refuses numbers that no sensor can mean.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`] or [`Error::NotPositive`] with the quantity and its value.
    pub fn validate(&self) -> Result<(), Error> {
        match self {
            Self::Motion { velocity_mps: [e, n] } => {
                within("motion east velocity, m/s", *e, SPEED_MPS)?;
                within("motion north velocity, m/s", *n, SPEED_MPS)?;
            }
            Self::Odometry { displacement_m: [f, l], yaw_change_rad, covariance } => {
                finite("odometry forward displacement, m", *f)?;
                finite("odometry left displacement, m", *l)?;
                finite("odometry yaw change, rad", *yaw_change_rad)?;
                for value in covariance {
                    finite("odometry covariance", *value)?;
                }
                for value in [covariance[0], covariance[3], covariance[5]] {
                    non_negative("odometry variance", value)?;
                }
            }
            Self::WaterDepth { water_depth_m, sigma_m } => {
                non_negative("water depth, m", *water_depth_m)?;
                within("water depth, m", *water_depth_m, DISTANCE_M)?;
                non_negative("water depth sigma, m", *sigma_m)?;
            }
            Self::Depth { depth_m, sigma_m } => {
                // A depth sensor at the surface reads a little above it.
                within("depth, m", *depth_m, DISTANCE_M)?;
                non_negative("depth sigma, m", *sigma_m)?;
            }
            Self::Heading { yaw_rad, sigma_rad } => {
                finite("heading yaw, rad", *yaw_rad)?;
                non_negative("heading sigma, rad", *sigma_rad)?;
            }
            Self::TurnRate { yaw_rate_radps, sigma_radps } => {
                finite("turn rate, rad/s", *yaw_rate_radps)?;
                non_negative("turn rate sigma, rad/s", *sigma_radps)?;
            }
            Self::GroundVelocity { velocity_mps: [f, l], sigma_mps } => {
                finite("ground velocity forward, m/s", *f)?;
                finite("ground velocity left, m/s", *l)?;
                non_negative("ground velocity sigma, m/s", *sigma_mps)?;
            }
            Self::Fix { position_m: [e, n], covariance_m2 } => {
                within("fix east, m", *e, DISTANCE_M)?;
                within("fix north, m", *n, DISTANCE_M)?;
                check_covariance("fix covariance, m²", *covariance_m2)?;
            }
            Self::AcousticFix { range_m, own_bearing_rad, peer_bearing_rad, .. } => {
                if let Some(range) = range_m {
                    positive("acoustic range, m", *range)?;
                }
                for bearing in [own_bearing_rad, peer_bearing_rad].into_iter().flatten() {
                    finite("acoustic bearing, rad", *bearing)?;
                }
            }
            Self::Reception { tol_ns, toa_ns, .. } => {
                if toa_ns < tol_ns {
                    return Err(Error::OutOfBound {
                        quantity: "travel time (toa − tol), s",
                        value: toa_ns.saturating_sub(*tol_ns) as f64 * 1e-9,
                        bound: "0 and above",
                    });
                }
            }
            Self::Landed | Self::LiftedOff | Self::RoleTaken { .. } | Self::Delivered { .. } => {}
        }
        Ok(())
    }
}

/// Nothing that a DVL rides on goes faster over ground, m/s: a reading above it says that there is none.
pub const GROUND_SPEED_MAX_MPS: f64 = 30.0;
/// Faster than anything that swims, m/s: beyond it sums over a mission would lose their digits.
const SPEED_MPS: (f64, &str) = (1e4, "-10,000 to 10,000");
/// Further than around the Earth, m.
const DISTANCE_M: (f64, &str) = (1e8, "-1e8 to 1e8");

/// Refuses what is not finite or larger than any honest source would say.
fn within(quantity: &'static str, value: f64, (limit, bound): (f64, &'static str)) -> Result<(), Error> {
    finite(quantity, value)?;
    if value.abs() > limit {
        return Err(Error::OutOfBound { quantity, value, bound });
    }
    Ok(())
}

/// Refuses a covariance [xx, xy, yy] that is not finite or not positive semi-definite.
///
/// # Errors
/// [`Error::NotFinite`], [`Error::NotPositive`].
pub fn check_covariance(quantity: &'static str, [xx, xy, yy]: [f64; 3]) -> Result<(), Error> {
    for value in [xx, xy, yy] {
        finite(quantity, value)?;
    }
    if xx < 0.0 || yy < 0.0 || xy * xy > xx * yy * (1.0 + 1e-9) + 1e-18 {
        return Err(Error::NotPositive { quantity, value: [xx, xy, xy, yy] });
    }
    Ok(())
}
