//! Dead reckoning: the velocity of the [motion front end](crate::motion) integrated, with a consistent covariance. Ranges
//! and soundings are not used.

use std::sync::Arc;

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use super::diagnostics::LINEAR_STATES;
use super::drift::Drift;
use super::snapshot::{load, save};
use super::{Estimate, Kinds, Navigator, Outcome, Profile, Status, check_event, check_sender};
use crate::error::Error;
use crate::event::{Event, Kind, Payload, VehicleId, seconds};
use crate::information::Gaussian;
use crate::kernels::particles::displacement_map;
use crate::motion::{FrontEnd, Taken, VelocityError};

/// Position, current, compass bias, thrust bias.
const D: usize = 6;
type ReckoningVector = SVector<f64, D>;
type Covariance = SMatrix<f64, D, D>;

/// A Kalman filter over position, current and the two biases that hears nothing but fixes.
pub struct DeadReckoning {
    own: VehicleId,
    vehicles: usize,
    drift: Drift,
    core: ReckoningState,
}

#[derive(Clone, Serialize, Deserialize)]
struct ReckoningState {
    now_ns: Option<i64>,
    started: bool,
    motion: FrontEnd,
    drift_in_force: Drift,
    mean: ReckoningVector,
    covariance: Covariance,
    rejected: u64,
    gated_velocities: u64,
}

/// The states that hold the error of the velocity.
struct ReckoningPair<'a> {
    mean: &'a mut ReckoningVector,
    covariance: &'a mut Covariance,
}

/// Where they stand, and where the thrust bias does.
const PAIR: usize = 2;
const THRUST: usize = 5;

impl VelocityError for ReckoningPair<'_> {
    fn moments(&self) -> ([f64; 2], [f64; 3]) {
        let of = |r: usize, c: usize| self.covariance[(PAIR + r, PAIR + c)];
        ([self.mean[PAIR], self.mean[PAIR + 1]], [of(0, 0), of(0, 1), of(1, 1)])
    }

    fn reset(&mut self, mean_mps: [f64; 2], [ee, en, nn]: [f64; 3], thrust_sigma_mps: f64) {
        let thrust_m2ps2 = thrust_sigma_mps * thrust_sigma_mps;
        let states = [(PAIR, mean_mps[0], ee), (PAIR + 1, mean_mps[1], nn), (THRUST, 0.0, thrust_m2ps2)];
        for (k, mean, variance) in states {
            self.mean[k] = mean;
            self.covariance.row_mut(k).fill(0.0);
            self.covariance.column_mut(k).fill(0.0);
            self.covariance[(k, k)] = variance;
        }
        self.covariance[(PAIR, PAIR + 1)] = en;
        self.covariance[(PAIR + 1, PAIR)] = en;
    }

    fn turn(&mut self, re: f64, im: f64) {
        let mut turn = Covariance::identity();
        turn.fixed_view_mut::<2, 2>(PAIR, PAIR).copy_from(&Matrix2::new(re, -im, im, re));
        *self.mean = turn * *self.mean;
        *self.covariance = turn * *self.covariance * turn.transpose();
    }
}

impl DeadReckoning {
    /// A navigator for vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// What [`Drift::validate`] says; [`Error::UnknownVehicle`] for one outside the team.
    pub fn new(own: VehicleId, vehicles: usize, drift: Drift) -> Result<Self, Error> {
        drift.validate()?;
        if usize::from(own) >= vehicles {
            return Err(Error::UnknownVehicle { vehicle: own, count: vehicles });
        }
        let mut covariance = Covariance::zeros();
        covariance.fixed_view_mut::<4, 4>(2, 2).copy_from(&drift.prior::<4>());
        let core = ReckoningState {
            now_ns: None,
            started: false,
            motion: FrontEnd::new(&drift),
            drift_in_force: drift,
            mean: ReckoningVector::zeros(),
            covariance,
            rejected: 0,
            gated_velocities: 0,
        };
        Ok(Self { own, vehicles, drift, core })
    }

    /// Mean and covariance moved from `now_ns` to `t_ns` with the velocity in force.
    fn predicted(&self, now_ns: i64, t_ns: i64) -> (ReckoningVector, Covariance) {
        let dt_s = seconds(t_ns.saturating_sub(now_ns));
        let (velocity, drift) = (self.core.motion.velocity_mps(), &self.core.drift_in_force);
        let mut transition = Covariance::identity();
        let map = displacement_map::<4>(velocity, dt_s);
        for (row, columns) in map.iter().enumerate() {
            for (k, value) in columns.iter().enumerate() {
                transition[(row, 2 + k)] = *value;
            }
        }
        let mut mean = transition * self.core.mean;
        mean[0] += velocity[0] * dt_s;
        mean[1] += velocity[1] * dt_s;
        let mut covariance = transition * self.core.covariance * transition.transpose();
        // Looking back, what has happened since is not taken away again: a covariance stays one.
        let walked_s = dt_s.max(0.0);
        let walk = drift.position_walk(walked_s);
        let old_m2 = self.core.motion.out_of_force_m2(now_ns, t_ns);
        covariance[(0, 0)] += walk[0] + old_m2;
        covariance[(1, 1)] += walk[2] + old_m2;
        let linear = drift.walk::<4>(walked_s);
        for k in 0..4 {
            covariance[(2 + k, 2 + k)] += linear[(k, k)];
        }
        (mean, covariance)
    }

    fn advance(&mut self, t_ns: i64) {
        let end_ns = self.core.motion.ends_before(t_ns);
        if let Some(end_ns) = end_ns.filter(|end_ns| self.core.now_ns.is_some_and(|now_ns| *end_ns > now_ns))
        {
            self.step(end_ns);
            self.follow(end_ns);
        }
        self.step(t_ns);
    }

    /// Puts in force what the sensors say.
    fn follow(&mut self, t_ns: i64) {
        let ReckoningState { motion, mean, covariance, .. } = &mut self.core;
        motion.follow(t_ns, &mut ReckoningPair { mean, covariance });
        self.core.drift_in_force = self.core.motion.drift(t_ns, &self.drift);
    }

    fn take_motion(&mut self, t_ns: i64, payload: &Payload) -> Outcome {
        let outcome = match self.core.motion.take(t_ns, payload) {
            Taken::Noted => Outcome::Noted,
            Taken::Used => Outcome::Fused,
            Taken::Gated => {
                self.core.rejected += 1;
                self.core.gated_velocities += 1;
                Outcome::Gated
            }
            Taken::Shifted(by_m) => {
                self.core.mean[0] += by_m[0];
                self.core.mean[1] += by_m[1];
                Outcome::Fused
            }
        };
        self.follow(t_ns);
        outcome
    }

    fn step(&mut self, t_ns: i64) {
        if let (true, Some(now_ns)) = (self.core.started, self.core.now_ns)
            && t_ns > now_ns
        {
            let dt_s = seconds(t_ns.saturating_sub(now_ns));
            (self.core.mean, self.core.covariance) = self.predicted(now_ns, t_ns);
            let [e, n] = self.core.motion.velocity_mps();
            self.core.motion.moved([e * dt_s, n * dt_s]);
        }
        self.core.now_ns = Some(t_ns);
    }

    fn fix(&mut self, position_m: [f64; 2], [ee, en, nn]: [f64; 3]) -> Outcome {
        let noise = Matrix2::new(ee, en, en, nn);
        if !self.core.started {
            let linear = self.core.covariance.fixed_view::<4, 4>(2, 2).clone_owned();
            self.core.started = true;
            self.core.mean[0] = position_m[0];
            self.core.mean[1] = position_m[1];
            self.core.covariance = Covariance::zeros();
            self.core.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&noise);
            self.core.covariance.fixed_view_mut::<4, 4>(2, 2).copy_from(&linear);
            return Outcome::Fused;
        }
        let core = &mut self.core;
        let cross = core.covariance.fixed_view::<D, 2>(0, 0).clone_owned();
        let s = cross.fixed_view::<2, 2>(0, 0) + noise;
        let Some(inverse) = s.try_inverse() else {
            core.rejected += 1;
            return Outcome::Gated;
        };
        let gain = cross * inverse;
        let mean = core.mean + gain * (Vector2::from(position_m) - core.mean.fixed_rows::<2>(0));
        // Joseph's form: a sum of squares, which rounding cannot take below zero.
        let mut keep = Covariance::identity();
        for row in 0..D {
            for axis in 0..2 {
                keep[(row, axis)] -= gain[(row, axis)];
            }
        }
        let updated = keep * core.covariance * keep.transpose() + gain * noise * gain.transpose();
        let belief = Gaussian { mean, covariance: (updated + updated.transpose()) * 0.5 };
        if !belief.is_sound() {
            core.rejected += 1;
            return Outcome::Gated;
        }
        (core.mean, core.covariance) = (belief.mean, belief.covariance);
        Outcome::Fused
    }
}

impl Navigator for DeadReckoning {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.core.now_ns)?;
        if let Payload::Reception { sender, .. } = &event.payload {
            check_sender(*sender, self.own, self.vehicles)?;
        }
        self.advance(event.t_ns);
        match &event.payload {
            Payload::Fix { position_m, covariance_m2 } => Ok(self.fix(*position_m, *covariance_m2)),
            other => Ok(self.take_motion(event.t_ns, other)),
        }
    }

    fn transmit(&mut self, _tol_ns: i64, _capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        Ok(None)
    }

    fn profile(&self) -> Profile {
        Profile {
            takes_ranges: false,
            has_checksum: true,
            needs_delivery_oracle: false,
            uses: Kinds::MOTION.with(Kind::Fix, true),
        }
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let core = &self.core;
        let (mean, covariance, status) = match (core.started, core.now_ns) {
            (true, Some(now_ns)) => {
                let (mean, covariance) = self.predicted(now_ns, t_ns);
                (
                    [mean[0], mean[1]],
                    [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]],
                    Status::Navigating,
                )
            }
            _ => ([f64::NAN; 2], [f64::INFINITY, 0.0, f64::INFINITY], Status::NotStarted),
        };
        Estimate {
            t_ns,
            mean_m: mean,
            covariance_m2: covariance,
            yaw: None,
            ess: None,
            rejected: core.rejected,
            status,
        }
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut columns = Vec::with_capacity(9);
        for (k, [name, name_of_sigma]) in LINEAR_STATES.into_iter().enumerate() {
            let variance = self.core.covariance[(2 + k, 2 + k)];
            let known = self.core.started;
            columns.push((name, if known { self.core.mean[2 + k] } else { f64::NAN }));
            columns.push((name_of_sigma, if known { variance.max(0.0).sqrt() } else { f64::NAN }));
        }
        columns.push(("gated_fixes", (self.core.rejected - self.core.gated_velocities) as f64));
        columns.push(("gated_velocities", self.core.gated_velocities as f64));
        columns
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.core)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.core = load(snapshot)?;
        Ok(())
    }
}
