//! The belief that this vehicle last broadcast, kept while teammates navigate by it.

use serde::{Deserialize, Serialize};

use super::joint::Joint;
use super::stationary_gyro::StationaryGyro;

/// The belief as it was broadcast, and the gyro readings at rest since then.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SentBelief {
    /// Its pose is the one that the packet holds, rounding included.
    pub joint: Joint,
    /// Gyro readings since the broadcast.
    pub gyro: StationaryGyro,
}
