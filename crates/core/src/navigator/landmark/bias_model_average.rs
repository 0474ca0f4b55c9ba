//! `landmark` with bias states, averaged over whether the sensors have biases at all.
//!
//! States with a prior of 1 % or 0.5° cost accuracy where there is nothing to estimate. So two filters run: one with the
//! states, one that takes the sensors at their word. Both see the same events; each sums up the logarithm of the density
//! that it gave to every positioning and to the gyro at rest before it used it, and the estimate and the packet are the
//! moments of both, weighed by the prior and these densities.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::options::LandmarkOptions;
use super::robust::Landmark;
use crate::error::Error;
use crate::event::{Event, VehicleId};
use crate::measurement::angle::wrap;
use crate::mixture::Mode;
use crate::navigator::settings::{LandmarkSettings, Settings, check_all};
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Navigator, Outcome, Particles, Profile, Status};

/// Two filters of one vehicle, with and without bias states.
pub struct BiasModelAverage {
    biased: Landmark,
    plain: Landmark,
    /// Logarithm of the prior odds of biases.
    log_prior: f64,
}

impl BiasModelAverage {
    /// `options` with bias states; `share` is the prior probability, in (0, 1), that the sensors have biases.
    ///
    /// # Errors
    /// As [`Landmark::new`]; [`Error::OutOfBound`] for the share.
    pub fn new(
        own: VehicleId,
        vehicles: usize,
        options: LandmarkOptions,
        seed: u64,
        share: f64,
    ) -> Result<Self, Error> {
        check_all(&LandmarkSettings::bounds(), &[("bias_share", share)])?;
        let plain = LandmarkOptions { bias_sigma: [0.0; 3], ..options };
        Ok(Self {
            biased: Landmark::new(own, vehicles, options, seed)?,
            plain: Landmark::new(own, vehicles, plain, seed)?,
            log_prior: (share / (1.0 - share).max(f64::MIN_POSITIVE)).ln(),
        })
    }

    /// Posterior probability of biases.
    #[must_use]
    pub fn share(&self) -> f64 {
        let log_odds = self.log_prior + self.biased.log_evidence() - self.plain.log_evidence();
        1.0 / (1.0 + (-log_odds).exp())
    }

    /// The likelier of the two.
    fn likelier(&self) -> &Landmark {
        if self.share() >= 0.5 { &self.biased } else { &self.plain }
    }

    fn launch(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        let share = self.share();
        let (biased, plain) = (self.biased.modes()?, self.plain.modes()?);
        let modes = match (biased.as_slice(), plain.as_slice()) {
            ([biased], [plain]) => vec![pooled(biased, plain, share)],
            _ if share >= 0.5 => biased,
            _ => plain,
        };
        let told = self.biased.launch(modes.clone(), tol_ns, capacity_bytes)?;
        self.plain.launch(modes, tol_ns, capacity_bytes)?;
        Ok(told)
    }
}

/// Mean and covariance of two modes in the packet's coordinates.
fn pooled(a: &Mode<6>, b: &Mode<6>, share: f64) -> Mode<6> {
    let mut apart = a.mean - b.mean;
    for k in [2, 4, 5] {
        apart[k] = wrap(apart[k]);
    }
    Mode {
        weight: 1.0,
        mean: b.mean + apart * share,
        covariance: a.covariance * share
            + b.covariance * (1.0 - share)
            + apart * apart.transpose() * (share * (1.0 - share)),
    }
}

/// Mean and covariance of two estimates.
fn blend(a: Estimate, b: Estimate, share: f64) -> Estimate {
    let (Some((a_yaw, a_row)), Some((b_yaw, b_row))) = (a.yaw, b.yaw) else { return a };
    if a.status != Status::Navigating || b.status != Status::Navigating {
        return a;
    }
    let matrix =
        |[ee, en, nn]: [f64; 3], [ye, yn, yy]: [f64; 3]| Matrix3::new(ee, en, ye, en, nn, yn, ye, yn, yy);
    let apart = Vector3::new(a.mean_m[0] - b.mean_m[0], a.mean_m[1] - b.mean_m[1], wrap(a_yaw - b_yaw));
    let p = matrix(a.covariance_m2, a_row) * share
        + matrix(b.covariance_m2, b_row) * (1.0 - share)
        + apart * apart.transpose() * (share * (1.0 - share));
    Estimate {
        mean_m: [b.mean_m[0] + share * apart.x, b.mean_m[1] + share * apart.y],
        covariance_m2: [p[(0, 0)], p[(0, 1)], p[(1, 1)]],
        yaw: Some((wrap(b_yaw + share * apart.z), [p[(2, 0)], p[(2, 1)], p[(2, 2)]])),
        ..if share >= 0.5 { a } else { b }
    }
}

impl Navigator for BiasModelAverage {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        // Both refuse the same events, so nothing has changed where the first one does.
        let plain = self.plain.handle(event)?;
        let biased = self.biased.handle(event)?;
        Ok(if self.share() >= 0.5 { biased } else { plain })
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        if !self.biased.has_news() {
            return Ok(None);
        }
        let before = (self.biased.kept(), self.plain.kept());
        let launched = self.launch(tol_ns, capacity_bytes);
        if !matches!(launched, Ok(Some(_))) {
            self.biased.silent(before.0);
            self.plain.silent(before.1);
        }
        launched
    }

    fn profile(&self) -> Profile {
        self.biased.profile()
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        blend(self.biased.estimate(t_ns), self.plain.estimate(t_ns), self.share())
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&(self.biased.snapshot()?, self.plain.snapshot()?))
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let (biased, plain): (Vec<u8>, Vec<u8>) = load(snapshot)?;
        let before = self.biased.kept();
        self.biased.restore(&biased)?;
        self.plain.restore(&plain).inspect_err(|_| self.biased.silent(before))
    }

    fn particles(&self) -> Option<Particles> {
        self.likelier().particles()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let share = self.share();
        let mut numbers = self.likelier().diagnostics();
        for (number, (_, biased)) in numbers.iter_mut().zip(self.biased.diagnostics()) {
            if ["gyro_bias_radps", "dvl_scale", "dvl_misalignment_rad"].contains(&number.0) {
                number.1 = share * biased;
            }
        }
        numbers.push(("bias_share", share));
        numbers
    }
}
