//! Dead reckoning: integrated commanded velocity, with a consistent covariance. Ranges and soundings are not used.

use std::sync::Arc;

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

use super::diagnostics::LINEAR_STATES;
use super::drift::Drift;
use super::held_velocity::HeldVelocity;
use super::snapshot::{load, save};
use super::{Estimate, Kinds, Navigator, Outcome, Profile, Status, check_event, check_sender};
use crate::error::Error;
use crate::event::{Event, Kind, Payload, VehicleId, seconds};
use crate::information::Gaussian;
use crate::kernels::particles::displacement_map;

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
    velocity_mps: [f64; 2],
    held: HeldVelocity,
    mean: ReckoningVector,
    covariance: Covariance,
    rejected: u64,
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
        let core = ReckoningState {
            now_ns: None,
            started: false,
            velocity_mps: [0.0; 2],
            held: HeldVelocity::default(),
            mean: ReckoningVector::zeros(),
            covariance: Covariance::zeros(),
            rejected: 0,
        };
        Ok(Self { own, vehicles, drift, core })
    }

    /// Mean and covariance moved from `now_ns` to `t_ns` with the velocity in force.
    fn predicted(&self, now_ns: i64, t_ns: i64) -> (ReckoningVector, Covariance) {
        let dt_s = seconds(t_ns.saturating_sub(now_ns));
        let mut transition = Covariance::identity();
        let map = displacement_map::<4>(self.core.velocity_mps, dt_s);
        for (row, columns) in map.iter().enumerate() {
            for (k, value) in columns.iter().enumerate() {
                transition[(row, 2 + k)] = *value;
            }
        }
        let mut mean = transition * self.core.mean;
        mean[0] += self.core.velocity_mps[0] * dt_s;
        mean[1] += self.core.velocity_mps[1] * dt_s;
        let mut covariance = transition * self.core.covariance * transition.transpose();
        // Looking back, what has happened since is not taken away again: a covariance stays one.
        let walked_s = dt_s.max(0.0);
        let walk = self.drift.position_walk(walked_s);
        let held_m2 = self.core.held.drift_m2(now_ns, t_ns);
        covariance[(0, 0)] += walk[0] + held_m2;
        covariance[(1, 1)] += walk[2] + held_m2;
        let linear = self.drift.walk::<4>(walked_s);
        for k in 0..4 {
            covariance[(2 + k, 2 + k)] += linear[(k, k)];
        }
        (mean, covariance)
    }

    fn advance(&mut self, t_ns: i64) {
        if let (true, Some(now_ns)) = (self.core.started, self.core.now_ns)
            && t_ns > now_ns
        {
            (self.core.mean, self.core.covariance) = self.predicted(now_ns, t_ns);
        }
        self.core.now_ns = Some(t_ns);
    }

    fn fix(&mut self, position_m: [f64; 2], [ee, en, nn]: [f64; 3]) -> Outcome {
        let noise = Matrix2::new(ee, en, en, nn);
        if !self.core.started {
            self.core.started = true;
            self.core.mean[0] = position_m[0];
            self.core.mean[1] = position_m[1];
            self.core.covariance = Covariance::zeros();
            self.core.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&noise);
            self.core.covariance.fixed_view_mut::<4, 4>(2, 2).copy_from(&self.drift.prior::<4>());
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
            Payload::Motion { velocity_mps } => {
                self.core.velocity_mps = *velocity_mps;
                self.core.held.renew(event.t_ns, *velocity_mps);
                Ok(Outcome::Fused)
            }
            Payload::Fix { position_m, covariance_m2 } => Ok(self.fix(*position_m, *covariance_m2)),
            _ => Ok(Outcome::Noted),
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
            uses: Kinds::of(&[Kind::Motion, Kind::Fix]),
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
        columns.push(("gated_fixes", self.core.rejected as f64));
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
