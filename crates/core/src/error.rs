//! One error enum for the core; each variant carries the numbers that went wrong.

use thiserror::Error;

use crate::link::LinkError;
use crate::packet::PacketError;

/// Everything that the core refuses.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    /// A number that must be finite is not.
    #[error("{quantity} is {value}, which is not finite")]
    NotFinite {
        /// What the number means.
        quantity: &'static str,
        /// Its value.
        value: f64,
    },
    /// A number outside its bound.
    #[error("{quantity} is {value}, outside {bound}")]
    OutOfBound {
        /// What the number means, with its unit.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// The bound in words.
        bound: &'static str,
    },
    /// A number outside its least and greatest value.
    #[error("{quantity} is {value}, outside {open}{minimum} to {maximum}")]
    OutsideBounds {
        /// What the number means, with its unit.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// "above " where the least value itself is refused.
        open: &'static str,
        /// Least value.
        minimum: f64,
        /// Greatest value.
        maximum: f64,
    },
    /// An event older than what the navigator has already advanced to.
    #[error("event at {event_ns} ns is before the navigator's time {now_ns} ns")]
    FromThePast {
        /// Stamp of the event.
        event_ns: i64,
        /// Time of the navigator.
        now_ns: i64,
    },
    /// An event of another vehicle.
    #[error("event of vehicle {event} reached the navigator of vehicle {own}")]
    WrongVehicle {
        /// Vehicle in the event.
        event: u16,
        /// Vehicle of the navigator.
        own: u16,
    },
    /// A vehicle number that the mission does not know.
    #[error("vehicle {vehicle} is unknown: the mission has {count}")]
    UnknownVehicle {
        /// The number.
        vehicle: u16,
        /// How many vehicles there are.
        count: usize,
    },
    /// A covariance that is not symmetric positive semi-definite.
    #[error("{quantity} is not positive semi-definite: [{}, {}; {}, {}]", .value[0], .value[1], .value[2], .value[3])]
    NotPositive {
        /// What the matrix means.
        quantity: &'static str,
        /// Its four entries, row by row.
        value: [f64; 4],
    },
    /// A matrix of any size that must be positive definite and is not.
    #[error("{quantity} is not positive definite")]
    NotPositiveDefinite {
        /// What the matrix means.
        quantity: &'static str,
    },
    /// A chart that cannot be a chart.
    #[error("chart: {0}")]
    Chart(String),
    /// Two arrays that belong together have different lengths.
    #[error("{quantity} has {found} entries where {expected} are expected")]
    Length {
        /// What the array means.
        quantity: &'static str,
        /// Entries found.
        found: usize,
        /// Entries expected.
        expected: usize,
    },
    /// An option of a navigator that it does not have, does not read, or whose value it cannot take.
    #[error("navigator.{navigator}.{option}: {reason}")]
    Setting {
        /// The navigator, or its method.
        navigator: &'static str,
        /// The option.
        option: String,
        /// Why.
        reason: String,
    },
    /// A packet longer than its slot allows.
    #[error("packet of {bytes} bytes exceeds the slot's capacity of {capacity} bytes")]
    PacketTooLong {
        /// Length of the packet.
        bytes: usize,
        /// What the slot carries.
        capacity: usize,
    },
    /// A packet that could not be built or read.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// A link that contradicts itself.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A snapshot that cannot be restored.
    #[error("snapshot: {0}")]
    Snapshot(String),
    /// Something outside the core failed (a navigator written in Python, say).
    #[error("{0}")]
    External(String),
}

/// Refuses what is not finite.
///
/// # Errors
/// [`Error::NotFinite`].
pub fn finite(quantity: &'static str, value: f64) -> Result<f64, Error> {
    if value.is_finite() { Ok(value) } else { Err(Error::NotFinite { quantity, value }) }
}

/// Refuses what is not finite or is below zero.
///
/// # Errors
/// [`Error::NotFinite`], [`Error::OutOfBound`].
pub fn non_negative(quantity: &'static str, value: f64) -> Result<f64, Error> {
    finite(quantity, value)?;
    if value < 0.0 {
        return Err(Error::OutOfBound { quantity, value, bound: "0 and above" });
    }
    Ok(value)
}

/// Refuses what is not finite or is not above zero.
///
/// # Errors
/// [`Error::NotFinite`], [`Error::OutOfBound`].
pub fn positive(quantity: &'static str, value: f64) -> Result<f64, Error> {
    finite(quantity, value)?;
    if value <= 0.0 {
        return Err(Error::OutOfBound { quantity, value, bound: "above 0" });
    }
    Ok(value)
}
