//! What can be wrong with a link's set-up, a packet's place in its sequence, or a measured range.

use thiserror::Error;

/// Why a link cannot be set up, a packet is refused, or a range makes no sense.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LinkError {
    /// A quantity lies outside its bounds, or is not a number.
    #[error("{quantity} {value} is outside {minimum} to {maximum}")]
    OutOfRange {
        /// Which one, with its unit in the name.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// The smallest allowed value.
        minimum: f64,
        /// The largest allowed value.
        maximum: f64,
    },
    /// A packet needs more frames than the modem sends in one go.
    #[error(
        "packet of {bytes} bytes needs {frames} frames of {frame_bytes} bytes, the modem sends at most {max_frames}"
    )]
    TooManyFrames {
        /// Length of the packet.
        bytes: usize,
        /// Frames that it needs.
        frames: usize,
        /// Bytes in a frame.
        frame_bytes: usize,
        /// Most frames of one packet.
        max_frames: usize,
    },
    /// A packet is longer than its slot allows.
    #[error(
        "packet of {bytes} bytes does not fit the slot of vehicle {sender} at {tol_ns} ns, which holds {capacity_bytes}"
    )]
    SlotTooShort {
        /// Length of the packet.
        bytes: usize,
        /// Whose slot it is.
        sender: u16,
        /// Launch time of the slot.
        tol_ns: i64,
        /// What the slot holds.
        capacity_bytes: usize,
    },
    /// There is no slot for this sender at this time.
    #[error("vehicle {sender} has no slot at {tol_ns} ns")]
    NoSlot {
        /// Who wanted to send.
        sender: u16,
        /// When.
        tol_ns: i64,
    },
    /// Slots are not in the order of time, or two start at once.
    #[error("slot {index} starts at {tol_ns} ns, not after slot {before} at {previous_ns} ns")]
    SlotOrder {
        /// Place in the table.
        index: usize,
        /// Its launch time.
        tol_ns: i64,
        /// Place of the slot before it.
        before: usize,
        /// Launch time of that slot.
        previous_ns: i64,
    },
    /// A full slot is still on the air when the next one starts.
    #[error(
        "slot at {tol_ns} ns: {capacity_bytes} bytes take {air_time_ns} ns, but the next slot starts {gap_ns} ns later"
    )]
    SlotOverlap {
        /// Launch time of the slot.
        tol_ns: i64,
        /// Bytes that it is said to hold.
        capacity_bytes: usize,
        /// Air time of so many bytes.
        air_time_ns: i64,
        /// Time to the next slot.
        gap_ns: i64,
    },
    /// A packet was accepted before.
    #[error("packet {sequence} launched at {tol_ns} ns was received before")]
    Duplicate {
        /// Its sequence modulo 256.
        sequence: u8,
        /// Its launch time.
        tol_ns: i64,
    },
    /// A packet is older than what the receiver remembers.
    #[error(
        "packet {sequence} launched at {tol_ns} ns is older than the receive window, which starts at {oldest_ns} ns"
    )]
    TooOld {
        /// Its sequence modulo 256.
        sequence: u8,
        /// Its launch time.
        tol_ns: i64,
        /// Launch time of the oldest packet remembered.
        oldest_ns: i64,
    },
    /// A packet's sequence contradicts its launch time.
    #[error("packet {sequence} launched at {tol_ns} ns cannot lie between packets {lower} and {upper}")]
    OutOfSequence {
        /// Its sequence modulo 256.
        sequence: u8,
        /// Its launch time.
        tol_ns: i64,
        /// Counter of the last packet launched before it.
        lower: u64,
        /// Counter of the first packet launched after it.
        upper: u64,
    },
    /// No holder of the team's key tagged this packet for this slot.
    #[error("packet of {bytes} bytes is not authentic for the slot of vehicle {sender} at {tol_ns} ns")]
    Unauthentic {
        /// Length of what was received, tag included.
        bytes: usize,
        /// Whose slot it is.
        sender: u16,
        /// Launch time of the slot.
        tol_ns: i64,
    },
    /// An authentic packet that is not newer than the newest one heard of its sender.
    #[error("packet of vehicle {sender} launched at {tol_ns} ns is not newer than that of {newest_ns} ns")]
    Replayed {
        /// Whose slot it is.
        sender: u16,
        /// Launch time of the slot.
        tol_ns: i64,
        /// Launch time of the newest one.
        newest_ns: i64,
    },
    /// An admission is committed to a window that has moved on since, or is another peer's.
    #[error("packet {counter} launched at {tol_ns} ns no longer fits the receive window")]
    StaleAdmission {
        /// Counter of the admitted packet.
        counter: u64,
        /// Its launch time.
        tol_ns: i64,
    },
    /// A counter has reached its end.
    #[error("packet counter {counter} has no successor")]
    CounterExhausted {
        /// The last value.
        counter: u64,
    },
    /// A signal that arrives before, or when, it is launched.
    #[error("range {range_m} m is not positive: launched at {tol_ns} ns, arrived at {toa_ns} ns")]
    RangeNotPositive {
        /// Sound speed times travel time.
        range_m: f64,
        /// Launch time.
        tol_ns: i64,
        /// Arrival time.
        toa_ns: i64,
    },
    /// A slant range that two vehicles so far apart in depth cannot have.
    #[error(
        "slant range {slant_m} m is more than {allowance_m} m below the depth difference {depth_difference_m} m"
    )]
    SlantTooShort {
        /// The measured slant range.
        slant_m: f64,
        /// Difference of the depths.
        depth_difference_m: f64,
        /// How much shorter than that it may be.
        allowance_m: f64,
    },
}

/// Refuses a quantity that is NaN or outside `minimum..=maximum`.
pub(super) fn within(
    quantity: &'static str,
    value: f64,
    minimum: f64,
    maximum: f64,
) -> Result<(), LinkError> {
    if (minimum..=maximum).contains(&value) {
        Ok(())
    } else {
        Err(LinkError::OutOfRange { quantity, value, minimum, maximum })
    }
}
