//! `mpf`: the consistent marginalised particle filter: the [terrain core](super::terrain_core), and ranges to broadcast
//! beliefs, tempered because a belief that was fused before carries little new information.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::diagnostics::teammates;
use super::from_outside::BeaconOptions;
use super::last_heard::LastHeard;
use super::radio::{HeardBelief, Radio};
use super::range::{RangeMethod, RangeOptions};
use super::range_novelty;
use super::snapshot::{load, save};
use super::terrain_core::{TerrainCore, TerrainOptions, TerrainState};
use super::{
    Estimate, Innovation, Kinds, LastInnovation, Navigator, Outcome, Particles, Profile, check_event,
};
use crate::chart::Chart;
use crate::error::Error;
use crate::event::{Event, Kind, Payload, VehicleId, seconds};
use crate::packet::PacketKind;

/// Options of `mpf`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MpfOptions {
    /// Cloud, datum offset, soundings, monitor, drift.
    pub terrain: TerrainOptions,
    /// Range likelihood; none leaves ranges unused and keeps silent.
    pub range: Option<RangeOptions>,
    /// Of a teammate's range, count only what is new since it was last heard ([`range_novelty`]).
    pub range_novelty: bool,
    /// Form of the broadcast belief.
    pub packet: PacketKind,
}

/// Two vehicles at one place have no direction between them, m.
const LEAST_DISTANCE_M: f64 = 1e-6;

/// The navigator, with K = 2 (current) or 4 (and compass and thrust bias) linear states.
pub struct Mpf<const K: usize> {
    own: VehicleId,
    options: MpfOptions,
    terrain: TerrainCore<K>,
    link: LinkState,
}

#[derive(Serialize, Deserialize)]
struct LinkState {
    radio: Radio,
    last_heard: LastHeard,
}

impl<const K: usize> Mpf<K> {
    /// A navigator for vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// Options outside their bounds.
    pub fn new(
        own: VehicleId,
        vehicles: usize,
        options: MpfOptions,
        chart: Option<Arc<Chart>>,
        sound_speed_mps: f64,
        seed: u64,
    ) -> Result<Self, Error> {
        if let Some(range) = &options.range {
            range.validate()?;
        }
        let mut terrain = TerrainCore::new(own, options.terrain, chart, seed)?;
        if let Some(range) = &options.range {
            terrain.set_beacons(BeaconOptions::of(range.clock, range.gate_sigmas, sound_speed_mps));
        }
        Ok(Self {
            own,
            options,
            terrain,
            link: LinkState {
                radio: Radio::new(own, vehicles, sound_speed_mps)?,
                last_heard: LastHeard::new(vehicles),
            },
        })
    }

    /// The own core: cloud, datum offset, alarms.
    #[must_use]
    pub fn terrain(&self) -> &TerrainCore<K> {
        &self.terrain
    }

    fn reception(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Outcome {
        let Some(range) = self.options.range else { return Outcome::Noted };
        // Before the radio takes down that the packet was heard: what cannot be placed in time is refused whole.
        if !self.terrain.state.core.remembers(toa_ns) {
            self.terrain.state.core.rejected += 1;
            return Outcome::Rejected;
        }
        let standing_m2 = self.link.radio.standing_m2(&range.clock, tol_ns, toa_ns);
        let range = range.inflated(standing_m2);
        let Some(heard) = self.link.radio.receive(sender, tol_ns, toa_ns, bytes, range.sigma_m) else {
            self.terrain.state.core.rejected += 1;
            return Outcome::Rejected;
        };
        let range = range.inflated(heard.depth_rounding_m2);
        if self.terrain.acquiring() {
            return self.range_while_acquiring(&heard, toa_ns, &range);
        }
        let share = self.new_share(sender, tol_ns, &heard, standing_m2);
        let outcome = self.terrain.state.core.range(&heard, toa_ns, &range.counting(share));
        if outcome == Outcome::Fused {
            self.link.last_heard.keep(sender, tol_ns, heard.belief.moments().1);
            self.terrain.resample();
        }
        outcome
    }
}

impl<const K: usize> Mpf<K> {
    /// A range weighs the search by itself: what its sender believed before is not in it.
    fn range_while_acquiring(&mut self, heard: &HeardBelief, toa_ns: i64, range: &RangeOptions) -> Outcome {
        let (RangeMethod::Gaussian { temper }, Some(moved_m)) =
            (range.method, self.terrain.state.core.displacement_since(toa_ns))
        else {
            return Outcome::Noted;
        };
        self.terrain.acquire_range(heard.belief.summary(heard.range_m, moved_m, range.sigma_m), temper)
    }

    /// Share of this belief that counts: all of it, or what is new beside a standing error.
    fn new_share(&self, sender: VehicleId, tol_ns: i64, heard: &HeardBelief, standing_m2: f64) -> f64 {
        let (true, Some(before)) = (self.options.range_novelty, self.link.last_heard.of(sender)) else {
            return 1.0;
        };
        let (theirs, covariance_m2) = heard.belief.moments();
        let core = &self.terrain.state.core;
        let (own, _) = core.cloud.position_moments();
        let (de, dn) = (own[0] - theirs[0], own[1] - theirs[1]);
        let distance_m = de.hypot(dn).max(LEAST_DISTANCE_M);
        let direction = [de / distance_m, dn / distance_m];
        // A teammate drifts as this vehicle does: its packets have no room for more.
        let growth = core.growth(direction, seconds(tol_ns.saturating_sub(before.tol_ns)));
        range_novelty::share(before.covariance_m2, covariance_m2, direction, &growth, standing_m2)
    }
}

impl<const K: usize> Mpf<K> {
    /// What one event does once the clock has been advanced to it.
    fn fuse_event(&mut self, event: &Event) -> Outcome {
        match &event.payload {
            Payload::Depth { depth_m, .. } => {
                self.link.radio.set_depth(*depth_m);
                self.terrain.handle(event)
            }
            Payload::Reception { sender, tol_ns, toa_ns, bytes } => {
                self.reception(*sender, *tol_ns, *toa_ns, bytes)
            }
            _ => self.terrain.handle(event),
        }
    }
}

impl<const K: usize> Navigator for Mpf<K> {
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        check_event(event, self.own, self.terrain.state.core.now_ns())?;
        self.link.radio.check_sender(&event.payload)?;
        self.terrain.state.core.innovation = LastInnovation::default();
        self.terrain.advance(event.t_ns);
        let rejected_before = self.terrain.state.core.rejected;
        let outcome = self.fuse_event(event);
        self.terrain.state.core.count_gated(&event.payload, outcome, rejected_before);
        Ok(outcome)
    }

    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error> {
        // What is being searched for is no belief yet.
        if self.options.range.is_none() || !self.terrain.state.core.started() || self.terrain.acquiring() {
            return Ok(None);
        }
        let estimate = self.terrain.state.core.estimate(tol_ns);
        self.link.radio.broadcast(self.options.packet, &estimate, tol_ns, capacity_bytes).map(Some)
    }

    fn profile(&self) -> Profile {
        let ranges = self.options.range.is_some();
        let uses = Kinds::MOTION.with(Kind::Fix, true).with(Kind::WaterDepth, true);
        let uses = uses.and(Kinds::STATIONS).with(Kind::Reception, ranges);
        Profile { takes_ranges: ranges, has_checksum: true, needs_delivery_oracle: false, uses }
    }

    fn estimate(&self, t_ns: i64) -> Estimate {
        self.terrain.state.core.estimate(t_ns)
    }

    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        save(&(&self.terrain.state, &self.link))
    }

    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        let (terrain, link): (TerrainState<K>, LinkState) = load(snapshot)?;
        self.terrain.check_same(&terrain)?;
        self.link.radio.check_same(&link.radio)?;
        self.terrain.state = terrain;
        self.link = link;
        Ok(())
    }

    fn particles(&self) -> Option<Particles> {
        self.terrain.state.core.particles()
    }

    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        let mut columns = self.terrain.diagnostics();
        if self.options.range.is_some() {
            columns.extend(teammates(self.terrain.state.core.now_ns(), self.link.last_heard.all()));
        }
        columns
    }

    fn information_nat(&self) -> f64 {
        self.terrain.state.core.information_nat
    }

    fn innovation(&self) -> Option<Innovation> {
        self.terrain.state.core.innovation.0
    }
}
