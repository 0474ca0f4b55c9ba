//! Any navigator behind an authenticated link: it knows nothing of tags, and never sees a packet without a right one.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::delayed::{Delayed, DelayedOptions};
use super::snapshot::{load, save};
use super::{Estimate, Innovation, Navigator, Outcome, Particles, Profile};
use crate::error::Error;
use crate::event::{Event, Payload, VehicleId};
use crate::link::{Authenticator, FailedTags, ReplayGuard};
use crate::packet::{CRC_BYTES, append_crc, check_crc, layout};

/// A navigator whose packets carry tags.
///
/// ```text
/// transmit: navigator ─ packet ─► drop its CRC ─► append tag ─► channel
/// handle:   channel ─► check tag, then counter ─► give back its CRC ─ packet ─► navigator
///                        └─► rejected and counted: the navigator is not called
/// ```
///
/// The tag takes the place of the checksum that packets end in: a navigator that fills what it is given fills the slot.
///
/// A forged, altered or replayed packet changes nothing but the count in [`Estimate::rejected`], and after
/// [`FailedTags::MOST`] forgeries in a slot nothing more is heard in it. A snapshot holds the
/// counters and the navigator's own snapshot, never the key.
#[derive(Debug)]
pub struct Authenticated<N> {
    inner: N,
    own: VehicleId,
    authenticator: Authenticator,
    state: AuthenticatedState,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct AuthenticatedState {
    guard: ReplayGuard,
    failed: FailedTags,
    rejected: u64,
}

impl<N: Navigator> Authenticated<N> {
    /// The navigator of vehicle `own` in a team of `vehicles`, all of which hold the same key.
    pub fn new(inner: N, own: VehicleId, vehicles: usize, authenticator: Authenticator) -> Self {
        Self {
            inner,
            own,
            authenticator,
            state: AuthenticatedState {
                guard: ReplayGuard::new(vehicles),
                failed: FailedTags::new(vehicles),
                rejected: 0,
            },
        }
    }

    /// The navigator itself.
    pub fn inner(&self) -> &N {
        &self.inner
    }

    /// Packets that were forged, altered or replayed so far.
    #[must_use]
    pub fn unauthentic(&self) -> u64 {
        self.state.rejected
    }

    /// The packet of an event without its tag, if it is authentic and new, and its slot saw few forgeries.
    fn untagged(&mut self, sender: VehicleId, tol_ns: i64, bytes: &[u8]) -> Option<Arc<[u8]>> {
        if self.state.failed.is_deaf(sender, tol_ns) {
            return None;
        }
        let Ok(packet) = self.authenticator.check_tag(bytes, sender, tol_ns) else {
            self.state.failed.count(sender, tol_ns);
            return None;
        };
        self.state.guard.check(sender, tol_ns).ok()?;
        Some(if self.inner.profile().has_checksum {
            append_crc(packet.to_vec(), sender, tol_ns).into()
        } else {
            packet.into()
        })
    }

    /// What a tag adds to the navigator's own packet, bytes; it may be less than nothing.
    fn cost_bytes(&self) -> isize {
        let saved = if self.inner.profile().has_checksum { CRC_BYTES } else { 0 };
        // Both are small.
        self.authenticator.tag_bytes() as isize - saved as isize
    }

    /// The navigator's packet as it goes on the channel.
    fn tagged(&self, packet: &[u8], tol_ns: i64) -> Result<Arc<[u8]>, Error> {
        let has_checksum = self.inner.profile().has_checksum;
        let payload = if has_checksum { check_crc(packet, self.own, tol_ns)? } else { packet };
        let tagged = self.authenticator.append_tag(payload, self.own, tol_ns);
        layout::note_tag(self.authenticator.tag_bytes() as u32 * 8, has_checksum);
        Ok(tagged.into())
    }

    /// What no honest source sends is refused before its tag is looked at, as the navigator itself would refuse it.
    fn check(&self, event: &Event, sender: VehicleId) -> Result<(), Error> {
        if event.vehicle != self.own {
            return Err(Error::WrongVehicle { event: event.vehicle, own: self.own });
        }
        if sender == self.own {
            return Err(Error::WrongVehicle { event: sender, own: self.own });
        }
        if usize::from(sender) >= self.state.guard.vehicles() {
            return Err(Error::UnknownVehicle { vehicle: sender, count: self.state.guard.vehicles() });
        }
        event.validate()
    }
}

impl<N: Navigator> Navigator for Authenticated<N> {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        let Payload::Reception { sender, tol_ns, toa_ns, bytes } = &event.payload else {
            return self.inner.handle(event);
        };
        let (sender, tol_ns, toa_ns) = (*sender, *tol_ns, *toa_ns);
        self.check(event, sender)?;
        let Some(bytes) = self.untagged(sender, tol_ns, bytes) else {
            self.state.rejected += 1;
            return Ok(Outcome::Rejected);
        };
        let payload = Payload::Reception { sender, tol_ns, toa_ns, bytes };
        let outcome = self.inner.handle(&Event { payload, ..*event })?;
        self.state.guard.commit(sender, tol_ns)?;
        Ok(outcome)
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        let cost_bytes = self.cost_bytes();
        let Some(room) = capacity_bytes.checked_add_signed(-cost_bytes) else {
            let bytes = self.authenticator.tag_bytes();
            return Err(Error::PacketTooLong { bytes, capacity: capacity_bytes });
        };
        match self.inner.transmit(tol_ns, room) {
            Ok(Some(packet)) => self.tagged(&packet, tol_ns).map(Some),
            Ok(None) => Ok(None),
            Err(Error::PacketTooLong { bytes, .. }) => {
                let bytes = bytes.saturating_add_signed(cost_bytes);
                Err(Error::PacketTooLong { bytes, capacity: capacity_bytes })
            }
            Err(other) => Err(other),
        }
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let mut estimate = self.inner.estimate(t_ns);
        estimate.rejected += self.state.rejected;
        estimate
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&(&self.state, self.inner.snapshot()?))
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let (state, inner): (AuthenticatedState, Vec<u8>) = load(snapshot)?;
        if state.guard.vehicles() != self.state.guard.vehicles() {
            return Err(Error::Snapshot("made in a team of another size".into()));
        }
        self.inner.restore(&inner)?;
        self.state = state;
        Ok(())
    }

    fn profile(&self) -> Profile {
        Profile { has_checksum: false, ..self.inner.profile() }
    }

    fn information_nat(&self) -> f64 {
        self.inner.information_nat()
    }

    fn innovation(&self) -> Option<Innovation> {
        self.inner.innovation()
    }

    fn particles(&self) -> Option<Particles> {
        self.inner.particles()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        self.inner.diagnostics()
    }
}

/// `inner` with tags, as [`Authenticated::new`]; its window of late events, if it has one, lies around the tags: what is
/// replayed is checked anew, in order.
pub fn authenticated(
    mut inner: Box<dyn Navigator>,
    own: VehicleId,
    vehicles: usize,
    authenticator: Authenticator,
) -> Box<dyn Navigator> {
    let window = inner.give_up_window();
    let tagged = Authenticated::new(inner, own, vehicles, authenticator);
    match window {
        Some(options) => Box::new(Delayed::around(tagged, own, options)),
        None => Box::new(tagged),
    }
}

/// A navigator in a box is one.
impl Navigator for Box<dyn Navigator> {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        self.as_mut().handle(event)
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        self.as_mut().transmit(tol_ns, capacity_bytes)
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        self.as_ref().estimate(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        self.as_ref().snapshot()
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.as_mut().restore(snapshot)
    }

    fn profile(&self) -> Profile {
        self.as_ref().profile()
    }

    fn give_up_window(&mut self) -> Option<DelayedOptions> {
        self.as_mut().give_up_window()
    }

    fn information_nat(&self) -> f64 {
        self.as_ref().information_nat()
    }

    fn innovation(&self) -> Option<Innovation> {
        self.as_ref().innovation()
    }

    fn particles(&self) -> Option<Particles> {
        self.as_ref().particles()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        self.as_ref().diagnostics()
    }
}
