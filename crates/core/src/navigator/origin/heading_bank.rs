//! `mdeif` for a vehicle with odometry whose heading at the start is not known.
//!
//! ```text
//! heading with a sigma above 20°  ─►  a navigator for each of 24 headings  ─►  ranges weigh them  ─►  one is left
//! ```
//!
//! The error of a heading is linearised, so no single Gaussian holds a circle of headings. Each hypothesis is a navigator
//! of its own with a small sigma; its weight is the density of what it fused. Those that ranges contradict are dropped,
//! those that came to the same are merged. Until one is left the estimate is the mean and covariance of them all, and
//! the vehicle keeps silent: its packets would be those of a graph that may be dropped.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::mdeif::Mdeif;
use super::odometry::KNOWN_RAD;
use crate::error::Error;
use crate::event::{Event, Payload};
use crate::kernels::math::{exp, ln};
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Innovation, Navigator, Outcome, Profile, Status};

/// A sigma beyond this says nothing, rad: that of a uniform circle.
const CIRCLE_RAD: f64 = 1.8;
/// 15° apart.
const HYPOTHESES: usize = 24;
/// Of one hypothesis: half the distance between two, rad.
const SIGMA_RAD: f64 = PI / HYPOTHESES as f64;
/// A hypothesis is dropped when the best is more likely by this factor's logarithm. Errors of ranges that last (a bias)
/// are counted at each range, hence the caution.
const DROPPED: f64 = 20.0;
/// Hypotheses are merged when their headings and places differ by less than this share of their sigmas.
const SAME: f64 = 0.5;

/// One heading at the start.
#[derive(Clone)]
struct Hypothesis {
    start_rad: f64,
    /// Logarithm of the weight, but for the navigator's evidence.
    log_prior: f64,
    navigator: Mdeif,
}

/// The bank as bytes hold it.
#[derive(Serialize, Deserialize)]
struct Stored {
    heading: Option<(f64, f64)>,
    begun: bool,
    /// Heading, logarithm of the weight, navigator.
    bank: Vec<(f64, f64, Vec<u8>)>,
}

/// The navigators of all headings that are still possible; one where the heading is known.
pub struct HeadingBank {
    /// Last yaw and sigma before the vehicle moves, rad.
    heading: Option<(f64, f64)>,
    begun: bool,
    bank: Vec<Hypothesis>,
}

impl HeadingBank {
    /// Around a navigator that has not been told anything yet.
    #[must_use]
    pub fn new(navigator: Mdeif) -> Self {
        let only = Hypothesis { start_rad: 0.0, log_prior: 0.0, navigator };
        Self { heading: None, begun: false, bank: vec![only] }
    }

    /// Before the vehicle moves for the first time: hypotheses, if its heading is not known.
    fn watch(&mut self, event: &Event) -> Result<(), Error> {
        let (Payload::Odometry { yaw_change_rad, .. }, Some((yaw_rad, sigma_rad))) =
            (&event.payload, self.heading)
        else {
            return Ok(());
        };
        if self.best().navigator.estimate(event.t_ns).status == Status::NotStarted {
            self.heading = Some((yaw_rad + yaw_change_rad, sigma_rad));
            return Ok(());
        }
        if sigma_rad > KNOWN_RAD {
            self.bank = self.split(event, yaw_rad, sigma_rad)?;
        }
        self.begun = true;
        Ok(())
    }

    fn split(&self, event: &Event, yaw_rad: f64, sigma_rad: f64) -> Result<Vec<Hypothesis>, Error> {
        let only = self.best();
        (0..HYPOTHESES)
            .map(|k| {
                let turn_rad = wrapped(TAU * k as f64 / HYPOTHESES as f64);
                let mut one = only.clone();
                one.start_rad = yaw_rad + turn_rad;
                if sigma_rad < CIRCLE_RAD {
                    one.log_prior = -0.5 * (turn_rad / sigma_rad).powi(2);
                }
                let heading = Payload::Heading { yaw_rad: one.start_rad, sigma_rad: SIGMA_RAD };
                one.navigator.handle(&Event { payload: heading, ..event.clone() })?;
                Ok(one)
            })
            .collect()
    }

    fn best(&self) -> &Hypothesis {
        let heavier = |a: &&Hypothesis, b: &&Hypothesis| a.log_weight().total_cmp(&b.log_weight());
        self.bank.iter().max_by(heavier).unwrap_or(&self.bank[0])
    }

    /// Lets every hypothesis handle an event. One that a measurement contradicts, but not all, pays for it.
    fn handle_all(&mut self, event: &Event) -> Result<Outcome, Error> {
        let best_start_rad = self.best().start_rad;
        let mut failed = Vec::new();
        let mut kept = Vec::with_capacity(self.bank.len());
        for mut one in self.bank.drain(..).collect::<Vec<_>>() {
            match one.navigator.handle(event) {
                Ok(outcome) => kept.push((outcome, one)),
                Err(error) => failed.push((error, one)),
            }
        }
        if kept.is_empty()
            && let Some((error, _)) = failed.first()
        {
            // Nothing has changed in any of them.
            let error = error.clone();
            self.bank.extend(failed.into_iter().map(|(_, one)| one));
            return Err(error);
        }
        let fused = kept.iter().any(|(outcome, _)| *outcome == Outcome::Fused);
        let of_best = kept.iter().find(|(_, one)| one.start_rad == best_start_rad).or(kept.first());
        let outcome = of_best.map_or(Outcome::Noted, |(outcome, _)| *outcome);
        for (outcome, mut one) in kept {
            if fused && outcome == Outcome::Gated {
                let local = &one.navigator.options.local;
                one.log_prior -= 0.5 * local.gate_sigmas * local.gate_sigmas + ln(local.sigma_range_m);
            }
            self.bank.push(one);
        }
        Ok(outcome)
    }

    /// Drops what is unlikely and merges what is the same.
    fn prune(&mut self) {
        let most = self.best().log_weight();
        self.bank.retain(|one| one.log_weight() >= most - DROPPED);
        self.bank.sort_by(|a, b| b.log_weight().total_cmp(&a.log_weight()));
        let mut kept: Vec<Hypothesis> = Vec::with_capacity(self.bank.len());
        for one in self.bank.drain(..) {
            match kept.iter_mut().find(|other| other.is_like(&one)) {
                Some(other) => {
                    let share = exp(one.log_weight() - other.log_weight());
                    other.log_prior += ln(1.0 + share);
                }
                None => kept.push(one),
            }
        }
        self.bank = kept;
    }
}

impl Hypothesis {
    fn log_weight(&self) -> f64 {
        self.log_prior + self.navigator.core.joint_filter.log_evidence()
    }

    /// Whether another hypothesis came to the same heading and place.
    fn is_like(&self, other: &Self) -> bool {
        let own = |one: &Self| one.navigator.core.joint_filter.own_at(0, 0.0);
        let (Some(mine), Some(others)) = (own(self), own(other)) else { return false };
        let turn_rad = wrapped(self.start_rad + mine.mean[2] - other.start_rad - others.mean[2]);
        let apart = (mine.mean - others.mean).fixed_rows::<2>(0).into_owned();
        let place = mine.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let Some(lower) = place.cholesky() else { return false };
        turn_rad * turn_rad < SAME * SAME * mine.covariance[(2, 2)]
            && apart.dot(&lower.solve(&apart)) < SAME * SAME
    }
}

/// An angle in (−π, π].
fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - TAU * (angle_rad / TAU).round()
}

impl Navigator for HeadingBank {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        if !self.begun && matches!(event.payload, Payload::Odometry { .. }) {
            // An event that is refused must not split the bank.
            self.best().navigator.clone().handle(event)?;
            self.watch(event)?;
        }
        if let [only] = self.bank.as_mut_slice() {
            let outcome = only.navigator.handle(event)?;
            if let (false, Payload::Heading { yaw_rad, sigma_rad }) = (self.begun, &event.payload) {
                self.heading = Some((*yaw_rad, *sigma_rad));
            }
            return Ok(outcome);
        }
        let outcome = self.handle_all(event)?;
        if matches!(event.payload, Payload::Reception { .. } | Payload::Fix { .. }) {
            self.prune();
        }
        Ok(outcome)
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        match self.bank.as_mut_slice() {
            [only] => only.navigator.transmit(tol_ns, capacity_bytes),
            _ => Ok(None),
        }
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        let best = self.best();
        let mut found = best.navigator.estimate(t_ns);
        if self.bank.len() == 1 {
            return found;
        }
        let most = best.log_weight();
        let all: Vec<(f64, Vector2<f64>, Matrix2<f64>)> = self
            .bank
            .iter()
            .map(|one| {
                let Estimate { mean_m, covariance_m2: [ee, en, nn], .. } = one.navigator.estimate(t_ns);
                (exp(one.log_weight() - most), Vector2::from(mean_m), Matrix2::new(ee, en, en, nn))
            })
            .collect();
        let total: f64 = all.iter().map(|(weight, ..)| weight).sum();
        let mean = all.iter().map(|(weight, mean, _)| mean * (weight / total)).sum::<Vector2<f64>>();
        let covariance = all
            .iter()
            .map(|(weight, one, own)| (own + (one - mean) * (one - mean).transpose()) * (weight / total))
            .sum::<Matrix2<f64>>();
        found.mean_m = [mean.x, mean.y];
        found.covariance_m2 = [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]];
        found
    }

    fn profile(&self) -> Profile {
        self.bank[0].navigator.profile()
    }

    fn innovation(&self) -> Option<Innovation> {
        self.best().navigator.innovation()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut found = self.best().navigator.diagnostics();
        found.push(("heading_hypotheses", self.bank.len() as f64));
        found
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        let stored =
            self.bank.iter().map(|one| Ok((one.start_rad, one.log_prior, one.navigator.snapshot()?)));
        let bank = stored.collect::<Result<_, Error>>()?;
        save(&Stored { heading: self.heading, begun: self.begun, bank })
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let Stored { heading, begun, bank } = load(snapshot)?;
        if bank.is_empty() || bank.len() > HYPOTHESES {
            return Err(Error::Snapshot("holds no navigator, or more than there are hypotheses".into()));
        }
        let restored = bank.into_iter().map(|(start_rad, log_prior, bytes)| {
            let mut navigator = self.bank[0].navigator.clone();
            navigator.restore(&bytes)?;
            Ok(Hypothesis { start_rad, log_prior, navigator })
        });
        let bank = restored.collect::<Result<Vec<_>, Error>>()?;
        (self.heading, self.begun, self.bank) = (heading, begun, bank);
        Ok(())
    }
}
