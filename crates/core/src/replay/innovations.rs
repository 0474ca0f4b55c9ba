//! How measurements fitted the beliefs before they were used, and what became of them: what a mission without truth is
//! judged by. Nothing here changes an estimate.

use serde::{Deserialize, Serialize};

use super::Estimators;
use crate::error::Error;
use crate::event::{Event, Kind, Payload, VehicleId};
use crate::measurement::fix;
use crate::navigator::{Estimate, Outcome};

/// A measurement against the belief before it was used.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct InnovationRecord {
    /// When, ns.
    pub t_ns: i64,
    /// Whose.
    pub vehicle: VehicleId,
    /// [`Kind::Fix`] or [`Kind::Usbl`], [`Kind::WaterDepth`], or [`Kind::Reception`] or [`Kind::BeaconRange`] for a range.
    pub kind: Kind,
    /// Of a range.
    pub sender: Option<VehicleId>,
    /// What became of it.
    pub outcome: Outcome,
    /// Measured less expected, m; of a fix its distance from the belief.
    pub innovation_m: f64,
    /// Standard deviation of it by belief and sensor; of a fix the root of the trace, m.
    pub sigma_m: f64,
    /// Normalised innovation squared: χ² with one degree of freedom, of a fix with two.
    pub squared: f64,
    /// How far a fix moved the belief, m; NaN for the others.
    pub jump_m: f64,
}

/// By vehicle, how many events of a kind were fused, noted, gated, rejected.
pub type OutcomeCounts = Vec<[u64; 4]>;

/// Place of an outcome in [`OutcomeCounts`].
#[must_use]
pub fn place_of(outcome: Outcome) -> usize {
    match outcome {
        Outcome::Fused => 0,
        Outcome::Noted => 1,
        Outcome::Gated => 2,
        Outcome::Rejected => 3,
    }
}

/// A fix and the belief at its time.
fn of_fix(
    before: &Estimate,
    event: &Event,
    position_m: [f64; 2],
    covariance_m2: [f64; 3],
) -> Option<InnovationRecord> {
    let [e, n] = [position_m[0] - before.mean_m[0], position_m[1] - before.mean_m[1]];
    let noise = fix::floored(covariance_m2);
    let [ee, en, nn] = [0, 1, 2].map(|k| before.covariance_m2[k] + noise[k]);
    let determinant = ee * nn - en * en;
    let squared = (nn * e * e - 2.0 * en * e * n + ee * n * n) / determinant;
    (squared.is_finite() && determinant > 0.0).then(|| InnovationRecord {
        t_ns: event.t_ns,
        vehicle: event.vehicle,
        kind: event.payload.kind(),
        sender: None,
        outcome: Outcome::Noted,
        innovation_m: e.hypot(n),
        sigma_m: (ee + nn).sqrt(),
        squared,
        jump_m: f64::NAN,
    })
}

impl Estimators {
    /// As [`Estimators::handle`], with how the measurement fitted; `None` where it was not compared with the belief.
    ///
    /// # Errors
    /// What the navigator refuses.
    pub fn handle_judged(&mut self, event: &Event) -> Result<(Outcome, Option<InnovationRecord>), Error> {
        let vehicle = usize::from(event.vehicle);
        let position = match event.payload {
            Payload::Fix { position_m, covariance_m2 } => Some((event.t_ns, position_m, covariance_m2)),
            Payload::Usbl { measured_ns, position_m, covariance_m2 } => {
                Some((measured_ns, position_m, covariance_m2))
            }
            _ => None,
        };
        if let Some((measured_ns, position_m, covariance_m2)) = position {
            let kind = event.payload.kind();
            if !self.profile(event.vehicle).is_some_and(|profile| profile.uses.contains(kind)) {
                return Ok((self.handle(event)?, None));
            }
            // Where the vehicle is believed to have been then; what moves is the belief of now.
            let before_then = self.estimate(vehicle, measured_ns);
            let before = self.estimate(vehicle, event.t_ns);
            let outcome = self.handle(event)?;
            let after_m = self.estimate(vehicle, event.t_ns).mean_m;
            let jump_m = (after_m[0] - before.mean_m[0]).hypot(after_m[1] - before.mean_m[1]);
            let seen = of_fix(&before_then, event, position_m, covariance_m2);
            return Ok((outcome, seen.map(|seen| InnovationRecord { outcome, jump_m, ..seen })));
        }
        let outcome = self.handle(event)?;
        let (kind, sender) = match &event.payload {
            Payload::WaterDepth { .. } => (Kind::WaterDepth, None),
            Payload::Reception { sender, .. } => (Kind::Reception, Some(*sender)),
            Payload::BeaconRange { .. } => (Kind::BeaconRange, None),
            _ => return Ok((outcome, None)),
        };
        let record = self.innovation(event.vehicle).map(|seen| InnovationRecord {
            t_ns: event.t_ns,
            vehicle: event.vehicle,
            kind,
            sender,
            outcome,
            innovation_m: seen.value_m,
            sigma_m: seen.variance_m2.sqrt(),
            squared: seen.value_m * seen.value_m / seen.variance_m2,
            jump_m: f64::NAN,
        });
        Ok((outcome, record))
    }
}
