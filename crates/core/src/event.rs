//! What can happen to a vehicle, stamped.

mod bounds;
mod kind;
mod order;

use std::sync::Arc;

use nalgebra::{Matrix2, Matrix3};
use serde::{Deserialize, Serialize};

pub use bounds::{BOUNDS, Bound, CORRELATION_SLACK, TIME_NS, TRAVEL_NS, check_time, check_travel};

pub use kind::{Class, Kind};

use crate::error::Error;
use bounds::{check_span, check_triangle};

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
        /// Slant range from the two-way travel time, m.
        range_m: Option<f64>,
        /// Direction to the peer, own body frame, rad.
        own_bearing_rad: Option<f64>,
        /// Direction to this vehicle as the peer's reply tells it, the peer's body frame, rad.
        peer_bearing_rad: Option<f64>,
        /// The peer's depth below the surface as its reply tells it, m.
        peer_depth_m: Option<f64>,
    },
    /// Velocity through the water from a DVL's water lock or a speed log, body frame.
    WaterVelocity {
        /// [forward, left], m/s.
        velocity_mps: [f64; 2],
        /// Standard deviation per axis, m/s.
        sigma_mps: f64,
    },
    /// Range to a beacon that stands at a known place.
    BeaconRange {
        /// When the signal arrived, ns: the range is to where the vehicle was then.
        measured_ns: i64,
        /// The beacon, [east, north], m.
        beacon_m: [f64; 2],
        /// Its depth below the surface, m.
        beacon_depth_m: f64,
        /// Slant range, m.
        range_m: f64,
        /// Standard deviation, m.
        sigma_m: f64,
        /// From the travel time one way, in which the difference of the clocks stands; false: there and back.
        one_way: bool,
    },
    /// Position by an ultra-short baseline, told some time after it was measured.
    Usbl {
        /// When it was measured, ns: the position is that of the vehicle then.
        measured_ns: i64,
        /// [east, north], m.
        position_m: [f64; 2],
        /// [ee, en, nn], m².
        covariance_m2: [f64; 3],
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

    /// Which kind of event it is.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::Motion { .. } => Kind::Motion,
            Self::Odometry { .. } => Kind::Odometry,
            Self::WaterDepth { .. } => Kind::WaterDepth,
            Self::Depth { .. } => Kind::Depth,
            Self::Heading { .. } => Kind::Heading,
            Self::TurnRate { .. } => Kind::TurnRate,
            Self::GroundVelocity { .. } => Kind::GroundVelocity,
            Self::Fix { .. } => Kind::Fix,
            Self::AcousticFix { .. } => Kind::AcousticFix,
            Self::WaterVelocity { .. } => Kind::WaterVelocity,
            Self::BeaconRange { .. } => Kind::BeaconRange,
            Self::Usbl { .. } => Kind::Usbl,
            Self::Landed => Kind::Landed,
            Self::LiftedOff => Kind::LiftedOff,
            Self::RoleTaken { .. } => Kind::RoleTaken,
            Self::Reception { .. } => Kind::Reception,
            Self::Delivered { .. } => Kind::Delivered,
        }
    }

    /// Refuses numbers outside [`BOUNDS`] and covariances that are none.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutsideBounds`] or [`Error::NotPositiveDefinite`] with the quantity.
    pub fn validate(&self) -> Result<(), Error> {
        match self {
            Self::Motion { velocity_mps: [e, n] } => {
                bounds::MOTION_E.check(*e)?;
                bounds::MOTION_N.check(*n)
            }
            Self::Odometry { displacement_m: [f, l], yaw_change_rad, covariance } => {
                bounds::ODOMETRY_FORWARD.check(*f)?;
                bounds::ODOMETRY_LEFT.check(*l)?;
                bounds::ODOMETRY_YAW.check(*yaw_change_rad)?;
                check_odometry(covariance)
            }
            Self::WaterDepth { water_depth_m, sigma_m } => {
                bounds::WATER_DEPTH.check(*water_depth_m)?;
                bounds::WATER_DEPTH_SIGMA.check(*sigma_m)
            }
            Self::Depth { depth_m, sigma_m } => {
                bounds::DEPTH.check(*depth_m)?;
                bounds::DEPTH_SIGMA.check(*sigma_m)
            }
            Self::Heading { yaw_rad, sigma_rad } => {
                bounds::HEADING.check(*yaw_rad)?;
                bounds::HEADING_SIGMA.check(*sigma_rad)
            }
            Self::TurnRate { yaw_rate_radps, sigma_radps } => {
                bounds::TURN_RATE.check(*yaw_rate_radps)?;
                bounds::TURN_RATE_SIGMA.check(*sigma_radps)
            }
            Self::GroundVelocity { velocity_mps: [f, l], sigma_mps } => {
                bounds::GROUND_FORWARD.check(*f)?;
                bounds::GROUND_LEFT.check(*l)?;
                bounds::GROUND_SIGMA.check(*sigma_mps)
            }
            Self::Fix { position_m: [e, n], covariance_m2: [ee, en, nn] } => {
                bounds::FIX_E.check(*e)?;
                bounds::FIX_N.check(*n)?;
                check_fix_covariance([*ee, *en, *nn])
            }
            Self::AcousticFix { range_m, own_bearing_rad, peer_bearing_rad, peer_depth_m, .. } => {
                peer_depth_m.map_or(Ok(()), |m| bounds::ACOUSTIC_PEER_DEPTH.check(m))?;
                range_m.map_or(Ok(()), |m| bounds::ACOUSTIC_RANGE.check(m))?;
                own_bearing_rad.map_or(Ok(()), |rad| bounds::ACOUSTIC_OWN.check(rad))?;
                peer_bearing_rad.map_or(Ok(()), |rad| bounds::ACOUSTIC_PEER.check(rad))
            }
            Self::WaterVelocity { velocity_mps: [f, l], sigma_mps } => {
                bounds::WATER_FORWARD.check(*f)?;
                bounds::WATER_LEFT.check(*l)?;
                bounds::WATER_SIGMA.check(*sigma_mps)
            }
            Self::BeaconRange { beacon_m: [e, n], beacon_depth_m, range_m, sigma_m, .. } => {
                bounds::BEACON_E.check(*e)?;
                bounds::BEACON_N.check(*n)?;
                bounds::BEACON_DEPTH.check(*beacon_depth_m)?;
                bounds::BEACON_RANGE.check(*range_m)?;
                bounds::BEACON_SIGMA.check(*sigma_m)
            }
            Self::Usbl { position_m: [e, n], covariance_m2: [ee, en, nn], .. } => {
                bounds::USBL_E.check(*e)?;
                bounds::USBL_N.check(*n)?;
                bounds::USBL_EE.check(*ee)?;
                bounds::USBL_EN.check(*en)?;
                bounds::USBL_NN.check(*nn)?;
                check_triangle("usbl covariance", &Matrix2::new(*ee, *en, *en, *nn))
            }
            Self::Landed
            | Self::LiftedOff
            | Self::RoleTaken { .. }
            | Self::Reception { .. }
            | Self::Delivered { .. } => Ok(()),
        }
    }
}

/// Nothing that a DVL rides on goes faster over ground, m/s: a reading above it says that there is none.
pub const GROUND_SPEED_MAX_MPS: f64 = 30.0;

/// Refuses a fix covariance [ee, en, nn] that keeps no bound or is not positive semi-definite.
///
/// # Errors
/// [`Error::NotFinite`], [`Error::OutsideBounds`], [`Error::NotPositiveDefinite`].
pub fn check_fix_covariance([ee, en, nn]: [f64; 3]) -> Result<(), Error> {
    bounds::FIX_EE.check(ee)?;
    bounds::FIX_EN.check(en)?;
    bounds::FIX_NN.check(nn)?;
    check_triangle("fix covariance", &Matrix2::new(ee, en, en, nn))
}

fn check_odometry(covariance: &[f64; 6]) -> Result<(), Error> {
    let [ff, fl, fy, ll, ly, yy] = *covariance;
    for (bound, value) in [
        (&bounds::ODOMETRY_FF, ff),
        (&bounds::ODOMETRY_FL, fl),
        (&bounds::ODOMETRY_FY, fy),
        (&bounds::ODOMETRY_LL, ll),
        (&bounds::ODOMETRY_LY, ly),
        (&bounds::ODOMETRY_YY, yy),
    ] {
        bound.check(value)?;
    }
    check_triangle("odometry covariance", &Matrix3::new(ff, fl, fy, fl, ll, ly, fy, ly, yy))
}

impl Event {
    /// Refuses what no honest source could send: numbers outside their bounds, and times that contradict each other.
    ///
    /// # Errors
    /// What [`Payload::validate`] says; [`Error::OutsideBounds`] for a time more than [`TIME_NS`] off the epoch, a signal
    /// that arrived before it was launched, travelled longer than [`TRAVEL_NS`], or arrived after the event itself.
    pub fn validate(&self) -> Result<(), Error> {
        check_time("event t_ns", self.t_ns)?;
        match self.payload {
            Payload::Reception { tol_ns, toa_ns, .. } => {
                check_travel(tol_ns, toa_ns)?;
                check_span("time from arrival to the end of decoding, s", toa_ns, self.t_ns, i64::MAX)
            }
            Payload::AcousticFix { transmit_ns, .. } => {
                check_time("acoustic_fix transmit_ns", transmit_ns)?;
                check_span("duration of an acoustic fix, s", transmit_ns, self.t_ns, TRAVEL_NS)?;
                self.payload.validate()
            }
            Payload::BeaconRange { measured_ns, .. } | Payload::Usbl { measured_ns, .. } => {
                check_time("measured_ns", measured_ns)?;
                check_span("age of a position or range, s", measured_ns, self.t_ns, TRAVEL_NS)?;
                self.payload.validate()
            }
            Payload::Delivered { tol_ns, .. } => {
                check_time("delivered tol_ns", tol_ns)?;
                check_span("time from launch to delivery, s", tol_ns, self.t_ns, i64::MAX)
            }
            _ => self.payload.validate(),
        }
    }
}
