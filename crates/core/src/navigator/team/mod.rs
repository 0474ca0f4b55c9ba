//! `team`: every particle carries its teammates.
//!
//! Only local data is broadcast ([`book`]): displacement, soundings, measured ranges, fixes; never a belief. Each
//! particle of the receiver holds a Gaussian over its teammates' states, conditioned on that particle's own track
//! ([`group`]); a packet runs over it in the order of time ([`program`]). Each datum is used once by each receiver, so
//! nothing is counted twice, and a lost packet costs what was in it. The own core is that of
//! [`mpf`](super::mpf): a vehicle that hears nobody is `mpf` without ranges, bit for bit.

mod book;
mod current;
mod filled;
mod group;
mod past;
mod program;
mod reception;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::common::{Drift, check_event, load, save, seconds};
use super::mpf::{Mpf, MpfOptions, State as MpfState};
use super::{Estimate, Navigator, Outcome, Particles, Status};
use crate::chart::Chart;
use crate::error::{Error, positive};
use crate::event::{Event, Payload, VehicleId};
use crate::kernels::lookup::Paired;
use crate::kernels::particles::liu_west_bandwidth;
use crate::kernels::weights::weighted_mean;
use crate::noise::Purpose;
use crate::packet::{SEAL_BYTES, TEAM_MAX, TeamLayout, TeamReport};
use book::Book;
use current::CommonCurrent;
use group::Group;
use past::Past;
use program::Program;

/// Options of `team`.
#[derive(Debug, Clone, PartialEq)]
pub struct TeamOptions {
    /// The own core; its `range` and `packet` are not used.
    pub core: MpfOptions,
    /// Drift of each vehicle of the team.
    pub drifts: Vec<Drift>,
    /// Whether to talk and to listen.
    pub use_ranges: bool,
    /// Standard deviation of a range, m.
    pub sigma_range_m: f64,
    /// A range that the team's beliefs contradict by more than this many sigmas is gated; infinite for never.
    pub range_gate_sigmas: f64,
    /// Bytes of a frame, tag or checksum included.
    pub frame_bytes: usize,
    /// Bytes of the frame that an authentication tag takes.
    pub tag_bytes: usize,
    /// `f64` packets, for studies without a limit on bandwidth.
    pub packet_f64: bool,
    /// Least distance between the soundings of a packet, m.
    pub packet_spacing_m: f64,
    /// Most teammates whose cross-covariances are kept; larger teams fall into groups of this size.
    pub group_size: usize,
    /// A packet whose weights would leave a smaller effective share of the particles is softened.
    pub least_ess_share: f64,
    /// How much of a teammate's current is its own: 1 for currents that have nothing in common; below, the prior and
    /// walk of the difference to this vehicle's current are this share of the drift's.
    pub current_difference: f64,
    /// Standard deviation of a teammate's datum offset (tide) minus this vehicle's, m; infinite for offsets that have
    /// nothing in common.
    pub offset_difference_m: f64,
    /// How far the outer points of a sounding may lie from a depth of the chart, m.
    pub fill_reach_m: f64,
}

/// A teammate that was heard.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Teammate {
    /// Where its block stands in time: the launch of its last packet.
    pub tol_ns: i64,
    /// Its dead reckoning then, m.
    pub position_m: [f64; 2],
    /// Low bits of that packet's counter.
    pub sequence: u8,
    /// Distance travelled since its last sounding that was used, m.
    pub since_sounding_m: Option<f64>,
}

/// The navigator, with K = 2 (current) or 4 (and compass and thrust bias) own linear states.
pub struct Team<const K: usize> {
    mpf: Mpf<K>,
    options: TeamOptions,
    layout: TeamLayout,
    filled: Option<Vec<Paired>>,
    state: State<K>,
    scratch: Scratch,
}

#[derive(Clone, Serialize, Deserialize)]
struct State<const K: usize> {
    book: Book,
    mates: Vec<Option<Teammate>>,
    groups: Vec<Group>,
    past: Past,
    current: Option<CommonCurrent<K>>,
    sigma_sounding_m: Option<f64>,
}

#[derive(Default)]
struct Scratch {
    report: TeamReport,
    program: Program,
    lanes: Vec<[f64; crate::kernels::team::LANES]>,
    rows: Vec<f64>,
    innovation: [Vec<f64>; 2],
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
        positive("sigma_range_m", options.sigma_range_m)?;
        if vehicles > usize::from(TEAM_MAX) {
            let value = vehicles as f64;
            return Err(Error::OutOfBound { quantity: "vehicles of a team", value, bound: "1 to 16" });
        }
        if options.drifts.len() != vehicles {
            let found = options.drifts.len();
            return Err(Error::Length { quantity: "drifts of the team", found, expected: vehicles });
        }
        options.drifts.iter().try_for_each(Drift::validate)?;
        if !(1..=15).contains(&options.group_size) {
            let value = options.group_size as f64;
            return Err(Error::OutOfBound { quantity: "group_size", value, bound: "1 to 15" });
        }
        let overhead = if options.tag_bytes > 0 { options.tag_bytes } else { SEAL_BYTES };
        let layout = TeamLayout::new(vehicles, options.frame_bytes.saturating_sub(overhead))?;
        let filled = chart.as_deref().and_then(|c| filled::filled(c, options.fill_reach_m));
        let core = MpfOptions {
            range: None,
            drift: options.drifts.get(usize::from(own)).copied().unwrap_or(options.core.drift),
            ..options.core
        };
        let groups = vehicles.saturating_sub(1).div_ceil(options.group_size);
        Ok(Self {
            state: State {
                book: Book::new(vehicles),
                mates: vec![None; vehicles],
                groups: (0..groups).map(|_| Group::new(options.core.particles)).collect(),
                past: Past::default(),
                current: (options.current_difference < 1.0)
                    .then(|| CommonCurrent::new(options.core.particles, vehicles)),
                sigma_sounding_m: None,
            },
            mpf: Mpf::new(own, vehicles, core, chart, sound_speed_mps, seed)?,
            layout,
            filled,
            options,
            scratch: Scratch::default(),
        })
    }

    /// How often the health monitor spread the cloud.
    #[must_use]
    pub fn alarms(&self) -> u64 {
        self.mpf.alarms()
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
        self.mpf.state.core.cloud.weights()
    }

    /// Which group a teammate belongs to: the others in their order, `group_size` to a group.
    fn group_of(&self, vehicle: VehicleId) -> usize {
        let place = usize::from(vehicle) - usize::from(vehicle > self.mpf.own);
        place / self.options.group_size
    }

    /// The own particles make a step, and what must know of it is told.
    fn advance(&mut self, t_ns: i64) {
        let core = &mut self.mpf.state.core;
        let Some(before_ns) = core.now_ns().filter(|now_ns| *now_ns < t_ns) else {
            core.advance(t_ns);
            return;
        };
        let covariance = core.covariance;
        if let Some(current) = &mut self.state.current {
            current.before(&core.cloud.linear);
        }
        let step = core.advance(t_ns);
        if let Some(current) = &mut self.state.current {
            let dt_s = seconds(t_ns - before_ns);
            current.after(&core.cloud.linear, &covariance, step.as_ref(), dt_s);
        }
        if step.is_some() && self.options.use_ranges {
            self.state.past.remember(t_ns, &core.cloud.east, &core.cloud.north);
        }
    }

    fn fix(&mut self, t_ns: i64, position_m: [f64; 2], covariance_m2: [f64; 3]) -> Outcome {
        let restarts = self.mpf.state.core.restarts;
        let outcome = self.mpf.weigh_fix(position_m, covariance_m2);
        if outcome == Outcome::Fused {
            self.state.book.fix(t_ns, position_m, covariance_m2);
        }
        if self.mpf.state.core.restarts != restarts {
            self.forget();
            self.state.past.clear();
        }
        self.resample();
        outcome
    }

    fn sounding(&mut self, t_ns: i64, water_depth_m: f64, sigma_m: f64) -> Outcome {
        self.state.book.sounding(t_ns, water_depth_m);
        self.state.sigma_sounding_m = Some(sigma_m);
        let (outcome, health) = self.mpf.weigh_sounding(water_depth_m, sigma_m);
        if let Some(statistic) = health {
            self.remember_own();
            if self.mpf.watch(statistic) {
                self.move_past();
                self.forget();
            } else {
                self.resample();
            }
        }
        outcome
    }

    /// Own positions, to know later how far each particle was moved.
    fn remember_own(&mut self) {
        let cloud = &self.mpf.state.core.cloud;
        for (kept, now) in self.scratch.own.iter_mut().zip([&cloud.east, &cloud.north]) {
            kept.clear();
            kept.extend_from_slice(now);
        }
    }

    /// Where a particle was moves as the particle does.
    fn move_past(&mut self) {
        let cloud = &self.mpf.state.core.cloud;
        self.state.past.shift(&self.scratch.own, &cloud.east, &cloud.north);
    }

    /// The own cloud was spread: what each particle knew of the teammates is pooled and widened.
    fn forget(&mut self) {
        for group in &mut self.state.groups {
            if let Some(vehicle) = group.members.first() {
                let drift = &self.options.drifts[usize::from(*vehicle)];
                group.forget([
                    100.0,
                    100.0,
                    1.0,
                    0.01,
                    0.01,
                    drift.sigma_heading_bias0_rad.powi(2),
                    drift.sigma_thrust_bias0_mps.powi(2),
                ]);
            }
        }
    }

    /// As `mpf`; teammates and launch positions go with their particle, and are jittered jointly with it.
    fn resample(&mut self) {
        let core = &mut self.mpf.state.core;
        if core.cloud.ess() > self.mpf.options.resample_share * core.cloud.len() as f64 {
            return;
        }
        let stream = core.next_stream(Purpose::Resample);
        let terrain = self.mpf.chart.is_some() && core.status != Status::OffChart;
        let unseen = !terrain && self.state.groups.iter().any(|g| !g.members.is_empty());
        let kept = unseen.then(|| self.means());
        let core = &mut self.mpf.state.core;
        core.cloud.resample(&stream);
        let ancestors = core.cloud.ancestors();
        let [column, _] = &mut self.scratch.innovation;
        column.resize(ancestors.len(), 0.0);
        self.state.past.gather(ancestors, column);
        if let Some(current) = &mut self.state.current {
            current.gather(ancestors, column);
        }
        self.state.groups.iter_mut().for_each(|g| g.gather(ancestors));
        let stream = self.mpf.state.core.next_stream(Purpose::Jitter);
        self.jitter_groups(&stream);
        self.remember_own();
        self.mpf.state.core.cloud.liu_west(&stream);
        if let Some(kept) = kept {
            self.keep_means(&kept);
        }
        self.move_past();
    }

    /// Weighted mean of every column: own states, then the teammates'.
    fn means(&self) -> Vec<f64> {
        let (cloud, n) = (&self.mpf.state.core.cloud, self.options.core.particles);
        let own = [&cloud.east, &cloud.north, &cloud.offset].into_iter().chain(&cloud.linear);
        let own = own.map(Vec::as_slice);
        let mates = self.state.groups.iter().flat_map(|g| g.mean.chunks(n));
        own.chain(mates).map(|column| weighted_mean(cloud.weights(), column)).collect()
    }

    /// Takes what chance did to the means in resampling back. Where no terrain holds the team in place, such errors would
    /// add up to metres: ranges do not see where all of it went.
    fn keep_means(&mut self, kept: &[f64]) {
        let now = self.means();
        let n = self.options.core.particles;
        let cloud = &mut self.mpf.state.core.cloud;
        let own = [&mut cloud.east, &mut cloud.north, &mut cloud.offset].into_iter().chain(&mut cloud.linear);
        let own = own.map(Vec::as_mut_slice);
        let mates = self.state.groups.iter_mut().flat_map(|g| g.mean.chunks_mut(n));
        for ((column, kept), now) in own.chain(mates).zip(kept).zip(&now) {
            column.iter_mut().for_each(|x| *x += kept - now);
        }
    }

    /// The teammates' part of the joint jitter: the own part takes the same normals afterwards.
    fn jitter_groups(&mut self, stream: &crate::noise::Stream) {
        if self.state.groups.iter().all(|g| g.members.is_empty()) {
            return;
        }
        let cloud = &self.mpf.state.core.cloud;
        let n = cloud.len();
        for (k, pair) in self.scratch.normals.chunks_mut(2).enumerate() {
            if let [a, b] = pair {
                a.resize(n, 0.0);
                b.resize(n, 0.0);
                stream.normal_pairs(k as u32, a, b);
            }
        }
        let mut own: [&[f64]; 7] = [&[]; 7];
        let mut normals: [&[f64]; 7] = [&[]; 7];
        own[..3].copy_from_slice(&[&cloud.east, &cloud.north, &cloud.offset]);
        for (place, column) in own[3..].iter_mut().zip(&cloud.linear) {
            *place = column;
        }
        for (place, column) in normals.iter_mut().zip(&self.scratch.normals) {
            *place = column;
        }
        let (k, h) = (3 + K, liu_west_bandwidth(n));
        for (index, group) in self.state.groups.iter_mut().enumerate() {
            // The own columns take the lanes 0 to 3.
            let lane = 16 + 64 * index as u32;
            group.jitter(&own[..k], &normals[..k], h, stream, lane);
        }
    }

    fn remember_launch(&mut self, tol_ns: i64, sequence: u8) {
        let core = &self.mpf.state.core;
        let (cloud, velocity) = (&core.cloud, core.velocity_mps);
        let ahead_s = core.now_ns().map_or(0.0, |now| seconds(tol_ns.saturating_sub(now)).max(0.0));
        let place = |i: usize| {
            let now = [cloud.east[i], cloud.north[i]];
            [0, 1].map(|axis| now[axis] + ahead_s * (velocity[axis] + cloud.linear[axis][i]))
        };
        self.state.past.launched(sequence, tol_ns, place, cloud.len());
    }
}

impl<const K: usize> Navigator for Team<K> {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.mpf.own, self.mpf.state.core.now_ns())?;
        self.mpf.state.radio.check_sender(&event.payload)?;
        self.state.book.advance(event.t_ns, self.mpf.state.core.velocity_mps);
        self.advance(event.t_ns);
        match &event.payload {
            Payload::Motion { velocity_mps } => {
                self.mpf.state.core.velocity_mps = *velocity_mps;
                Ok(Outcome::Fused)
            }
            Payload::Depth { depth_m, .. } => {
                self.mpf.state.radio.set_depth(*depth_m);
                Ok(Outcome::Fused)
            }
            Payload::Fix { position_m, covariance_m2 } => {
                Ok(self.fix(event.t_ns, *position_m, *covariance_m2))
            }
            Payload::WaterDepth { water_depth_m, sigma_m } => {
                Ok(self.sounding(event.t_ns, *water_depth_m, *sigma_m))
            }
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                Ok(self.reception(*sender, *tol_ns, *toa_ns, bytes))
            }
            _ => Ok(Outcome::Noted),
        }
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        if !self.options.use_ranges || !self.mpf.state.core.started() {
            return Ok(None);
        }
        let (radio, book) = (&mut self.mpf.state.radio, &mut self.state.book);
        let report = &mut self.scratch.report;
        let velocity = self.mpf.state.core.velocity_mps;
        if !book.report(tol_ns, velocity, self.options.packet_spacing_m, &self.layout, report) {
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
        book.sent(tol_ns);
        self.remember_launch(tol_ns, sequence);
        Ok(Some(packet))
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        self.mpf.estimate(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&(&self.mpf.state, &self.state))
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let (mpf, state): (MpfState<K>, State<K>) = load(snapshot)?;
        if state.groups.len() != self.state.groups.len() || state.mates.len() != self.state.mates.len() {
            return Err(Error::Snapshot("made with another team".into()));
        }
        let (particles, vehicles) = (self.options.core.particles, self.state.mates.len());
        state.groups.iter().try_for_each(|g| g.check(particles))?;
        let shared = state.current.as_ref().map(|c| c.fits(particles, vehicles));
        if !state.past.fits(particles)
            || shared.is_some() != self.state.current.is_some()
            || shared == Some(false)
        {
            return Err(Error::Snapshot("made with another team".into()));
        }
        self.mpf.state = mpf;
        self.state = state;
        Ok(())
    }

    fn particles(&self) -> Option<Particles> {
        self.mpf.particles()
    }

    fn information_nat(&self) -> f64 {
        self.mpf.information_nat()
    }
}
