//! What navigators share: their clock, their radio, and the marginalised particle core of `dmpf` and `mpf`.

use std::sync::Arc;

use nalgebra::{Matrix2, SMatrix, Vector2};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::news::Growth;
use super::trajectory::Trajectory;
use super::{Estimate, Outcome, Particles, Status};
use crate::cloud::Cloud;
use crate::error::{Error, non_negative};
use crate::event::{Event, Payload, VehicleId};
use crate::kernels::particles::{MAX_LINEAR, Step, displacement_map, prepare_step};
use crate::kernels::weights::{known_share, weighted_covariance};
use crate::link::{ReceiveWindow, Sequencer, range_m, slant_to_horizontal};
use crate::noise::{Purpose, Stream, Streams};
use crate::packet::{
    Belief, BeliefPacket, CloudPacket, Header, HeardBitmap, MixturePacket, PacketKind, open,
};

/// Nanoseconds to seconds.
#[must_use]
pub fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// State to bytes.
///
/// # Errors
/// [`Error::Snapshot`].
pub fn save<T: Serialize>(state: &T) -> Result<Vec<u8>, Error> {
    postcard::to_stdvec(state).map_err(|e| Error::Snapshot(e.to_string()))
}

/// Bytes to state.
///
/// # Errors
/// [`Error::Snapshot`].
pub fn load<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Error> {
    postcard::from_bytes(bytes).map_err(|e| Error::Snapshot(e.to_string()))
}

/// Whose event it is and whether it is in order, before anything changes.
///
/// # Errors
/// [`Error::WrongVehicle`], [`Error::FromThePast`], or what [`crate::event::Payload::validate`] says.
pub fn check_event(event: &Event, own: VehicleId, now_ns: Option<i64>) -> Result<(), Error> {
    if event.vehicle != own {
        return Err(Error::WrongVehicle { event: event.vehicle, own });
    }
    if let Some(now_ns) = now_ns
        && event.t_ns < now_ns
    {
        return Err(Error::FromThePast { event_ns: event.t_ns, now_ns });
    }
    event.payload.validate()
}

/// Refuses a sender that is the receiver itself, or that the team does not have.
///
/// # Errors
/// [`Error::WrongVehicle`], [`Error::UnknownVehicle`].
pub fn check_sender(sender: VehicleId, own: VehicleId, vehicles: usize) -> Result<(), Error> {
    if sender == own {
        return Err(Error::WrongVehicle { event: sender, own });
    }
    if usize::from(sender) >= vehicles {
        return Err(Error::UnknownVehicle { vehicle: sender, count: vehicles });
    }
    Ok(())
}

/// How a vehicle's dead reckoning drifts. Random walks are per root second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// White velocity noise as a walk of the position, m/√s.
    pub sigma_position_m_per_sqrt_s: f64,
    /// Walk of the current, m/s/√s.
    pub sigma_current_mps_per_sqrt_s: f64,
    /// Prior of the current per axis, m/s.
    pub sigma_current0_mps: f64,
    /// Prior of the compass bias, rad.
    pub sigma_heading_bias0_rad: f64,
    /// Its walk, rad/√s.
    pub sigma_heading_bias_rad_per_sqrt_s: f64,
    /// Prior of the thrust bias, m/s.
    pub sigma_thrust_bias0_mps: f64,
    /// Its walk, m/s/√s.
    pub sigma_thrust_bias_mps_per_sqrt_s: f64,
}

impl Drift {
    /// Refuses what is not finite or below zero.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        non_negative("sigma_position_m_per_sqrt_s", self.sigma_position_m_per_sqrt_s)?;
        non_negative("sigma_current_mps_per_sqrt_s", self.sigma_current_mps_per_sqrt_s)?;
        non_negative("sigma_current0_mps", self.sigma_current0_mps)?;
        non_negative("sigma_heading_bias0_rad", self.sigma_heading_bias0_rad)?;
        non_negative("sigma_heading_bias_rad_per_sqrt_s", self.sigma_heading_bias_rad_per_sqrt_s)?;
        non_negative("sigma_thrust_bias0_mps", self.sigma_thrust_bias0_mps)?;
        non_negative("sigma_thrust_bias_mps_per_sqrt_s", self.sigma_thrust_bias_mps_per_sqrt_s)?;
        Ok(())
    }

    /// Prior covariance of the linear states.
    #[must_use]
    pub fn prior<const K: usize>(&self) -> SMatrix<f64, K, K> {
        let sigmas = [
            self.sigma_current0_mps,
            self.sigma_current0_mps,
            self.sigma_heading_bias0_rad,
            self.sigma_thrust_bias0_mps,
        ];
        SMatrix::from_fn(|r, c| if r == c { sigmas[r] * sigmas[r] } else { 0.0 })
    }

    /// Process noise of the linear states over `dt_s`.
    #[must_use]
    pub fn walk<const K: usize>(&self, dt_s: f64) -> SMatrix<f64, K, K> {
        let sigmas: [f64; MAX_LINEAR] = [
            self.sigma_current_mps_per_sqrt_s,
            self.sigma_current_mps_per_sqrt_s,
            self.sigma_heading_bias_rad_per_sqrt_s,
            self.sigma_thrust_bias_mps_per_sqrt_s,
        ];
        SMatrix::from_fn(|r, c| if r == c { sigmas[r] * sigmas[r] * dt_s } else { 0.0 })
    }

    /// Process noise of the position over `dt_s`, [ee, en, nn].
    #[must_use]
    pub fn position_walk(&self, dt_s: f64) -> [f64; 3] {
        let q = self.sigma_position_m_per_sqrt_s * self.sigma_position_m_per_sqrt_s * dt_s;
        [q, 0.0, q]
    }
}

/// A navigator's side of the acoustic link: sequence numbers, what was heard, own depth.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Radio {
    pub(super) own: VehicleId,
    pub(super) depth_m: f64,
    pub(super) sequencer: Sequencer,
    pub(super) windows: Vec<ReceiveWindow>,
    heard: HeardBitmap,
    pub(super) sound_speed_mps: f64,
}

/// A slant range this many sigmas shorter than the difference of the depths is refused.
pub(super) const SLANT_GATES: f64 = 4.0;

/// What a teammate said of its own position at launch.
#[derive(Debug, Clone, PartialEq)]
pub enum Said {
    /// A Gaussian.
    Gaussian(Belief),
    /// All its particles.
    Cloud(CloudPacket),
    /// A few Gaussian modes with their shares.
    Mixture(Vec<(f64, Belief)>),
}

/// A teammate's belief with the measured horizontal range to where it was.
#[derive(Debug, Clone, PartialEq)]
pub struct Heard {
    /// What the teammate believes of itself at launch.
    pub said: Said,
    /// Horizontal range from the teammate at launch to this vehicle at arrival, m.
    pub range_m: f64,
}

impl Radio {
    /// A radio of vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] for a sound speed that is not one.
    pub fn new(own: VehicleId, vehicles: usize, sound_speed_mps: f64) -> Result<Self, Error> {
        crate::error::positive("sound_speed_mps", sound_speed_mps)?;
        if usize::from(own) >= vehicles {
            return Err(Error::UnknownVehicle { vehicle: own, count: vehicles });
        }
        Ok(Self {
            own,
            depth_m: 0.0,
            sequencer: Sequencer::default(),
            // Not `vec![…; n]`: clones of an empty window have no memory of their own yet.
            windows: (0..vehicles).map(|_| ReceiveWindow::new()).collect(),
            heard: HeardBitmap::default(),
            sound_speed_mps,
        })
    }

    /// Refuses an event of a sender that the team does not have, or that is this vehicle, before anything changes.
    ///
    /// # Errors
    /// [`Error::UnknownVehicle`], [`Error::WrongVehicle`].
    pub fn check_sender(&self, payload: &Payload) -> Result<(), Error> {
        match payload {
            Payload::Reception { sender, .. } => check_sender(*sender, self.own, self.windows.len()),
            _ => Ok(()),
        }
    }

    /// Refuses a snapshot of another vehicle or team.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check_same(&self, other: &Self) -> Result<(), Error> {
        let (own, theirs) = ((self.own, self.windows.len()), (other.own, other.windows.len()));
        if own == theirs {
            return Ok(());
        }
        Err(Error::Snapshot(format!(
            "it is of vehicle {} in a team of {}, not of {} in {}",
            theirs.0, theirs.1, own.0, own.1
        )))
    }

    /// The vehicle's own depth, m.
    pub fn set_depth(&mut self, depth_m: f64) {
        self.depth_m = depth_m;
    }

    /// A sealed packet with this belief.
    ///
    /// # Errors
    /// What the packet says of values that do not fit; [`Error::PacketTooLong`].
    pub fn broadcast(
        &mut self,
        kind: PacketKind,
        estimate: &Estimate,
        tol_ns: i64,
        capacity_bytes: usize,
    ) -> Result<Arc<[u8]>, Error> {
        let [ee, en, nn] = estimate.covariance_m2;
        let packet = BeliefPacket {
            header: self.header(kind),
            belief: Belief {
                mean_m: Vector2::from(estimate.mean_m),
                covariance_m2: Matrix2::new(ee, en, en, nn),
            },
        };
        self.launch(packet.encode(self.own, tol_ns)?, capacity_bytes)
    }

    /// A sealed packet with all particles.
    ///
    /// # Errors
    /// As [`Radio::broadcast`].
    pub fn broadcast_cloud(
        &mut self,
        particles: Particles,
        tol_ns: i64,
        capacity_bytes: usize,
    ) -> Result<Arc<[u8]>, Error> {
        let Particles { east, north, weights } = particles;
        let packet = CloudPacket { header: self.header(PacketKind::Cloud), east, north, weights };
        self.launch(packet.encode(self.own, tol_ns)?, capacity_bytes)
    }

    /// A sealed packet with a few modes.
    ///
    /// # Errors
    /// As [`Radio::broadcast`].
    pub fn broadcast_modes(
        &mut self,
        modes: Vec<(f64, Belief)>,
        tol_ns: i64,
        capacity_bytes: usize,
    ) -> Result<Arc<[u8]>, Error> {
        let packet = MixturePacket { header: self.header(PacketKind::Mixture), modes };
        self.launch(packet.encode(self.own, tol_ns)?, capacity_bytes)
    }

    fn header(&self, kind: PacketKind) -> Header {
        Header {
            kind,
            sequence: self.sequencer.residue(),
            // A sensor at the surface may read a little above it.
            depth_m: self.depth_m.max(0.0),
            heard: self.heard,
        }
    }

    /// Counts the packet as sent if it fits.
    pub(super) fn launch(&mut self, bytes: Vec<u8>, capacity_bytes: usize) -> Result<Arc<[u8]>, Error> {
        if bytes.len() > capacity_bytes {
            return Err(Error::PacketTooLong { bytes: bytes.len(), capacity: capacity_bytes });
        }
        self.sequencer.take()?;
        self.heard = HeardBitmap::default();
        Ok(bytes.into())
    }

    /// Reads a packet; `None` (and no change) for one that does not decode, was seen before, or whose range makes no
    /// sense.
    pub fn receive(
        &mut self,
        sender: VehicleId,
        tol_ns: i64,
        toa_ns: i64,
        bytes: &[u8],
        sigma_range_m: f64,
    ) -> Option<Heard> {
        let window = self.windows.get_mut(usize::from(sender))?;
        let (header, said) = match open(bytes, sender, tol_ns).and_then(Header::peek_kind).ok()? {
            PacketKind::Cloud => {
                let packet = CloudPacket::decode(bytes, sender, tol_ns).ok()?;
                (packet.header, Said::Cloud(packet))
            }
            PacketKind::Mixture => {
                let packet = MixturePacket::decode(bytes, sender, tol_ns).ok()?;
                (packet.header, Said::Mixture(packet.modes))
            }
            PacketKind::Belief | PacketKind::BeliefF64 => {
                let packet = BeliefPacket::decode(bytes, sender, tol_ns).ok()?;
                (packet.header, Said::Gaussian(packet.belief))
            }
            // What other families of navigators say.
            _ => return None,
        };
        let range = range_m(tol_ns, toa_ns, self.sound_speed_mps).and_then(|slant_m| {
            slant_to_horizontal(slant_m, self.depth_m, header.depth_m, sigma_range_m, SLANT_GATES)
        });
        let mut heard = self.heard;
        let range_m = range.ok()?.range_m;
        heard.insert(sender).ok()?;
        window.accept(header.sequence, tol_ns).ok()?;
        self.heard = heard;
        Some(Heard { said, range_m })
    }
}

/// Particles for the position, one Gaussian of linear states for each (its covariance common to all), and the clock.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ParticleCore<const K: usize> {
    /// The particles.
    pub cloud: Cloud<K>,
    /// Covariance of the linear states.
    pub covariance: SMatrix<f64, K, K>,
    /// Commanded velocity in force, m/s.
    pub velocity_mps: [f64; 2],
    /// Recent displacement; none before the first event.
    pub trajectory: Option<Trajectory>,
    /// Whether the chart helps now.
    pub status: Status,
    /// Measurements gated and packets rejected.
    pub rejected: u64,
    /// What the last fused range told, nat; NaN where not asked for.
    pub information_nat: f64,
    /// How often fixes that insisted scattered the cloud anew.
    pub restarts: u32,
    drift: Drift,
    streams: Streams,
    step: u32,
    contradicting_fixes: u32,
}

/// A fix that contradicts the belief by more than this (χ² of two degrees of freedom, 5e-6) is gated …
const FIX_GATE: f64 = 24.0;
/// … but this many in a row are believed: a lost vehicle that surfaces must be able to start anew.
const FIXES_BELIEVED: u32 = 3;
/// No fix is better than a decimetre per axis, m².
const FIX_FLOOR_M2: f64 = 0.01;
/// Share of the weight that must have a chart for a sounding to be used.
const CHART_SHARE: f64 = 0.2;

impl<const K: usize> ParticleCore<K> {
    /// `particles` particles without a position yet.
    ///
    /// # Errors
    /// What [`Drift::validate`] says; [`Error::OutOfBound`] for fewer than 10 particles.
    pub fn new(particles: usize, drift: Drift, streams: Streams) -> Result<Self, Error> {
        drift.validate()?;
        if !(10..=10_000_000).contains(&particles) {
            return Err(Error::OutOfBound {
                quantity: "particles",
                value: particles as f64,
                bound: "10 to 10,000,000",
            });
        }
        Ok(Self {
            cloud: Cloud::new(particles),
            covariance: drift.prior(),
            velocity_mps: [0.0; 2],
            trajectory: None,
            status: Status::NotStarted,
            rejected: 0,
            information_nat: f64::NAN,
            restarts: 0,
            drift,
            streams,
            step: 0,
            contradicting_fixes: 0,
        })
    }

    /// Refuses a snapshot of another number of particles, or whose columns differ in length.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check_same(&self, other: &Self) -> Result<(), Error> {
        let (own, theirs) = (&self.cloud, &other.cloud);
        if own.len() != theirs.len() {
            return Err(Error::Snapshot(format!("it holds {} particles, not {}", theirs.len(), own.len())));
        }
        let full = [theirs.north.len(), theirs.weights().len()];
        let lengths = full.into_iter().chain(theirs.linear.iter().map(Vec::len));
        let offsets = [theirs.offset.len(), theirs.offset_variance.len()];
        if lengths.into_iter().any(|n| n != own.len()) || offsets.iter().any(|n| *n != own.offset.len()) {
            return Err(Error::Snapshot("its columns of particles differ in length".into()));
        }
        Ok(())
    }

    /// Time that the core has advanced to.
    #[must_use]
    pub fn now_ns(&self) -> Option<i64> {
        self.trajectory.as_ref().map(Trajectory::now_ns)
    }

    /// True once a fix gave it a position.
    #[must_use]
    pub fn started(&self) -> bool {
        self.status != Status::NotStarted
    }

    /// A stream that no other use shares.
    pub fn next_stream(&mut self, purpose: Purpose) -> Stream {
        self.step = self.step.wrapping_add(1);
        self.streams.at(purpose, self.step)
    }

    /// Propagates every particle to `t_ns` with the velocity in force (5)–(8); the step that they made, if any.
    pub fn advance(&mut self, t_ns: i64) -> Option<Step<K>> {
        let Some(trajectory) = &self.trajectory else {
            self.trajectory = Some(Trajectory::new(t_ns));
            return None;
        };
        let dt_s = seconds(t_ns.saturating_sub(trajectory.now_ns()));
        if dt_s <= 0.0 {
            return None;
        }
        let mut made = None;
        let mut mean_step = [self.velocity_mps[0] * dt_s, self.velocity_mps[1] * dt_s];
        if self.started() {
            // The segment that later soundings are strung on moves with the mean before the prediction.
            let map = displacement_map::<K>(self.velocity_mps, dt_s);
            for (k, c) in self.cloud.linear_mean().iter().enumerate() {
                mean_step[0] += map[0][k] * c;
                mean_step[1] += map[1][k] * c;
            }
            let step = prepare_step(
                &mut self.covariance,
                self.velocity_mps,
                dt_s,
                self.drift.position_walk(dt_s),
                &self.drift.walk(dt_s),
            );
            let stream = self.next_stream(Purpose::Process);
            self.cloud.propagate(&step, &stream);
            made = Some(step);
        }
        if let Some(trajectory) = &mut self.trajectory {
            trajectory.advance(t_ns, mean_step);
        }
        made
    }

    /// Starts at the first fix; later ones weigh the particles.
    pub fn fix(&mut self, position_m: [f64; 2], covariance_m2: [f64; 3]) -> Outcome {
        if !self.started() {
            let stream = self.next_stream(Purpose::Initial);
            self.cloud.scatter_disc(position_m, covariance_m2, &stream);
            self.status = Status::Navigating;
            return Outcome::Fused;
        }
        let r = Matrix2::new(
            covariance_m2[0].max(FIX_FLOOR_M2),
            covariance_m2[1],
            covariance_m2[1],
            covariance_m2[2].max(FIX_FLOOR_M2),
        );
        let (mean, [ee, en, nn]) = self.cloud.position_moments();
        let off = Vector2::new(position_m[0] - mean[0], position_m[1] - mean[1]);
        let (Some(inverse), Some(total)) =
            (r.try_inverse(), (r + Matrix2::new(ee, en, en, nn)).try_inverse())
        else {
            self.rejected += 1;
            return Outcome::Gated;
        };
        if (off.transpose() * total * off)[0] > FIX_GATE {
            self.contradicting_fixes += 1;
            if self.contradicting_fixes < FIXES_BELIEVED {
                self.rejected += 1;
                return Outcome::Gated;
            }
            self.contradicting_fixes = 0;
            let stream = self.next_stream(Purpose::Recovery);
            self.restarts = self.restarts.wrapping_add(1);
            self.cloud.scatter_disc(position_m, [r[(0, 0)], r[(0, 1)], r[(1, 1)]], &stream);
            return Outcome::Fused;
        }
        self.contradicting_fixes = 0;
        let mut column = self.cloud.likelihood_column();
        for ((l, e), n) in column.iter_mut().zip(&self.cloud.east).zip(&self.cloud.north) {
            let d = Vector2::new(position_m[0] - e, position_m[1] - n);
            *l = -0.5 * (d.transpose() * inverse * d)[0];
        }
        self.cloud.reweight(column);
        Outcome::Fused
    }

    /// Where the vehicle was at `t_ns` relative to now, m.
    #[must_use]
    pub fn displacement_since(&self, t_ns: i64) -> Option<[f64; 2]> {
        self.trajectory.as_ref().and_then(|t| t.since(t_ns))
    }

    /// Gives particles without a likelihood (NaN: over a hole, off the chart) the mean likelihood of those that have one.
    ///
    /// False, and `OffChart`, if those hold too little of the weight: the sounding must not be used then.
    pub fn fill_holes(&mut self, log_likelihood: &mut [f64]) -> bool {
        let weights = self.cloud.weights();
        let (top, share) = known_share(log_likelihood, weights);
        if share < CHART_SHARE || !top.is_finite() {
            self.status = Status::OffChart;
            return false;
        }
        self.status = Status::Navigating;
        if log_likelihood.iter().any(|l| l.is_nan()) {
            let sum: f64 = log_likelihood
                .iter()
                .zip(weights)
                .filter(|(l, _)| !l.is_nan())
                .map(|(l, w)| w * (l - top).exp())
                .sum();
            let neutral = top + (sum / share).ln();
            log_likelihood.iter_mut().filter(|l| l.is_nan()).for_each(|l| *l = neutral);
        }
        true
    }

    /// Position moments and the mean of the linear states, predicted to `t_ns`.
    #[must_use]
    pub fn estimate(&self, t_ns: i64) -> Estimate {
        let mut estimate = Estimate {
            t_ns,
            mean_m: [f64::NAN; 2],
            covariance_m2: [f64::INFINITY, 0.0, f64::INFINITY],
            yaw: None,
            ess: None,
            rejected: self.rejected,
            status: self.status,
        };
        let (true, Some(trajectory)) = (self.started(), &self.trajectory) else { return estimate };
        let (mean, covariance) = self.cloud.position_moments();
        estimate.ess = Some(self.cloud.ess());
        estimate.mean_m = mean;
        estimate.covariance_m2 = covariance;
        let dt_s = seconds(t_ns.saturating_sub(trajectory.now_ns()));
        if dt_s < 0.0 {
            if let Some(back) = trajectory.since(t_ns) {
                estimate.mean_m = [mean[0] - back[0], mean[1] - back[1]];
            }
        } else if dt_s > 0.0 {
            self.predict(&mut estimate, dt_s);
        }
        estimate
    }

    /// How the position's error would grow along `direction` in `dt_s` of dead reckoning from now.
    #[must_use]
    pub fn growth(&self, direction: [f64; 2], dt_s: f64) -> Growth {
        let (mean, [ee, en, nn]) = self.cloud.position_moments();
        let (_, cross, drift) = self.drift_ahead(mean, dt_s);
        let u = Vector2::from(direction);
        let position_m2 = (u.transpose() * Matrix2::new(ee, en, en, nn) * u)[0];
        let drift_m2 = (u.transpose() * drift * u)[0].max(0.0);
        let [walk_ee, walk_en, walk_nn] = self.drift.position_walk(dt_s);
        let scale = (position_m2 * drift_m2).sqrt();
        Growth {
            correlation: if scale > 0.0 {
                ((u.transpose() * cross * u)[0] / scale).clamp(0.0, 1.0)
            } else {
                0.0
            },
            drift_m2,
            walk_m2: (u.transpose() * Matrix2::new(walk_ee, walk_en, walk_en, walk_nn) * u)[0],
        }
    }

    /// Mean displacement by the linear states over `dt_s`, its covariance with the position, and its own covariance.
    fn drift_ahead(&self, mean_m: [f64; 2], dt_s: f64) -> (Vector2<f64>, Matrix2<f64>, Matrix2<f64>) {
        let w = self.cloud.weights();
        let map = displacement_map::<K>(self.velocity_mps, dt_s);
        let f = SMatrix::<f64, 2, K>::from_fn(|r, c| map[r][c]);
        let means = self.cloud.linear_mean();
        let columns = &self.cloud.linear;
        let spread = SMatrix::<f64, K, K>::from_fn(|r, c| {
            weighted_covariance(w, &columns[r], means[r], &columns[c], means[c])
        });
        let position = [&self.cloud.east, &self.cloud.north];
        let cross = SMatrix::<f64, 2, K>::from_fn(|r, c| {
            weighted_covariance(w, position[r], mean_m[r], &columns[c], means[c])
        });
        let moved = f * SMatrix::<f64, K, 1>::from(means);
        (moved, cross * f.transpose(), f * (spread + self.covariance) * f.transpose())
    }

    /// Moves an estimate of the present ahead by `dt_s`, with the cloud's own correlation of position and drift.
    fn predict(&self, estimate: &mut Estimate, dt_s: f64) {
        let (moved, coupled, drift) = self.drift_ahead(estimate.mean_m, dt_s);
        for a in 0..2 {
            estimate.mean_m[a] += self.velocity_mps[a] * dt_s + moved[a];
        }
        let added = drift + coupled + coupled.transpose();
        let walk = self.drift.position_walk(dt_s);
        estimate.covariance_m2[0] += added[(0, 0)] + walk[0];
        estimate.covariance_m2[1] += added[(0, 1)] + walk[1];
        estimate.covariance_m2[2] += added[(1, 1)] + walk[2];
    }

    /// A copy moved ahead to `t_ns` with the mean displacement.
    #[must_use]
    pub fn particles_at(&self, t_ns: i64) -> Particles {
        let cloud = &self.cloud;
        let now = self.cloud.position_moments().0;
        let then = self.estimate(t_ns).mean_m;
        let along = |x: &[f64], by: f64| x.iter().map(|v| v + by).collect();
        Particles {
            east: along(&cloud.east, then[0] - now[0]),
            north: along(&cloud.north, then[1] - now[1]),
            weights: cloud.weights().to_vec(),
        }
    }

    /// A copy for pictures.
    #[must_use]
    pub fn particles(&self) -> Option<Particles> {
        self.started().then(|| Particles {
            east: self.cloud.east.clone(),
            north: self.cloud.north.clone(),
            weights: self.cloud.weights().to_vec(),
        })
    }
}
