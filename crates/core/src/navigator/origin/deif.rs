//! DEIF: delta information from one node to the next (Webster et al. 2010; Walls & Eustice 2012, section 3).
//!
//! As published, the server must know which packets arrive: a client cannot use a delta since a node that it lacks.
//! `deif-redundant` repeats the last deltas in each packet instead; if more packets are lost in a row, the client can
//! use none of the later ones.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::joint_filter::{JointFilter, PeerUpdate};
use super::lasting::LastingOptions;
use super::local::estimate;
use super::local_options::LocalOptions;
use super::range::Range;
use super::sensors::{LOCAL_SENSORS, check_local_event};
use super::server::{Launch, Server};
use crate::error::{Error, positive};
use crate::event::{Event, Kind, Payload, VehicleId};
use crate::information::{Gaussian, GraphStep, NODE};
use crate::link::ReceiveWindow;
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Innovation, LastInnovation, Navigator, Outcome, Profile};
use crate::packet::PacketError;
use crate::packet::graph::DeltaMessage;

/// How a client gets the deltas of lost packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Repair {
    /// The server knows which packets arrived, and sends the delta since the last of them.
    Oracle,
    /// Each packet holds so many deltas.
    Repeat(usize),
}

/// A server's newest node at the client: its counter, and the server's own belief about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct DeifPeer {
    window: ReceiveWindow,
    newest: Option<(u64, Gaussian<NODE>)>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct DeifState {
    server: Server,
    /// The launch that the client is known to hold.
    delivered: Option<u64>,
    joint_filter: JointFilter,
    peers: Vec<DeifPeer>,
    rejected: u64,
    missed: u64,
}

/// The navigators `deif` and `deif-redundant`.
pub struct Deif {
    own: VehicleId,
    ranging: Vec<bool>,
    options: LocalOptions,
    repair: Repair,
    sound_speed_mps: f64,
    core: DeifState,
}

impl Deif {
    /// A navigator for vehicle `own`; `ranging` says by vehicle whether it uses ranges.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] unless exactly one vehicle does: the method is one-way. [`Error::UnknownVehicle`], and options
    /// outside their bounds.
    pub fn new(
        own: VehicleId,
        ranging: &[bool],
        options: LocalOptions,
        repair: Repair,
        sound_speed_mps: f64,
    ) -> Result<Self, Error> {
        positive("sound_speed_mps", sound_speed_mps)?;
        if usize::from(own) >= ranging.len() {
            return Err(Error::UnknownVehicle { vehicle: own, count: ranging.len() });
        }
        let clients = ranging.iter().filter(|ranging| **ranging).count();
        if clients != 1 {
            return Err(Error::OutOfBound {
                quantity: "vehicles that fuse ranges (the DEIF is one-way: fuses_ranges = false for all others)",
                value: clients as f64,
                bound: "1",
            });
        }
        let peer = || DeifPeer { window: ReceiveWindow::new(), newest: None };
        let core = DeifState {
            server: Server::new(options, &vec![false; ranging.len()], 1)?,
            delivered: None,
            joint_filter: JointFilter::new(options, LastingOptions::NONE, ranging.len()),
            peers: ranging.iter().map(|_| peer()).collect(),
            rejected: 0,
            missed: 0,
        };
        Ok(Self { own, ranging: ranging.to_vec(), options, repair, sound_speed_mps, core })
    }

    fn is_client(&self) -> bool {
        self.ranging[usize::from(self.own)]
    }

    fn process_noise(&self) -> f64 {
        self.core.server.filter.sensors.process_noise_m2_per_s3(&self.options)
    }

    fn reject(&mut self) -> Outcome {
        self.core.rejected += 1;
        Outcome::Rejected
    }

    /// The packet of a launch: deltas back to what the client holds, or as many as a packet repeats.
    fn message(&self, launch: &Launch) -> Result<DeltaMessage, Error> {
        let server = &self.core.server;
        let id = launch.node.id;
        let mut message = DeltaMessage {
            sequence: server.sequencer.residue(),
            depth_m: server.filter.sensors.depth_m(),
            base_age: 0,
            first: None,
            deltas: Vec::new(),
        };
        match self.repair {
            Repair::Oracle => match self.core.delivered {
                Some(base) => {
                    let age = id.saturating_sub(base);
                    message.base_age = u8::try_from(age).map_err(|_| PacketError::TooManyBits {
                        field: "transmissions since the last one that arrived",
                        value: age,
                        bits: 8,
                        maximum: 255,
                    })?;
                    if let Some(step) = server.step_from(launch, base)? {
                        message.deltas.push(step.information()?);
                    }
                }
                None => message.first = Some(launch.node.filtered.information()?),
            },
            Repair::Repeat(repeats) => {
                message.base_age = u8::from(id > 0);
                let nodes = server.chain().nodes();
                if let Some(last) = nodes.last()
                    && let Some(step) = server.step_from(launch, last.id)?
                {
                    message.deltas.push(step.information()?);
                }
                for later in (1..nodes.len()).rev().take(repeats - 1) {
                    message.deltas.push(server.chain().between(later - 1, later)?.information()?);
                }
                if id < repeats as u64 {
                    let first = nodes.first().unwrap_or(&launch.node);
                    message.first = Some(first.filtered.information()?);
                }
            }
        }
        Ok(message)
    }

    /// From the newest node held to the packet's, or the first one; `None` when deltas in between are missing.
    fn peer_update(
        &self,
        sender: VehicleId,
        counter: u64,
        message: &DeltaMessage,
    ) -> Result<Option<(PeerUpdate, Gaussian<NODE>)>, Error> {
        let (start, begun, missing) = match self.core.peers[usize::from(sender)].newest {
            Some((held, gaussian)) => {
                let age = counter.saturating_sub(held);
                let steps = if u64::from(message.base_age) == age { 1 } else { age as usize };
                if steps > 1 && message.base_age != 1 {
                    return Ok(None);
                }
                (gaussian, false, steps)
            }
            None => match &message.first {
                Some(first) => (first.gaussian()?, true, message.deltas.len()),
                None => return Ok(None),
            },
        };
        let Some(deltas) = message.deltas.get(..missing) else { return Ok(None) };
        let (mut all, mut node) = (GraphStep::identity(), start);
        for delta in deltas.iter().rev() {
            let step = GraphStep::from_information(delta, &node)?;
            node = step.apply(&node)?;
            if !node.is_sound() {
                return Err(Error::NotPositiveDefinite { quantity: "a server's node" });
            }
            all = all.then(&step)?;
        }
        Ok(Some((if begun { PeerUpdate::First(node) } else { PeerUpdate::Step(all) }, node)))
    }

    fn receive(
        &mut self,
        sender: VehicleId,
        tol_ns: i64,
        toa_ns: i64,
        bytes: &[u8],
    ) -> Result<Outcome, Error> {
        let window = &self.core.peers[usize::from(sender)].window;
        let Ok(message) = DeltaMessage::decode(bytes, sender, tol_ns) else { return Ok(self.reject()) };
        let Ok(admission) = window.check(message.sequence, tol_ns) else { return Ok(self.reject()) };
        if window.newest().is_some_and(|newest| newest.tol_ns >= tol_ns) {
            return Ok(self.reject());
        }
        if !self.is_client() {
            return Ok(Outcome::Noted);
        }
        let depth_m = self.core.server.filter.sensors.depth_m();
        // The packet holds the sender's depth in float64: no step.
        let (sound, sender_m) = (self.sound_speed_mps, message.depth_m);
        let range = Range::measured(tol_ns, toa_ns, sound, depth_m, sender_m, 0.0, &self.options);
        let Ok(range) = range else { return Ok(self.reject()) };
        let (update, node) = match self.peer_update(sender, admission.counter, &message) {
            Ok(Some(found)) => found,
            Ok(None) => {
                self.core.missed += 1;
                return Ok(self.reject());
            }
            Err(_) => return Ok(self.reject()),
        };
        match self.core.joint_filter.hear(sender, update, range, toa_ns, self.process_noise()) {
            Ok(Outcome::Fused) => {}
            Ok(_) => {
                // The server takes a packet that arrived for one that is held: its delta must not be lost with the range.
                let held = self.core.joint_filter.hear(sender, update, None, toa_ns, self.process_noise());
                if held != Ok(Outcome::Fused) {
                    return Ok(self.reject());
                }
                self.core.rejected += 1;
            }
            Err(_) => return Ok(self.reject()),
        }
        let peer = &mut self.core.peers[usize::from(sender)];
        peer.window.commit(admission)?;
        peer.newest = Some((admission.counter, node));
        Ok(Outcome::Fused)
    }

    /// A packet arrived at the client (delivery oracle).
    fn delivered(&mut self, tol_ns: i64, to: VehicleId) -> Outcome {
        let nodes = self.core.server.chain().nodes();
        let node = nodes.iter().find(|node| node.tol_ns == tol_ns).map(|node| node.id);
        let Some(id) = node.filter(|_| self.ranging.get(usize::from(to)) == Some(&true)) else {
            return Outcome::Noted;
        };
        self.core.delivered = Some(id);
        self.core.server.forget_before(id);
        Outcome::Noted
    }
}

impl Navigator for Deif {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_local_event(event, self.own, self.core.server.filter.now_ns)?;
        self.core.server.filter.odometer.check_heading(&event.payload)?;
        self.core.joint_filter.innovation = LastInnovation::default();
        match &event.payload {
            Payload::Reception { sender, .. } if *sender == self.own => {
                Err(Error::WrongVehicle { event: *sender, own: self.own })
            }
            Payload::Reception { sender, .. } if usize::from(*sender) >= self.ranging.len() => {
                Err(Error::UnknownVehicle { vehicle: *sender, count: self.ranging.len() })
            }
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                let outcome = self.receive(*sender, *tol_ns, *toa_ns, bytes)?;
                self.core.server.filter.advance(event.t_ns);
                Ok(outcome)
            }
            Payload::Delivered { tol_ns, to } => {
                self.core.server.filter.advance(event.t_ns);
                Ok(self.delivered(*tol_ns, *to))
            }
            payload => {
                let mut server = self.core.server.clone();
                let (outcome, fused) = server.sense(event.t_ns, payload)?;
                if let Some(fused) = fused
                    && self.core.joint_filter.sense(event.t_ns, &fused).is_err()
                {
                    // A measurement that the joint filter refuses is not fused by the filter of the own node either.
                    self.core.server.filter.advance(event.t_ns);
                    self.core.rejected += 1;
                    return Ok(Outcome::Gated);
                }
                self.core.server = server;
                Ok(outcome)
            }
        }
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        let server = &self.core.server;
        server.check_launch(tol_ns)?;
        if self.is_client() {
            return Ok(None);
        }
        let Some(launch) = server.prepare(tol_ns) else { return Ok(None) };
        let bytes = self.message(&launch)?.encode(self.own, tol_ns)?;
        if bytes.len() > capacity_bytes {
            return Err(Error::PacketTooLong { bytes: bytes.len(), capacity: capacity_bytes });
        }
        let server = &mut self.core.server;
        server.launch(&launch, None)?;
        if let Repair::Repeat(repeats) = self.repair {
            server.forget_before((launch.node.id + 1).saturating_sub(repeats as u64));
        }
        Ok(Some(bytes.into()))
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let node = self.core.joint_filter.own_at(t_ns, self.process_noise());
        estimate(node.as_ref(), t_ns, self.core.rejected + self.core.server.filter.rejected)
    }

    fn innovation(&self) -> Option<Innovation> {
        self.core.joint_filter.innovation.0
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.core)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let core: DeifState = load(snapshot)?;
        if core.peers.len() != self.ranging.len() {
            return Err(Error::Snapshot("made with another team".into()));
        }
        self.core = core;
        Ok(())
    }

    fn profile(&self) -> Profile {
        let (takes_ranges, oracle) = (self.is_client(), self.repair == Repair::Oracle);
        let uses = LOCAL_SENSORS.with(Kind::Reception, takes_ranges).with(Kind::Delivered, oracle);
        Profile { takes_ranges, has_checksum: true, needs_delivery_oracle: oracle, uses }
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("graph_nodes", self.core.server.chain().nodes().len() as f64),
            ("missed_deltas", self.core.missed as f64),
        ]
    }
}
