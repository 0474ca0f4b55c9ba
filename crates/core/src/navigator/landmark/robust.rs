//! `landmark`: alternating landmark with a Gaussian core, particles where that does not do, and recovery by odds.
//!
//! Odometry is pre-integrated, so 5 Hz sensors cost next to nothing; work is done at a positioning, a packet or a role.

use std::sync::Arc;

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::absolute_sensors::UNKNOWN_YAW;
use super::broadcast_belief::SentBelief;
use super::consensus::Consensus;
use super::joint::Joint;
use super::joint_exchange::Pair;
use super::jump_hypotheses::JumpHypotheses;
use super::model::Measurement;
use super::odometry::Odometer;
use super::options::LandmarkOptions;
use super::particles::JointParticles;
use super::role_exchange::RoleExchange;
use super::stationary_gyro::StationaryGyro;
use crate::error::Error;
use crate::event::{Event, Kind, Payload, VehicleId};
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Kinds, Navigator, Outcome, Particles, Profile, Status, check_event};
use crate::random::{Purpose, Stream, Streams};

/// Which coordinates of a packet are angles.
pub const PACKET_ANGLES: [bool; 6] = [false, false, true, false, true, true];
/// Kinds of events that it reads beside positionings and packets.
const ROBUST_KINDS: Kinds = Kinds::of(&[
    Kind::GroundVelocity,
    Kind::TurnRate,
    Kind::Odometry,
    Kind::Fix,
    Kind::Heading,
    Kind::Depth,
    Kind::Landed,
    Kind::LiftedOff,
    Kind::RoleTaken,
]);

/// Numbers for pictures and tables.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Counts {
    pub(super) rejected: u64,
    pub(super) resets: u64,
    pub(super) core_changes: u64,
    pub(super) outliers: [u64; 3],
    pub(super) offsets: [f64; 3],
    pub(super) believed: [f64; 3],
}

#[derive(Clone, Serialize, Deserialize)]
pub(super) struct LandmarkState {
    pub(super) odometer: Odometer,
    pub(super) joint: Joint,
    pub(super) scatter: Option<JointParticles>,
    pub(super) positioned: bool,
    pub(super) role_exchange: RoleExchange,
    pub(super) sent: Option<SentBelief>,
    pub(super) stationary_gyro: StationaryGyro,
    pub(super) pending: Option<(VehicleId, Pair)>,
    pub(super) consensus: Consensus,
    pub(super) jumps: JumpHypotheses,
    /// Landmark and time of the last positioning, ns.
    pub(super) last_fix: Option<(VehicleId, i64)>,
    /// Logarithm of the predictive density of the measurements.
    pub(super) log_evidence: f64,
    pub(super) step: u32,
    pub(super) counts: Counts,
}

/// Alternating landmark of one vehicle, as mover, landmark or follower.
pub struct Landmark {
    pub(super) own: VehicleId,
    pub(super) options: LandmarkOptions,
    pub(super) streams: Streams,
    pub(super) state: LandmarkState,
}

impl Landmark {
    /// A navigator of vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// What [`LandmarkOptions::validate`] says; [`Error::UnknownVehicle`].
    pub fn new(own: VehicleId, vehicles: usize, options: LandmarkOptions, seed: u64) -> Result<Self, Error> {
        options.validate()?;
        let mut unknown = Matrix3::zeros();
        unknown[(2, 2)] = UNKNOWN_YAW;
        let joint = Joint::new([0.0; 3], &unknown, options.first_landmark, options.bias_sigma);
        let state = LandmarkState {
            odometer: Odometer::default(),
            joint,
            scatter: None,
            positioned: false,
            role_exchange: RoleExchange::new(own, vehicles)?,
            sent: None,
            stationary_gyro: StationaryGyro::default(),
            pending: None,
            consensus: Consensus::default(),
            jumps: JumpHypotheses::default(),
            last_fix: None,
            log_evidence: 0.0,
            step: 0,
            counts: Counts::default(),
        };
        Ok(Self { own, options, streams: Streams::new(seed, own), state })
    }

    pub(super) fn stream(&mut self, purpose: Purpose) -> Stream {
        self.state.step = self.state.step.wrapping_add(1);
        self.streams.at(purpose, self.state.step)
    }

    /// Brings the belief up to the odometer's time.
    pub(super) fn settle(&mut self) {
        let increment = self.state.odometer.take();
        let walk = self.options.gyro_bias_walk;
        let moved = increment.dt_s > 0.0;
        if moved {
            let bias = self.state.joint.bias();
            self.state.consensus.advance(&increment, &bias);
        }
        if self.state.scatter.is_some() {
            let stream = self.stream(Purpose::Process);
            if let Some(scatter) = &mut self.state.scatter {
                if moved {
                    scatter.advance(&increment, walk, &stream);
                }
                self.state.joint = scatter.joint();
            }
        } else {
            let gyro = std::mem::take(&mut self.state.stationary_gyro);
            let mut readings = 0.0;
            for joint in self.state.jumps.joints().chain([&mut self.state.joint]) {
                if moved {
                    joint.advance(&increment, walk);
                }
                readings = gyro.apply(joint);
            }
            // The belief is the last of them.
            self.state.log_evidence += readings;
        }
    }

    pub(super) fn gated(&mut self) -> Outcome {
        self.state.counts.rejected += 1;
        Outcome::Gated
    }

    fn land(&mut self) {
        self.settle();
        if self.state.odometer.land() {
            let [sigma_m, sigma_rad] = self.options.landing_sigma;
            self.gaussian();
            for joint in self.state.jumps.joints().chain([&mut self.state.joint]) {
                joint.disturb(sigma_m, sigma_rad);
            }
        }
    }

    fn turn_rate(&mut self, reading: f64, sigma: f64) {
        if self.state.odometer.landed() {
            self.state.stationary_gyro.add(reading, sigma);
            if let Some(sent) = &mut self.state.sent {
                sent.gyro.add(reading, sigma);
            }
        }
        self.state.odometer.yaw_rate(reading, sigma);
    }
}

impl Navigator for Landmark {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.state.odometer.now_ns())?;
        self.state.role_exchange.check(&event.payload)?;
        self.state.odometer.advance(event.t_ns);
        let outcome = match &event.payload {
            Payload::GroundVelocity { velocity_mps, sigma_mps } => {
                if self.state.odometer.velocity(*velocity_mps, *sigma_mps) {
                    Outcome::Fused
                } else {
                    self.gated()
                }
            }
            Payload::TurnRate { yaw_rate_radps, sigma_radps } => {
                self.turn_rate(*yaw_rate_radps, *sigma_radps);
                Outcome::Fused
            }
            Payload::Odometry { displacement_m, yaw_change_rad, covariance } => {
                self.state.odometer.odometry(*displacement_m, *yaw_change_rad, *covariance);
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
                self.land();
                Outcome::Fused
            }
            Payload::LiftedOff => {
                self.settle();
                self.state.odometer.lift_off();
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
        if !self.has_news() {
            return Ok(None);
        }
        let before = self.kept();
        let modes = self.modes();
        let launched = modes.and_then(|modes| self.launch(modes, tol_ns, capacity_bytes));
        if !matches!(launched, Ok(Some(_))) {
            self.silent(before);
        }
        launched
    }

    fn profile(&self) -> Profile {
        let exchanges = self.options.use_fixes;
        Profile {
            takes_ranges: false,
            has_checksum: self.options.packet.has_checksum(),
            needs_delivery_oracle: false,
            uses: ROBUST_KINDS.with(Kind::AcousticFix, exchanges).with(Kind::Reception, exchanges),
        }
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let status = if self.state.positioned { Status::Navigating } else { Status::NotStarted };
        let mut joint = self.state.joint.clone();
        let increment = self.state.odometer.ahead(t_ns);
        if increment.dt_s > 0.0 {
            joint.advance(&increment, self.options.gyro_bias_walk);
        }
        self.state.stationary_gyro.apply(&mut joint);
        let (own, p) = (joint.own(), joint.own_covariance());
        let (mean_m, covariance_m2) = if self.state.positioned {
            ([own[0], own[1]], [p[(0, 0)], p[(0, 1)], p[(1, 1)]])
        } else {
            ([f64::NAN; 2], [f64::INFINITY, 0.0, f64::INFINITY])
        };
        Estimate {
            t_ns,
            mean_m,
            covariance_m2,
            yaw: self.state.positioned.then(|| (own[2], [p[(2, 0)], p[(2, 1)], p[(2, 2)]])),
            ess: self.state.scatter.as_ref().map(JointParticles::ess),
            rejected: self.state.counts.rejected,
            status,
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
        let scatter = self.state.scatter.as_ref()?;
        let (east, north) = scatter.positions();
        Some(Particles { east, north, weights: scatter.weights.clone() })
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let c = &self.state.counts;
        let b = self.state.joint.bias();
        let known = self.state.positioned && !self.state.role_exchange.is_landmark;
        let landmark = if known { self.state.joint.landmark() } else { [f64::NAN; 3] };
        vec![
            ("core_particles", f64::from(u8::from(self.state.scatter.is_some()))),
            ("core_changes", c.core_changes as f64),
            ("resets", c.resets as f64),
            ("packets_untold", self.state.role_exchange.untold as f64),
            ("outliers_range", c.outliers[0] as f64),
            ("outliers_own_bearing", c.outliers[1] as f64),
            ("outliers_peer_bearing", c.outliers[2] as f64),
            ("offset_range_m", c.offsets[0]),
            ("offset_own_bearing_rad", c.offsets[1]),
            ("offset_peer_bearing_rad", c.offsets[2]),
            ("believed_range", c.believed[0]),
            ("believed_own_bearing", c.believed[1]),
            ("believed_peer_bearing", c.believed[2]),
            ("landmark_e_m", landmark[0]),
            ("landmark_n_m", landmark[1]),
            ("landmark_yaw_rad", landmark[2]),
            ("gyro_bias_radps", b.x),
            ("dvl_scale", b.y),
            ("dvl_misalignment_rad", b.z),
        ]
    }
}
