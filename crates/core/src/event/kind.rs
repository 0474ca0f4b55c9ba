//! Kinds of events, and their order at one instant.

use serde::{Deserialize, Serialize};

/// Kinds of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Kind {
    /// [`super::Payload::Motion`].
    Motion,
    /// [`super::Payload::Odometry`].
    Odometry,
    /// [`super::Payload::WaterDepth`].
    WaterDepth,
    /// [`super::Payload::Depth`].
    Depth,
    /// [`super::Payload::Heading`].
    Heading,
    /// [`super::Payload::TurnRate`].
    TurnRate,
    /// [`super::Payload::GroundVelocity`].
    GroundVelocity,
    /// [`super::Payload::Fix`].
    Fix,
    /// [`super::Payload::AcousticFix`].
    AcousticFix,
    /// [`super::Payload::WaterVelocity`].
    WaterVelocity,
    /// [`super::Payload::BeaconRange`].
    BeaconRange,
    /// [`super::Payload::Usbl`].
    Usbl,
    /// [`super::Payload::Landed`].
    Landed,
    /// [`super::Payload::LiftedOff`].
    LiftedOff,
    /// [`super::Payload::RoleTaken`].
    RoleTaken,
    /// [`super::Payload::Reception`].
    Reception,
    /// [`super::Payload::Delivered`].
    Delivered,
}

impl Kind {
    /// All kinds, in the order of their declaration.
    pub const ALL: [Self; 17] = [
        Self::Motion,
        Self::Odometry,
        Self::WaterDepth,
        Self::Depth,
        Self::Heading,
        Self::TurnRate,
        Self::GroundVelocity,
        Self::Fix,
        Self::AcousticFix,
        Self::WaterVelocity,
        Self::BeaconRange,
        Self::Usbl,
        Self::Landed,
        Self::LiftedOff,
        Self::RoleTaken,
        Self::Reception,
        Self::Delivered,
    ];

    /// Its name in a mission log.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Motion => "motion",
            Self::Odometry => "odometry",
            Self::WaterDepth => "water_depth",
            Self::Depth => "depth",
            Self::Heading => "heading",
            Self::TurnRate => "turn_rate",
            Self::GroundVelocity => "ground_velocity",
            Self::Fix => "fix",
            Self::AcousticFix => "acoustic_fix",
            Self::WaterVelocity => "water_velocity",
            Self::BeaconRange => "beacon_range",
            Self::Usbl => "usbl",
            Self::Landed => "landed",
            Self::LiftedOff => "lifted_off",
            Self::RoleTaken => "role_taken",
            Self::Reception => "reception",
            Self::Delivered => "delivered",
        }
    }
}

/// Order of events at one instant (sensors, receptions, transmissions, role changes).
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
