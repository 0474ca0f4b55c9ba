//! `mpf`: the consistent marginalised particle filter. The datum offset is a further Rao–Blackwellised state, absolute
//! depth is used once per sounding, tempered by the distance over which the chart's error stays itself, with Student
//! tails; Liu–West on the joint state; a health monitor; ranges tempered because a belief that was fused before carries little new information.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::drift::Drift;
use super::particle_core::ParticleCore;
use super::radio::{HeardBelief, Radio};
use super::range::RangeOptions;
use super::range_novelty::RangeNovelty;
use super::snapshot::{load, save};
use super::{Estimate, Navigator, Outcome, Particles, check_event};
use crate::chart::{Chart, SigmaMap};
use crate::cloud::Cloud;
use crate::error::{Error, non_negative, positive};
use crate::event::{Event, Payload, VehicleId, seconds};
use crate::kernels::likelihood::{OffsetModel, SoundingColumns, sounding_update};
use crate::kernels::lookup::bilinear;
use crate::kernels::pattern::{Pattern, pattern_depths};
use crate::kernels::weights::{known_share, weighted_covariance, weighted_mean};
use crate::measurement::sounding::{LEAST_SIGMA_M, sharing_error};
use crate::packet::PacketKind;
use crate::random::{Purpose, Streams};

/// When the cloud no longer explains its soundings: an EWMA of normalised squared mean innovations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonitorOptions {
    /// Weight of a new sounding.
    pub forgetting: f64,
    /// One sounding counts at most this.
    pub clip: f64,
    /// Alarm above this.
    pub alarm: f64,
    /// On alarm, spread of the position, m.
    pub spread_m: f64,
    /// Spread when an alarm repeats within `repeat_s`, m.
    pub repeat_spread_m: f64,
    /// Spread of the current, m/s.
    pub spread_current_mps: f64,
    /// No two alarms closer than this, s.
    pub quiet_s: f64,
    /// See `repeat_spread_m`, s.
    pub repeat_s: f64,
}

/// Options of `mpf`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MpfOptions {
    /// N.
    pub particles: usize,
    /// Resample at N_eff ≤ this × N.
    pub resample_share: f64,
    /// Standard deviation of a sounding, m; `None` takes what the sensor states.
    pub sigma_depth_m: Option<f64>,
    /// Prior of the datum offset (tide), m.
    pub sigma_offset0_m: f64,
    /// Its walk per sounding, m.
    pub sigma_offset_m_per_sounding: f64,
    /// Degrees of freedom of Student's t; infinite for a Gaussian.
    pub student_dof: f64,
    /// Distance over which the chart's error stays itself, m; `None` asks the chart.
    pub correlation_length_m: Option<f64>,
    /// Standard deviation of the chart's error, m; `None` asks the chart.
    pub sigma_map_m: Option<f64>,
    /// Least distance between soundings that are used, m.
    pub sounding_spacing_m: f64,
    /// Share of the particles that a sounding must leave as effective sample size; 0 never softens one.
    pub least_ess_share: f64,
    /// Health monitor.
    pub monitor: Option<MonitorOptions>,
    /// Range likelihood; none leaves ranges unused and keeps silent.
    pub range: Option<RangeOptions>,
    /// Of a teammate's range, count only what is new since it was last heard ([`RangeNovelty`]).
    pub range_news: bool,
    /// Form of the broadcast belief.
    pub packet: PacketKind,
    /// Process noise and priors.
    pub drift: Drift,
}

/// Two vehicles at one place have no direction between them, m.
const LEAST_DISTANCE_M: f64 = 1e-6;

/// A sounding that would leave too few particles is weighed again with twice the sigma, at most so many times.
const SOFTENINGS: usize = 6;

/// The navigator, with K = 2 (current) or 4 (and compass and thrust bias) linear states.
pub struct Mpf<const K: usize> {
    pub(super) own: VehicleId,
    pub(super) options: MpfOptions,
    pub(super) chart: Option<Arc<Chart>>,
    pub(super) state: MpfState<K>,
    scratch: Scratch,
}

#[derive(Serialize, Deserialize)]
pub(super) struct MpfState<const K: usize> {
    pub(super) core: ParticleCore<K>,
    pub(super) radio: Radio,
    range_novelty: RangeNovelty,
    /// Travelled distance at the last sounding used, m.
    sounded_at_m: Option<f64>,
    health: f64,
    alarms: u64,
    last_alarm_ns: Option<i64>,
}

#[derive(Default)]
struct Scratch {
    here: Pattern,
    depth: Vec<f64>,
    sigma_map: Vec<f64>,
    correction: Vec<f64>,
    variance: Vec<f64>,
    innovation: Vec<f64>,
    innovation_variance: Vec<f64>,
    /// ln Σ w exp(log-likelihood) of the last event, where that was a sounding that was weighed, nat.
    evidence_nat: Option<f64>,
}

impl<const K: usize> Mpf<K> {
    /// A navigator for vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// Options outside their bounds.
    pub fn new(
        own: VehicleId,
        vehicles: usize,
        options: MpfOptions,
        chart: Option<Arc<Chart>>,
        sound_speed_mps: f64,
        seed: u64,
    ) -> Result<Self, Error> {
        options.validate()?;
        let mut core = ParticleCore::new(options.particles, options.drift, Streams::new(seed, own))?;
        core.cloud.add_offset();
        Ok(Self {
            own,
            options,
            chart,
            state: MpfState {
                core,
                radio: Radio::new(own, vehicles, sound_speed_mps)?,
                range_novelty: RangeNovelty::new(vehicles),
                sounded_at_m: None,
                health: 1.0,
                alarms: 0,
                last_alarm_ns: None,
            },
            scratch: Scratch::default(),
        })
    }

    /// How often the health monitor spread the cloud.
    #[must_use]
    pub fn alarms(&self) -> u64 {
        self.state.alarms
    }

    /// Mean and variance of the datum offset (tide), m and m²; positive = deeper than the chart.
    #[must_use]
    pub fn datum_offset(&self) -> (f64, f64) {
        let cloud = &self.state.core.cloud;
        let (w, b) = (cloud.weights(), &cloud.offset);
        let mean = weighted_mean(w, b);
        (mean, weighted_mean(w, &cloud.offset_variance) + weighted_covariance(w, b, mean, b, mean))
    }

    /// How well the cloud explained the last sounding, before it took it up: ln Σ w exp(log-likelihood), nat. `None` where
    /// that was not weighed.
    pub(super) fn evidence_nat(&self) -> Option<f64> {
        self.scratch.evidence_nat
    }

    /// The own cloud, and what belongs to it, become those of `other`.
    pub(super) fn become_cloud_of(&mut self, other: &Self) {
        let (mine, theirs) = (&mut self.state, &other.state);
        let (rejected, restarts, nat) = (mine.core.rejected, mine.core.restarts, mine.core.information_nat);
        mine.core.become_core(&theirs.core);
        (mine.core.rejected, mine.core.restarts, mine.core.information_nat) = (rejected, restarts, nat);
        mine.sounded_at_m = theirs.sounded_at_m;
        mine.health = theirs.health;
        mine.last_alarm_ns = theirs.last_alarm_ns;
    }

    fn fix(&mut self, position_m: [f64; 2], covariance_m2: [f64; 3]) -> Outcome {
        let outcome = self.weigh_fix(position_m, covariance_m2);
        self.resample();
        outcome
    }

    /// A fix up to its weights: resampling is left to the caller.
    pub(super) fn weigh_fix(&mut self, position_m: [f64; 2], covariance_m2: [f64; 3]) -> Outcome {
        let core = &mut self.state.core;
        let fresh = !core.started();
        let outcome = core.fix(position_m, covariance_m2);
        if fresh {
            core.cloud.offset_variance.fill(self.options.sigma_offset0_m.powi(2));
        }
        outcome
    }

    /// One sounding: lookup, offset update, tempered weights, health, resampling.
    fn sounding(&mut self, water_depth_m: f64, sensor_sigma_m: f64) -> Outcome {
        let (outcome, health) = self.weigh_sounding(water_depth_m, sensor_sigma_m);
        if let Some(statistic) = health
            && !self.watch(statistic)
        {
            self.resample();
        }
        outcome
    }

    /// A sounding up to its weights; with the health statistic where it was used. Watching and resampling are left to the
    /// caller.
    pub(super) fn weigh_sounding(
        &mut self,
        water_depth_m: f64,
        sensor_sigma_m: f64,
    ) -> (Outcome, Option<f64>) {
        self.scratch.evidence_nat = None;
        let core = &mut self.state.core;
        let (true, Some(chart), Some(trajectory)) = (core.started(), &self.chart, &core.trajectory) else {
            return (Outcome::Noted, None);
        };
        let travelled_m = trajectory.travelled_m();
        let apart_m = self.state.sounded_at_m.map(|at| travelled_m - at);
        if apart_m.is_some_and(|d| d < self.options.sounding_spacing_m) {
            return (Outcome::Noted, None);
        }
        let correlation_m = self.options.correlation_length_m.unwrap_or(chart.correlation_length_m());
        let shared = sharing_error(correlation_m, apart_m);
        let mut model = OffsetModel {
            sigma_m: self.options.sigma_depth_m.unwrap_or(sensor_sigma_m).max(LEAST_SIGMA_M),
            shared,
            dof: self.options.student_dof,
        };

        let scratch = &mut self.scratch;
        scratch.look_up(chart, &core.cloud.east, &core.cloud.north);
        scratch.sigma_map(self.options.sigma_map_m, chart, &core.cloud.east, &core.cloud.north);
        let q = self.options.sigma_offset_m_per_sounding.powi(2);
        let mut column = core.cloud.likelihood_column();
        let mut health = None;
        for _ in 0..=SOFTENINGS {
            scratch.weigh(&model, &core.cloud, water_depth_m, q, &mut column);
            // Health is judged by the noise that the sensor states, before anything is softened.
            health.get_or_insert_with(|| scratch.health(&column, core.cloud.weights()));
            if !core.fill_holes(&mut column) {
                core.cloud.put_back(column);
                core.rejected += 1;
                return (Outcome::Gated, None);
            }
            if cloud_keeps(&core.cloud, &column, self.options.least_ess_share) {
                break;
            }
            model.sigma_m *= 2.0;
        }
        self.state.sounded_at_m = Some(travelled_m);
        for (b, c) in core.cloud.offset.iter_mut().zip(&self.scratch.correction) {
            *b += c;
        }
        core.cloud.offset_variance.copy_from_slice(&self.scratch.variance);
        self.scratch.evidence_nat = core.cloud.reweight_evidence(column);
        (Outcome::Fused, health)
    }

    /// Health monitor; true after an alarm, when the cloud was spread.
    pub(super) fn watch(&mut self, statistic: f64) -> bool {
        let (Some(monitor), Some(now_ns)) = (self.options.monitor, self.state.core.now_ns()) else {
            return false;
        };
        let state = &mut self.state;
        state.health += monitor.forgetting * (statistic.min(monitor.clip) - state.health);
        let since_s = state.last_alarm_ns.map_or(f64::INFINITY, |last| seconds(now_ns - last));
        if state.health <= monitor.alarm || since_s < monitor.quiet_s {
            return false;
        }
        let position_m = if since_s < monitor.repeat_s { monitor.repeat_spread_m } else { monitor.spread_m };
        let mut linear = [0.0; K];
        linear[..2].fill(monitor.spread_current_mps);
        let stream = state.core.next_stream(Purpose::Recovery);
        let cloud = &mut state.core.cloud;
        cloud.equalise();
        cloud.spread(position_m, linear, &stream);
        cloud.offset_variance.fill(self.options.sigma_offset0_m.powi(2));
        state.health = 1.0;
        state.alarms += 1;
        state.last_alarm_ns = Some(now_ns);
        true
    }

    fn resample(&mut self) {
        let core = &mut self.state.core;
        if core.cloud.ess() <= self.options.resample_share * core.cloud.len() as f64 {
            let stream = core.next_stream(Purpose::Resample);
            core.cloud.resample(&stream);
            let stream = core.next_stream(Purpose::Jitter);
            core.cloud.liu_west(&stream);
        }
    }

    fn reception(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Outcome {
        let Some(range) = self.options.range else { return Outcome::Noted };
        let standing_m2 = self.state.radio.standing_m2(&range.clock, tol_ns, toa_ns);
        let range = range.inflated(standing_m2);
        let Some(heard) = self.state.radio.receive(sender, tol_ns, toa_ns, bytes, range.sigma_m) else {
            self.state.core.rejected += 1;
            return Outcome::Rejected;
        };
        let share = self.new_share(sender, tol_ns, &heard, standing_m2);
        let outcome = self.state.core.range(&heard, toa_ns, &range.counting(share));
        if outcome == Outcome::Fused {
            self.state.range_novelty.heard(sender, tol_ns, heard.said.moments().1);
            self.resample();
        }
        outcome
    }
}

impl<const K: usize> Mpf<K> {
    /// Share of this belief that counts: all of it, or what is new beside a standing error.
    fn new_share(&self, sender: VehicleId, tol_ns: i64, heard: &HeardBelief, standing_m2: f64) -> f64 {
        let (true, Some(before_ns)) = (self.options.range_news, self.state.range_novelty.heard_at(sender))
        else {
            return 1.0;
        };
        let (theirs, covariance_m2) = heard.said.moments();
        let core = &self.state.core;
        let (own, _) = core.cloud.position_moments();
        let (de, dn) = (own[0] - theirs[0], own[1] - theirs[1]);
        let distance_m = de.hypot(dn).max(LEAST_DISTANCE_M);
        let direction = [de / distance_m, dn / distance_m];
        // A teammate drifts as this vehicle does: its packets have no room for more.
        let growth = core.growth(direction, seconds(tol_ns.saturating_sub(before_ns)));
        self.state.range_novelty.share(sender, covariance_m2, direction, &growth, standing_m2)
    }
}

impl MpfOptions {
    fn validate(&self) -> Result<(), Error> {
        positive("resample_share", self.resample_share)?;
        if let Some(sigma) = self.sigma_depth_m {
            positive("sigma_depth_m", sigma)?;
        }
        positive("sigma_offset0_m", self.sigma_offset0_m)?;
        non_negative("sigma_offset_m_per_sounding", self.sigma_offset_m_per_sounding)?;
        if self.student_dof.is_nan() || self.student_dof <= 0.0 {
            return Err(Error::OutOfBound {
                quantity: "student_dof",
                value: self.student_dof,
                bound: "above 0",
            });
        }
        if let Some(length) = self.correlation_length_m {
            non_negative("correlation_length_m", length)?;
        }
        if let Some(sigma) = self.sigma_map_m {
            non_negative("sigma_map_m", sigma)?;
        }
        non_negative("sounding_spacing_m", self.sounding_spacing_m)?;
        non_negative("least_ess_share", self.least_ess_share)?;
        if let Some(range) = &self.range {
            range.validate()?;
        }
        Ok(())
    }
}

impl Scratch {
    /// Log-likelihood of one sounding for each particle (NaN without a depth) and the offsets that would follow.
    fn weigh<const K: usize>(
        &mut self,
        model: &OffsetModel,
        cloud: &Cloud<K>,
        water_depth_m: f64,
        q_offset_m2: f64,
        column: &mut [f64],
    ) {
        let mut columns = SoundingColumns {
            depth_m: &self.depth,
            sigma_map_m: &self.sigma_map,
            offset_m: &cloud.offset,
            offset_variance_m2: &cloud.offset_variance,
            log_likelihood: column,
            correction_m: &mut self.correction,
            variance_m2: &mut self.variance,
            innovation_m: &mut self.innovation,
            innovation_variance_m2: &mut self.innovation_variance,
        };
        sounding_update(model, water_depth_m, q_offset_m2, &mut columns);
    }

    /// Standard deviation of the chart under each particle.
    fn sigma_map(&mut self, fixed_m: Option<f64>, chart: &Chart, east: &[f64], north: &[f64]) {
        match (fixed_m, chart.sigma_map()) {
            (Some(sigma), _) | (None, &SigmaMap::Uniform(sigma)) => self.sigma_map.fill(sigma),
            (None, SigmaMap::PerNode { .. }) => {
                for ((out, e), n) in self.sigma_map.iter_mut().zip(east).zip(north) {
                    *out = chart.sigma_map_at(*e, *n);
                }
            }
        }
    }

    /// ν̄² / (S + Var_w(h + b)) over the particles that have a chart.
    fn health(&self, log_likelihood: &[f64], weights: &[f64]) -> f64 {
        let (_, share) = known_share(log_likelihood, weights);
        // Innovation and its variance are zero for the others.
        let mean = weighted_mean(weights, &self.innovation) / share;
        let square = weighted_covariance(weights, &self.innovation, 0.0, &self.innovation, 0.0) / share;
        let spread = (square - mean * mean).max(0.0);
        let statistic = mean * mean / (weighted_mean(weights, &self.innovation_variance) / share + spread);
        if statistic.is_finite() { statistic } else { 0.0 }
    }

    /// Depth under each particle, NaN where there is none.
    fn look_up(&mut self, chart: &Chart, east: &[f64], north: &[f64]) {
        let n = east.len();
        for column in [
            &mut self.depth,
            &mut self.sigma_map,
            &mut self.correction,
            &mut self.variance,
            &mut self.innovation,
            &mut self.innovation_variance,
        ] {
            column.resize(n, 0.0);
        }
        let grid = chart.grid();
        self.here.set(&grid, std::iter::once([0.0, 0.0]));
        let depth = &mut self.depth;
        let inside = pattern_depths(&grid, &self.here, east, north, |first, count, _, depths| {
            for (out, d) in depth[first..first + count].iter_mut().zip(depths) {
                *out = f64::from(*d);
            }
        });
        if !inside {
            for ((out, e), n) in self.depth.iter_mut().zip(east).zip(north) {
                *out = bilinear(&grid, *e, *n);
            }
        }
    }
}

/// Whether enough particles would keep weight; a sounding that leaves a handful says more of the cloud than of the sea.
fn cloud_keeps<const K: usize>(cloud: &Cloud<K>, log_likelihood: &[f64], share: f64) -> bool {
    share <= 0.0 || cloud.ess_after(log_likelihood) >= share * cloud.len() as f64
}

impl<const K: usize> Navigator for Mpf<K> {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.state.core.now_ns())?;
        self.state.radio.check_sender(&event.payload)?;
        self.state.core.advance(event.t_ns);
        match &event.payload {
            Payload::Motion { velocity_mps } => {
                self.state.core.velocity_mps = *velocity_mps;
                Ok(Outcome::Fused)
            }
            Payload::Depth { depth_m, .. } => {
                self.state.radio.set_depth(*depth_m);
                Ok(Outcome::Fused)
            }
            Payload::Fix { position_m, covariance_m2 } => Ok(self.fix(*position_m, *covariance_m2)),
            Payload::WaterDepth { water_depth_m, sigma_m } => Ok(self.sounding(*water_depth_m, *sigma_m)),
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                Ok(self.reception(*sender, *tol_ns, *toa_ns, bytes))
            }
            _ => Ok(Outcome::Noted),
        }
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        if self.options.range.is_none() || !self.state.core.started() {
            return Ok(None);
        }
        let estimate = self.state.core.estimate(tol_ns);
        self.state.radio.broadcast(self.options.packet, &estimate, tol_ns, capacity_bytes).map(Some)
    }

    fn takes_ranges(&self) -> bool {
        self.options.range.is_some()
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        self.state.core.estimate(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.state)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let state: MpfState<K> = load(snapshot)?;
        self.state.core.check_same(&state.core)?;
        self.state.radio.check_same(&state.radio)?;
        self.state = state;
        Ok(())
    }

    fn particles(&self) -> Option<Particles> {
        self.state.core.particles()
    }

    fn information_nat(&self) -> f64 {
        self.state.core.information_nat
    }
}
