//! What can be wrong with a packet, at the sender or at the receiver.

use thiserror::Error;

/// Why something could not be written to, or read from, a packet. Field names carry no unit; the message does.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PacketError {
    /// A value lies outside what its field can hold.
    #[error("{field} {value} {unit} is outside {minimum} to {maximum} {unit}")]
    OutOfRange {
        /// What the field holds.
        field: &'static str,
        /// Its unit.
        unit: &'static str,
        /// The value that does not fit.
        value: f64,
        /// The smallest value that the field holds.
        minimum: f64,
        /// The largest one.
        maximum: f64,
    },
    /// NaN or infinity where a number is needed.
    #[error("{field} is {value}, not a finite number")]
    NotFinite {
        /// What the field holds.
        field: &'static str,
        /// NaN or an infinity.
        value: f64,
    },
    /// An integer needs more bits than its field has.
    #[error("{field} {value} does not fit {bits} bits (at most {maximum})")]
    TooManyBits {
        /// What the field holds.
        field: &'static str,
        /// The value that does not fit.
        value: u64,
        /// Width of the field.
        bits: u32,
        /// The largest value that it holds.
        maximum: u64,
    },
    /// A field is defined with a width, step or range that cannot work.
    #[error("field {field} is defined with {quantity} {value}, allowed are {minimum} to {maximum}")]
    Definition {
        /// What the field holds.
        field: &'static str,
        /// Which part of the definition.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// The least allowed value.
        minimum: f64,
        /// The largest allowed value.
        maximum: f64,
    },
    /// A matrix that is not a covariance: not symmetric, or with a negative eigenvalue.
    #[error("covariance [{ee}, {en}; {ne}, {nn}] m^2 is not symmetric positive semi-definite")]
    NotCovariance {
        /// Variance of easting, m².
        ee: f64,
        /// Covariance, upper right element, m².
        en: f64,
        /// Covariance, lower left element, m².
        ne: f64,
        /// Variance of northing, m².
        nn: f64,
    },
    /// A matrix that must be positive definite and is not.
    #[error("{field} is not positive definite")]
    NotPositiveDefinite {
        /// What the field holds.
        field: &'static str,
    },
    /// A graph whose x and y differ, or depend on each other, in a form that holds one number for both.
    #[error(
        "x and y of the graph differ or are coupled by {apart}: this form is for senders whose axes are alike (GPS alone)"
    )]
    NotIsotropic {
        /// By how much.
        apart: f64,
    },
    /// The packet ends inside a field.
    #[error("packet ends inside {field}: {needed_bits} bits needed, {left_bits} left")]
    Truncated {
        /// What the field holds.
        field: &'static str,
        /// Width of the field.
        needed_bits: u32,
        /// Bits that were left.
        left_bits: usize,
    },
    /// The packet does not have its kind's length.
    #[error("packet has {bytes} bytes, {expected} expected")]
    Length {
        /// Bytes there are.
        bytes: usize,
        /// Bytes there should be (at least, where the length is not fixed).
        expected: usize,
    },
    /// The bits after the last field are more than the rest of a byte, or not zero.
    #[error(
        "{left_bits} bits with value {value} follow the last field, only zero bits up to a whole byte may"
    )]
    Padding {
        /// Bits that follow.
        left_bits: usize,
        /// Their value (of the first 64).
        value: u64,
    },
    /// A bit pattern that no sender writes.
    #[error("{field} holds code {code}, which no sender writes")]
    InvalidCode {
        /// What the field holds.
        field: &'static str,
        /// The pattern, as an unsigned number.
        code: u64,
    },
    /// The checksum does not belong to these bytes, this sender and this launch time.
    #[error("checksum is {received:#06x}, but the packet, its sender and launch time give {computed:#06x}")]
    Checksum {
        /// The checksum in the packet.
        received: u16,
        /// The one computed from its content.
        computed: u16,
    },
    /// A covariance that is not positive definite.
    #[error("{field} is not positive definite")]
    NotDefinite {
        /// What the matrix means.
        field: &'static str,
    },
}
