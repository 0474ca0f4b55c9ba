//! `team`: every particle carries its teammates.
//!
//! Only local data is broadcast ([`outgoing_data`]): displacement, soundings, measured ranges, fixes; never a belief. Each
//! particle of the receiver holds a Gaussian over its teammates' states, conditioned on that particle's own track
//! ([`group`]); a packet runs over it in the order of time ([`packet_updates`]). Each datum is used once by each receiver, so
//! nothing is counted twice, and a lost packet costs what was in it. The own core is that of
//! [`mpf`](super::mpf), the [terrain core](super::terrain_core): a vehicle that hears nobody is `mpf` without ranges, bit for bit.

mod group;
mod options;
mod outgoing_data;
mod own_sensors;
mod packet_updates;
mod plausibility;
mod position_history;
mod range_record;
mod ranges;
mod reception;
mod referee;
mod resampling;
mod shared_current;
mod state;

pub use options::TeamOptions;

use std::sync::Arc;

use super::diagnostics::teammates;
use super::from_outside::BeaconOptions;
use super::radio::Radio;
use super::snapshot::{load, save};
use super::terrain_core::{TerrainCore, TerrainOptions, TerrainState};
use super::{
    Estimate, Innovation, Kinds, LastInnovation, Navigator, Outcome, Particles, Profile, check_event,
};
use crate::chart::Chart;
use crate::error::{Error, non_negative};
use crate::event::{Event, Kind, Payload, VehicleId, seconds};
use crate::kernels::lookup::Paired;
use crate::kernels::team::BlockLayout;
use crate::packet::{CRC_BYTES, TEAM_MAX, TeamLayout, TeamReport};
use group::Group;
use outgoing_data::OutgoingData;
use packet_updates::PacketUpdates;
use position_history::PositionHistory;
use range_record::RangeRecord;
use referee::Referee;
use shared_current::SharedCurrent;
use state::TeamState;
pub use state::Teammate;

/// The navigator, with K = 2 (current) or 4 (and compass and thrust bias) own linear states.
pub struct Team<const K: usize> {
    own: VehicleId,
    terrain: TerrainCore<K>,
    radio: Radio,
    options: TeamOptions,
    layout: TeamLayout,
    filled: Option<Vec<Paired>>,
    /// The filter without ranges; none where it is not to judge.
    lone: Option<TerrainCore<K>>,
    state: TeamState<K>,
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    report: TeamReport,
    updates: PacketUpdates,
    lanes: Vec<[f64; crate::kernels::team::LANES]>,
    rows: Vec<f64>,
    innovation: [Vec<f64>; 2],
    /// For gathering alone, which changes columns with what it gathers: no other use may count on its memory.
    gathered: Vec<f64>,
    mean: Vec<f64>,
    usable: Vec<(i64, f64, packet_updates::Target)>,
    own: [Vec<f64>; 2],
    normals: [Vec<f64>; 8],
    current: [Vec<f64>; 2],
}

impl<const K: usize> Team<K> {
    /// A navigator for vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// Options outside their bounds; a frame that holds no packet of this team.
    pub fn new(
        own: VehicleId,
        vehicles: usize,
        options: TeamOptions,
        chart: Option<Arc<Chart>>,
        sound_speed_mps: f64,
        seed: u64,
    ) -> Result<Self, Error> {
        options.validate()?;
        non_negative("referee_nat", options.referee_nat)?;
        options.clock.validate()?;
        if vehicles > usize::from(TEAM_MAX) {
            let value = vehicles as f64;
            return Err(Error::OutOfBound { quantity: "vehicles of a team", value, bound: "1 to 16" });
        }
        if options.drifts.len() != vehicles {
            let found = options.drifts.len();
            return Err(Error::Length { quantity: "drifts of the team", found, expected: vehicles });
        }
        let overhead = if options.tag_bytes > 0 { options.tag_bytes } else { CRC_BYTES };
        let layout = TeamLayout::new(vehicles, options.frame_bytes.saturating_sub(overhead))?;
        let filled = chart.as_deref().and_then(|c| c.nodes_with_holes_filled(options.fill_reach_m));
        let terrain = TerrainOptions {
            drift: options.drifts.get(usize::from(own)).copied().unwrap_or(options.terrain.drift),
            ..options.terrain
        };
        let groups = vehicles.saturating_sub(1).div_ceil(options.group_size);
        let states =
            BlockLayout { scale: options.clock.sound_speed_sigma_mps > 0.0, clock: options.clock.differ() };
        let judged = options.use_ranges && options.referee_nat > 0.0 && chart.is_some();
        let beacons = BeaconOptions::of(options.clock, options.range_gate_sigmas, sound_speed_mps);
        let alone = || {
            let mut core = TerrainCore::new(own, terrain, chart.clone(), seed)?;
            core.set_beacons(beacons);
            Ok::<_, Error>(core)
        };
        let lone = judged.then(alone).transpose()?;
        Ok(Self {
            state: TeamState {
                outgoing: OutgoingData::new(vehicles),
                mates: vec![None; vehicles],
                groups: (0..groups).map(|_| Group::new(options.terrain.particles, states)).collect(),
                history: PositionHistory::default(),
                current: (options.current_difference < 1.0)
                    .then(|| SharedCurrent::new(options.terrain.particles, vehicles)),
                current_given_up: false,
                sigma_sounding_m: None,
                referee: Referee::default(),
                ranges: RangeRecord::default(),
            },
            lone,
            own,
            terrain: alone()?,
            radio: Radio::new(own, vehicles, sound_speed_mps)?,
            layout,
            filled,
            options,
            scratch: Scratch { usable: Vec::with_capacity(vehicles), ..Scratch::default() },
        })
    }

    /// The own core: cloud, datum offset, alarms.
    #[must_use]
    pub fn terrain(&self) -> &TerrainCore<K> {
        &self.terrain
    }

    /// The filter without ranges that judges the own core; none where it is left out.
    #[must_use]
    pub fn lone(&self) -> Option<&TerrainCore<K>> {
        self.lone.as_ref()
    }

    /// Mean and covariance [ee, en, nn] of a teammate's position at the launch of its last packet, m and m².
    #[must_use]
    pub fn teammate(&self, vehicle: VehicleId) -> Option<(i64, [f64; 2], [f64; 3])> {
        let mate = (*self.state.mates.get(usize::from(vehicle))?)?;
        let group = &self.state.groups[self.group_of(vehicle)];
        let (mean, covariance) = reception::position_moments(group, group.base_of(vehicle)?, self.weights());
        Some((mate.tol_ns, mean, covariance))
    }

    fn weights(&self) -> &[f64] {
        self.terrain.state.core.cloud.weights()
    }

    /// Which group a teammate belongs to: the others in their order, `group_size` to a group.
    fn group_of(&self, vehicle: VehicleId) -> usize {
        let place = usize::from(vehicle) - usize::from(vehicle > self.own);
        place / self.options.group_size
    }

    fn remember_launch(&mut self, tol_ns: i64, sequence: u8) {
        let core = &self.terrain.state.core;
        let (cloud, velocity) = (&core.cloud, core.velocity_mps);
        let ahead_s = core.now_ns().map_or(0.0, |now| seconds(tol_ns.saturating_sub(now)).max(0.0));
        let place = |i: usize| {
            let now = [cloud.east[i], cloud.north[i]];
            [0, 1].map(|axis| now[axis] + ahead_s * (velocity[axis] + cloud.linear[axis][i]))
        };
        self.state.history.launched(sequence, tol_ns, place, cloud.len());
    }
}

impl<const K: usize> Team<K> {
    /// What one event does once the clock has been advanced to it.
    fn fuse_event(&mut self, event: &Event) -> Outcome {
        match &event.payload {
            Payload::Depth { depth_m, .. } => {
                self.radio.set_depth(*depth_m);
                self.terrain.state.core.set_depth(*depth_m);
                Outcome::Fused
            }
            Payload::Usbl { .. } | Payload::BeaconRange { .. } => self.station(event.t_ns, &event.payload),
            Payload::Fix { position_m, covariance_m2 } => self.fix(event.t_ns, *position_m, *covariance_m2),
            Payload::WaterDepth { water_depth_m, sigma_m } => {
                self.sounding(event.t_ns, *water_depth_m, *sigma_m)
            }
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                self.reception(*sender, *tol_ns, *toa_ns, bytes)
            }
            other => self.motion(event.t_ns, other),
        }
    }
}

impl<const K: usize> Navigator for Team<K> {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.terrain.state.core.now_ns())?;
        self.radio.check_sender(&event.payload)?;
        // A step at a reception would draw on: not told of any, it is `mpf` without ranges bit for bit.
        if let (Some(lone), false) = (&mut self.lone, matches!(event.payload, Payload::Reception { .. })) {
            lone.handle(event);
        }
        if let Some(end_ns) = self.terrain.state.core.motion_ends_before(event.t_ns) {
            self.state.outgoing.advance(end_ns, self.terrain.state.core.velocity_mps);
            self.advance(end_ns);
        }
        self.state.outgoing.advance(event.t_ns, self.terrain.state.core.velocity_mps);
        self.terrain.state.core.innovation = LastInnovation::default();
        self.advance(event.t_ns);
        let rejected_before = self.terrain.state.core.rejected;
        let outcome = self.fuse_event(event);
        self.terrain.state.core.count_gated(&event.payload, outcome, rejected_before);
        Ok(outcome)
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        if !self.options.use_ranges || !self.terrain.state.core.started() {
            return Ok(None);
        }
        let (radio, outgoing) = (&mut self.radio, &mut self.state.outgoing);
        let report = &mut self.scratch.report;
        let velocity = self.terrain.state.core.velocity_mps;
        if !outgoing.report(tol_ns, velocity, self.options.packet_spacing_m, &self.layout, report) {
            return Ok(None);
        }
        report.sequence = radio.sequencer.residue();
        report.depth_m = radio.depth_m.max(0.0);
        let bytes = if self.options.packet_f64 {
            report.encode_f64(radio.own, tol_ns)?
        } else {
            report.encode(&self.layout, radio.own, tol_ns)?
        };
        let sequence = report.sequence;
        let packet = radio.launch(bytes, capacity_bytes)?;
        outgoing.sent(tol_ns);
        self.remember_launch(tol_ns, sequence);
        Ok(Some(packet))
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        self.terrain.state.core.estimate(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&(&self.terrain.state, &self.radio, &self.state, self.lone.as_ref().map(|lone| &lone.state)))
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        type Snapshot<const K: usize> = (TerrainState<K>, Radio, TeamState<K>, Option<TerrainState<K>>);
        let (terrain, radio, state, lone): Snapshot<K> = load(snapshot)?;
        self.terrain.check_same(&terrain)?;
        self.radio.check_same(&radio)?;
        self.state.check_same(
            &state,
            self.options.terrain.particles,
            self.options.current_difference < 1.0,
        )?;
        match (&mut self.lone, lone) {
            (None, None) => {}
            (Some(lone), Some(theirs)) => {
                lone.check_same(&theirs)?;
                lone.state = theirs;
            }
            _ => return Err(Error::Snapshot("made with another referee".into())),
        }
        self.terrain.state = terrain;
        self.radio = radio;
        self.state = state;
        Ok(())
    }

    fn profile(&self) -> Profile {
        let ranges = self.options.use_ranges;
        let uses = Kinds::MOTION.with(Kind::Fix, true).with(Kind::WaterDepth, true);
        let uses = uses.and(Kinds::STATIONS).with(Kind::Reception, ranges);
        Profile { takes_ranges: ranges, has_checksum: true, needs_delivery_oracle: false, uses }
    }

    fn particles(&self) -> Option<Particles> {
        self.terrain.state.core.particles()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut columns = self.terrain.diagnostics();
        let heard = (0..self.state.mates.len()).filter_map(|v| self.teammate(v as VehicleId));
        let heard = heard.map(|(tol_ns, _, covariance_m2)| (tol_ns, covariance_m2));
        columns.extend(teammates(self.terrain.state.core.now_ns(), heard));
        let (late, told_m2) = (self.options.clock.late().is_some(), self.options.sigma_range_m.powi(2));
        columns.extend(self.state.ranges.diagnostics(late, told_m2));
        if self.lone.is_some() {
            columns.extend(self.state.referee.diagnostics());
        }
        columns.extend(self.clock_diagnostics());
        columns
    }

    fn information_nat(&self) -> f64 {
        self.terrain.state.core.information_nat
    }

    fn innovation(&self) -> Option<Innovation> {
        self.terrain.state.core.innovation.0
    }
}
