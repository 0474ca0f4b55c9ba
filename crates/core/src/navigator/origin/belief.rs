//! Navigators that exchange beliefs instead of pose graphs: each packet holds the sender's position, mean and covariance.
//!
//! * `nekf`: treats beliefs as independent (Walls & Eustice 2012, section 2.1). Information that returns to its source
//!   is counted twice.
//! * `covariance-intersection`: treats their correlation as unknown (Julier & Uhlmann 1997). Counts nothing twice, and is
//!   conservative.

use std::sync::Arc;

use nalgebra::{Matrix2, Vector4};
use serde::{Deserialize, Serialize};

use super::graph::Graph;
use super::local_options::LocalOptions;
use super::range::{Range, RangeNoise};
use super::sensors::{LOCAL_SENSORS, check_local_event};
use crate::error::Error;
use crate::event::{Event, Kind, Payload, VehicleId, seconds};
use crate::information::{Gaussian, Joint, NODE, NodeMatrix, NodeVector};
use crate::navigator::radio::{BroadcastBelief, HeardBelief, Radio};
use crate::navigator::settings::{BeliefSettings, Settings, check_all};
use crate::navigator::snapshot::{load, save};
use crate::navigator::{Estimate, Innovation, LastInnovation, Navigator, Outcome, Profile};
use crate::packet::{Belief, PacketKind};

/// Assumption on the correlation between a teammate's belief and the own one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Correlation {
    /// None.
    Ignored,
    /// Any.
    Unknown,
}

/// What navigators that exchange beliefs are configured with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BeliefOptions {
    /// How motion, sensors and ranges are modelled.
    pub local: LocalOptions,
    /// What is assumed of correlations.
    pub correlation: Correlation,
    /// Factor on the process noise, to compensate for correlation that is not modelled.
    pub process_noise_factor: f64,
    /// Whether this vehicle uses ranges.
    pub ranging: bool,
    /// Whether it broadcasts.
    pub talking: bool,
    /// [`PacketKind::Belief`] or [`PacketKind::BeliefF64`].
    pub packet: PacketKind,
}

/// The only vehicle of its graph.
const ALONE: usize = 0;

/// A navigator with one node, its own.
pub struct BeliefNavigator {
    own: VehicleId,
    options: BeliefOptions,
    sound_speed_mps: f64,
    core: ExchangeState,
    innovation: LastInnovation,
}

#[derive(Clone, Serialize, Deserialize)]
struct ExchangeState {
    /// Of this vehicle alone.
    graph: Graph,
    radio: Radio,
    /// Stamp of the last event, ns.
    last_ns: Option<i64>,
    /// Share of the own information that the last intersection kept; NaN before.
    kept_share: f64,
}

impl BeliefNavigator {
    /// For vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// Options that cannot be; an unknown vehicle.
    pub fn new(
        own: VehicleId,
        vehicles: usize,
        options: BeliefOptions,
        sound_speed_mps: f64,
    ) -> Result<Self, Error> {
        check_all(&BeliefSettings::bounds(), &[("process_noise_factor", options.process_noise_factor)])?;
        let mut local = options.local;
        local.process_noise_m2_per_s3 *= options.process_noise_factor;
        local.process_noise_dvl_m2_per_s3 *= options.process_noise_factor;
        local.validate()?;
        let core = ExchangeState {
            graph: Graph::new(1, local),
            radio: Radio::new(own, vehicles, sound_speed_mps)?,
            last_ns: None,
            kept_share: f64::NAN,
        };
        Ok(Self { own, options, sound_speed_mps, core, innovation: LastInnovation::default() })
    }

    fn hear(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Outcome {
        let noise = RangeNoise::of(&self.options.local, tol_ns, toa_ns, self.sound_speed_mps);
        let Some(HeardBelief { belief: BroadcastBelief::Gaussian(belief), range_m, depth_rounding_m2 }) =
            self.core.radio.receive(sender, tol_ns, toa_ns, bytes, noise.whole_m)
        else {
            self.core.graph.reject(ALONE);
            return Outcome::Rejected;
        };
        if !self.options.ranging {
            return Outcome::Noted;
        }
        let slant_m = seconds(toa_ns.saturating_sub(tol_ns)) * self.sound_speed_mps;
        if range_m <= noise.whole_m {
            self.core.graph.reject(ALONE);
            return Outcome::Gated;
        }
        let range = noise.range(slant_m, range_m).with_rounding(depth_rounding_m2);
        self.core.graph.advance(ALONE, toa_ns);
        let outcome = self.fuse(&range, &node_of(&belief), toa_ns);
        if outcome == Outcome::Gated {
            self.core.graph.reject(ALONE);
        }
        outcome
    }

    /// Fuses a range to a teammate at launch, with the own node where it was at arrival.
    fn fuse(&mut self, range: &Range, sender: &Gaussian<NODE>, toa_ns: i64) -> Outcome {
        let Some(node) = self.core.graph.current(ALONE) else { return Outcome::Gated };
        let late_s = self.core.graph.late_s(ALONE, toa_ns);
        let (mut own, mut sender) = (self.core.graph.coast(ALONE, -late_s).applied(&node), *sender);
        if self.options.correlation == Correlation::Unknown {
            let Some(share) = best_share(&own, &sender, range) else { return Outcome::Noted };
            self.core.kept_share = share;
            own.covariance /= share;
            sender.covariance /= 1.0 - share;
        }
        let mut joint = Joint::new();
        let (own, sender) = (joint.push(&own), joint.push(&sender));
        let gate = self.options.local.gate_sigmas;
        let outcome = range.fuse_seen(&mut joint, sender, own, gate, &mut self.innovation);
        if outcome == Outcome::Fused {
            let now = self.core.graph.coast(ALONE, late_s).applied(&joint.marginal(own));
            if !now.is_sound() {
                return Outcome::Gated;
            }
            self.core.graph.set_alone(&now);
        }
        outcome
    }
}

/// A position belief as a node at rest; a range needs the position only.
fn node_of(belief: &Belief) -> Gaussian<NODE> {
    let mut mean = NodeVector::zeros();
    mean.fixed_rows_mut::<2>(0).copy_from(&belief.mean_m);
    let mut covariance = NodeMatrix::zeros();
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&belief.covariance_m2);
    Gaussian { mean, covariance }
}

/// Shares that are tried first; golden sections around the best of them then halve the bracket below 1e-5.
const SHARES: u32 = 32;
const SECTIONS: u32 = 18;
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The share ω of the own information for which diag(P/ω, P_s/(1 − ω)), which no correlation exceeds, leaves the least
/// trace of the position's covariance after the range; `None` when no share is better than to leave the range be.
fn best_share(own: &Gaussian<NODE>, sender: &Gaussian<NODE>, range: &Range) -> Option<f64> {
    let between = (own.mean - sender.mean).fixed_rows::<2>(0).into_owned();
    let distance_m = between.norm();
    let unit = if distance_m > 0.0 { between / distance_m } else { return None };
    let own_toward = own.covariance * Vector4::new(unit.x, unit.y, 0.0, 0.0);
    let own_along = unit.dot(&own_toward.fixed_rows::<2>(0));
    let across = own_toward.fixed_rows::<2>(0).norm_squared();
    let sender_along = unit.dot(&(position(&sender.covariance) * unit));
    let trace = own.covariance[(0, 0)] + own.covariance[(1, 1)];
    let after = |share: f64| {
        let innovation = own_along / share + sender_along / (1.0 - share) + range.counted_m * range.counted_m;
        trace / share - across / (share * share * innovation)
    };
    let tried = (1..SHARES).map(|k| f64::from(k) / f64::from(SHARES));
    let first = tried.min_by(|a, b| after(*a).total_cmp(&after(*b)))?;
    let step = 1.0 / f64::from(SHARES);
    let (mut low, mut high) = (first - step, first + step);
    for _ in 0..SECTIONS {
        let span = GOLDEN * (high - low);
        // At the ends of (0, 1) the trace is infinite or the prior's: never less than inside.
        if after(high - span) < after(low + span) {
            high = low + span;
        } else {
            low = high - span;
        }
    }
    let share = 0.5 * (low + high);
    (after(share) < trace).then_some(share)
}

fn position(covariance: &NodeMatrix) -> Matrix2<f64> {
    covariance.fixed_view::<2, 2>(0, 0).into_owned()
}

impl Navigator for BeliefNavigator {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_local_event(event, self.own, self.core.last_ns)?;
        self.core.radio.check_sender(&event.payload)?;
        self.core.graph.check_heading(ALONE, &event.payload)?;
        self.innovation = LastInnovation::default();
        self.core.last_ns = Some(event.t_ns);
        Ok(match &event.payload {
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                self.hear(*sender, *tol_ns, *toa_ns, bytes)
            }
            payload => {
                let outcome = self.core.graph.sense(ALONE, event.t_ns, payload);
                self.core.radio.set_depth(self.core.graph.depth_m(ALONE));
                outcome
            }
        })
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        if !self.options.talking || self.core.graph.current(ALONE).is_none() {
            return Ok(None);
        }
        let belief = self.core.graph.estimate(ALONE, tol_ns);
        self.core.radio.broadcast(self.options.packet, &belief, tol_ns, capacity_bytes).map(Some)
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        self.core.graph.estimate(ALONE, t_ns)
    }

    fn profile(&self) -> Profile {
        Profile {
            takes_ranges: self.options.ranging,
            has_checksum: true,
            needs_delivery_oracle: false,
            uses: LOCAL_SENSORS.with(Kind::Reception, self.options.ranging || self.options.talking),
        }
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        match self.options.correlation {
            Correlation::Ignored => Vec::new(),
            Correlation::Unknown => vec![("kept_share", self.core.kept_share)],
        }
    }

    fn innovation(&self) -> Option<Innovation> {
        self.innovation.0
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&self.core)
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.core = load(snapshot)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    fn node(mean: [f64; 2], covariance: [f64; 3]) -> Gaussian<NODE> {
        let [ee, en, nn] = covariance;
        let mut found =
            node_of(&Belief { mean_m: Vector2::from(mean), covariance_m2: Matrix2::new(ee, en, en, nn) });
        found.covariance[(2, 2)] = 0.01;
        found.covariance[(3, 3)] = 0.01;
        found
    }

    /// Trace of the own position after a range under diag(P/ω, P_s/(1 − ω)), by the joint itself.
    fn trace_at(share: f64, own: &Gaussian<NODE>, sender: &Gaussian<NODE>, range: &Range) -> f64 {
        let (mut own, mut sender) = (*own, *sender);
        own.covariance /= share;
        sender.covariance /= 1.0 - share;
        let mut joint = Joint::new();
        joint.push(&own);
        joint.push(&sender);
        assert_eq!(range.fuse(&mut joint, 1, 0, 1e9), Outcome::Fused);
        position(&joint.marginal(0).covariance).trace()
    }

    #[test]
    fn the_share_is_the_best_of_all() {
        let own = node([0.0, 0.0], [25.0, 6.0, 9.0]);
        let sender = node([100.0, 40.0], [1.0, 0.2, 2.0]);
        let range = Range { range_m: 107.0, sigma_m: 1.0, counted_m: 1.0, late: None };
        let best = best_share(&own, &sender, &range).unwrap();
        let at_best = trace_at(best, &own, &sender, &range);
        for k in 1..1000 {
            assert!(at_best <= trace_at(f64::from(k) / 1000.0, &own, &sender, &range) + 1e-6);
        }
        assert!(at_best < 34.0);
    }

    #[test]
    fn a_worse_teammate_teaches_nothing() {
        let own = node([0.0, 0.0], [1.0, 0.0, 1.0]);
        let sender = node([100.0, 0.0], [1.0, 0.0, 1.0]);
        assert_eq!(
            best_share(&own, &sender, &Range { range_m: 100.0, sigma_m: 1.0, counted_m: 1.0, late: None }),
            None
        );
    }
}
