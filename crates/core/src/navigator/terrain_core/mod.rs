//! The terrain core of `mpf` and `team`: a marginalised particle filter whose particles also carry the datum offset
//! (tide). Absolute depth is used once per sounding, tempered by the distance over which the chart's error stays itself,
//! with Student tails; a health monitor spreads a cloud that no longer explains its soundings.

mod acquiring;
mod acquisition;
mod monitor;
mod noise_factor;
mod options;
mod search_region;
mod sounding;

pub use options::{MonitorOptions, TerrainOptions};

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Outcome;
use super::particle_core::ParticleCore;
use crate::chart::Chart;
use crate::error::Error;
use crate::event::{Event, Payload, VehicleId};
use crate::kernels::weights::{weighted_covariance, weighted_mean};
use crate::random::{Purpose, Streams};
use acquisition::Acquisition;
use noise_factor::NoiseFactor;
use search_region::SearchRegion;
use sounding::SoundingScratch;

/// The core, with K = 2 (current) or 4 (and compass and thrust bias) linear states.
pub struct TerrainCore<const K: usize> {
    /// Its options.
    pub options: TerrainOptions,
    /// The chart; without one it dead-reckons between fixes.
    pub chart: Option<Arc<Chart>>,
    /// What a snapshot holds.
    pub state: TerrainState<K>,
    scratch: SoundingScratch,
}

/// What determines the terrain core's next step.
#[derive(Serialize, Deserialize)]
pub struct TerrainState<const K: usize> {
    /// Particles, drift and clock.
    pub core: ParticleCore<K>,
    /// Travelled distance at the last sounding used, m.
    sounded_at_m: Option<f64>,
    health: f64,
    alarms: u64,
    last_alarm_ns: Option<i64>,
    noise: NoiseFactor,
    /// The search for the position, while it is known too little.
    acquisition: Option<Box<Acquisition<K>>>,
    /// Where the vehicle may be by its wide start and dead reckoning; none for one that never was acquired.
    region: Option<SearchRegion<K>>,
}

impl<const K: usize> TerrainCore<K> {
    /// The core of vehicle `own`.
    ///
    /// # Errors
    /// Options outside their bounds.
    pub fn new(
        own: VehicleId,
        options: TerrainOptions,
        chart: Option<Arc<Chart>>,
        seed: u64,
    ) -> Result<Self, Error> {
        options.validate()?;
        let mut core = ParticleCore::new(options.particles, options.drift, Streams::new(seed, own))?;
        if let Some(sigma_m) = options.update_entropy_sigma_m {
            core.cloud.measure_information(sigma_m);
        }
        core.cloud.add_offset();
        Ok(Self {
            options,
            chart,
            state: TerrainState {
                core,
                sounded_at_m: None,
                health: 1.0,
                alarms: 0,
                last_alarm_ns: None,
                noise: NoiseFactor::default(),
                acquisition: None,
                region: None,
            },
            scratch: SoundingScratch::default(),
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

    /// As the particle core, with the datum offset and the alarms.
    #[must_use]
    pub fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut columns = self.state.core.diagnostics();
        let (mean_m, variance_m2) =
            if self.state.core.started() { self.datum_offset() } else { (f64::NAN, f64::NAN) };
        columns.push(("datum_offset_m", mean_m));
        columns.push(("sigma_datum_offset_m", variance_m2.sqrt()));
        columns.push(("alarms", self.state.alarms as f64));
        columns.push(("depth_noise_factor", self.noise_factor()));
        columns
    }

    /// A fix up to its weights: resampling is left to the caller.
    pub fn weigh_fix(&mut self, position_m: [f64; 2], covariance_m2: [f64; 3]) -> Outcome {
        let core = &mut self.state.core;
        let (fresh, restarts) = (!core.started(), core.restarts);
        let outcome = core.fix(position_m, covariance_m2);
        if fresh {
            core.cloud.offset_variance.fill(self.options.sigma_offset0_m.powi(2));
        }
        if fresh || core.restarts != restarts {
            self.begin_at(position_m, covariance_m2);
        } else if outcome == Outcome::Fused {
            self.take_up_fix(position_m, covariance_m2);
        }
        outcome
    }

    /// Advances to an event that was checked, and takes up what concerns a filter that hears nobody.
    pub fn handle(&mut self, event: &Event) -> Outcome {
        self.advance(event.t_ns);
        match &event.payload {
            Payload::Motion { velocity_mps } => {
                self.state.core.set_velocity(*velocity_mps);
                Outcome::Fused
            }
            Payload::Fix { position_m, covariance_m2 } => {
                let outcome = self.weigh_fix(*position_m, *covariance_m2);
                self.resample();
                outcome
            }
            Payload::WaterDepth { water_depth_m, sigma_m } => {
                let (outcome, health) = self.weigh_sounding(*water_depth_m, *sigma_m);
                if let Some(statistic) = health
                    && !self.watch(statistic)
                {
                    self.resample();
                }
                outcome
            }
            _ => Outcome::Noted,
        }
    }

    /// How well the cloud explained the last sounding, before it took it up: ln Σ w exp(log-likelihood), nat. `None` where
    /// that was not weighed.
    #[must_use]
    pub fn evidence_nat(&self) -> Option<f64> {
        self.scratch.evidence_nat
    }

    /// The cloud, and what belongs to it, become those of `other`; counts stay.
    pub fn become_cloud_of(&mut self, other: &Self) {
        let (mine, theirs) = (&mut self.state, &other.state);
        let (rejected, restarts, nat) = (mine.core.rejected, mine.core.restarts, mine.core.information_nat);
        mine.core.become_core(&theirs.core);
        (mine.core.rejected, mine.core.restarts, mine.core.information_nat) = (rejected, restarts, nat);
        mine.sounded_at_m = theirs.sounded_at_m;
        mine.health = theirs.health;
        mine.last_alarm_ns = theirs.last_alarm_ns;
        mine.noise.clone_from(&theirs.noise);
        mine.acquisition.clone_from(&theirs.acquisition);
        mine.region.clone_from(&theirs.region);
    }

    /// Resamples where the weights call for it (14), and jitters on the joint state.
    pub fn resample(&mut self) {
        let core = &mut self.state.core;
        if core.cloud.ess() <= self.options.resample_share * core.cloud.len() as f64 {
            let stream = core.next_stream(Purpose::Resample);
            core.cloud.resample(&stream);
            let stream = core.next_stream(Purpose::Jitter);
            core.cloud.liu_west(&stream);
        }
    }
}
