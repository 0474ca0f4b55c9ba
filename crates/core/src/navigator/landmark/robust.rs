//! `landmark`: alternating landmark with a Gaussian core, particles where that does not do, and recovery by consensus.
//!
//! Odometry is pre-integrated, so 5 Hz sensors cost next to nothing; work is done at a positioning, a packet or a role.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::consensus::Consensus;
use super::joint::{Channels, Correction, Joint, Pair, at_transmit, seen};
use super::jump::Jumps;
use super::link::Exchanges;
use super::model::{Measurement, offsets};
use super::odometry::{Increment, Odometer};
use super::options::LandmarkOptions;
use super::scatter::Scatter;
use crate::error::Error;
use crate::event::{Event, Payload, VehicleId};
use crate::mixture::{Mode, select};
use crate::navigator::common::{check_event, load, save};
use crate::navigator::{Estimate, Navigator, Outcome, Particles, Status};
use crate::noise::{Purpose, Stream, Streams};
use crate::packet::PacketError;

/// Which coordinates of a packet are angles.
pub const PACKET_ANGLES: [bool; 6] = [false, false, true, false, true, true];
/// A fix that contradicts the belief by more than this (χ² of two degrees of freedom, 5e-6) is gated.
const FIX_GATE: f64 = 24.0;
/// Variance of a yaw of which nothing is known: uniform on the circle.
const UNKNOWN_YAW: f64 = std::f64::consts::PI * std::f64::consts::PI / 3.0;

/// Gyro readings of a vehicle at rest: each is the bias and noise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Rest {
    information: f64,
    weighted_sum: f64,
}

impl Rest {
    fn add(&mut self, reading: f64, sigma: f64) {
        if sigma > 0.0 {
            self.information += 1.0 / (sigma * sigma);
            self.weighted_sum += reading / (sigma * sigma);
        }
    }

    /// Corrects the gyro's bias, where it is a state; the logarithm of the readings' density before that.
    fn apply(&self, joint: &mut Joint) -> f64 {
        if self.information <= 0.0 {
            return 0.0;
        }
        let mut row = nalgebra::SMatrix::<f64, 1, 9>::zeros();
        row[6] = 1.0;
        let innovation = self.weighted_sum / self.information - joint.mean[6];
        joint.update(innovation, &row, 1.0 / self.information, None).log_evidence
    }
}

/// The belief as it was broadcast, and what the gyro has said at rest since.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Sent {
    joint: Joint,
    rest: Rest,
}

/// Numbers for pictures and tables.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Counts {
    rejected: u64,
    resets: u64,
    core_changes: u64,
    outliers: [u64; 3],
    offsets: [f64; 3],
    believed: [f64; 3],
}

#[derive(Clone, Serialize, Deserialize)]
struct State {
    odometer: Odometer,
    joint: Joint,
    scatter: Option<Scatter>,
    positioned: bool,
    exchanges: Exchanges,
    sent: Option<Sent>,
    rest: Rest,
    pending: Option<(VehicleId, Pair)>,
    consensus: Consensus,
    jumps: Jumps,
    /// Logarithm of the density that the belief gave to what was measured.
    log_evidence: f64,
    step: u32,
    counts: Counts,
}

/// Alternating landmark of one vehicle, as mover, landmark or follower.
pub struct Landmark {
    own: VehicleId,
    options: LandmarkOptions,
    streams: Streams,
    state: State,
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
        let state = State {
            odometer: Odometer::default(),
            joint,
            scatter: None,
            positioned: false,
            exchanges: Exchanges::new(own, vehicles)?,
            sent: None,
            rest: Rest::default(),
            pending: None,
            consensus: Consensus::default(),
            jumps: Jumps::default(),
            log_evidence: 0.0,
            step: 0,
            counts: Counts::default(),
        };
        Ok(Self { own, options, streams: Streams::new(seed, own), state })
    }

    fn stream(&mut self, purpose: Purpose) -> Stream {
        self.state.step = self.state.step.wrapping_add(1);
        self.streams.at(purpose, self.state.step)
    }

    /// Brings the belief up to the odometer's time.
    fn settle(&mut self) {
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
            let rest = std::mem::take(&mut self.state.rest);
            let mut readings = 0.0;
            for joint in self.state.jumps.joints().chain([&mut self.state.joint]) {
                if moved {
                    joint.advance(&increment, walk);
                }
                readings = rest.apply(joint);
            }
            // The belief is the last of them.
            self.state.log_evidence += readings;
        }
    }

    fn fix(&mut self, position_m: [f64; 2], [ee, en, nn]: [f64; 3]) -> Outcome {
        self.settle();
        let joint = &mut self.state.joint;
        if !self.state.positioned {
            self.state.positioned = true;
            let yaw_variance = joint.own_covariance()[(2, 2)];
            let start = Matrix3::new(ee, en, 0.0, en, nn, 0.0, 0.0, 0.0, yaw_variance);
            joint.stand([position_m[0], position_m[1], joint.own()[2]], &start);
            return Outcome::Fused;
        }
        if !joint.fix(position_m, &nalgebra::Matrix2::new(ee, en, en, nn), FIX_GATE) {
            return self.gated();
        }
        self.state.scatter = None;
        self.state.jumps.clear();
        Outcome::Fused
    }

    fn heading(&mut self, yaw_rad: f64, sigma_rad: f64) -> Outcome {
        self.settle();
        let joint = &mut self.state.joint;
        let variance = (sigma_rad * sigma_rad).max(1e-12);
        let spread = joint.own_covariance();
        let own = joint.own();
        // Nothing was known: what the compass says is all there is.
        if spread[(2, 2)] >= UNKNOWN_YAW {
            let mut start = spread;
            start.fill_row(2, 0.0);
            start.fill_column(2, 0.0);
            start[(2, 2)] = variance;
            joint.stand([own[0], own[1], super::model::wrap(yaw_rad)], &start);
            return Outcome::Fused;
        }
        let innovation = super::model::wrap(yaw_rad - own[2]);
        if innovation * innovation > FIX_GATE * (spread[(2, 2)] + variance) {
            return self.gated();
        }
        let row = joint.own_rows().fixed_view::<1, 9>(2, 0).into_owned();
        joint.update(innovation, &row, variance, None);
        self.state.scatter = None;
        self.state.jumps.clear();
        Outcome::Fused
    }

    fn gated(&mut self) -> Outcome {
        self.state.counts.rejected += 1;
        Outcome::Gated
    }

    fn positioning(&mut self, peer: VehicleId, transmit_ns: i64, measured: &Measurement) -> Outcome {
        if !self.options.use_fixes || self.state.exchanges.is_landmark || !self.state.positioned {
            return Outcome::Noted;
        }
        self.settle();
        let delay = self.state.odometer.since_ns(transmit_ns);
        let placed = seen(measured, self.options.acoustics.sigma, &delay, &self.state.joint.bias());
        if self.state.exchanges.landmark != Some(peer)
            && let Some(outcome) = self.change_landmark(peer, placed)
        {
            return outcome;
        }
        self.choose_core();
        let joint = &self.state.joint;
        let at = at_transmit(joint.seen(), &delay, &joint.bias());
        self.state.counts.offsets = offsets(joint.seen(), at, [0.0; 3], measured);
        let outcome = match self.state.scatter {
            Some(_) => self.weigh(measured, &delay),
            None => self.correct(measured, &delay, placed.as_ref()),
        };
        if let (Some((pose, covariance)), Some(rule)) = (placed, self.options.consensus) {
            self.state.consensus.push(pose, covariance, &rule);
            let (belief, spread) = self.state.joint.relative();
            if let Some((pose, covariance)) = self.state.consensus.verdict(&belief, &spread, &rule) {
                self.state.joint.place_own(&pose, &covariance);
                self.state.scatter = None;
                self.state.consensus.clear();
                self.state.jumps.clear();
                self.state.counts.resets += 1;
                return Outcome::Fused;
            }
        }
        outcome
    }

    /// Another landmark answers: take up the packet about it, or place it as seen from here.
    fn change_landmark(
        &mut self,
        peer: VehicleId,
        placed: Option<(Vector3<f64>, Matrix3<f64>)>,
    ) -> Option<Outcome> {
        let told = self.state.pending.take_if(|(sender, _)| *sender == peer);
        if let Some((_, pair)) = told {
            self.gaussian();
            self.state.joint.follow(&pair);
        } else if self.state.exchanges.landmark.is_some() || !self.state.exchanges.first {
            let Some((pose, covariance)) = placed else { return Some(self.gated()) };
            self.gaussian();
            self.state.joint.place_landmark(&pose, &covariance);
            self.follow(peer);
            return Some(Outcome::Fused);
        }
        self.follow(peer);
        None
    }

    fn follow(&mut self, peer: VehicleId) {
        self.state.exchanges.landmark = Some(peer);
        self.state.exchanges.first = false;
        self.state.consensus.clear();
        self.state.jumps.clear();
    }

    /// Replaces particles by their moments.
    fn gaussian(&mut self) {
        if let Some(scatter) = self.state.scatter.take() {
            self.state.joint = scatter.joint();
            self.state.jumps.clear();
        }
    }

    /// Particles where the tangent of a positioning bends within the belief's spread, else a Gaussian.
    fn choose_core(&mut self) {
        if self.options.particles == 0 {
            return;
        }
        let polar = self.state.joint.polar();
        let bend = 0.5 * polar.mean[3] * polar.covariance[(4, 4)];
        let straight = bend <= self.options.bend_sigmas * self.options.acoustics.sigma[0]
            && polar.covariance[(5, 5)].sqrt() <= self.options.yaw_limit_rad;
        match &self.state.scatter {
            None if !straight => {
                let stream = self.stream(Purpose::Initial);
                let scatter = Scatter::of(&self.state.joint, self.options.particles, &stream);
                self.state.scatter = Some(scatter);
                self.state.jumps.clear();
                self.state.counts.core_changes += 1;
            }
            Some(scatter) if straight && scatter.kurtosis_ratio() <= self.options.kurtosis_limit => {
                self.gaussian();
                self.state.counts.core_changes += 1;
            }
            _ => {}
        }
    }

    /// The Gaussian core's update, and the alternatives to it.
    fn correct(
        &mut self,
        measured: &Measurement,
        delay: &Increment,
        placed: Option<&(Vector3<f64>, Matrix3<f64>)>,
    ) -> Outcome {
        let (sigma, outliers) = (self.options.acoustics.sigma, self.options.outliers);
        let channels = Channels { sigma, outliers };
        let before = self.state.joint.clone();
        let correction = self.state.joint.correct(measured, delay, &channels);
        let believed = correction.log_evidence;
        self.state.log_evidence += believed;
        let Some(rule) = self.options.jump else { return self.tally(&correction) };
        let State { jumps, joint, counts, log_evidence, .. } = &mut self.state;
        if let Some(gained) = jumps.weigh(joint, believed, measured, delay, &channels, &rule) {
            counts.resets += 1;
            *log_evidence += gained;
        } else if let (Some(placed), Some((_, widths))) = (placed, outliers) {
            jumps.found(&before, placed, believed, widths, &rule);
        }
        jumps.branch(joint, &rule);
        self.tally(&correction)
    }

    /// Counts what was believed of a positioning.
    fn tally(&mut self, correction: &Correction) -> Outcome {
        let counts = &mut self.state.counts;
        let (mut used, mut refused) = (false, false);
        for (channel, share) in correction.shares.into_iter().enumerate() {
            let Some(share) = share else { continue };
            counts.believed[channel] = share;
            if share < 0.5 {
                counts.outliers[channel] += 1;
                refused = true;
            } else {
                used = true;
            }
        }
        if refused {
            counts.rejected += 1;
        }
        match (used, refused) {
            (true, _) => Outcome::Fused,
            (false, true) => Outcome::Gated,
            (false, false) => Outcome::Noted,
        }
    }

    /// The particles' update.
    fn weigh(&mut self, measured: &Measurement, delay: &Increment) -> Outcome {
        let (acoustics, gate) = (self.options.acoustics, self.options.gate());
        let (jitter, draw) = (self.stream(Purpose::Jitter), self.stream(Purpose::Resample));
        let Some(scatter) = &mut self.state.scatter else { return Outcome::Noted };
        if !scatter.weigh(measured, delay, &acoustics, &gate) {
            return self.gated();
        }
        if scatter.ess() < self.options.resample_share * scatter.states.len() as f64 {
            let mut u0 = [0.0];
            draw.uniforms(0, &mut u0);
            scatter.resample(u0[0], self.options.roughening, &jitter);
        }
        self.state.joint = scatter.joint();
        Outcome::Fused
    }

    fn reception(&mut self, sender: VehicleId, tol_ns: i64, bytes: &[u8]) -> Outcome {
        if !self.options.use_fixes || !self.state.positioned {
            return Outcome::Noted;
        }
        let known = if self.state.exchanges.is_landmark {
            self.state.joint.own()
        } else {
            self.state.joint.landmark()
        };
        let packet =
            self.state.exchanges.receive(sender, tol_ns, bytes, [known[0], known[1]], &self.options.packet);
        let Some(pair) = packet.and_then(|p| Pair::of(&p.modes)) else {
            self.state.counts.rejected += 1;
            return Outcome::Rejected;
        };
        self.settle();
        if self.state.exchanges.is_landmark {
            self.gaussian();
            // A repeated packet replaces the one before: both stand on what was sent, not on each other.
            let sent = match &self.state.sent {
                Some(sent) => sent.clone(),
                None => Sent { joint: self.state.joint.clone(), rest: Rest::default() },
            };
            self.state.joint.take_over(&sent.joint, &pair);
            sent.rest.apply(&mut self.state.joint);
            self.state.sent = Some(sent);
            self.state.exchanges.landmark = Some(sender);
            self.state.exchanges.first = false;
            return Outcome::Fused;
        }
        if self.state.exchanges.landmark == Some(sender) {
            return Outcome::Noted;
        }
        self.state.pending = Some((sender, pair));
        Outcome::Fused
    }

    fn role(&mut self, landmark: bool) {
        self.settle();
        let was = self.state.exchanges.is_landmark;
        self.state.exchanges.is_landmark = landmark;
        if landmark && !was {
            // From now on only packets and the gyro at rest change the belief.
            self.gaussian();
            self.state.jumps.clear();
            if self.state.sent.is_none() {
                self.state.sent = Some(Sent { joint: self.state.joint.clone(), rest: Rest::default() });
            }
            self.state.exchanges.landmark = None;
            self.state.exchanges.first = false;
            self.state.pending = None;
        }
        if was && !landmark {
            self.state.sent = None;
            self.state.consensus.clear();
        }
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
            self.state.rest.add(reading, sigma);
            if let Some(sent) = &mut self.state.sent {
                sent.rest.add(reading, sigma);
            }
        }
        self.state.odometer.yaw_rate(reading, sigma);
    }

    /// Logarithm of the density that this filter gave to all that was measured.
    pub(super) fn log_evidence(&self) -> f64 {
        self.state.log_evidence
    }

    /// Whether this vehicle is to hand over: it stands, is not the landmark, and knows of one.
    pub(super) fn has_news(&self) -> bool {
        let exchanges = &self.state.exchanges;
        self.options.use_fixes
            && self.state.odometer.landed()
            && !exchanges.is_landmark
            && exchanges.landmark.is_some()
    }

    /// The belief up to now as modes for the packet.
    pub(super) fn modes(&mut self) -> Result<Vec<Mode<6>>, Error> {
        self.settle();
        let options = self.options.packet;
        let stream = self.stream(Purpose::Belief);
        let Some(scatter) = &self.state.scatter else { return Ok(vec![self.state.joint.polar()]) };
        let fitted = select(
            &scatter.polar(),
            &scatter.weights,
            PACKET_ANGLES,
            options.size.modes(),
            options.criterion,
            &options.fit,
            options.search_points,
            &stream,
        );
        let none = PacketError::NotDefinite { field: "belief of an exchange" };
        Ok(fitted.ok_or(none)?.modes)
    }

    /// Sends the modes, and keeps the belief for when the role comes back: its pose as it was told.
    pub(super) fn launch(
        &mut self,
        modes: Vec<Mode<6>>,
        tol_ns: i64,
        capacity_bytes: usize,
    ) -> Result<Option<Arc<[u8]>>, Error> {
        let pair = Pair::of(&modes);
        let packet = self.state.exchanges.packet(modes, &self.options.packet, tol_ns);
        let told = self.state.exchanges.told(packet, capacity_bytes)?;
        self.gaussian();
        let mut joint = self.state.joint.clone();
        if let Some(pair) = pair {
            joint.mean.fixed_rows_mut::<3>(0).copy_from(&pair.seen);
            joint.mean.fixed_rows_mut::<3>(3).copy_from(&pair.landmark);
        }
        self.state.sent = Some(Sent { joint, rest: Rest::default() });
        Ok(told)
    }

    /// A copy of the state, for [`Self::silent`].
    pub(super) fn kept(&self) -> Kept {
        Kept(Box::new(self.state.clone()))
    }

    /// Takes back a launch that came to nothing; that it did is counted.
    pub(super) fn silent(&mut self, before: Kept) {
        let untold = self.state.exchanges.untold;
        self.state = *before.0;
        self.state.exchanges.untold = untold;
    }
}

/// A state to return to.
pub(super) struct Kept(Box<State>);

impl Navigator for Landmark {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.state.odometer.now_ns())?;
        self.state.exchanges.check(&event.payload)?;
        self.state.odometer.advance(event.t_ns);
        let outcome = match &event.payload {
            Payload::GroundVelocity { velocity_mps, sigma_mps } => {
                self.state.odometer.velocity(*velocity_mps, *sigma_mps);
                Outcome::Fused
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
            Payload::AcousticFix { peer, transmit_ns, range_m, own_bearing_rad, peer_bearing_rad } => {
                let measured =
                    Measurement { range_m: *range_m, own_rad: *own_bearing_rad, peer_rad: *peer_bearing_rad };
                self.positioning(*peer, *transmit_ns, &measured)
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

    fn has_checksum(&self) -> bool {
        self.options.packet.is_sealed()
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let status = if self.state.positioned { Status::Navigating } else { Status::NotStarted };
        let mut joint = self.state.joint.clone();
        let increment = self.state.odometer.ahead(t_ns);
        if increment.dt_s > 0.0 {
            joint.advance(&increment, self.options.gyro_bias_walk);
        }
        self.state.rest.apply(&mut joint);
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
            ess: self.state.scatter.as_ref().map(Scatter::ess),
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
        let known = self.state.positioned && !self.state.exchanges.is_landmark;
        let landmark = if known { self.state.joint.landmark() } else { [f64::NAN; 3] };
        vec![
            ("core_particles", f64::from(u8::from(self.state.scatter.is_some()))),
            ("core_changes", c.core_changes as f64),
            ("resets", c.resets as f64),
            ("packets_untold", self.state.exchanges.untold as f64),
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
