//! One joint filter of the own state and each peer's newest node, which can go back to a time of arrival.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::lasting::{Lasting, LastingOptions};
use super::local::{self, Fused, predicted, start};
use super::local_options::LocalOptions;
use super::range::Range;
use crate::error::Error;
use crate::event::{VehicleId, seconds};
use crate::information::{Gaussian, GraphStep, Joint, NODE, NodeVector, process};
use crate::navigator::{LastInnovation, Outcome};

/// How far back an arrival may lie, ns: the longest air time of a packet, with room.
const MEMORY_NS: i64 = 30_000_000_000;
/// Copies of the joint are kept this far apart, ns.
const COPIES_NS: i64 = 5_000_000_000;
/// Measurements remembered at most.
const MEASUREMENTS_MAX: usize = 4096;

/// The joint at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Moment {
    t_ns: i64,
    joint: Joint,
    /// Node of this vehicle; none before its first fix.
    own: Option<usize>,
    /// Whether the own vehicle moves by odometry.
    moves: bool,
    /// Node of each vehicle's newest launch that is known.
    peers: Vec<Option<usize>>,
    /// Errors that last.
    lasting: Lasting,
}

/// What happened to the joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Change {
    Own(local::Change),
    Heard(Box<HeardPacket>),
}

/// A packet that was accepted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct HeardPacket {
    peer: VehicleId,
    update: PeerUpdate,
    range: Option<Range>,
}

/// The update of a peer's newest node that a packet holds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "one for each packet, and mostly the larger variant")]
pub enum PeerUpdate {
    /// The peer was not known before.
    First(Gaussian<NODE>),
    /// From the newest node that is known to the packet's.
    Step(GraphStep),
}

/// The own state and every peer's newest node, jointly: 4N numbers, whatever the length of the mission.
///
/// A range lies between the sender's node at launch and this vehicle at arrival, but is available only when its
/// packet is decoded, seconds later. So the filter stores the last 30 s, goes back to the arrival, fuses the range
/// there and repeats the later updates: the result is that of the correct order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointFilter {
    options: LocalOptions,
    lasting: LastingOptions,
    now: Moment,
    /// Moments before all changes at or after their time, oldest first.
    copies: VecDeque<Moment>,
    /// Changes since the oldest copy, with their times and the process noise that led to them.
    changes: VecDeque<(i64, f64, Change)>,
    /// Of the event that is being handled.
    #[serde(skip)]
    pub innovation: LastInnovation,
}

impl Moment {
    /// Predicts the own node to `t_ns`.
    fn advance(&mut self, t_ns: i64, q_m2_per_s3: f64) {
        let dt_s = seconds(t_ns.saturating_sub(self.t_ns));
        if let (Some(own), true) = (self.own, dt_s > 0.0 && !self.moves) {
            let (f, q) =
                (process::transition(dt_s), process::noise(dt_s, q_m2_per_s3 * self.lasting.scale.motion));
            self.joint.propagate(own, &f, &NodeVector::zeros(), &q);
        }
        self.t_ns = self.t_ns.max(t_ns);
    }

    /// Applies a change at its time; ranges beyond `gate_sigmas` are gated, and then nothing has changed. `last` takes how
    /// a range fitted.
    fn apply(
        &mut self,
        change: &Change,
        (options, lasting): (&LocalOptions, &LastingOptions),
        gate_sigmas: f64,
        last: &mut LastInnovation,
    ) -> Result<Outcome, Error> {
        match change {
            Change::Own(local::Change::Start(linear)) => {
                self.own = Some(self.joint.push(&start(linear, options)))
            }
            Change::Own(local::Change::Sensed(linear)) => {
                let Some(own) = self.own else { return Ok(Outcome::Noted) };
                let innovation =
                    self.joint.pair_innovation(own, linear.first(), &linear.value, &linear.noise).ok_or(
                        Error::NotPositiveDefinite { quantity: "innovation covariance of the own sensors" },
                    )?;
                self.joint.fuse(&innovation)?;
            }
            Change::Own(local::Change::Moved(movement)) => {
                self.moves = true;
                let Some(own) = self.own else { return Ok(Outcome::Noted) };
                let step = movement.step(&self.joint.node_mean(own));
                let noise = step.noise_scaled(self.lasting.scale.motion);
                self.joint.propagate(own, &step.transition, &step.offset, &noise);
                self.lasting.turn(&mut self.joint, own, self.t_ns, options.sigma_gyro_bias_radps);
            }
            Change::Heard(heard) => {
                return self.hear(heard, lasting, gate_sigmas, last);
            }
        }
        Ok(Outcome::Fused)
    }

    fn hear(
        &mut self,
        heard: &HeardPacket,
        options: &LastingOptions,
        gate_sigmas: f64,
        last: &mut LastInnovation,
    ) -> Result<Outcome, Error> {
        let HeardPacket { peer, update, range } = heard;
        let (mut joint, mut lasting) = (self.joint.clone(), self.lasting.clone());
        let count = self.peers.len();
        let slot =
            self.peers.get_mut(usize::from(*peer)).ok_or(Error::UnknownVehicle { vehicle: *peer, count })?;
        let node = match (update, *slot) {
            (PeerUpdate::Step(step), Some(node)) => {
                step.apply_to(&mut joint, node)?;
                node
            }
            (PeerUpdate::First(gaussian), None) => joint.push(gaussian),
            (PeerUpdate::Step(_), None) | (PeerUpdate::First(_), Some(_)) => {
                return Err(Error::External("a peer's packet does not follow what is known of it".into()));
            }
        };
        if !joint.is_sound() {
            return Err(Error::NotPositiveDefinite { quantity: "a peer's node" });
        }
        if let (Some(range), Some(own)) = (range, self.own) {
            let error = lasting.range_error(&mut joint, usize::from(*peer), self.t_ns, options);
            let scale = lasting.scale.range;
            let (outcome, seen) =
                range.fuse_with_error(&mut joint, (node, own), error, (scale, gate_sigmas), last);
            if let Some(seen) = seen {
                lasting.scale.learn(&seen, options);
                self.lasting.scale = lasting.scale;
            }
            if outcome != Outcome::Fused {
                return Ok(outcome);
            }
        }
        *slot = Some(node);
        (self.joint, self.lasting) = (joint, lasting);
        Ok(Outcome::Fused)
    }
}

impl JointFilter {
    /// A filter of a vehicle in a team of `vehicles`.
    #[must_use]
    pub fn new(options: LocalOptions, lasting: LastingOptions, vehicles: usize) -> Self {
        let now = Moment {
            t_ns: i64::MIN,
            joint: Joint::new(),
            own: None,
            moves: false,
            peers: vec![None; vehicles],
            lasting: Lasting::new(vehicles),
        };
        let innovation = LastInnovation::default();
        Self { options, lasting, now, copies: VecDeque::new(), changes: VecDeque::new(), innovation }
    }

    /// Repeats what the local filter fused at `t_ns`.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`]; nothing has changed then.
    pub fn sense(&mut self, t_ns: i64, fused: &Fused) -> Result<(), Error> {
        let change = Change::Own(fused.change);
        let q = fused.q_m2_per_s3;
        let mut next = self.now.clone();
        next.advance(t_ns, q);
        let copy = next.clone();
        let mut none = LastInnovation::default();
        next.apply(&change, (&self.options, &self.lasting), f64::INFINITY, &mut none)?;
        self.remember(copy, t_ns, q, change);
        self.now = next;
        Ok(())
    }

    /// Stores a change, at intervals with a copy of the joint before it, and drops what is older than the window.
    fn remember(&mut self, before: Moment, t_ns: i64, q: f64, change: Change) {
        if self.copies.back().is_none_or(|copy| t_ns.saturating_sub(copy.t_ns) >= COPIES_NS) {
            self.copies.push_back(before);
        }
        self.changes.push_back((t_ns, q, change));
        let horizon_ns = t_ns.saturating_sub(MEMORY_NS);
        while self.copies.get(1).is_some_and(|copy| {
            copy.t_ns <= horizon_ns || (self.changes.len() > MEASUREMENTS_MAX && self.copies.len() > 2)
        }) {
            self.copies.pop_front();
            let oldest_ns = self.copies.front().map_or(i64::MIN, |copy| copy.t_ns);
            while self.changes.front().is_some_and(|(at_ns, _, _)| *at_ns < oldest_ns) {
                self.changes.pop_front();
            }
        }
    }

    /// Fuses a packet's node and its range at `toa_ns`, `q_m2_per_s3` being the process noise until then and since. A
    /// range older than the window is left out. Gated: nothing has changed but what is
    /// known of the noise.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] for a node that cannot be fused; nothing has changed then.
    pub fn hear(
        &mut self,
        peer: VehicleId,
        update: PeerUpdate,
        range: Option<Range>,
        toa_ns: i64,
        q_m2_per_s3: f64,
    ) -> Result<Outcome, Error> {
        let gate = self.options.gate_sigmas;
        let last_ns = self.changes.back().map_or(i64::MIN, |(at_ns, _, _)| *at_ns);
        if last_ns <= toa_ns {
            let change = Change::Heard(Box::new(HeardPacket { peer, update, range }));
            let mut next = self.now.clone();
            next.advance(toa_ns, q_m2_per_s3);
            let copy = next.clone();
            let outcome = next.apply(&change, (&self.options, &self.lasting), gate, &mut self.innovation)?;
            if outcome == Outcome::Fused {
                self.remember(copy, toa_ns, q_m2_per_s3, change);
                self.now = next;
            } else {
                self.now.lasting.scale = next.lasting.scale;
            }
            return Ok(outcome);
        }
        let Some(place) = self.copies.iter().rposition(|copy| copy.t_ns <= toa_ns) else {
            return self.hear(peer, update, None, last_ns, q_m2_per_s3);
        };
        self.insert(place, Change::Heard(Box::new(HeardPacket { peer, update, range })), toa_ns)
    }

    /// Goes back to the copy at `place`, fuses the change at its time and repeats what came after.
    fn insert(&mut self, place: usize, change: Change, toa_ns: i64) -> Result<Outcome, Error> {
        let mut rebuilt = self.clone();
        rebuilt.copies.truncate(place + 1);
        let Some(mut moment) = rebuilt.copies.pop_back() else { return Ok(Outcome::Gated) };
        let first = rebuilt.changes.partition_point(|(at_ns, _, _)| *at_ns < moment.t_ns);
        let mut later: Vec<(i64, f64, Change)> = rebuilt.changes.drain(first..).collect();
        let at = later.partition_point(|(at_ns, _, _)| *at_ns <= toa_ns);
        // What led to the next measurement led to the arrival as well.
        let q = later.get(at).map_or(self.options.process_noise_m2_per_s3, |(_, q, _)| *q);
        later.insert(at, (toa_ns, q, change));
        for (index, (t_ns, q, change)) in later.into_iter().enumerate() {
            moment.advance(t_ns, q);
            let before = moment.clone();
            let gate = if index == at { self.options.gate_sigmas } else { f64::INFINITY };
            let mut last = LastInnovation::default();
            let outcome = moment.apply(&change, (&self.options, &self.lasting), gate, &mut last)?;
            if index == at {
                self.innovation = last;
                rebuilt.innovation = last;
            }
            if index == at && outcome != Outcome::Fused {
                return Ok(outcome);
            }
            rebuilt.remember(before, t_ns, q, change);
        }
        rebuilt.now = moment;
        *self = rebuilt;
        Ok(Outcome::Fused)
    }

    /// The own node predicted to `t_ns`, without changing anything.
    #[must_use]
    pub fn own_at(&self, t_ns: i64, q_m2_per_s3: f64) -> Option<Gaussian<NODE>> {
        let own = self.now.own?;
        let node = self.now.joint.marginal(own);
        if self.now.moves {
            return Some(node);
        }
        Some(predicted(&node, seconds(t_ns.saturating_sub(self.now.t_ns)), q_m2_per_s3))
    }

    /// A peer's newest node, as the joint has it.
    #[must_use]
    pub fn peer(&self, peer: VehicleId) -> Option<Gaussian<NODE>> {
        let node = (*self.now.peers.get(usize::from(peer))?)?;
        Some(self.now.joint.marginal(node))
    }

    /// What [`Joint::log_evidence`] of the newest joint says.
    #[must_use]
    pub fn log_evidence(&self) -> f64 {
        self.now.joint.log_evidence()
    }

    /// Noise of the day and errors that last, each with its name in the diagnostics.
    #[must_use]
    pub fn lasting_by_name(&self) -> [(&'static str, f64); 4] {
        self.now.lasting.by_name(&self.now.joint)
    }

    /// Nodes in the joint.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.now.joint.nodes()
    }
}
