//! D-MPF (Tan, Chitre & Hover 2016): a marginalised particle filter on depth differences and broadcast beliefs.
//!
//! [`Dmpf::sounding`] reads like Algorithm 1: time update (5)–(8), terrain likelihood (15), weights (9), resampling
//! (13)–(14), roughening; [`Navigator::handle`] adds the range likelihood (17)–(18) when a packet arrives.

mod modes;

use std::collections::VecDeque;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::diagnostics::teammates;
use super::drift::Drift;
use super::from_outside::BeaconOptions;
use super::last_heard::LastHeard;
use super::particle_core::ParticleCore;
use super::radio::Radio;
use super::range::RangeOptions;
use super::settings::{DmpfSettings, Settings, check_all};
use super::snapshot::{load, save};
use super::{
    Estimate, Innovation, Kinds, LastInnovation, Navigator, Outcome, Particles, Profile, check_event,
};
use crate::chart::Chart;
use crate::error::Error;
use crate::event::{Event, Kind, Payload, VehicleId};
use crate::kernels::likelihood::{terrain_log_likelihood, terrain_log_likelihood_fast};
use crate::kernels::pattern::Pattern;
use crate::packet::PacketKind;
use crate::random::{Purpose, Streams};

/// The paper has no tide; a sounding may lie outside the chart's depths by as much as `mpf` believes of one, m.
const TIDE_SIGMA_M: f64 = 1.0;

/// Options of `dmpf`; [`DmpfSettings`] holds the paper's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DmpfOptions {
    /// N.
    pub particles: usize,
    /// ℓ, differences along the segment.
    pub window: usize,
    /// σ of a difference in (15), m.
    pub sigma_like_m: f64,
    /// Resample at N_eff ≤ this × N (14).
    pub resample_share: f64,
    /// Variance of the roughening per axis, m².
    pub roughening_m2: f64,
    /// Range likelihood; none leaves ranges unused and keeps silent.
    pub range: Option<RangeOptions>,
    /// Whether soundings are used.
    pub terrain: bool,
    /// Form of the broadcast belief.
    pub packet: PacketKind,
    /// Modes of a [`PacketKind::Mixture`].
    pub modes: usize,
    /// Kernel width for the information of each update, m; `None`: not measured.
    pub update_entropy_sigma_m: Option<f64>,
    /// Process noise and priors.
    pub drift: Drift,
}

/// The navigator.
pub struct Dmpf {
    own: VehicleId,
    options: DmpfOptions,
    chart: Option<Arc<Chart>>,
    state: DmpfState,
    scratch: Scratch,
}

#[derive(Serialize, Deserialize)]
struct DmpfState {
    core: ParticleCore<2>,
    radio: Radio,
    last_heard: LastHeard,
    soundings: VecDeque<Sounding>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Sounding {
    water_depth_m: f64,
    displacement_m: [f64; 2],
}

#[derive(Default)]
struct Scratch {
    offsets: Vec<[f64; 2]>,
    differences: Vec<f64>,
    pattern: Pattern,
}

impl Dmpf {
    /// A navigator for vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// Options outside their bounds.
    pub fn new(
        own: VehicleId,
        vehicles: usize,
        options: DmpfOptions,
        chart: Option<Arc<Chart>>,
        sound_speed_mps: f64,
        seed: u64,
    ) -> Result<Self, Error> {
        if let Some(range) = &options.range {
            range.validate()?;
        }
        let values = [
            ("sigma_like_m", options.sigma_like_m),
            ("roughening_m2", options.roughening_m2),
            ("resample_share", options.resample_share),
            ("modes", options.modes as f64),
            ("window", options.window as f64),
        ];
        check_all(&DmpfSettings::bounds(), &values)?;
        let mut core = ParticleCore::new(options.particles, options.drift, Streams::new(seed, own))?;
        if let Some(sigma_m) = options.update_entropy_sigma_m {
            check_all(&DmpfSettings::bounds(), &[("update_entropy_sigma_m", sigma_m)])?;
            core.cloud.measure_information(sigma_m);
        }
        if let Some(range) = &options.range {
            core.stations.options = BeaconOptions::of(range.clock, range.gate_sigmas, sound_speed_mps);
        }
        Ok(Self {
            own,
            options,
            chart,
            state: DmpfState {
                core,
                radio: Radio::new(own, vehicles, sound_speed_mps)?,
                last_heard: LastHeard::new(vehicles),
                soundings: VecDeque::with_capacity(options.window + 1),
            },
            scratch: Scratch::default(),
        })
    }

    /// Measurement update with one sounding: Algorithm 1, lines 9–18.
    fn sounding(&mut self, water_depth_m: f64) -> Outcome {
        let (core, soundings) = (&mut self.state.core, &mut self.state.soundings);
        let (true, Some(chart), Some(trajectory)) = (core.started(), &self.chart, &core.trajectory) else {
            return Outcome::Noted;
        };
        if !chart.admits(water_depth_m, TIDE_SIGMA_M) {
            core.rejected += 1;
            return Outcome::Gated;
        }
        let here = trajectory.displacement_m();
        if soundings.len() > self.options.window {
            soundings.pop_front();
        }
        soundings.push_back(Sounding { water_depth_m, displacement_m: here });
        if soundings.len() < 2 {
            return Outcome::Noted;
        }
        let scratch = &mut self.scratch;
        scratch.offsets.clear();
        scratch
            .offsets
            .extend(soundings.iter().map(|s| [s.displacement_m[0] - here[0], s.displacement_m[1] - here[1]]));
        scratch.differences.clear();
        scratch.differences.extend(
            soundings.iter().zip(soundings.iter().skip(1)).map(|(a, b)| b.water_depth_m - a.water_depth_m),
        );

        let mut column = core.cloud.likelihood_column();
        scratch.terrain(chart, &core.cloud.east, &core.cloud.north, self.options.sigma_like_m, &mut column);
        if !core.fill_holes(&mut column) {
            core.cloud.put_back(column);
            core.rejected += 1;
            return Outcome::Gated;
        }
        if !core.cloud.reweight(column) {
            core.rejected += 1;
            return Outcome::Gated;
        }
        self.resample();
        Outcome::Fused
    }

    /// Algorithm 1, lines 14–18.
    fn resample(&mut self) {
        let core = &mut self.state.core;
        if core.cloud.ess() <= self.options.resample_share * core.cloud.len() as f64 {
            let stream = core.next_stream(Purpose::Resample);
            core.cloud.resample(&stream);
            let stream = core.next_stream(Purpose::Jitter);
            core.cloud.roughen(self.options.roughening_m2, &stream);
        }
    }

    fn reception(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Outcome {
        let Some(range) = self.options.range else { return Outcome::Noted };
        // Before the radio takes down that the packet was heard: what cannot be placed in time is refused whole.
        if !self.state.core.remembers(toa_ns) {
            self.state.core.rejected += 1;
            return Outcome::Rejected;
        }
        // Of an error that stands from range to range nothing is renewed: it counts by the share of the rest.
        let standing_m2 = self.state.radio.standing_m2(&range.clock, tol_ns, toa_ns);
        let noise_m2 = range.sigma_m * range.sigma_m;
        let range = range.inflated(standing_m2).counting(noise_m2 / (noise_m2 + standing_m2));
        let Some(heard) = self.state.radio.receive(sender, tol_ns, toa_ns, bytes, range.sigma_m) else {
            self.state.core.rejected += 1;
            return Outcome::Rejected;
        };
        let range = range.inflated(heard.depth_rounding_m2);
        let outcome = self.state.core.range(&heard, toa_ns, &range);
        if outcome == Outcome::Fused {
            self.state.last_heard.keep(sender, tol_ns, heard.belief.moments().1);
            self.resample();
        }
        outcome
    }
}

impl Scratch {
    /// Terrain log-likelihood (15); NaN for a particle whose segment touches no depth.
    fn terrain(&mut self, chart: &Chart, east: &[f64], north: &[f64], sigma_m: f64, out: &mut [f64]) {
        let grid = chart.grid();
        self.pattern.set(&grid, self.offsets.iter().copied());
        if !terrain_log_likelihood_fast(&grid, &self.pattern, east, north, &self.differences, sigma_m, out) {
            let (offsets, differences) = (&self.offsets, &self.differences);
            terrain_log_likelihood(&grid, east, north, offsets, differences, sigma_m, f64::NAN, out);
        }
    }
}

impl Dmpf {
    /// What one event does once the clock has been advanced to it.
    fn fuse_event(&mut self, event: &Event) -> Outcome {
        match &event.payload {
            Payload::Depth { depth_m, .. } => {
                self.state.radio.set_depth(*depth_m);
                self.state.core.set_depth(*depth_m);
                Outcome::Fused
            }
            Payload::Usbl { .. } | Payload::BeaconRange { .. } => {
                let outcome = self.state.core.station(&event.payload);
                self.resample();
                outcome
            }
            Payload::Fix { position_m, covariance_m2 } => {
                let outcome = self.state.core.fix(*position_m, *covariance_m2);
                self.resample();
                outcome
            }
            Payload::WaterDepth { water_depth_m, .. } if self.options.terrain => {
                self.sounding(*water_depth_m)
            }
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                self.reception(*sender, *tol_ns, *toa_ns, bytes)
            }
            other => self.state.core.take_motion(event.t_ns, other).0,
        }
    }
}

impl Navigator for Dmpf {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.state.core.now_ns())?;
        self.state.radio.check_sender(&event.payload)?;
        self.state.core.innovation = LastInnovation::default();
        self.state.core.advance_following(event.t_ns);
        let rejected_before = self.state.core.rejected;
        let outcome = self.fuse_event(event);
        self.state.core.count_gated(&event.payload, outcome, rejected_before);
        Ok(outcome)
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        if self.options.range.is_none() || !self.state.core.started() {
            return Ok(None);
        }
        if self.options.packet == PacketKind::Cloud {
            let particles = self.state.core.particles_at(tol_ns);
            return self.state.radio.broadcast_cloud(particles, tol_ns, capacity_bytes).map(Some);
        }
        if let Some(modes) = self.modes(tol_ns) {
            return self.state.radio.broadcast_modes(modes, tol_ns, capacity_bytes).map(Some);
        }
        let estimate = self.state.core.estimate(tol_ns);
        self.state.radio.broadcast(self.options.packet, &estimate, tol_ns, capacity_bytes).map(Some)
    }

    fn profile(&self) -> Profile {
        let ranges = self.options.range.is_some();
        let uses = Kinds::MOTION.with(Kind::Fix, true).with(Kind::WaterDepth, self.options.terrain);
        let uses = uses.and(Kinds::STATIONS).with(Kind::Reception, ranges);
        Profile { takes_ranges: ranges, has_checksum: true, needs_delivery_oracle: false, uses }
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        self.state.core.estimate(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.state)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let state: DmpfState = load(snapshot)?;
        self.state.core.check_same(&state.core)?;
        self.state.radio.check_same(&state.radio)?;
        self.state = state;
        Ok(())
    }

    fn particles(&self) -> Option<Particles> {
        self.state.core.particles()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut columns = self.state.core.diagnostics();
        if self.options.range.is_some() {
            columns.extend(teammates(self.state.core.now_ns(), self.state.last_heard.all()));
        }
        columns
    }

    fn information_nat(&self) -> f64 {
        self.state.core.information_nat
    }

    fn innovation(&self) -> Option<Innovation> {
        self.state.core.innovation.0
    }
}
