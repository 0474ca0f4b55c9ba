//! The centralised references: `cekf`, with all sensor data and receptions of the team (Webster et al. 2009), and the
//! same for one vehicle at a time, with the raw data of exactly the packets that it received.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::graph::{Graph, Node};
use super::local_options::LocalOptions;
use super::sensors::{LOCAL_SENSORS, check_local_event};
use crate::error::{Error, positive};
use crate::event::{Event, Kind, Payload, VehicleId};
use crate::navigator::snapshot::{load, save};
use crate::navigator::{CentralEstimator, Estimate, Innovation, LastInnovation, Outcome, Profile};

/// What centralised references are configured with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CentralOptions {
    /// How motion, sensors and ranges are modelled.
    pub local: LocalOptions,
    /// By vehicle, whether its ranges are used; as many as there are vehicles.
    pub ranging: Vec<bool>,
    /// m/s.
    pub sound_speed_mps: f64,
    /// Assumed length of the packet that carries a range, for loss and air time.
    pub packet_bytes: usize,
}

impl CentralOptions {
    fn validate(&self) -> Result<(), Error> {
        self.local.validate()?;
        positive("sound_speed_mps", self.sound_speed_mps)?;
        Ok(())
    }

    fn profile(&self) -> Profile {
        let takes_ranges = self.ranging.contains(&true);
        let uses = LOCAL_SENSORS.with(Kind::Reception, takes_ranges);
        Profile { takes_ranges, has_checksum: false, needs_delivery_oracle: false, uses }
    }

    fn known(&self, vehicle: VehicleId) -> Result<usize, Error> {
        let count = self.ranging.len();
        if usize::from(vehicle) < count {
            Ok(usize::from(vehicle))
        } else {
            Err(Error::UnknownVehicle { vehicle, count })
        }
    }

    /// Whose event it is, that it is in order, and that its sender is one of the others.
    fn check(&self, vehicle: VehicleId, event: &Event, now_ns: Option<i64>) -> Result<(), Error> {
        check_local_event(event, vehicle, now_ns)?;
        if let Payload::Reception { sender, .. } = event.payload {
            self.known(sender)?;
            if sender == vehicle {
                return Err(Error::WrongVehicle { event: sender, own: vehicle });
            }
        }
        Ok(())
    }
}

/// Refuses a launch before the vehicle's last event.
fn check_launch(tol_ns: i64, now_ns: Option<i64>) -> Result<(), Error> {
    match now_ns {
        Some(now_ns) if tol_ns < now_ns => Err(Error::FromThePast { event_ns: tol_ns, now_ns }),
        _ => Ok(()),
    }
}

/// Which receptions have been used: one of each signal at each receiver.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Used(Vec<(VehicleId, VehicleId, i64)>);

impl Used {
    /// True the first time; forgets what is older than `sender`'s signal.
    fn first_time(&mut self, sender: VehicleId, receiver: VehicleId, tol_ns: i64) -> bool {
        if self.0.iter().any(|(s, r, t)| *s == sender && *r == receiver && *t >= tol_ns) {
            return false;
        }
        self.0.retain(|(s, r, _)| *s != sender || *r != receiver);
        self.0.push((sender, receiver, tol_ns));
        true
    }
}

/// The centralised extended Kalman filter: one graph of the whole team, delayed states at times of launch.
pub struct Cekf {
    options: CentralOptions,
    core: CekfCore,
}

#[derive(Clone, Serialize, Deserialize)]
struct CekfCore {
    graph: Graph,
    /// By vehicle: its depth at its last launch, as a packet carries it, m.
    launch_depth_m: Vec<f64>,
    /// By vehicle, the stamp of its last event, ns.
    last_ns: Vec<Option<i64>>,
    used: Used,
}

impl Cekf {
    /// Of a team as large as `options.ranging`.
    ///
    /// # Errors
    /// Options that cannot be.
    pub fn new(options: CentralOptions) -> Result<Self, Error> {
        options.validate()?;
        let vehicles = options.ranging.len();
        let core = CekfCore {
            graph: Graph::new(vehicles, options.local),
            launch_depth_m: vec![0.0; vehicles],
            last_ns: vec![None; vehicles],
            used: Used::default(),
        };
        Ok(Self { options, core })
    }

    fn hear(&mut self, sender: VehicleId, receiver: usize, tol_ns: i64, toa_ns: i64) -> Outcome {
        let core = &mut self.core;
        if !self.options.ranging[receiver] {
            return Outcome::Noted;
        }
        let Some(node) = core.graph.find(Node::Launch(sender, tol_ns)) else {
            core.graph.reject(receiver);
            return Outcome::Rejected;
        };
        if !core.used.first_time(sender, receiver as VehicleId, tol_ns) {
            core.graph.reject(receiver);
            return Outcome::Rejected;
        }
        let from = usize::from(sender);
        let depth_m = core.launch_depth_m[from];
        let sound = self.options.sound_speed_mps;
        let range = core.graph.measured(receiver, (tol_ns, toa_ns), depth_m, sound);
        core.graph.range(node, receiver, range, toa_ns)
    }
}

impl CentralEstimator for Cekf {
    fn handle(&mut self, vehicle: VehicleId, event: &Event) -> Result<Outcome, Error> {
        let own = self.options.known(vehicle)?;
        self.options.check(vehicle, event, self.core.last_ns[own])?;
        self.core.graph.check_heading(own, &event.payload)?;
        self.core.last_ns[own] = Some(event.t_ns);
        self.core.graph.innovation = LastInnovation::default();
        Ok(match event.payload {
            Payload::Reception { sender, tol_ns, toa_ns, .. } => self.hear(sender, own, tol_ns, toa_ns),
            _ => self.core.graph.sense(own, event.t_ns, &event.payload),
        })
    }

    fn launch(&mut self, vehicle: VehicleId, tol_ns: i64) -> Result<bool, Error> {
        let own = self.options.known(vehicle)?;
        check_launch(tol_ns, self.core.last_ns[own])?;
        self.core.launch_depth_m[own] = self.core.graph.carried_depth_m(own);
        Ok(self.core.graph.launch(own, tol_ns))
    }

    fn estimate(&self, vehicle: VehicleId, t_ns: i64) -> Estimate {
        self.core.graph.estimate(usize::from(vehicle), t_ns)
    }

    fn profile(&self) -> Profile {
        self.options.profile()
    }

    fn assumed_packet_bytes(&self) -> usize {
        self.options.packet_bytes
    }

    fn diagnostics(&self, _vehicle: VehicleId) -> Vec<(&'static str, f64)> {
        vec![("graph_nodes", self.core.graph.nodes() as f64)]
    }

    fn innovation(&self) -> Option<Innovation> {
        self.core.graph.innovation.0
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.core)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.core = load(snapshot)?;
        Ok(())
    }
}

/// The best that packets can transmit: one graph for each vehicle, with its own events, the raw events of every peer
/// up to the launch of the last packet that arrived, and its own ranges. Peers' ranges are not in it.
pub struct Received {
    options: CentralOptions,
    core: ReceivedCore,
    /// Whose event was handled last.
    last_own: usize,
}

#[derive(Clone, Serialize, Deserialize)]
struct ReceivedCore {
    /// By receiver.
    graphs: Vec<Graph>,
    /// By vehicle: its sensor events that a peer may still receive.
    sensed: Vec<VecDeque<(i64, Payload)>>,
    /// By vehicle, how many events before `told`'s first have been dropped.
    dropped: Vec<u64>,
    /// By receiver and vehicle: how many of its events have been fed.
    fed: Vec<Vec<u64>>,
    /// By vehicle, the stamp of its last event, ns.
    last_ns: Vec<Option<i64>>,
    started: Vec<bool>,
    used: Used,
}

impl Received {
    /// Of a team as large as `options.ranging`.
    ///
    /// # Errors
    /// Options that cannot be.
    pub fn new(options: CentralOptions) -> Result<Self, Error> {
        options.validate()?;
        let vehicles = options.ranging.len();
        let core = ReceivedCore {
            graphs: (0..vehicles).map(|_| Graph::new(vehicles, options.local)).collect(),
            sensed: (0..vehicles).map(|_| VecDeque::new()).collect(),
            dropped: vec![0; vehicles],
            fed: vec![vec![0; vehicles]; vehicles],
            last_ns: vec![None; vehicles],
            started: vec![false; vehicles],
            used: Used::default(),
        };
        Ok(Self { options, core, last_own: 0 })
    }

    fn sense(&mut self, own: usize, t_ns: i64, payload: &Payload) -> Outcome {
        let core = &mut self.core;
        let listened = self.options.ranging.iter().enumerate().any(|(v, ranging)| v != own && *ranging);
        if listened && !matches!(payload, Payload::Motion { .. } | Payload::WaterDepth { .. }) {
            core.sensed[own].push_back((t_ns, payload.clone()));
        }
        core.started[own] |= matches!(payload, Payload::Fix { .. });
        core.graphs[own].sense(own, t_ns, payload)
    }

    /// Feeds a receiver's graph the sensor events of `sender` up to `tol_ns`, and drops those that all receivers
    /// have.
    fn feed(&mut self, sender: usize, receiver: usize, tol_ns: i64) {
        let core = &mut self.core;
        let skip = core.fed[receiver][sender].saturating_sub(core.dropped[sender]) as usize;
        let graph = &mut core.graphs[receiver];
        for (t_ns, payload) in core.sensed[sender].iter().skip(skip).take_while(|(t_ns, _)| *t_ns <= tol_ns) {
            graph.sense(sender, *t_ns, payload);
            core.fed[receiver][sender] += 1;
        }
        graph.advance(sender, tol_ns);
        let listeners = self.options.ranging.iter().enumerate();
        let known = listeners
            .filter(|(v, ranging)| *v != sender && **ranging)
            .map(|(v, _)| core.fed[v][sender])
            .min()
            .unwrap_or(0);
        while core.dropped[sender] < known && core.sensed[sender].pop_front().is_some() {
            core.dropped[sender] += 1;
        }
    }

    fn hear(&mut self, sender: VehicleId, receiver: usize, tol_ns: i64, toa_ns: i64) -> Outcome {
        let from = usize::from(sender);
        if !self.options.ranging[receiver] {
            return Outcome::Noted;
        }
        if !self.core.used.first_time(sender, receiver as VehicleId, tol_ns) {
            self.core.graphs[receiver].reject(receiver);
            return Outcome::Rejected;
        }
        self.feed(from, receiver, tol_ns);
        let graph = &mut self.core.graphs[receiver];
        let depth_m = graph.carried_depth_m(from);
        let sound = self.options.sound_speed_mps;
        let range = graph.measured(receiver, (tol_ns, toa_ns), depth_m, sound);
        match graph.find(Node::Current(sender)) {
            Some(node) => graph.range(node, receiver, range, toa_ns),
            None => {
                graph.reject(receiver);
                Outcome::Rejected
            }
        }
    }
}

impl CentralEstimator for Received {
    fn handle(&mut self, vehicle: VehicleId, event: &Event) -> Result<Outcome, Error> {
        let own = self.options.known(vehicle)?;
        self.options.check(vehicle, event, self.core.last_ns[own])?;
        self.core.graphs[own].check_heading(own, &event.payload)?;
        self.core.last_ns[own] = Some(event.t_ns);
        self.last_own = own;
        self.core.graphs[own].innovation = LastInnovation::default();
        Ok(match event.payload {
            Payload::Reception { sender, tol_ns, toa_ns, .. } => self.hear(sender, own, tol_ns, toa_ns),
            _ => self.sense(own, event.t_ns, &event.payload),
        })
    }

    fn launch(&mut self, vehicle: VehicleId, tol_ns: i64) -> Result<bool, Error> {
        let own = self.options.known(vehicle)?;
        check_launch(tol_ns, self.core.last_ns[own])?;
        Ok(self.core.started[own])
    }

    fn estimate(&self, vehicle: VehicleId, t_ns: i64) -> Estimate {
        let own = usize::from(vehicle);
        self.core.graphs[own].estimate(own, t_ns)
    }

    fn profile(&self) -> Profile {
        self.options.profile()
    }

    fn assumed_packet_bytes(&self) -> usize {
        self.options.packet_bytes
    }

    fn diagnostics(&self, vehicle: VehicleId) -> Vec<(&'static str, f64)> {
        vec![("graph_nodes", self.core.graphs[usize::from(vehicle)].nodes() as f64)]
    }

    fn innovation(&self) -> Option<Innovation> {
        self.core.graphs[self.last_own].innovation.0
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.core)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.core = load(snapshot)?;
        Ok(())
    }
}
