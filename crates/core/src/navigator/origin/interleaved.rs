//! Interleaved update (Bahr, Walter & Leonard 2009): a bank of filters with a table of origins.
//!
//! ```text
//! own bank     { 1 } own sensors alone      { 1, 2 } with vehicle 2's      { 1, 2, 3 } …
//! heard bank   { 2 }                        { 2, 3 }                       { 1, 2 } has own information: not fused
//! ```
//!
//! A filter of the bank is made from the sensors of its origins only. A range joins an own filter and a heard belief
//! only if no vehicle is an origin of both: they are uncorrelated then, whatever was exchanged before. The result
//! replaces the own filter of the joined origins where it has the smaller covariance. So a second range to the same
//! teammate never adds to the first: it is fused with a filter that does not contain that teammate. Conservative,
//! never overconfident.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::graph::{Graph, NodeChange};
use super::local::estimate;
use super::local_options::LocalOptions;
use super::odometry::OdometryStep;
use super::range::Range;
use super::sensors::{LOCAL_SENSORS, check_local_event};
use crate::error::{Error, positive};
use crate::event::{Event, Kind, Payload, VehicleId};
use crate::information::{Gaussian, Joint, NODE, NodeMatrix, NodeVector};
use crate::link::{Admission, ReceiveWindow, Sequencer};
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Navigator, Outcome, Profile};
use crate::packet::{BankPacket, Belief, Header, HeardBitmap, Member, Origins, PacketKind};

/// Teams larger than this would need banks of more than 128 filters.
pub const TEAM_MOST: usize = 8;

/// What the interleaved update is configured with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct InterleavedOptions {
    /// How motion, sensors and ranges are modelled.
    pub local: LocalOptions,
    /// Whether this vehicle uses ranges.
    pub ranging: bool,
}

/// The only vehicle of its graph.
const ALONE: usize = 0;

/// A navigator with a bank of filters over its own node.
pub struct Interleaved {
    own: VehicleId,
    options: InterleavedOptions,
    sound_speed_mps: f64,
    core: InterleavedState,
}

/// A filter that contains data of other vehicles' sensors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Helped {
    origins: Origins,
    node: Gaussian<NODE>,
}

#[derive(Clone, Serialize, Deserialize)]
struct InterleavedState {
    /// Own sensors alone.
    graph: Graph,
    /// Stamp of the last event, ns.
    last_ns: Option<i64>,
    alone: Origins,
    bank: Vec<Helped>,
    sequencer: Sequencer,
    windows: Vec<ReceiveWindow>,
    heard: HeardBitmap,
}

impl Interleaved {
    /// For vehicle `own` in a team of `vehicles`, [`TEAM_MOST`] at most.
    ///
    /// # Errors
    /// Options that cannot be; an unknown vehicle; a team that is too large.
    pub fn new(
        own: VehicleId,
        vehicles: usize,
        options: InterleavedOptions,
        sound_speed_mps: f64,
    ) -> Result<Self, Error> {
        positive("sound_speed_mps", sound_speed_mps)?;
        options.local.validate()?;
        if usize::from(own) >= vehicles {
            return Err(Error::UnknownVehicle { vehicle: own, count: vehicles });
        }
        if vehicles > TEAM_MOST {
            return Err(Error::OutOfBound {
                quantity: "vehicles in a team with interleaved update",
                value: vehicles as f64,
                bound: "1 to 8: a bank has a filter for every set of vehicles",
            });
        }
        let core = InterleavedState {
            graph: Graph::new(1, options.local),
            last_ns: None,
            alone: Origins::of(own)?,
            bank: Vec::new(),
            sequencer: Sequencer::default(),
            windows: (0..vehicles).map(|_| ReceiveWindow::new()).collect(),
            heard: HeardBitmap::default(),
        };
        Ok(Self { own, options, sound_speed_mps, core })
    }

    fn check_sender(&self, payload: &Payload) -> Result<(), Error> {
        match payload {
            Payload::Reception { sender, .. } if *sender == self.own => {
                Err(Error::WrongVehicle { event: *sender, own: self.own })
            }
            Payload::Reception { sender, .. } if usize::from(*sender) >= self.core.windows.len() => {
                Err(Error::UnknownVehicle { vehicle: *sender, count: self.core.windows.len() })
            }
            _ => Ok(()),
        }
    }

    /// Own sensors are fused in every filter: the vehicle is an origin of all.
    fn sense(&mut self, t_ns: i64, payload: &Payload) -> Outcome {
        if !matches!(payload, Payload::Heading { .. } | Payload::Depth { .. }) {
            self.advance(t_ns);
        }
        let (outcome, change) = self.core.graph.sense_with_change(ALONE, t_ns, payload);
        match change {
            NodeChange::Nothing => {}
            // A filter that cannot take it is lost: the one alone never is.
            NodeChange::Linear(linear) => self.core.bank.retain_mut(|helped| {
                helped.node.update(&linear.observe(), &linear.value, &linear.noise).is_ok()
            }),
            NodeChange::Moved(step) => self.move_bank(&step),
        }
        outcome
    }

    fn advance(&mut self, t_ns: i64) {
        if self.core.graph.now_ns(ALONE).is_some_and(|now_ns| t_ns > now_ns) {
            self.move_bank(&self.core.graph.drift(ALONE, t_ns));
        }
        self.core.graph.advance(ALONE, t_ns);
    }

    fn move_bank(&mut self, step: &OdometryStep) {
        for helped in &mut self.core.bank {
            helped.node = step.applied(&helped.node);
        }
    }

    fn hear(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Outcome {
        let Ok(packet) = BankPacket::decode(bytes, sender, tol_ns) else { return self.reject() };
        let from = usize::from(sender);
        let mut heard = self.core.heard;
        let admission = self.core.windows[from].check(packet.header.sequence, tol_ns);
        let (Ok(()), Ok(admission)) = (heard.insert(sender), admission) else { return self.reject() };
        if !self.options.ranging {
            return self.admit(from, admission, heard, Outcome::Noted);
        }
        let graph = &self.core.graph;
        let range = graph.measured(ALONE, (tol_ns, toa_ns), packet.header.depth_m, self.sound_speed_mps);
        let (Some(range), Some(_)) = (range, graph.current(ALONE)) else { return self.reject() };
        self.advance(toa_ns);
        let graph = &self.core.graph;
        let late_s = graph.late_s(ALONE, toa_ns);
        let (back, forth) = (graph.coast(ALONE, -late_s), graph.coast(ALONE, late_s));
        let Some(alone) = graph.current(ALONE) else { return self.reject() };
        let own = Helped { origins: self.core.alone, node: alone };
        let filters: Vec<Helped> = std::iter::once(own).chain(self.core.bank.iter().copied()).collect();
        let mut better = false;
        for filter in &filters {
            for member in packet.members.iter().filter(|m| m.origins.disjoint(filter.origins)) {
                if let Some(joined) =
                    join(filter, member, &range, (&back, &forth), self.options.local.gate_sigmas)
                {
                    better |= self.offer(joined);
                }
            }
        }
        self.admit(from, admission, heard, if better { Outcome::Fused } else { Outcome::Noted })
    }

    /// Records a received packet, after all checks.
    fn admit(&mut self, from: usize, admission: Admission, heard: HeardBitmap, outcome: Outcome) -> Outcome {
        if self.core.windows[from].commit(admission).is_err() {
            return self.reject();
        }
        self.core.heard = heard;
        outcome
    }

    /// Keeps a filter if its covariance is smaller than that of the filter with the same origins.
    fn offer(&mut self, joined: Helped) -> bool {
        match self.core.bank.iter_mut().find(|helped| helped.origins == joined.origins) {
            Some(have) if trace(&joined.node) < trace(&have.node) => *have = joined,
            Some(_) => return false,
            None => self.core.bank.push(joined),
        }
        true
    }

    fn reject(&mut self) -> Outcome {
        self.core.graph.reject(ALONE);
        Outcome::Rejected
    }

    /// The filter with the smallest covariance.
    fn best(&self) -> Option<Helped> {
        let alone = self.core.graph.current(ALONE).map(|node| Helped { origins: self.core.alone, node });
        let all = alone.into_iter().chain(self.core.bank.iter().copied());
        all.min_by(|a, b| trace(&a.node).total_cmp(&trace(&b.node)))
    }

    fn ahead(&self, node: &Gaussian<NODE>, t_ns: i64) -> Gaussian<NODE> {
        self.core.graph.drift(ALONE, t_ns).applied(node)
    }
}

/// Trace of the position's covariance, m².
fn trace(node: &Gaussian<NODE>) -> f64 {
    node.covariance[(0, 0)] + node.covariance[(1, 1)]
}

/// An own filter and a heard belief of other origins, joined by a range; `None` where it is gated.
fn join(
    filter: &Helped,
    member: &Member,
    range: &Range,
    (back, forth): (&OdometryStep, &OdometryStep),
    gate_sigmas: f64,
) -> Option<Helped> {
    let mut sender = Gaussian { mean: NodeVector::zeros(), covariance: NodeMatrix::zeros() };
    sender.mean.fixed_rows_mut::<2>(0).copy_from(&member.belief.mean_m);
    sender.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&member.belief.covariance_m2);
    let mut joint = Joint::new();
    let own = joint.push(&back.applied(&filter.node));
    let sender = joint.push(&sender);
    let fused = range.fuse(&mut joint, sender, own, gate_sigmas) == Outcome::Fused;
    let node = forth.applied(&joint.marginal(own));
    (fused && node.is_sound()).then(|| Helped { origins: filter.origins.union(member.origins), node })
}

impl Navigator for Interleaved {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_local_event(event, self.own, self.core.last_ns)?;
        self.check_sender(&event.payload)?;
        self.core.graph.check_heading(ALONE, &event.payload)?;
        self.core.last_ns = Some(event.t_ns);
        Ok(match &event.payload {
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                self.hear(*sender, *tol_ns, *toa_ns, bytes)
            }
            payload => self.sense(event.t_ns, payload),
        })
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        let Some(alone) = self.core.graph.current(ALONE) else { return Ok(None) };
        let member = |origins: Origins, node: &Gaussian<NODE>| {
            let node = self.ahead(node, tol_ns);
            let mean_m = node.mean.fixed_rows::<2>(0).into_owned();
            let covariance_m2 = node.covariance.fixed_view::<2, 2>(0, 0).into_owned();
            Member { origins, belief: Belief { mean_m, covariance_m2 } }
        };
        let mut members = vec![member(self.core.alone, &alone)];
        members.extend(self.core.bank.iter().map(|helped| member(helped.origins, &helped.node)));
        let header = Header {
            kind: PacketKind::Bank,
            sequence: self.core.sequencer.residue(),
            depth_m: self.core.graph.depth_m(ALONE),
            heard: self.core.heard,
        };
        let bytes = BankPacket { header, members }.encode(self.own, tol_ns)?;
        if bytes.len() > capacity_bytes {
            return Err(Error::PacketTooLong { bytes: bytes.len(), capacity: capacity_bytes });
        }
        self.core.sequencer.take()?;
        self.core.heard = HeardBitmap::default();
        Ok(Some(bytes.into()))
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let node = self.best().map(|helped| self.ahead(&helped.node, t_ns));
        estimate(node.as_ref(), t_ns, self.core.graph.estimate(ALONE, t_ns).rejected)
    }

    fn profile(&self) -> Profile {
        Profile {
            takes_ranges: self.options.ranging,
            has_checksum: true,
            needs_delivery_oracle: false,
            // Packets acknowledge receptions, even where it uses no ranges.
            uses: LOCAL_SENSORS.with(Kind::Reception, true),
        }
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let origins = self.best().map_or(f64::NAN, |best| f64::from(best.origins.bits().count_ones()));
        vec![("bank_filters", 1.0 + self.core.bank.len() as f64), ("best_filter_origins", origins)]
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.core)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.core = load(snapshot)?;
        Ok(())
    }
}
