//! Resampling of `team`: what belongs to a particle goes with it.

use super::Team;
use super::group::Widening;
use crate::event::seconds;
use crate::kernels::particles::liu_west_bandwidth;
use crate::kernels::weights::weighted_mean;
use crate::navigator::Status;
use crate::random::{Purpose, Stream};

/// A clock difference widens by no more than a position, m².
const MOST_WIDENED_M2: f64 = 100.0;

impl<const K: usize> Team<K> {
    /// Own positions, to know later how far each particle was moved.
    pub(super) fn remember_own(&mut self) {
        let cloud = &self.terrain.state.core.cloud;
        for (kept, now) in self.scratch.own.iter_mut().zip([&cloud.east, &cloud.north]) {
            kept.clear();
            kept.extend_from_slice(now);
        }
    }

    /// Where a particle was moves as the particle does.
    pub(super) fn move_past(&mut self) {
        let cloud = &self.terrain.state.core.cloud;
        self.state.history.shift(&self.scratch.own, &cloud.east, &cloud.north);
    }

    /// The own cloud was spread: what each particle knew of the teammates is pooled and widened.
    pub(super) fn forget(&mut self) {
        let clock_m2 = self.clock_widening_m2();
        for group in &mut self.state.groups {
            if let Some(vehicle) = group.members.first() {
                let drift = &self.options.drifts[usize::from(*vehicle)];
                let states = [
                    100.0,
                    100.0,
                    1.0,
                    0.01,
                    0.01,
                    drift.sigma_heading_bias0_rad.powi(2),
                    drift.sigma_thrust_bias0_mps.powi(2),
                ];
                group.forget(&Widening { states, clock_m2 }, None);
            }
        }
    }

    /// By how much clock differences widen when the own cloud has lost its way, m²: they have absorbed its error, but are
    /// no worse than the hardware allows.
    pub(super) fn clock_widening_m2(&self) -> f64 {
        let elapsed_s = self.terrain.state.core.now_ns().map_or(0.0, seconds);
        let prior = self.options.clock.prior(self.radio.sound_speed_mps, elapsed_s);
        prior.difference_m2.min(MOST_WIDENED_M2)
    }

    /// As `mpf`; teammates and launch positions go with their particle, and are jittered jointly with it.
    pub(super) fn resample(&mut self) {
        let core = &mut self.terrain.state.core;
        if core.cloud.ess() > self.terrain.options.resample_share * core.cloud.len() as f64 {
            return;
        }
        let stream = core.next_stream(Purpose::Resample);
        let terrain = self.terrain.chart.is_some() && core.status != Status::OffChart;
        let unseen = !terrain && self.state.groups.iter().any(|g| !g.members.is_empty());
        let kept = unseen.then(|| self.means());
        let core = &mut self.terrain.state.core;
        core.cloud.resample(&stream);
        let ancestors = core.cloud.ancestors();
        let column = &mut self.scratch.gathered;
        column.resize(ancestors.len(), 0.0);
        self.state.history.gather(ancestors, column);
        if let Some(current) = &mut self.state.current {
            current.gather(ancestors, column);
        }
        self.state.groups.iter_mut().for_each(|g| g.gather(ancestors));
        let stream = self.terrain.state.core.next_stream(Purpose::Jitter);
        self.jitter_groups(&stream);
        self.remember_own();
        self.terrain.state.core.cloud.liu_west(&stream);
        if let Some(kept) = kept {
            self.keep_means(&kept);
        }
        self.move_past();
    }

    /// Weighted mean of every column: own states, then the teammates'.
    pub(super) fn means(&self) -> Vec<f64> {
        let (cloud, n) = (&self.terrain.state.core.cloud, self.options.terrain.particles);
        let own = [&cloud.east, &cloud.north, &cloud.offset].into_iter().chain(&cloud.linear);
        let own = own.map(Vec::as_slice);
        let mates = self.state.groups.iter().flat_map(|g| g.mean.chunks(n));
        own.chain(mates).map(|column| weighted_mean(cloud.weights(), column)).collect()
    }

    /// Takes what chance did to the means in resampling back. Where no terrain holds the team in place, such errors would
    /// add up to metres: ranges do not see where all of it went.
    pub(super) fn keep_means(&mut self, kept: &[f64]) {
        let now = self.means();
        let n = self.options.terrain.particles;
        let cloud = &mut self.terrain.state.core.cloud;
        let own = [&mut cloud.east, &mut cloud.north, &mut cloud.offset].into_iter().chain(&mut cloud.linear);
        let own = own.map(Vec::as_mut_slice);
        let mates = self.state.groups.iter_mut().flat_map(|g| g.mean.chunks_mut(n));
        for ((column, kept), now) in own.chain(mates).zip(kept).zip(&now) {
            column.iter_mut().for_each(|x| *x += kept - now);
        }
    }

    /// The teammates' part of the joint jitter: the own part takes the same normals afterwards.
    pub(super) fn jitter_groups(&mut self, stream: &Stream) {
        if self.state.groups.iter().all(|g| g.members.is_empty()) {
            return;
        }
        let cloud = &self.terrain.state.core.cloud;
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
}
