//! Role exchanges of `landmark-paper`.

use std::f64::consts::PI;
use std::sync::Arc;

use super::joint_exchange::Pair;
use super::model::{Measurement, Monitor};
use super::paper::LandmarkPaper;
use super::paper_cloud::{Columns, moments};
use super::pose_algebra::difference;
use super::robust::PACKET_ANGLES;
use crate::error::Error;
use crate::event::VehicleId;
use crate::measurement::angle::wrap;
use crate::mixture::{Mode, select};
use crate::navigator::Outcome;
use crate::packet::PacketError;
use crate::random::Purpose;

/// A packet's landmark is believed within this of the own estimate of it, m, m, rad …
const REACH: [f64; 3] = [5.0, 5.0, 0.5];
/// … and so many sigmas of both, of which a packet's count up to the above.
const REACH_SIGMAS: f64 = 5.0;

impl LandmarkPaper {
    /// Another landmark answers; false if nothing is known of it and this positioning cannot place it.
    pub(super) fn change_landmark(&mut self, peer: VehicleId, measured: &Measurement) -> bool {
        let told = self.state.pending.take_if(|(sender, _)| *sender == peer);
        if let Some((_, modes)) = told {
            let stream = self.stream(Purpose::Belief);
            self.state.cloud.adopt_landmark(&modes, &stream);
        } else if self.state.role_exchange.landmark.is_some() || !self.state.role_exchange.first {
            let (Some(r), Some(own), Some(peer)) = (measured.range_m, measured.own_rad, measured.peer_rad)
            else {
                return false;
            };
            self.place_landmark([r, own, peer]);
        }
        self.state.role_exchange.landmark = Some(peer);
        self.state.role_exchange.first = false;
        self.state.monitor = Monitor::default();
        true
    }

    /// (23)–(25) solved for the landmark, for each particle: a landmark whose packet was lost.
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

    pub(super) fn reception(&mut self, sender: VehicleId, tol_ns: i64, bytes: &[u8]) -> Outcome {
        if !self.state.positioned {
            return Outcome::Noted;
        }
        let cloud = &self.state.cloud;
        let known = if self.state.role_exchange.is_landmark { &cloud.own } else { &cloud.landmark };
        let n = cloud.len() as f64;
        let near = [known[0].iter().sum::<f64>() / n, known[1].iter().sum::<f64>() / n];
        let packet = self.state.role_exchange.read(sender, tol_ns, bytes, near, &self.options.packet);
        let Some(packet) = packet else {
            self.state.counts.rejected += 1;
            return Outcome::Rejected;
        };
        if self.contradicts_landmark(&packet.modes) {
            self.state.counts.rejected += 1;
            return Outcome::Gated;
        }
        self.state.role_exchange.accept(sender, tol_ns);
        if self.state.role_exchange.is_landmark {
            let stream = self.stream(Purpose::Belief);
            self.state.cloud.become_landmark(&packet.modes, &stream);
            self.state.counts.landmark = moments(&self.state.cloud.landmark).0.into();
            self.state.role_exchange.landmark = Some(sender);
            self.state.role_exchange.first = false;
            return Outcome::Fused;
        }
        if self.state.role_exchange.landmark == Some(sender) {
            return Outcome::Noted;
        }
        self.state.pending = Some((sender, packet.modes));
        Outcome::Fused
    }

    /// Whether a packet's pose of the old landmark is out of reach of the own estimate of it, which the paper does not
    /// ask: a forged packet moved a vehicle by kilometres. The bound is wide, as the paper's cloud is often too sure.
    fn contradicts_landmark(&self, modes: &[Mode<6>]) -> bool {
        let Some(pair) = Pair::of(modes) else { return true };
        let cloud = &self.state.cloud;
        let known = if self.state.role_exchange.is_landmark { &cloud.own } else { &cloud.landmark };
        let (mean, covariance) = moments(known);
        let off = difference(&pair.landmark, &mean);
        !(0..3).all(|k| {
            let claimed = pair.covariance[(k, k)].max(0.0).sqrt().min(REACH[k]);
            off[k].abs() <= REACH[k] + REACH_SIGMAS * (covariance[(k, k)].max(0.0).sqrt() + claimed)
        })
    }

    pub(super) fn role(&mut self, landmark: bool) {
        let exchanges = &mut self.state.role_exchange;
        if landmark && !exchanges.is_landmark {
            exchanges.landmark = None;
            exchanges.first = false;
            self.state.pending = None;
        }
        exchanges.is_landmark = landmark;
        self.state.monitor = Monitor::default();
    }

    /// Section II.D: clustering with model selection at the packet's capacity.
    pub(super) fn launch(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
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
            let packet = self.state.role_exchange.packet(modes, &options, tol_ns);
            // Modes further apart than their fields: fewer of them, fitted anew.
            if count > 1 && matches!(packet, Err(PacketError::OutOfRange { .. })) {
                most = count - 1;
                continue;
            }
            let told = self.state.role_exchange.checked_packet(packet, capacity_bytes)?;
            if told.is_some() {
                self.state.counts.modes = count as u64;
            }
            return Ok(told);
        }
    }
}
