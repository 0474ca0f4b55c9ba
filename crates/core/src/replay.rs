//! The event loop of a team: order, channel, transmit, receive, record.
//!
//! The next thing to happen is the least of the next event, the next transmit slot, the next packet to be decoded and
//! the next instant to record, in the order (time, class, vehicle, arrival). Losses belong to the mission: each
//! opportunity carries one uniform draw per frame, and a packet arrives if every frame that *this* packet needs
//! survives. A packet that does not fit its fields or its slot is silence in that slot, and counted.

mod authenticated;
mod estimators;
mod innovations;
mod mission;
mod poll;
mod record;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use estimators::Estimators;
pub use innovations::{InnovationRecord, OutcomeCounts};
pub use mission::{Mission, Opportunity};
pub use poll::Poll;
pub use record::{CloudRecord, PacketRecord, Record, Tracks};

use crate::error::Error;
use crate::event::{Class, Event, Kind, Payload, VehicleId};
use crate::link::Slot;
use crate::navigator::Outcome;
use crate::navigator::snapshot::{load, save};

/// A packet on its way to being decoded.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
struct Arrival {
    t_ns: i64,
    receiver: VehicleId,
    order: u64,
    sender: VehicleId,
    tol_ns: i64,
    toa_ns: i64,
    record: usize,
    bytes: Arc<[u8]>,
}

/// State of a replay; all of it is in a snapshot.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Cursor {
    event: usize,
    slot: usize,
    sample: usize,
    order: u64,
    in_flight: BinaryHeap<Reverse<Arrival>>,
}

/// One team replaying one mission.
pub struct Replay {
    mission: Arc<Mission>,
    team: Estimators,
    cursor: Cursor,
    record: Record,
}

/// A packet and its use of the channel.
struct Launched {
    bytes: Arc<[u8]>,
    length: usize,
    frames: usize,
    air_time_ns: i64,
}

/// What happens next.
enum Next {
    Event,
    Arrival,
    Slot,
    Sample,
}

impl Replay {
    /// A team at the start of a mission; `sample_ns` are the instants to record (ascending), every `cloud_every`-th of
    /// them with particles (0: none).
    ///
    /// # Errors
    /// [`Error::Length`] if team and mission differ in size.
    pub fn new(
        mission: Arc<Mission>,
        team: Estimators,
        sample_ns: Arc<[i64]>,
        cloud_every: usize,
    ) -> Result<Self, Error> {
        if let Some(found) = team.size()
            && found != mission.vehicles
        {
            return Err(Error::Length { quantity: "team of navigators", found, expected: mission.vehicles });
        }
        let record = Record::new(mission.vehicles, sample_ns, cloud_every);
        Ok(Self { mission, team, cursor: Cursor::default(), record })
    }

    /// Runs until everything before `until_ns` has happened.
    ///
    /// # Errors
    /// What a navigator refuses.
    pub fn run_until(&mut self, until_ns: i64) -> Result<(), Error> {
        while let Some(next) = self.next(until_ns) {
            match next {
                Next::Event => self.event()?,
                Next::Arrival => self.arrival()?,
                Next::Slot => self.slot()?,
                Next::Sample => self.record.sample(&self.team, &mut self.cursor.sample),
            }
        }
        Ok(())
    }

    /// Runs to the end.
    ///
    /// # Errors
    /// What a navigator refuses.
    pub fn run(&mut self) -> Result<(), Error> {
        self.run_until(i64::MAX)
    }

    /// The record, given up.
    #[must_use]
    pub fn into_tracks(self) -> Tracks {
        self.record.into_tracks()
    }

    /// Everything that determines what comes next, and what was recorded so far.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&(&self.cursor, self.team.snapshot()?, &self.record))
    }

    /// Takes up a snapshot made with the same mission and team.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let (cursor, team, record): (Cursor, Vec<Vec<u8>>, Record) = load(snapshot)?;
        if cursor.event > self.mission.events.len() || !record.fits(&self.record) {
            return Err(Error::Snapshot("made with another mission".into()));
        }
        self.team.restore(&team)?;
        self.cursor = cursor;
        self.record = record;
        Ok(())
    }

    /// The least of the four heads that is due before `until_ns`.
    fn next(&self, until_ns: i64) -> Option<Next> {
        let c = &self.cursor;
        let event = self.mission.events.get(c.event).map(|e| (e.t_ns, e.payload.class() as u8, Next::Event));
        let arrival = c.in_flight.peek().map(|Reverse(a)| (a.t_ns, Class::Reception as u8, Next::Arrival));
        let slot =
            self.mission.slots.slots().get(c.slot).map(|s| (s.tol_ns, Class::Transmit as u8, Next::Slot));
        let sample = self.record.sample_at(c.sample).map(|t| (t, u8::MAX, Next::Sample));
        [event, arrival, slot, sample]
            .into_iter()
            .flatten()
            .filter(|head| head.0 < until_ns)
            .min_by_key(|head| (head.0, head.1))
            .map(|head| head.2)
    }

    fn event(&mut self) -> Result<(), Error> {
        let event = &self.mission.events[self.cursor.event];
        let (vehicle, kind) = (event.vehicle, event.payload.kind());
        let (outcome, seen) = self.team.handle_judged(event)?;
        self.record.judged(vehicle, kind, outcome, seen);
        self.count_unused(vehicle, kind);
        self.cursor.event += 1;
        Ok(())
    }

    fn count_unused(&mut self, vehicle: VehicleId, kind: Kind) {
        if self.team.profile(vehicle).is_some_and(|profile| !profile.uses.contains(kind)) {
            self.record.unused(kind);
        }
    }

    fn arrival(&mut self) -> Result<(), Error> {
        let Some(Reverse(arrival)) = self.cursor.in_flight.pop() else { return Ok(()) };
        let Arrival { t_ns, receiver, sender, tol_ns, toa_ns, record, bytes, .. } = arrival;
        let payload = Payload::Reception { sender, tol_ns, toa_ns, bytes };
        let (outcome, seen) = self.team.handle_judged(&Event { t_ns, vehicle: receiver, payload })?;
        self.record.judged(receiver, Kind::Reception, outcome, seen);
        self.count_unused(receiver, Kind::Reception);
        if outcome == Outcome::Fused {
            self.record.accepted(record, self.team.information_nat(receiver));
        }
        if self.team.profile(sender).is_some_and(|profile| profile.needs_delivery_oracle) {
            self.team.handle(&Event {
                t_ns,
                vehicle: sender,
                payload: Payload::Delivered { tol_ns, to: receiver },
            })?;
        }
        Ok(())
    }

    /// What a packet takes of its slot, with `reply_bytes` of a poll's answer beside it.
    fn on_air(&self, slot: &Slot, bytes: Arc<[u8]>, reply_bytes: u32) -> Result<Launched, Error> {
        let length = self.team.packet_length(&bytes);
        self.mission.slots.check_packet(slot.sender, slot.tol_ns, length)?;
        let length = length + reply_bytes as usize;
        let frames = self.mission.link.frames_needed(length)?;
        let air_time_ns = self.mission.link.air_time_ns(length)?;
        Ok(Launched { bytes, length, frames, air_time_ns })
    }

    /// A transmit slot: asks for the packet; the mission's draws decide which vehicles receive it.
    fn slot(&mut self) -> Result<(), Error> {
        let slot = self.mission.slots.slots()[self.cursor.slot];
        self.cursor.slot += 1;
        let poll = self.mission.poll_of(&slot).copied();
        if let Some(poll) =
            poll.filter(|poll| self.team.profile(poll.poller).is_some_and(|profile| profile.takes_ranges))
        {
            self.record.polled(poll);
        }
        if poll.is_some_and(|poll| !poll.answered) {
            return Ok(());
        }
        let launched = self.team.transmit(&slot).and_then(|packet| {
            packet.map(|bytes| self.on_air(&slot, bytes, poll.map_or(0, |p| p.reply_bytes))).transpose()
        });
        let Launched { bytes, length, frames, air_time_ns } = match launched {
            Ok(Some(launched)) => launched,
            Ok(None) => return Ok(()),
            Err(Error::Packet(_) | Error::PacketTooLong { .. } | Error::Link(_)) => {
                self.record.unsent(slot.sender);
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        self.record.sent(slot.sender, slot.tol_ns, length);
        for o in self.mission.opportunities_of(&slot) {
            let survives = |k| o.draws.get(k).is_some_and(|draw| *draw < o.survive_probability);
            let received = (0..frames).all(survives);
            let record = self.record.packet(PacketRecord {
                sender: o.sender,
                receiver: o.receiver,
                tol_ns: o.tol_ns,
                toa_ns: o.toa_ns,
                bytes: length as u32,
                frames: frames as u32,
                received,
                accepted: false,
                information_nat: f64::NAN,
            });
            if received {
                self.cursor.order += 1;
                self.cursor.in_flight.push(Reverse(Arrival {
                    t_ns: o.toa_ns.saturating_add(air_time_ns),
                    receiver: o.receiver,
                    order: self.cursor.order,
                    sender: o.sender,
                    tol_ns: o.tol_ns,
                    toa_ns: o.toa_ns,
                    record,
                    bytes: bytes.clone(),
                }));
            }
        }
        Ok(())
    }
}
