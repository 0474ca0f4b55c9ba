//! Late and out-of-order events: a window of snapshots and events around any navigator.
//!
//! Everything that the navigator was handed within the last `lag` is kept, with snapshots in between. What comes late is
//! put in its place ([`Event::order`], a launch between receptions and roles): the snapshot before it is restored and all
//! that follows is handed over again. The belief is then that of everything in order, bit for bit, whatever the order in
//! which it came.
//!
//! A packet that was sent stays what it was: its launch is repeated for what it changes in the navigator, and the bytes of
//! the repetition are dropped. Where they differ from those on the air, the packet is counted
//! (`late_packets_outdated`). Packets that are complete in themselves (beliefs, displacements, soundings) are only less
//! informed then. Packets that build on earlier ones (`deif`, `mdeif`) take the late event for told: teammates learn of it
//! with what it changes from then on; they never count it twice.

mod window;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::settings::{Bound, Bounded, check_all};
use super::snapshot::{load, save};
use super::{Estimate, Navigator, Outcome, Particles, Profile, check_event};
use crate::error::Error;
use crate::event::{Event, Payload, VehicleId};
use window::{Step, Window};

/// What becomes of an event that is older than the navigator's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Late {
    /// It is an error, and changes nothing.
    #[default]
    Refuse,
    /// It takes its place, and what came after it is done again.
    Replay,
    /// A position, a range or a packet is used now, moved along and less certain by what has happened since; what else
    /// comes late is rejected and counted.
    Inflate,
}

/// How late events are taken up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelayedOptions {
    /// What becomes of them.
    pub late: Late,
    /// How old an event may be, s. An older one is rejected and counted.
    pub lag_s: f64,
}

/// Bounds of [`DelayedOptions`].
pub const BOUNDS: [Bounded; 1] = [("lag_s", Bound::between(0.1, 600.0, "0.1 to 600"))];

/// A navigator that takes late events.
pub struct Delayed<N> {
    own: VehicleId,
    inner: N,
    options: DelayedOptions,
    window: Window,
}

/// What a step gave.
enum Given {
    Outcome(Outcome),
    Packet(Option<Arc<[u8]>>),
}

impl<N: Navigator> Delayed<N> {
    /// A window around `inner`, the navigator of vehicle `own`, which has not been handed anything yet.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] for a lag outside its bound.
    pub fn new(inner: N, own: VehicleId, options: DelayedOptions) -> Result<Self, Error> {
        check_all(&BOUNDS, &[("lag_s", options.lag_s)])?;
        Ok(Self::around(inner, own, options))
    }

    /// With options that were checked.
    pub(super) fn around(inner: N, own: VehicleId, options: DelayedOptions) -> Self {
        Self { own, inner, options, window: Window::default() }
    }

    /// The navigator itself.
    pub fn inner(&self) -> &N {
        &self.inner
    }

    fn too_late(&mut self) -> Outcome {
        self.window.rejected = self.window.rejected.saturating_add(1);
        Outcome::Rejected
    }

    /// Hands an event over now, though it may be late; see [`Late::Inflate`].
    fn handle_now(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, None)?;
        let late_by = |newest_ns: Option<i64>| newest_ns.filter(|now_ns| event.t_ns < *now_ns);
        if late_by(self.window.newest_ns).is_none() {
            match self.inner.handle(event) {
                // A launch may have taken the navigator further than any event.
                Err(Error::FromThePast { now_ns, .. }) => self.window.newest_ns = Some(now_ns),
                given => {
                    let outcome = given?;
                    self.window.newest_ns = Some(event.t_ns);
                    return Ok(outcome);
                }
            }
        }
        let Some(now_ns) = late_by(self.window.newest_ns) else { return Ok(self.too_late()) };
        let payload = match &event.payload {
            Payload::Fix { position_m, covariance_m2 } => Payload::Usbl {
                measured_ns: event.t_ns,
                position_m: *position_m,
                covariance_m2: *covariance_m2,
            },
            Payload::Usbl { .. } | Payload::BeaconRange { .. } | Payload::Reception { .. } => {
                event.payload.clone()
            }
            _ => return Ok(self.too_late()),
        };
        let old = now_ns.saturating_sub(event.t_ns) > self.lag_ns();
        if old || !self.inner.profile().uses.contains(payload.kind()) {
            return Ok(self.too_late());
        }
        let mut moved = Event { t_ns: now_ns, vehicle: event.vehicle, payload };
        let outcome = match self.inner.handle(&moved) {
            Err(Error::FromThePast { now_ns, .. }) => {
                (moved.t_ns, self.window.newest_ns) = (now_ns, Some(now_ns));
                self.inner.handle(&moved)?
            }
            given => given?,
        };
        if outcome == Outcome::Fused {
            self.window.inflated = self.window.inflated.saturating_add(1);
        }
        Ok(outcome)
    }

    fn lag_ns(&self) -> i64 {
        // At most ten minutes.
        (self.options.lag_s * 1e9) as i64
    }

    /// Hands a step over, in its place.
    fn take(&mut self, step: Step) -> Result<Given, Error> {
        match self.window.place(&step) {
            None => self.append(step),
            Some(at) => self.insert(step, at),
        }
    }

    fn append(&mut self, mut step: Step) -> Result<Given, Error> {
        let wanted = self.window.wants_mark(step.t_ns(), self.lag_ns());
        let mark = wanted.then(|| self.inner.snapshot()).transpose()?;
        let given = hand_over(&mut self.inner, &mut step)?;
        self.window.push(step, mark, self.lag_ns());
        Ok(given)
    }

    /// Hands over a step before others that were handed over already; these follow again.
    fn insert(&mut self, mut step: Step, at: usize) -> Result<Given, Error> {
        let now = self.inner.snapshot()?;
        let Some((snapshot, between)) = self.window.before(at) else {
            return Err(Error::Snapshot("the window of late events has no beginning".into()));
        };
        self.inner.restore(snapshot)?;
        for earlier in between {
            hand_over_again(&mut self.inner, earlier);
        }
        let given = match hand_over(&mut self.inner, &mut step) {
            Ok(given) => given,
            Err(error) => {
                self.inner.restore(&now)?;
                return Err(error);
            }
        };
        let (later, lag_ns) = (self.window.cut(at), self.lag_ns());
        self.window.replayed = self.window.replayed.saturating_add(1);
        self.window.push(step, None, lag_ns);
        for mut step in later {
            // One snapshot less costs time, not the result.
            let wanted = self.window.wants_mark(step.t_ns(), lag_ns);
            let mark = if wanted { self.inner.snapshot().ok() } else { None };
            if hand_over_again(&mut self.inner, &mut step) {
                self.window.outdated = self.window.outdated.saturating_add(1);
            }
            self.window.push(step, mark, lag_ns);
        }
        Ok(given)
    }
}

fn hand_over<N: Navigator>(inner: &mut N, step: &mut Step) -> Result<Given, Error> {
    match step {
        Step::Event(event) => inner.handle(event).map(Given::Outcome),
        Step::Launch { tol_ns, capacity_bytes, sent, .. } => {
            let packet = inner.transmit(*tol_ns, *capacity_bytes)?;
            sent.clone_from(&packet);
            Ok(Given::Packet(packet))
        }
    }
}

/// True for a packet on the air that would be another one for the first time. What is refused in its place changes nothing,
/// as it would have in order.
fn hand_over_again<N: Navigator>(inner: &mut N, step: &mut Step) -> bool {
    match step {
        Step::Event(event) => {
            let _ = inner.handle(event);
            false
        }
        Step::Launch { tol_ns, capacity_bytes, sent, outdated } => {
            let packet = inner.transmit(*tol_ns, *capacity_bytes).unwrap_or(None);
            let newly = !*outdated && packet != *sent;
            *outdated |= newly;
            newly
        }
    }
}

impl<N: Navigator> Navigator for Delayed<N> {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        if self.options.late == Late::Refuse {
            return self.inner.handle(event);
        }
        if self.options.late == Late::Inflate {
            return self.handle_now(event);
        }
        check_event(event, self.own, None)?;
        if !self.window.reaches(event.t_ns, self.lag_ns()) {
            return Ok(self.too_late());
        }
        match self.take(Step::Event(event.clone()))? {
            Given::Outcome(outcome) => Ok(outcome),
            Given::Packet(_) => Ok(Outcome::Noted),
        }
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        if self.options.late != Late::Replay || !self.window.reaches(tol_ns, self.lag_ns()) {
            return self.inner.transmit(tol_ns, capacity_bytes);
        }
        match self.take(Step::Launch { tol_ns, capacity_bytes, sent: None, outdated: false })? {
            Given::Packet(packet) => Ok(packet),
            Given::Outcome(_) => Ok(None),
        }
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let mut estimate = self.inner.estimate(t_ns);
        estimate.rejected += self.window.rejected;
        estimate
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        if self.options.late == Late::Refuse {
            return self.inner.snapshot();
        }
        save(&(&self.window, self.inner.snapshot()?))
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        if self.options.late == Late::Refuse {
            return self.inner.restore(snapshot);
        }
        let (window, inner): (Window, Vec<u8>) = load(snapshot)?;
        window.check()?;
        self.inner.restore(&inner)?;
        self.window = window;
        Ok(())
    }

    fn profile(&self) -> Profile {
        self.inner.profile()
    }

    fn give_up_window(&mut self) -> Option<DelayedOptions> {
        let options = self.options;
        self.options.late = Late::Refuse;
        self.window = Window::default();
        (options.late != Late::Refuse).then_some(options)
    }

    fn information_nat(&self) -> f64 {
        self.inner.information_nat()
    }

    fn particles(&self) -> Option<Particles> {
        self.inner.particles()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut columns = self.inner.diagnostics();
        if self.options.late != Late::Refuse {
            let inflates = self.options.late == Late::Inflate;
            let used = if inflates { self.window.inflated } else { self.window.replayed };
            columns.push((if inflates { "late_inflated" } else { "late_replayed" }, used as f64));
            columns.push(("late_rejected", self.window.rejected as f64));
            columns.push(("late_packets_outdated", self.window.outdated as f64));
        }
        columns
    }
}
