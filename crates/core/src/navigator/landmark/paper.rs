//! `landmark-paper`: the particle filter of Matsuda et al. (2017), every constant an option.
//!
//! A step reads like section II.C: predict (5)–(8) at the sensors' rate; at a positioning the likelihood (9)–(14), the
//! monitor (15)–(18), reconstruction (19)–(25) and resampling; at a role exchange section II.D.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::model::{Measurement, Monitor};
use super::odometry::held_velocity_drift_m2;
use super::paper_cloud::PaperCloud;
use super::paper_options::PaperOptions;
use super::role_exchange::RoleExchange;
use crate::error::Error;
use crate::event::{Event, GROUND_SPEED_MAX_MPS, Kind, Payload, VehicleId, seconds};
use crate::kernels::landmark::OdometryStep;
use crate::measurement::angle::wrap;
use crate::mixture::Mode;
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Kinds, Navigator, Outcome, Particles, Profile, Status, check_event};
use crate::random::{Purpose, Stream, Streams};

/// Kinds of events that the method reads beside positionings and packets.
const PAPER_KINDS: Kinds = Kinds::of(&[
    Kind::GroundVelocity,
    Kind::TurnRate,
    Kind::Fix,
    Kind::Heading,
    Kind::Depth,
    Kind::Landed,
    Kind::LiftedOff,
    Kind::RoleTaken,
]);

/// Numbers for pictures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct PaperCounts {
    pub(super) rejected: u64,
    pub(super) reconstructions: u64,
    pub(super) replaced: u64,
    pub(super) lows: u64,
    pub(super) log_mean: f64,
    pub(super) log_max: f64,
    pub(super) offsets: [f64; 3],
    pub(super) ess: f64,
    pub(super) modes: u64,
    pub(super) landmark: [f64; 3],
}

#[derive(Clone, Serialize, Deserialize)]
pub(super) struct PaperState {
    pub(super) now_ns: Option<i64>,
    pub(super) velocity_mps: [f64; 2],
    /// Since when that velocity holds: the last reading, the last lift-off, or the first event.
    pub(super) velocity_ns: i64,
    pub(super) yaw_rate_radps: f64,
    pub(super) landed: bool,
    pub(super) positioned: bool,
    pub(super) oriented: bool,
    pub(super) cloud: PaperCloud,
    pub(super) role_exchange: RoleExchange,
    pub(super) pending: Option<(VehicleId, Vec<Mode<6>>)>,
    pub(super) monitor: Monitor,
    pub(super) step: u32,
    pub(super) counts: PaperCounts,
}

/// The paper's navigator of one vehicle.
pub struct LandmarkPaper {
    own: VehicleId,
    pub(super) options: PaperOptions,
    streams: Streams,
    pub(super) state: PaperState,
}

impl LandmarkPaper {
    /// A navigator of vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] naming an option; [`Error::UnknownVehicle`].
    pub fn new(own: VehicleId, vehicles: usize, options: PaperOptions, seed: u64) -> Result<Self, Error> {
        options.validate()?;
        let state = PaperState {
            now_ns: None,
            velocity_mps: [0.0; 2],
            velocity_ns: 0,
            yaw_rate_radps: 0.0,
            landed: false,
            positioned: false,
            oriented: false,
            cloud: PaperCloud::new(options.particles, options.first_landmark),
            role_exchange: RoleExchange::new(own, vehicles)?,
            pending: None,
            monitor: Monitor::default(),
            step: 0,
            counts: PaperCounts {
                ess: options.particles as f64,
                landmark: options.first_landmark,
                ..PaperCounts::default()
            },
        };
        Ok(Self { own, options, streams: Streams::new(seed, own), state })
    }

    pub(super) fn stream(&mut self, purpose: Purpose) -> Stream {
        self.state.step = self.state.step.wrapping_add(1);
        self.streams.at(purpose, self.state.step)
    }

    /// (6), (8): what is measured, and how well by Table 4; where the DVL is silent, also how far the velocity may have
    /// walked away from the one held, which the paper leaves open.
    fn odometry(&self, from_ns: i64, to_ns: i64) -> OdometryStep {
        let dt_s = seconds(to_ns.saturating_sub(from_ns));
        let [forward, left] = self.state.velocity_mps;
        let [low, high] = self.options.speed_bounds_mps;
        let [constant, root] = self.options.sigma_velocity;
        let measured_mps = constant + root * forward.hypot(left).clamp(low, high).sqrt();
        let drift_m2 = held_velocity_drift_m2(self.state.velocity_ns, from_ns, to_ns);
        OdometryStep {
            velocity_mps: self.state.velocity_mps,
            sigma_mps: measured_mps.hypot(drift_m2.sqrt() / dt_s),
            yaw_rate_radps: self.state.yaw_rate_radps,
            sigma_radps: self.options.sigma_yaw_rate_radps,
            dt_s,
        }
    }

    fn advance(&mut self, t_ns: i64) {
        let Some(now_ns) = self.state.now_ns.replace(t_ns) else {
            self.state.velocity_ns = t_ns;
            return;
        };
        // A landed vehicle is not propagated and gets no noise.
        if t_ns <= now_ns || self.state.landed || !self.state.positioned {
            return;
        }
        let step = self.odometry(now_ns, t_ns);
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
}

impl Navigator for LandmarkPaper {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.state.now_ns)?;
        self.state.role_exchange.check(&event.payload)?;
        self.advance(event.t_ns);
        let outcome = match &event.payload {
            Payload::GroundVelocity { velocity_mps: [forward, left], .. }
                if forward.hypot(*left) > GROUND_SPEED_MAX_MPS =>
            {
                self.state.counts.rejected += 1;
                Outcome::Gated
            }
            Payload::GroundVelocity { velocity_mps, .. } => {
                self.state.velocity_mps = *velocity_mps;
                self.state.velocity_ns = event.t_ns;
                Outcome::Fused
            }
            Payload::TurnRate { yaw_rate_radps, .. } => {
                self.state.yaw_rate_radps = *yaw_rate_radps;
                Outcome::Fused
            }
            Payload::Fix { position_m, covariance_m2 } => self.fix(*position_m, *covariance_m2),
            Payload::Heading { yaw_rad, sigma_rad } => self.heading(*yaw_rad, *sigma_rad),
            Payload::AcousticFix {
                peer,
                transmit_ns,
                range_m,
                own_bearing_rad,
                peer_bearing_rad,
                peer_depth_m,
            } => {
                let sigma_m = self.options.acoustics.sigma[0];
                let measured = Measurement {
                    range_m: self.state.role_exchange.horizontal(*range_m, *peer_depth_m, sigma_m),
                    own_rad: *own_bearing_rad,
                    peer_rad: *peer_bearing_rad,
                };
                self.positioning(*peer, *transmit_ns, &measured)
            }
            Payload::Depth { depth_m, .. } => {
                self.state.role_exchange.depth_m = Some(*depth_m);
                Outcome::Fused
            }
            Payload::Landed => {
                self.state.landed = true;
                Outcome::Fused
            }
            Payload::LiftedOff => {
                self.state.landed = false;
                // It stood still until now, which was as good as a reading.
                self.state.velocity_ns = event.t_ns;
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
        let exchanges = &self.state.role_exchange;
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

    fn profile(&self) -> Profile {
        Profile {
            takes_ranges: false,
            has_checksum: self.options.packet.has_checksum(),
            needs_delivery_oracle: false,
            uses: PAPER_KINDS.with(Kind::AcousticFix, true).with(Kind::Reception, true),
        }
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
        let (mut mean, mut p) = state.cloud.moments();
        let now_ns = state.now_ns.unwrap_or(t_ns);
        let ahead_s = seconds(t_ns.saturating_sub(now_ns));
        if ahead_s > 0.0 && !state.landed {
            let (s, c) = mean.z.sin_cos();
            let [f, l] = state.velocity_mps;
            mean.x += (c * f - s * l) * ahead_s;
            mean.y += (s * f + c * l) * ahead_s;
            mean.z = wrap(mean.z + state.yaw_rate_radps * ahead_s);
            let drift_m2 = held_velocity_drift_m2(state.velocity_ns, now_ns, t_ns);
            p[(0, 0)] += drift_m2;
            p[(1, 1)] += drift_m2;
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
        let known = self.state.positioned && !self.state.role_exchange.is_landmark;
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
            ("packets_untold", self.state.role_exchange.untold as f64),
            ("landmark_e_m", landmark[0]),
            ("landmark_n_m", landmark[1]),
            ("landmark_yaw_rad", landmark[2]),
        ]
    }
}
