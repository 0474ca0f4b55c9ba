//! The order of events.

use std::cmp::Ordering;

use super::{Class, Event, Kind, VehicleId};

impl Event {
    /// Time, class (sensors, receptions, roles), vehicle, kind as declared: what a log's sequence does not decide.
    #[must_use]
    pub fn place(&self) -> (i64, Class, VehicleId, Kind) {
        (self.t_ns, self.payload.class(), self.vehicle, self.payload.kind())
    }

    /// By [`place`](Self::place), then by content: an order of events that came in any sequence.
    #[must_use]
    pub fn order(&self, other: &Self) -> Ordering {
        self.place().cmp(&other.place()).then_with(|| self.content().cmp(&other.content()))
    }

    /// Its bytes; only two of one kind at one time are told apart by them.
    fn content(&self) -> Vec<u8> {
        // Writing to memory does not fail.
        postcard::to_stdvec(&self.payload).unwrap_or_default()
    }
}
