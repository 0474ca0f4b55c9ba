//! The marginalised particle core of `dmpf`, `mpf` and `team`: particles for the position, a Gaussian for the drift.

use nalgebra::{Matrix2, SMatrix, Vector2};
use serde::{Deserialize, Serialize};

use super::diagnostics::GatedCounts;
use super::drift::Drift;
use super::from_outside::Stations;
use super::settings::check_all;
use super::settings::terrain::PARTICLES;
use super::trajectory::Trajectory;
use super::{Estimate, LastInnovation, Outcome, Particles, Status};
use crate::cloud::Cloud;
use crate::error::Error;
use crate::event::seconds;
use crate::kernels::particles::{ParticleStep, displacement_map, prepare_step};
use crate::measurement::fix;
use crate::measurement::sounding::neutral_log_likelihood;
use crate::motion::FrontEnd;
use crate::random::{Purpose, Stream, Streams};

/// Particles for the position, one Gaussian of linear states for each (its covariance common to all), and the clock.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ParticleCore<const K: usize> {
    /// The particles.
    pub cloud: Cloud<K>,
    /// Covariance of the linear states.
    pub covariance: SMatrix<f64, K, K>,
    /// Velocity in force, m/s: commanded, or what the [front end](crate::motion) makes of the sensors.
    pub velocity_mps: [f64; 2],
    /// Recent displacement; none before the first event.
    pub trajectory: Option<Trajectory>,
    /// Whether the chart helps now.
    pub status: Status,
    /// Measurements gated and packets rejected.
    pub rejected: u64,
    /// What the last fused range told, nat; NaN where not asked for.
    pub information_nat: f64,
    /// Of the event that is being handled.
    #[serde(skip)]
    pub innovation: LastInnovation,
    /// What was gated or rejected, by kind of event.
    pub gated: GatedCounts,
    /// How often fixes that insisted scattered the cloud anew.
    pub restarts: u32,
    /// For a velocity through the water.
    pub(super) drift: Drift,
    pub(super) motion: FrontEnd,
    pub(super) drift_in_force: Drift,
    pub(super) stations: Stations,
    streams: Streams,
    step: u32,
    contradicting_fixes: u32,
}

/// So many fixes in a row that contradict the belief are believed: a lost vehicle that surfaces must be able to start anew.
pub(in crate::navigator) const FIXES_BELIEVED: u32 = 3;

impl<const K: usize> ParticleCore<K> {
    /// `particles` particles without a position yet.
    ///
    /// # Errors
    /// What [`Drift::validate`] says; [`Error::OutOfBound`] for fewer than 10 particles.
    pub fn new(particles: usize, drift: Drift, streams: Streams) -> Result<Self, Error> {
        drift.validate()?;
        check_all(&[PARTICLES], &[("particles", particles as f64)])?;
        Ok(Self {
            cloud: Cloud::new(particles),
            covariance: drift.prior(),
            velocity_mps: [0.0; 2],
            trajectory: None,
            status: Status::NotStarted,
            rejected: 0,
            innovation: LastInnovation::default(),
            gated: GatedCounts::default(),
            information_nat: f64::NAN,
            restarts: 0,
            motion: FrontEnd::new(&drift),
            drift_in_force: drift,
            drift,
            stations: Stations::default(),
            streams,
            step: 0,
            contradicting_fixes: 0,
        })
    }

    /// Becomes a copy of `other` of the same size, but draws on from where both have not drawn yet.
    pub fn become_core(&mut self, other: &Self) {
        let (step, innovation) = (self.step.max(other.step), self.innovation);
        self.clone_from(other);
        (self.step, self.innovation) = (step, innovation);
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
    pub fn advance(&mut self, t_ns: i64) -> Option<ParticleStep<K>> {
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
            let walk = self.position_walk_to(t_ns);
            let step = prepare_step(
                &mut self.covariance,
                self.velocity_mps,
                dt_s,
                walk,
                &self.drift_in_force.walk(dt_s),
            );
            let stream = self.next_stream(Purpose::Process);
            self.cloud.propagate(&step, &stream);
            made = Some(step);
        }
        self.motion.moved([self.velocity_mps[0] * dt_s, self.velocity_mps[1] * dt_s]);
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
        let noise_m2 = fix::floored(covariance_m2);
        let [ree, ren, rnn] = noise_m2;
        let (mean, [ee, en, nn]) = self.cloud.position_moments();
        let off = [position_m[0] - mean[0], position_m[1] - mean[1]];
        let (Some(inverse), Some(contradicts)) = (
            Matrix2::new(ree, ren, ren, rnn).try_inverse(),
            fix::contradicts(off, [ree + ee, ren + en, rnn + nn]),
        ) else {
            self.rejected += 1;
            return Outcome::Gated;
        };
        if contradicts {
            self.contradicting_fixes += 1;
            if self.contradicting_fixes < FIXES_BELIEVED {
                self.rejected += 1;
                return Outcome::Gated;
            }
            self.contradicting_fixes = 0;
            let stream = self.next_stream(Purpose::Recovery);
            self.restarts = self.restarts.wrapping_add(1);
            self.cloud.scatter_disc(position_m, noise_m2, &stream);
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

    /// The vehicle's own depth, m.
    pub fn set_depth(&mut self, depth_m: f64) {
        self.stations.depth_m = Some(depth_m);
    }

    /// Where the vehicle was at `t_ns` relative to now, m.
    #[must_use]
    pub fn displacement_since(&self, t_ns: i64) -> Option<[f64; 2]> {
        self.trajectory.as_ref().and_then(|t| t.since(t_ns))
    }

    /// Whether it knows where the vehicle was at `t_ns`, relative to where it is.
    #[must_use]
    pub fn remembers(&self, t_ns: i64) -> bool {
        self.started() && self.displacement_since(t_ns).is_some()
    }

    /// Gives particles without a likelihood (NaN: over a hole, off the chart) the mean likelihood of those that have one.
    ///
    /// False, and `OffChart`, if those hold too little of the weight: the sounding must not be used then.
    pub fn fill_holes(&mut self, log_likelihood: &mut [f64]) -> bool {
        let Some(neutral) = neutral_log_likelihood(log_likelihood, self.cloud.weights()) else {
            self.status = Status::OffChart;
            return false;
        };
        self.status = Status::Navigating;
        log_likelihood.iter_mut().filter(|l| l.is_nan()).for_each(|l| *l = neutral);
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
