//! Two-way ranging: the polls that ask for a slot's packet, and their bytes.

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::event::VehicleId;
use crate::link::SlotTable;

/// A teammate's request for the packet of one slot. A slot without one sends unasked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Poll {
    /// Launch of the slot's packet, ns: names the slot.
    pub tol_ns: i64,
    /// Whose slot it is.
    pub sender: VehicleId,
    /// Who polls, and alone gets the range.
    pub poller: VehicleId,
    /// Launch of the poll, ns.
    pub t_ns: i64,
    /// Length of the poll.
    pub bytes: u32,
    /// Time that it occupies the channel, ns.
    pub air_time_ns: i64,
    /// Bytes that the answer carries beside the navigator's packet: how long the poll was held.
    pub reply_bytes: u32,
    /// Whether the sender heard it; if not, its slot stays silent.
    pub answered: bool,
}

/// Checks polls against the team and the slots and sorts them by slot.
///
/// # Errors
/// An unknown or lonely poller, a poll without a slot, two for one, one launched after its answer, or a negative time.
pub(super) fn checked(mut polls: Vec<Poll>, vehicles: usize, slots: &SlotTable) -> Result<Vec<Poll>, Error> {
    for poll in &polls {
        for vehicle in [poll.poller, poll.sender] {
            if usize::from(vehicle) >= vehicles {
                return Err(Error::UnknownVehicle { vehicle, count: vehicles });
            }
        }
        if poll.poller == poll.sender {
            return Err(Error::WrongVehicle { event: poll.poller, own: poll.sender });
        }
        slots.check_packet(poll.sender, poll.tol_ns, 0)?;
        for (quantity, ns) in [
            ("time from poll to answer, s", poll.tol_ns.saturating_sub(poll.t_ns)),
            ("air time of a poll, s", poll.air_time_ns),
        ] {
            if ns < 0 {
                return Err(Error::OutOfBound { quantity, value: ns as f64 * 1e-9, bound: "0 and above" });
            }
        }
    }
    polls.sort_by_key(|p| (p.tol_ns, p.sender));
    if let Some(pair) =
        polls.windows(2).find(|pair| (pair[0].tol_ns, pair[0].sender) == (pair[1].tol_ns, pair[1].sender))
    {
        return Err(Error::OutOfBound {
            quantity: "polls of one slot",
            value: f64::from(pair[1].sender),
            bound: "one for each slot",
        });
    }
    Ok(polls)
}
