//! What a replay is given: events, opportunities to be heard, polls, and the link.

use super::poll::{self, Poll};
use crate::error::{Error, finite};
use crate::event::{Event, VehicleId, check_time, check_travel};
use crate::link::{LinkConfig, Slot, SlotTable};

/// A signal that could be heard: where the mission decides what the channel does.
#[derive(Debug, Clone, PartialEq)]
pub struct Opportunity {
    /// Launch, ns: names the slot.
    pub tol_ns: i64,
    /// Who launches.
    pub sender: VehicleId,
    /// Who could hear it.
    pub receiver: VehicleId,
    /// Measured arrival of the signal's start, ns.
    pub toa_ns: i64,
    /// Chance of one frame.
    pub survive_probability: f64,
    /// One uniform draw per frame.
    pub draws: Vec<f64>,
}

/// The navigators' half of a mission: everything but the truth.
#[derive(Debug, Clone)]
pub struct Mission {
    pub(super) vehicles: usize,
    pub(super) link: LinkConfig,
    pub(super) events: Vec<Event>,
    pub(super) slots: SlotTable,
    pub(super) opportunities: Vec<Opportunity>,
    pub(super) polls: Vec<Poll>,
    pub(super) end_ns: i64,
}

impl Mission {
    /// Checks and orders a mission.
    ///
    /// # Errors
    /// An event that no honest source could send, an unknown vehicle, an opportunity without a slot, or a probability
    /// or draw outside 0 to 1.
    pub fn new(
        vehicles: usize,
        link: LinkConfig,
        mut events: Vec<Event>,
        slots: Vec<Slot>,
        mut opportunities: Vec<Opportunity>,
        end_ns: i64,
    ) -> Result<Self, Error> {
        let known = |vehicle: VehicleId| {
            if usize::from(vehicle) < vehicles {
                Ok(())
            } else {
                Err(Error::UnknownVehicle { vehicle, count: vehicles })
            }
        };
        for event in &events {
            known(event.vehicle)?;
            event.validate()?;
        }
        let slots = SlotTable::new(slots)?;
        for slot in slots.slots() {
            known(slot.sender)?;
            check_time("slot tol_ns", slot.tol_ns)?;
        }
        for o in &opportunities {
            known(o.sender)?;
            known(o.receiver)?;
            slots.check_packet(o.sender, o.tol_ns, 0)?;
            for value in std::iter::once(&o.survive_probability).chain(&o.draws) {
                finite("survive probability or draw", *value)?;
                if !(0.0..=1.0).contains(value) {
                    return Err(Error::OutOfBound {
                        quantity: "survive probability or draw",
                        value: *value,
                        bound: "0 to 1",
                    });
                }
            }
            check_travel(o.tol_ns, o.toa_ns)?;
        }
        events.sort_by_key(Event::place);
        opportunities.sort_by_key(|o| (o.tol_ns, o.receiver));
        Ok(Self { vehicles, link, events, slots, opportunities, polls: Vec::new(), end_ns })
    }

    /// The same mission with two-way ranging: these slots are polled, and silent where the poll was not heard.
    ///
    /// # Errors
    /// An unknown poller, one that polls itself, a poll without a slot, two for one, or times that make no sense.
    pub fn with_polls(mut self, polls: Vec<Poll>) -> Result<Self, Error> {
        self.polls = poll::checked(polls, self.vehicles, &self.slots)?;
        Ok(self)
    }

    /// Number of vehicles.
    #[must_use]
    pub fn vehicles(&self) -> usize {
        self.vehicles
    }

    /// The link.
    #[must_use]
    pub fn link(&self) -> &LinkConfig {
        &self.link
    }

    /// End of the mission, ns.
    #[must_use]
    pub fn end_ns(&self) -> i64 {
        self.end_ns
    }

    /// Opportunities in order of launch.
    #[must_use]
    pub fn opportunities(&self) -> &[Opportunity] {
        &self.opportunities
    }

    pub(super) fn poll_of(&self, slot: &Slot) -> Option<&Poll> {
        let key = |p: &Poll| (p.tol_ns, p.sender);
        let at = self.polls.binary_search_by_key(&(slot.tol_ns, slot.sender), key).ok()?;
        self.polls.get(at)
    }

    pub(super) fn opportunities_of(&self, slot: &Slot) -> &[Opportunity] {
        let start = self.opportunities.partition_point(|o| o.tol_ns < slot.tol_ns);
        let end = self.opportunities.partition_point(|o| o.tol_ns <= slot.tol_ns);
        &self.opportunities[start..end]
    }
}
