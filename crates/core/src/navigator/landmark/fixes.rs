//! Positionings of the robust navigator: which landmark, which core, what is believed.

use nalgebra::{Matrix3, Vector3};

use super::joint::{Channels, Correction};
use super::model::{Acoustics, Measurement, offsets};
use super::odometry::Increment;
use super::particles::JointParticles;
use super::pose_algebra::{at_transmit, seen};
use super::robust::{Landmark, LandmarkState};
use crate::event::{VehicleId, seconds};
use crate::navigator::Outcome;
use crate::random::Purpose;

/// Positionings closer in time are one, s.
const SHORTEST_S: f64 = 1e-3;

impl Landmark {
    pub(super) fn positioning(
        &mut self,
        peer: VehicleId,
        transmit_ns: i64,
        measured: &Measurement,
    ) -> Outcome {
        if !self.options.use_fixes || self.state.role_exchange.is_landmark || !self.state.positioned {
            return Outcome::Noted;
        }
        self.settle();
        let delay = self.state.odometer.since_ns(transmit_ns);
        let acoustics = self.acoustics_of(peer);
        let placed = seen(measured, self.options.acoustics.sigma, &delay, &self.state.joint.bias());
        if self.state.role_exchange.landmark != Some(peer)
            && let Some(outcome) = self.change_landmark(peer, placed)
        {
            return outcome;
        }
        self.choose_core();
        let joint = &self.state.joint;
        let at = at_transmit(joint.seen(), &delay, &joint.bias());
        self.state.counts.offsets = offsets(joint.seen(), at, [0.0; 3], measured);
        let outcome = match self.state.scatter {
            Some(_) => self.weigh(measured, &delay, &acoustics),
            None => self.correct(measured, &delay, placed.as_ref(), &acoustics),
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

    /// The channels' sigmas for a positioning by `peer` now. Where its errors last, those of positionings that follow each
    /// other are one and the same: each counts as one of n = 2 τ/Δt that repeat it.
    fn acoustics_of(&mut self, peer: VehicleId) -> Acoustics {
        let mut acoustics = self.options.acoustics;
        let Some(now_ns) = self.state.odometer.now_ns() else { return acoustics };
        let last = self.state.last_fix.replace((peer, now_ns));
        if let Some((_, last_ns)) = last.filter(|(by, _)| *by == peer) {
            let since_s = seconds(now_ns.saturating_sub(last_ns)).max(SHORTEST_S);
            let repeats = (2.0 * self.options.fix_correlation_s / since_s).max(1.0);
            acoustics.sigma = acoustics.sigma.map(|sigma| sigma * repeats.sqrt());
        }
        acoustics
    }

    /// Another landmark answers: take up the packet about it, or place it as seen from here.
    pub(super) fn change_landmark(
        &mut self,
        peer: VehicleId,
        placed: Option<(Vector3<f64>, Matrix3<f64>)>,
    ) -> Option<Outcome> {
        let told = self.state.pending.take_if(|(sender, _)| *sender == peer);
        if let Some((_, pair)) = told {
            self.gaussian();
            self.state.joint.adopt_landmark(&pair);
        } else if self.state.role_exchange.landmark.is_some() || !self.state.role_exchange.first {
            let Some((pose, covariance)) = placed else { return Some(self.gated()) };
            self.gaussian();
            self.state.joint.place_landmark(&pose, &covariance);
            self.adopt_landmark(peer);
            return Some(Outcome::Fused);
        }
        self.adopt_landmark(peer);
        None
    }

    pub(super) fn adopt_landmark(&mut self, peer: VehicleId) {
        self.state.role_exchange.landmark = Some(peer);
        self.state.role_exchange.first = false;
        self.state.consensus.clear();
        self.state.jumps.clear();
    }

    /// Replaces particles by their moments.
    pub(super) fn gaussian(&mut self) {
        if let Some(scatter) = self.state.scatter.take() {
            self.state.joint = scatter.joint();
            self.state.jumps.clear();
        }
    }

    /// Particles where the tangent of a positioning bends within the belief's spread, else a Gaussian.
    pub(super) fn choose_core(&mut self) {
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
                let scatter = JointParticles::of(&self.state.joint, self.options.particles, &stream);
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
    pub(super) fn correct(
        &mut self,
        measured: &Measurement,
        delay: &Increment,
        placed: Option<&(Vector3<f64>, Matrix3<f64>)>,
        acoustics: &Acoustics,
    ) -> Outcome {
        let (sigma, outliers) = (acoustics.sigma, self.options.outliers);
        let channels = Channels { sigma, outliers };
        let before = self.state.joint.clone();
        let correction = self.state.joint.correct(measured, delay, &channels);
        let believed = correction.log_evidence;
        self.state.log_evidence += believed;
        let Some(rule) = self.options.jump else { return self.tally(&correction) };
        let LandmarkState { jumps, joint, counts, log_evidence, .. } = &mut self.state;
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
    pub(super) fn tally(&mut self, correction: &Correction) -> Outcome {
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
    pub(super) fn weigh(
        &mut self,
        measured: &Measurement,
        delay: &Increment,
        acoustics: &Acoustics,
    ) -> Outcome {
        let gate = self.options.gate();
        let (jitter, draw) = (self.stream(Purpose::Jitter), self.stream(Purpose::Resample));
        let Some(scatter) = &mut self.state.scatter else { return Outcome::Noted };
        if !scatter.weigh(measured, delay, acoustics, &gate) {
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
}
