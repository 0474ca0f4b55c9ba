//! MDEIF: the origin-state method (Walls & Eustice 2012, section 4), for teams of any size over a lossy channel.
//!
//! ```text
//! own sensors ─► server: local-only graph ─► packets            team filter: own state, each peer's newest node
//!            └──────────────────────────────────────────────────────▲                    ▲
//! packets ─► replica of the sender's graph ─► delta since its newest node held ──────────┤
//!        └─► travel time ─► range, used once, here, and never sent on ───────────────────┘
//! ```

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::joint_filter::{JointFilter, PeerUpdate};
use super::local::estimate;
use super::mdeif_counts::Counts;
pub use super::mdeif_options::MdeifOptions;
use super::range::Range;
use super::sensors::{LOCAL_SENSORS, check_local_event};
use super::server::{Launch, Server};
use crate::error::{Error, positive};
use crate::event::{Event, Kind, Payload, VehicleId, seconds};
use crate::information::graph_packet::GraphPacket;
use crate::information::replica::{JoinPlan, Method, Replica};
use crate::link::{AckBitmap, Admission, ReceiveWindow};
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Innovation, LastInnovation, Navigator, Outcome, Profile};
use crate::packet::graph::rounded::rounded_lags;
use crate::packet::graph::{GraphForm, GraphLink, GraphMessage};

/// What a client keeps of a peer whose packets it uses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct MdeifPeer {
    window: ReceiveWindow,
    replica: Replica,
    received: AckBitmap,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct MdeifState {
    server: Server,
    pub(super) joint_filter: JointFilter,
    /// By vehicle; of this one without use.
    peers: Vec<MdeifPeer>,
    rejected: u64,
    counts: Counts,
}

/// The navigator `mdeif`.
#[derive(Clone)]
pub struct Mdeif {
    own: VehicleId,
    /// By vehicle, whether it uses ranges.
    ranging: Vec<bool>,
    pub(super) options: MdeifOptions,
    sound_speed_mps: f64,
    pub(super) core: MdeifState,
}

impl Mdeif {
    /// A navigator for vehicle `own`; `ranging` says by vehicle whether it uses ranges. One that does not (a ship with
    /// GPS) still reads what packets acknowledge.
    ///
    /// # Errors
    /// [`Error::UnknownVehicle`], and options outside their bounds.
    pub fn new(
        own: VehicleId,
        ranging: &[bool],
        options: MdeifOptions,
        sound_speed_mps: f64,
    ) -> Result<Self, Error> {
        positive("sound_speed_mps", sound_speed_mps)?;
        options.lasting.validate()?;
        if usize::from(own) >= ranging.len() {
            return Err(Error::UnknownVehicle { vehicle: own, count: ranging.len() });
        }
        let mut clients = ranging.to_vec();
        clients[usize::from(own)] = false;
        let acknowledged = options.form.acknowledged();
        let peer = || -> Result<MdeifPeer, Error> {
            Ok(MdeifPeer {
                window: ReceiveWindow::new(),
                replica: Replica::new(options.form != GraphForm::F64),
                received: AckBitmap::new(acknowledged)?,
            })
        };
        let core = MdeifState {
            server: Server::new(options.local, &clients, acknowledged)?,
            joint_filter: JointFilter::new(options.local, options.lasting, ranging.len()),
            peers: ranging.iter().map(|_| peer()).collect::<Result<_, _>>()?,
            rejected: 0,
            counts: Counts::default(),
        };
        Ok(Self { own, ranging: ranging.to_vec(), options, sound_speed_mps, core })
    }

    fn uses_ranges(&self, vehicle: VehicleId) -> bool {
        self.ranging.get(usize::from(vehicle)).copied().unwrap_or(false)
    }

    /// Whether any teammate uses this vehicle's packets.
    fn has_clients(&self) -> bool {
        let own = usize::from(self.own);
        self.ranging.iter().enumerate().any(|(vehicle, ranging)| *ranging && vehicle != own)
    }

    fn process_noise(&self) -> f64 {
        let filter = &self.core.server.filter;
        filter.sensors.process_noise_m2_per_s3(filter.options())
    }

    fn link(&self, sender: VehicleId, tol_ns: i64) -> GraphLink {
        let bitmaps = if self.uses_ranges(sender) { self.ranging.len() - 1 } else { 0 };
        GraphLink { form: self.options.form, sender, tol_ns, bitmaps }
    }

    fn check_sender(&self, payload: &Payload) -> Result<(), Error> {
        match payload {
            Payload::Reception { sender, .. } if *sender == self.own => {
                Err(Error::WrongVehicle { event: *sender, own: self.own })
            }
            Payload::Reception { sender, .. } if usize::from(*sender) >= self.ranging.len() => {
                Err(Error::UnknownVehicle { vehicle: *sender, count: self.ranging.len() })
            }
            _ => Ok(()),
        }
    }

    fn reject(&mut self) -> Outcome {
        self.core.rejected += 1;
        Outcome::Rejected
    }

    /// Reads a packet; `None` when it does not decode or was seen before.
    fn read(&self, sender: VehicleId, tol_ns: i64, bytes: &[u8]) -> Option<(GraphMessage, Admission)> {
        let window = &self.core.peers.get(usize::from(sender))?.window;
        // Place of the bitmap about this vehicle among those about all but the sender.
        let place = usize::from(self.own) - usize::from(self.own > sender);
        let counter = |sequence| window.check(sequence, tol_ns).map_or(u64::from(sequence), |a| a.counter);
        let link = self.link(sender, tol_ns);
        let last_sent = self.core.server.sequencer.last();
        let mut message = GraphMessage::decode(bytes, &link, Some(place), last_sent, counter).ok()?;
        let admission = window.check(message.sequence, tol_ns).ok()?;
        if let Some(graph) = &mut message.graph
            && let Some(origin) = self.core.peers[usize::from(sender)].replica.origin_like(graph.origin)
        {
            graph.origin = origin;
        }
        Some((message, admission))
    }

    fn receive(
        &mut self,
        sender: VehicleId,
        tol_ns: i64,
        toa_ns: i64,
        bytes: &[u8],
    ) -> Result<Outcome, Error> {
        let Some((message, admission)) = self.read(sender, tol_ns, bytes) else {
            self.core.counts.unread += 1;
            return Ok(self.reject());
        };
        let outcome = match message.graph.as_ref().filter(|_| self.uses_ranges(self.own)) {
            Some(graph) => self.take(sender, graph, &message, tol_ns, toa_ns)?,
            None => Outcome::Noted,
        };
        if matches!(outcome, Outcome::Fused | Outcome::Noted) {
            let peer = &mut self.core.peers[usize::from(sender)];
            peer.window.commit(admission)?;
            if outcome == Outcome::Fused {
                peer.received.mark(admission.counter);
            }
            if let Some(bitmap) = message.bitmaps.first() {
                self.core.server.acknowledge(sender, bitmap);
            }
        }
        Ok(outcome)
    }

    /// Joins a packet's graph to the replica and its range to the team filter, both or none.
    fn take(
        &mut self,
        sender: VehicleId,
        graph: &GraphPacket,
        message: &GraphMessage,
        tol_ns: i64,
        toa_ns: i64,
    ) -> Result<Outcome, Error> {
        let own_depth_m = self.core.server.filter.sensors.depth_m();
        let (local, sound) = (&self.options.local, self.sound_speed_mps);
        let step_m = self.options.form.depth_step_m(message.depth_m);
        let range = Range::measured(tol_ns, toa_ns, sound, own_depth_m, message.depth_m, step_m, local);
        let Ok(range) = range else { return Ok(self.reject()) };
        let replica = &self.core.peers[usize::from(sender)].replica;
        let plan: JoinPlan = match replica.plan(graph, &self.options.methods) {
            Ok(Some(plan)) if plan.node.filtered.is_sound() => plan,
            unfit => {
                let counts = &mut self.core.counts;
                *(if matches!(unfit, Ok(None)) {
                    &mut counts.unknown_origin
                } else {
                    &mut counts.unsound
                }) += 1;
                return Ok(self.reject());
            }
        };
        let update = match plan.method {
            Method::Begun => PeerUpdate::First(plan.node.filtered),
            _ => PeerUpdate::Step(plan.step),
        };
        let q = self.process_noise();
        let outcome = match self.core.joint_filter.hear(sender, update, range, toa_ns, q) {
            Ok(Outcome::Fused) => Outcome::Fused,
            Ok(_) => {
                self.core.rejected += 1;
                return Ok(Outcome::Gated);
            }
            Err(_) => return Ok(self.reject()),
        };
        let counts = &mut self.core.counts;
        match plan.method {
            Method::Begun => counts.begun += 1,
            Method::ExactJoint => counts.exact_joint += 1,
            Method::Equation6 => counts.equation_6 += 1,
            Method::FilteredError => counts.filtered_error += 1,
        }
        self.core.peers[usize::from(sender)].replica.commit(&plan);
        Ok(outcome)
    }

    fn packet(&self, launch: &Launch) -> Result<Option<GraphPacket>, Error> {
        if !self.has_clients() {
            return Ok(None);
        }
        let server = &self.core.server;
        match self.options.form {
            GraphForm::F64 => server.exact_packet(launch, self.options.exact_lags).map(Some),
            form => {
                // Acknowledgements of teammates take the room that an exact lag would fill.
                let one_way = !self.uses_ranges(self.own);
                let room = form != GraphForm::Frame32 || one_way;
                let lags = if room { rounded_lags(form).min(self.options.exact_lags) } else { 0 };
                server.rounded_packet(launch, form, lags).map(Some)
            }
        }
    }
}

impl Navigator for Mdeif {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_local_event(event, self.own, self.core.server.filter.now_ns)?;
        self.core.joint_filter.innovation = LastInnovation::default();
        self.check_sender(&event.payload)?;
        if let Payload::Reception { sender, tol_ns, toa_ns, bytes } = &event.payload {
            let outcome = self.receive(*sender, *tol_ns, *toa_ns, bytes)?;
            self.core.server.filter.advance(event.t_ns);
            return Ok(outcome);
        }
        let mut server = self.core.server.clone();
        let (outcome, fused) = server.sense(event.t_ns, &event.payload)?;
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

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        let server = &self.core.server;
        server.check_launch(tol_ns)?;
        let Some(launch) = server.prepare(tol_ns) else { return Ok(None) };
        let graph = self.packet(&launch)?;
        let bitmaps = if self.uses_ranges(self.own) {
            let others = self.core.peers.iter().enumerate().filter(|(v, _)| *v != usize::from(self.own));
            others.map(|(_, peer)| peer.received).collect()
        } else {
            Vec::new()
        };
        let message = GraphMessage {
            sequence: server.sequencer.residue(),
            depth_m: server.filter.sensors.depth_m(),
            bitmaps,
            graph,
        };
        let bytes = message.encode(&self.link(self.own, tol_ns))?;
        if bytes.len() > capacity_bytes {
            return Err(Error::PacketTooLong { bytes: bytes.len(), capacity: capacity_bytes });
        }
        match &message.graph {
            Some(graph) => {
                let exact = self.options.form == GraphForm::F64;
                self.core.server.launch(&launch, (!exact).then_some(graph.node.filtered))?;
            }
            None => {
                self.core.server.sequencer.take()?;
            }
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
        let core: MdeifState = load(snapshot)?;
        if core.peers.len() != self.ranging.len() {
            return Err(Error::Snapshot("made with another team".into()));
        }
        self.core = core;
        Ok(())
    }

    fn profile(&self) -> Profile {
        let takes_ranges = self.uses_ranges(self.own);
        // One that uses no ranges still reads what packets acknowledge.
        let uses = LOCAL_SENSORS.with(Kind::Reception, true);
        Profile { takes_ranges, has_checksum: true, needs_delivery_oracle: false, uses }
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let MdeifState { server, counts, .. } = &self.core;
        let now_ns = server.filter.now_ns.unwrap_or(0);
        let age = server.origin().map_or(f64::NAN, |node| seconds(now_ns.saturating_sub(node.tol_ns)));
        let graph = [
            ("origin_age_s", age),
            ("origin_correlation", server.origin_correlation(now_ns)),
            ("graph_nodes", server.chain().nodes().len() as f64),
        ];
        let day = self.core.joint_filter.lasting_by_name();
        graph.into_iter().chain(day).chain(counts.by_name()).collect()
    }
}
