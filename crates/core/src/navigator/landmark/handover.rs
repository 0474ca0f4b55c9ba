//! Role exchanges of the robust navigator: the packets it sends, and the use of those it receives.

use std::sync::Arc;

use nalgebra::Vector3;

use super::broadcast_belief::SentBelief;
use super::joint_exchange::Pair;
use super::pose_algebra::difference;
use super::robust::{Landmark, LandmarkState, PACKET_ANGLES};
use super::stationary_gyro::StationaryGyro;
use crate::error::Error;
use crate::event::VehicleId;
use crate::mixture::{Mode, select};
use crate::navigator::Outcome;
use crate::packet::PacketError;
use crate::random::Purpose;

/// A packet whose landmark pose differs from the own estimate by more than this (χ² of three degrees of freedom,
/// 1e-6) is gated.
const EXCHANGE_GATE: f64 = 30.0;
/// Largest sigma of a packet's landmark that counts in the gate: so many times the receiver's own sigma, or this, m,
/// m, rad …
const CLAIMED_SIGMAS: f64 = 3.0;
const CLAIMED: [f64; 3] = [5.0, 5.0, 0.3];
/// … plus the sigma of rounding and of a landing.
const FLOOR: [f64; 3] = [0.5, 0.5, 0.03];

impl Landmark {
    pub(super) fn reception(&mut self, sender: VehicleId, tol_ns: i64, bytes: &[u8]) -> Outcome {
        if !self.options.use_fixes || !self.state.positioned {
            return Outcome::Noted;
        }
        let known = if self.state.role_exchange.is_landmark {
            self.state.joint.own()
        } else {
            self.state.joint.landmark()
        };
        let near_m = [known[0], known[1]];
        let packet = self.state.role_exchange.read(sender, tol_ns, bytes, near_m, &self.options.packet);
        let Some(pair) = packet.and_then(|p| Pair::of(&p.modes)) else {
            self.state.counts.rejected += 1;
            return Outcome::Rejected;
        };
        if self.contradicts_landmark(&pair) {
            return self.gated();
        }
        self.state.role_exchange.accept(sender, tol_ns);
        self.settle();
        if self.state.role_exchange.is_landmark {
            self.gaussian();
            // A repeated packet replaces the one before: both stand on what was sent, not on each other.
            let sent = match &self.state.sent {
                Some(sent) => sent.clone(),
                None => SentBelief { joint: self.state.joint.clone(), gyro: StationaryGyro::default() },
            };
            self.state.joint.become_landmark(&sent.joint, &pair);
            sent.gyro.apply(&mut self.state.joint);
            self.state.sent = Some(sent);
            self.state.role_exchange.landmark = Some(sender);
            self.state.role_exchange.first = false;
            return Outcome::Fused;
        }
        if self.state.role_exchange.landmark == Some(sender) {
            return Outcome::Noted;
        }
        self.state.pending = Some((sender, pair));
        Outcome::Fused
    }

    /// Whether a packet's pose of the old landmark contradicts the own estimate of it.
    ///
    /// Both estimates come partly from the same earlier packets, so the variance of their difference is at most twice
    /// the sum of both. The packet's own variance is bounded, so that a large one cannot open the gate.
    fn contradicts_landmark(&self, pair: &Pair) -> bool {
        let joint = match (&self.state.sent, self.state.role_exchange.is_landmark) {
            (Some(sent), true) => &sent.joint,
            _ => &self.state.joint,
        };
        let (known, covariance) = if self.state.role_exchange.is_landmark {
            (joint.own(), joint.own_covariance())
        } else {
            (joint.landmark(), joint.covariance.fixed_view::<3, 3>(3, 3).into_owned())
        };
        let claimed = pair.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let off = difference(&pair.landmark, &Vector3::from(known));
        let share = |k: usize| {
            let own = covariance[(k, k)];
            let most = (CLAIMED_SIGMAS * CLAIMED_SIGMAS * own).max(CLAIMED[k] * CLAIMED[k]);
            off[k] * off[k] / (2.0 * (own + claimed[(k, k)].clamp(0.0, most)) + FLOOR[k] * FLOOR[k])
        };
        let statistic = (0..3).map(share).sum::<f64>();
        // What is not a number contradicts.
        statistic.is_nan() || statistic > EXCHANGE_GATE
    }

    pub(super) fn role(&mut self, landmark: bool) {
        self.settle();
        let was = self.state.role_exchange.is_landmark;
        self.state.role_exchange.is_landmark = landmark;
        if landmark && !was {
            // From now on only packets and the gyro at rest change the belief.
            self.gaussian();
            self.state.jumps.clear();
            if self.state.sent.is_none() {
                self.state.sent =
                    Some(SentBelief { joint: self.state.joint.clone(), gyro: StationaryGyro::default() });
            }
            self.state.role_exchange.landmark = None;
            self.state.role_exchange.first = false;
            self.state.pending = None;
        }
        if was && !landmark {
            self.state.sent = None;
            self.state.consensus.clear();
        }
    }

    /// Logarithm of the density that this filter gave to all that was measured.
    pub(super) fn log_evidence(&self) -> f64 {
        self.state.log_evidence
    }

    /// Whether this vehicle is to take over the role: it has landed, is not the landmark, and has an estimate of one.
    pub(super) fn has_news(&self) -> bool {
        let exchanges = &self.state.role_exchange;
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
        let packet = self.state.role_exchange.packet(modes, &self.options.packet, tol_ns);
        let told = self.state.role_exchange.checked_packet(packet, capacity_bytes)?;
        self.gaussian();
        let mut joint = self.state.joint.clone();
        if let Some(pair) = pair {
            joint.mean.fixed_rows_mut::<3>(0).copy_from(&pair.seen);
            joint.mean.fixed_rows_mut::<3>(3).copy_from(&pair.landmark);
        }
        self.state.sent = Some(SentBelief { joint, gyro: StationaryGyro::default() });
        Ok(told)
    }

    /// A copy of the state, for [`Self::silent`].
    pub(super) fn kept(&self) -> Kept {
        Kept(Box::new(self.state.clone()))
    }

    /// Takes back a launch that came to nothing; that it did is counted.
    pub(super) fn silent(&mut self, before: Kept) {
        let untold = self.state.role_exchange.untold;
        self.state = *before.0;
        self.state.role_exchange.untold = untold;
    }
}

/// A state to return to.
pub(super) struct Kept(Box<LandmarkState>);
