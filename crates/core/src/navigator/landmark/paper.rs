//! `landmark-paper`: the particle filter of Matsuda et al. (2017), every constant an option.
//!
//! A step reads like section II.C: predict (5)–(8) at the sensors' rate; at a positioning the likelihood (9)–(14), the
//! monitor (15)–(18), reconstruction (19)–(25) and resampling; at a role exchange section II.D.

use std::f64::consts::PI;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::link::Exchanges;
use super::model::{
    Acoustics, Gate, Measurement, Monitor, MonitorRule, Pose, ancestors_among, least_likely,
    log_likelihood_max, log_likelihoods, log_mean_exp, new_particles, offsets, reconstruct, survivors, wrap,
};
use super::options::{PacketOptions, check_mixture, check_share};
use super::paper_cloud::{Columns, PaperCloud, moments};
use super::robust::PACKET_ANGLES;
use crate::error::{Error, non_negative};
use crate::event::{Event, Payload, VehicleId};
use crate::kernels::landmark::OdometryStep;
use crate::mixture::{Mode, select};
use crate::navigator::common::{check_event, load, save, seconds};
use crate::navigator::{Estimate, Navigator, Outcome, Particles, Status};
use crate::noise::{Purpose, Stream, Streams};
use crate::packet::PacketError;

/// Options of `landmark-paper`. Defaults live with the Python model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperOptions {
    /// n.
    pub particles: usize,
    /// Standard deviations and outlier thresholds of the acoustic channels.
    pub acoustics: Acoustics,
    /// How outliers are kept from deciding.
    pub gate: Gate,
    /// Table 4: σ_v = constant + root · √|v|, m/s.
    pub sigma_velocity: [f64; 2],
    /// |v| is taken inside these bounds, m/s.
    pub speed_bounds_mps: [f64; 2],
    /// Table 4: σ_ω, rad/s.
    pub sigma_yaw_rate_radps: f64,
    /// Reconstruction; `None` as in the sea trial.
    pub monitor: Option<MonitorRule>,
    /// r of (19).
    pub replace_share: f64,
    /// The first landmark's pose.
    pub first_landmark: Pose,
    /// Exchange packet.
    pub packet: PacketOptions,
}

impl PaperOptions {
    fn validate(&self) -> Result<(), Error> {
        self.acoustics.validate()?;
        if let Gate::Mixture { share, widths } = self.gate {
            check_mixture(share, widths)?;
        }
        for (name, value) in [
            ("sigma_velocity_constant_mps", self.sigma_velocity[0]),
            ("sigma_velocity_root", self.sigma_velocity[1]),
            ("speed_min_mps", self.speed_bounds_mps[0]),
            ("speed_max_mps", self.speed_bounds_mps[1]),
            ("sigma_yaw_rate_radps", self.sigma_yaw_rate_radps),
        ] {
            non_negative(name, value)?;
        }
        check_share("replace_share", self.replace_share)?;
        if let Some(rule) = self.monitor {
            check_share("monitor_ratio", rule.ratio)?;
        }
        for value in self.first_landmark {
            crate::error::finite("pose of the first landmark", value)?;
        }
        let [low, high] = self.speed_bounds_mps;
        if low > high {
            return Err(Error::OutOfBound {
                quantity: "speed_min_mps",
                value: low,
                bound: "0 to speed_max_mps",
            });
        }
        if (10..=1_000_000).contains(&self.particles) {
            return Ok(());
        }
        Err(Error::OutOfBound {
            quantity: "particles",
            value: self.particles as f64,
            bound: "10 to 1,000,000",
        })
    }
}

/// Numbers for pictures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Counts {
    rejected: u64,
    reconstructions: u64,
    replaced: u64,
    lows: u64,
    log_mean: f64,
    log_max: f64,
    offsets: [f64; 3],
    ess: f64,
    modes: u64,
    landmark: [f64; 3],
}

#[derive(Clone, Serialize, Deserialize)]
struct State {
    now_ns: Option<i64>,
    velocity_mps: [f64; 2],
    yaw_rate_radps: f64,
    landed: bool,
    positioned: bool,
    oriented: bool,
    cloud: PaperCloud,
    exchanges: Exchanges,
    pending: Option<(VehicleId, Vec<Mode<6>>)>,
    monitor: Monitor,
    step: u32,
    counts: Counts,
}

/// The paper's navigator of one vehicle.
pub struct LandmarkPaper {
    own: VehicleId,
    options: PaperOptions,
    streams: Streams,
    state: State,
}

impl LandmarkPaper {
    /// A navigator of vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] naming an option; [`Error::UnknownVehicle`].
    pub fn new(own: VehicleId, vehicles: usize, options: PaperOptions, seed: u64) -> Result<Self, Error> {
        options.validate()?;
        let state = State {
            now_ns: None,
            velocity_mps: [0.0; 2],
            yaw_rate_radps: 0.0,
            landed: false,
            positioned: false,
            oriented: false,
            cloud: PaperCloud::new(options.particles, options.first_landmark),
            exchanges: Exchanges::new(own, vehicles)?,
            pending: None,
            monitor: Monitor::default(),
            step: 0,
            counts: Counts {
                ess: options.particles as f64,
                landmark: options.first_landmark,
                ..Counts::default()
            },
        };
        Ok(Self { own, options, streams: Streams::new(seed, own), state })
    }

    fn stream(&mut self, purpose: Purpose) -> Stream {
        self.state.step = self.state.step.wrapping_add(1);
        self.streams.at(purpose, self.state.step)
    }

    /// (6), (8): what is measured, and how well by Table 4.
    fn odometry(&self, dt_s: f64) -> OdometryStep {
        let [forward, left] = self.state.velocity_mps;
        let [low, high] = self.options.speed_bounds_mps;
        let [constant, root] = self.options.sigma_velocity;
        OdometryStep {
            velocity_mps: self.state.velocity_mps,
            sigma_mps: constant + root * forward.hypot(left).clamp(low, high).sqrt(),
            yaw_rate_radps: self.state.yaw_rate_radps,
            sigma_radps: self.options.sigma_yaw_rate_radps,
            dt_s,
        }
    }

    fn advance(&mut self, t_ns: i64) {
        let Some(now_ns) = self.state.now_ns.replace(t_ns) else { return };
        // A landed vehicle is not propagated and gets no noise.
        if t_ns <= now_ns || self.state.landed || !self.state.positioned {
            return;
        }
        let step = self.odometry(seconds(t_ns.saturating_sub(now_ns)));
        let stream = self.stream(Purpose::Process);
        self.state.cloud.predict(&step, now_ns, t_ns, &stream);
    }

    fn fix(&mut self, position_m: [f64; 2], covariance_m2: [f64; 3]) -> Outcome {
        if self.state.positioned {
            // The method knows no fixes after its deployment.
            return Outcome::Noted;
        }
        let stream = self.stream(Purpose::Initial);
        self.state.cloud.scatter_position(position_m, covariance_m2, &stream);
        if !self.state.oriented {
            self.state.cloud.spread_yaw();
        }
        self.state.positioned = true;
        Outcome::Fused
    }

    fn heading(&mut self, yaw_rad: f64, sigma_rad: f64) -> Outcome {
        if self.state.oriented {
            return Outcome::Noted;
        }
        let stream = self.stream(Purpose::Initial);
        self.state.cloud.scatter_yaw(yaw_rad, sigma_rad, &stream);
        self.state.oriented = true;
        Outcome::Fused
    }

    /// The observation phase.
    fn positioning(&mut self, peer: VehicleId, transmit_ns: i64, measured: &Measurement) -> Outcome {
        if self.state.exchanges.is_landmark || !self.state.positioned {
            return Outcome::Noted;
        }
        if self.state.exchanges.landmark != Some(peer) && !self.change_landmark(peer, measured) {
            self.state.counts.rejected += 1;
            return Outcome::Gated;
        }
        let log_max = log_likelihood_max(measured, &self.options.acoustics, &self.options.gate);
        if measured.present() == [false; 3] {
            return Outcome::Noted;
        }
        let at = self.state.cloud.at(transmit_ns);
        let logs = self.log_likelihood(&at, measured);
        let log_mean = log_mean_exp(&logs);
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
            let (low, fire) = self.state.monitor.observe(log_mean, log_max, &rule);
            self.state.counts.lows += u64::from(low);
            if fire && complete.is_some() {
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
        let sum: f64 = survivors.iter().map(|i| (logs[*i as usize] - log_mean).exp()).sum();
        let squares: f64 = survivors.iter().map(|i| (2.0 * (logs[*i as usize] - log_mean)).exp()).sum();
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

    /// Another landmark answers; false if nothing is known of it and this positioning cannot place it.
    fn change_landmark(&mut self, peer: VehicleId, measured: &Measurement) -> bool {
        let told = self.state.pending.take_if(|(sender, _)| *sender == peer);
        if let Some((_, modes)) = told {
            let stream = self.stream(Purpose::Belief);
            self.state.cloud.follow(&modes, &stream);
        } else if self.state.exchanges.landmark.is_some() || !self.state.exchanges.first {
            let (Some(r), Some(own), Some(peer)) = (measured.range_m, measured.own_rad, measured.peer_rad)
            else {
                return false;
            };
            self.place_landmark([r, own, peer]);
        }
        self.state.exchanges.landmark = Some(peer);
        self.state.exchanges.first = false;
        self.state.monitor = Monitor::default();
        true
    }

    /// (23)–(25) solved for the landmark: one that nobody told of, as every particle sees it.
    fn place_landmark(&mut self, values: [f64; 3]) {
        let stream = self.stream(Purpose::Belief);
        let n = self.state.cloud.len();
        let mut normals: Columns = std::array::from_fn(|_| vec![0.0; n]);
        let [a, b, c] = &mut normals;
        stream.normal_pairs(0, a, b);
        stream.normal_pairs(1, c, &mut vec![0.0; n]);
        for i in 0..n {
            let [r, own, peer] =
                std::array::from_fn(|k| values[k] + self.options.acoustics.sigma[k] * normals[k][i]);
            let pose = self.state.cloud.own_pose(i);
            let yaw = wrap(pose[2] - peer + own + PI);
            let (s, c) = (yaw + peer).sin_cos();
            let landmark = &mut self.state.cloud.landmark;
            landmark[0][i] = pose[0] - r * c;
            landmark[1][i] = pose[1] - r * s;
            landmark[2][i] = yaw;
        }
    }

    fn reception(&mut self, sender: VehicleId, tol_ns: i64, bytes: &[u8]) -> Outcome {
        if !self.state.positioned {
            return Outcome::Noted;
        }
        let cloud = &self.state.cloud;
        let known = if self.state.exchanges.is_landmark { &cloud.own } else { &cloud.landmark };
        let n = cloud.len() as f64;
        let near = [known[0].iter().sum::<f64>() / n, known[1].iter().sum::<f64>() / n];
        let packet = self.state.exchanges.receive(sender, tol_ns, bytes, near, &self.options.packet);
        let Some(packet) = packet else {
            self.state.counts.rejected += 1;
            return Outcome::Rejected;
        };
        if self.state.exchanges.is_landmark {
            let stream = self.stream(Purpose::Belief);
            self.state.cloud.take_over(&packet.modes, &stream);
            self.state.counts.landmark = moments(&self.state.cloud.landmark).0.into();
            self.state.exchanges.landmark = Some(sender);
            self.state.exchanges.first = false;
            return Outcome::Fused;
        }
        if self.state.exchanges.landmark == Some(sender) {
            return Outcome::Noted;
        }
        self.state.pending = Some((sender, packet.modes));
        Outcome::Fused
    }

    fn role(&mut self, landmark: bool) {
        let exchanges = &mut self.state.exchanges;
        if landmark && !exchanges.is_landmark {
            exchanges.landmark = None;
            exchanges.first = false;
            self.state.pending = None;
        }
        exchanges.is_landmark = landmark;
        self.state.monitor = Monitor::default();
    }

    /// Section II.D: clustering with model selection at the packet's capacity.
    fn launch(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        let options = self.options.packet;
        let polar = self.state.cloud.polar();
        let weights = vec![1.0 / polar.len() as f64; polar.len()];
        let stream = self.stream(Purpose::Belief);
        let mut most = options.size.modes();
        loop {
            let fitted = select(
                &polar,
                &weights,
                PACKET_ANGLES,
                most,
                options.criterion,
                &options.fit,
                options.search_points,
                &stream,
            );
            let modes = fitted.map(|f| f.modes).unwrap_or_default();
            let count = modes.len();
            let packet = self.state.exchanges.packet(modes, &options, tol_ns);
            // Modes further apart than their fields: fewer of them, fitted anew.
            if count > 1 && matches!(packet, Err(PacketError::OutOfRange { .. })) {
                most = count - 1;
                continue;
            }
            let told = self.state.exchanges.told(packet, capacity_bytes)?;
            if told.is_some() {
                self.state.counts.modes = count as u64;
            }
            return Ok(told);
        }
    }
}

impl Navigator for LandmarkPaper {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.state.now_ns)?;
        self.state.exchanges.check(&event.payload)?;
        self.advance(event.t_ns);
        let outcome = match &event.payload {
            Payload::GroundVelocity { velocity_mps, .. } => {
                self.state.velocity_mps = *velocity_mps;
                Outcome::Fused
            }
            Payload::TurnRate { yaw_rate_radps, .. } => {
                self.state.yaw_rate_radps = *yaw_rate_radps;
                Outcome::Fused
            }
            Payload::Fix { position_m, covariance_m2 } => self.fix(*position_m, *covariance_m2),
            Payload::Heading { yaw_rad, sigma_rad } => self.heading(*yaw_rad, *sigma_rad),
            Payload::AcousticFix { peer, transmit_ns, range_m, own_bearing_rad, peer_bearing_rad } => {
                let measured =
                    Measurement { range_m: *range_m, own_rad: *own_bearing_rad, peer_rad: *peer_bearing_rad };
                self.positioning(*peer, *transmit_ns, &measured)
            }
            Payload::Landed => {
                self.state.landed = true;
                Outcome::Fused
            }
            Payload::LiftedOff => {
                self.state.landed = false;
                Outcome::Fused
            }
            Payload::RoleTaken { landmark } => {
                self.role(*landmark);
                Outcome::Fused
            }
            Payload::Reception { sender, tol_ns, bytes, .. } => self.reception(*sender, *tol_ns, bytes),
            _ => Outcome::Noted,
        };
        Ok(outcome)
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        let exchanges = &self.state.exchanges;
        if !self.state.landed || exchanges.is_landmark || exchanges.landmark.is_none() {
            return Ok(None);
        }
        let step = self.state.step;
        let launched = self.launch(tol_ns, capacity_bytes);
        if !matches!(launched, Ok(Some(_))) {
            self.state.step = step;
        }
        launched
    }

    fn has_checksum(&self) -> bool {
        self.options.packet.is_sealed()
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let state = &self.state;
        if !state.positioned {
            return Estimate {
                t_ns,
                mean_m: [f64::NAN; 2],
                covariance_m2: [f64::INFINITY, 0.0, f64::INFINITY],
                yaw: None,
                ess: None,
                rejected: state.counts.rejected,
                status: Status::NotStarted,
            };
        }
        let (mut mean, p) = state.cloud.moments();
        let ahead_s = state.now_ns.map_or(0.0, |now| seconds(t_ns.saturating_sub(now)));
        if ahead_s > 0.0 && !state.landed {
            let (s, c) = mean.z.sin_cos();
            let [f, l] = state.velocity_mps;
            mean.x += (c * f - s * l) * ahead_s;
            mean.y += (s * f + c * l) * ahead_s;
            mean.z = wrap(mean.z + state.yaw_rate_radps * ahead_s);
        }
        Estimate {
            t_ns,
            mean_m: [mean.x, mean.y],
            covariance_m2: [p[(0, 0)], p[(0, 1)], p[(1, 1)]],
            yaw: Some((mean.z, [p[(2, 0)], p[(2, 1)], p[(2, 2)]])),
            ess: Some(state.counts.ess),
            rejected: state.counts.rejected,
            status: Status::Navigating,
        }
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.state)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.state = load(snapshot)?;
        Ok(())
    }

    fn particles(&self) -> Option<Particles> {
        let cloud = &self.state.cloud;
        self.state.positioned.then(|| Particles {
            east: cloud.own[0].clone(),
            north: cloud.own[1].clone(),
            weights: vec![1.0 / cloud.len() as f64; cloud.len()],
        })
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let c = &self.state.counts;
        let known = self.state.positioned && !self.state.exchanges.is_landmark;
        let landmark = if known { c.landmark } else { [f64::NAN; 3] };
        vec![
            ("likelihood_log_mean", c.log_mean),
            ("likelihood_log_max", c.log_max),
            ("lows", c.lows as f64),
            ("reconstructions", c.reconstructions as f64),
            ("replaced", c.replaced as f64),
            ("offset_range_m", c.offsets[0]),
            ("offset_own_bearing_rad", c.offsets[1]),
            ("offset_peer_bearing_rad", c.offsets[2]),
            ("packet_modes", c.modes as f64),
            ("packets_untold", self.state.exchanges.untold as f64),
            ("landmark_e_m", landmark[0]),
            ("landmark_n_m", landmark[1]),
            ("landmark_yaw_rad", landmark[2]),
        ]
    }
}
