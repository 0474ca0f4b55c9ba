//! Positionings of `landmark-paper`: weights, monitor, reconstruction, resampling.

use super::model::{
    Measurement, Pose, ancestors_among, least_likely, log_likelihood_max, log_likelihoods, log_mean_exp,
    mixture_scale, new_particles, offsets, reconstruct, survivors,
};
use super::paper::LandmarkPaper;
use super::paper_cloud::{Columns, moments};
use crate::event::VehicleId;
use crate::navigator::Outcome;
use crate::random::Purpose;

impl LandmarkPaper {
    /// The observation phase.
    pub(super) fn positioning(
        &mut self,
        peer: VehicleId,
        transmit_ns: i64,
        measured: &Measurement,
    ) -> Outcome {
        if self.state.role_exchange.is_landmark || !self.state.positioned {
            return Outcome::Noted;
        }
        if self.state.role_exchange.landmark != Some(peer) && !self.change_landmark(peer, measured) {
            self.state.counts.rejected += 1;
            return Outcome::Gated;
        }
        let scale = mixture_scale(measured, &self.options.acoustics, &self.options.gate);
        let log_max = log_likelihood_max(measured, &self.options.acoustics, &self.options.gate) + scale;
        if measured.present() == [false; 3] {
            return Outcome::Noted;
        }
        let at = self.state.cloud.at(transmit_ns);
        let logs = self.log_likelihood(&at, measured);
        let log_mean = log_mean_exp(&logs) + scale;
        self.note(log_mean, log_max, measured, &at);
        let ancestors = self.reconstruct(&logs, log_mean, log_max, measured, &at);
        match ancestors {
            Some(()) => Outcome::Fused,
            None => {
                self.state.counts.rejected += 1;
                Outcome::Gated
            }
        }
    }

    fn log_likelihood(&self, at: &Columns, measured: &Measurement) -> Vec<f64> {
        let cloud = &self.state.cloud;
        (0..cloud.len())
            .map(|i| {
                let there = [at[0][i], at[1][i], at[2][i]];
                let offsets = offsets(cloud.own_pose(i), there, cloud.landmark_pose(i), measured);
                let [ml, lm] = log_likelihoods(offsets, &self.options.acoustics, &self.options.gate);
                ml + lm
            })
            .collect()
    }

    /// Monitor, replacement of the least likely, resampling of the others; `None` if no particle fits at all.
    fn reconstruct(
        &mut self,
        logs: &[f64],
        log_mean: f64,
        log_max: f64,
        measured: &Measurement,
        at: &Columns,
    ) -> Option<()> {
        if !log_mean.is_finite() {
            return None;
        }
        let n = logs.len();
        let complete = match (measured.range_m, measured.own_rad, measured.peer_rad) {
            (Some(r), Some(own), Some(peer)) => Some([r, own, peer]),
            _ => None,
        };
        let mut replaced = Vec::new();
        if let Some(rule) = self.options.monitor {
            let (low, fire) = self.state.monitor.observe(log_mean, log_max, complete.is_some(), &rule);
            self.state.counts.lows += u64::from(low);
            if fire {
                let count = new_particles(n, self.options.replace_share, log_mean, log_max);
                replaced = least_likely(logs, count);
            }
        }
        let survivors = survivors(n, &replaced);
        let (draw, noise) = (self.stream(Purpose::Resample), self.stream(Purpose::Recovery));
        let mut u0 = [0.0];
        draw.uniforms(0, &mut u0);
        let ancestors = ancestors_among(&survivors, logs, u0[0], n);
        let before: Vec<(Pose, Pose)> = replaced
            .iter()
            .map(|i| *i as usize)
            .map(|i| (self.state.cloud.own_pose(i), [at[0][i], at[1][i], at[2][i]]))
            .collect();
        self.state.cloud.resample(&ancestors);
        let centre = log_mean_exp(logs);
        let sum: f64 = survivors.iter().map(|i| (logs[*i as usize] - centre).exp()).sum();
        let squares: f64 = survivors.iter().map(|i| (2.0 * (logs[*i as usize] - centre)).exp()).sum();
        self.state.counts.ess = sum * sum / squares;
        if let Some(values) = complete
            && !replaced.is_empty()
        {
            self.state.counts.reconstructions += 1;
            self.state.counts.replaced += replaced.len() as u64;
            let mut normals: Columns = std::array::from_fn(|_| vec![0.0; replaced.len()]);
            let [a, b, c] = &mut normals;
            noise.normal_pairs(0, a, b);
            noise.normal_pairs(1, c, &mut vec![0.0; replaced.len()]);
            for (k, (i, (old, old_at))) in replaced.iter().zip(before).enumerate() {
                let i = *i as usize;
                let drawn = [normals[0][k], normals[1][k], normals[2][k]];
                let landmark = self.state.cloud.landmark_pose(i);
                let sigma = self.options.acoustics.sigma;
                let pose = reconstruct(landmark, old, old_at, values, sigma, drawn);
                for (column, value) in self.state.cloud.own.iter_mut().zip(pose) {
                    column[i] = value;
                }
            }
        }
        Some(())
    }

    fn note(&mut self, log_mean: f64, log_max: f64, measured: &Measurement, at: &Columns) {
        let (own, _) = self.state.cloud.moments();
        let i = 0;
        let old = self.state.cloud.own_pose(i);
        let there = [own.x + at[0][i] - old[0], own.y + at[1][i] - old[1], own.z + at[2][i] - old[2]];
        let (landmark, _) = moments(&self.state.cloud.landmark);
        let counts = &mut self.state.counts;
        counts.landmark = landmark.into();
        counts.offsets = offsets(own.into(), there, landmark.into(), measured);
        counts.log_mean = log_mean;
        counts.log_max = log_max;
    }
}
