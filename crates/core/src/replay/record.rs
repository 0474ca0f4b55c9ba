//! What a replay writes down: estimates in columns, packets, clouds.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::innovations::{InnovationRecord, OutcomeCounts, place_of};
use super::{Estimators, Poll};
use crate::event::{Kind, VehicleId};
use crate::navigator::{Estimate, Outcome, Status};

/// One packet at one receiver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PacketRecord {
    /// Who sent it.
    pub sender: VehicleId,
    /// Who could hear it.
    pub receiver: VehicleId,
    /// Launch, ns.
    pub tol_ns: i64,
    /// Arrival of the signal's start, ns.
    pub toa_ns: i64,
    /// Length on the air.
    pub bytes: u32,
    /// Frames it took.
    pub frames: u32,
    /// Whether all frames survived.
    pub received: bool,
    /// Whether the receiver used it.
    pub accepted: bool,
    /// Information gained from its range, nat; NaN where not used or not computed.
    pub information_nat: f64,
}

/// Particles of one vehicle at one instant, single precision: for pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CloudRecord {
    /// When, ns.
    pub t_ns: i64,
    /// Whose.
    pub vehicle: VehicleId,
    /// [east, north] of each particle, m.
    pub positions_m: Vec<[f32; 2]>,
    /// Normalised weights.
    pub weights: Vec<f32>,
}

/// The finished record. Columns are (vehicle, sample) in row-major order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracks {
    /// Vehicles.
    pub vehicles: usize,
    /// Instants, ns.
    pub t_ns: Vec<i64>,
    /// [east, north], m.
    pub mean_m: Vec<[f64; 2]>,
    /// [ee, en, nn], m².
    pub covariance_m2: Vec<[f64; 3]>,
    /// NaN where not estimated, rad.
    pub yaw_rad: Vec<f64>,
    /// [yaw–east, yaw–north, yaw–yaw].
    pub yaw_covariance: Vec<[f64; 3]>,
    /// NaN for navigators without particles.
    pub ess: Vec<f64>,
    /// Gated measurements and rejected packets so far.
    pub rejected: Vec<u64>,
    /// Slots so far that a vehicle left silent because its packet did not fit.
    pub unsent: Vec<u64>,
    /// Whether the vehicle's status was off the chart.
    pub off_chart: Vec<bool>,
    /// Whether the vehicle was searching for its position.
    pub acquiring: Vec<bool>,
    /// Diagnostics of the navigators, a column for each name; NaN where a navigator has none of this name.
    pub diagnostics: BTreeMap<String, Vec<f64>>,
    /// Events by the name of their kind that no estimate or packet can depend on: its navigator does not use the kind
    /// ([`Profile::uses`](crate::navigator::Profile)).
    pub unused: BTreeMap<String, u64>,
    /// What became of the events, by the name of their kind.
    pub outcomes: BTreeMap<String, OutcomeCounts>,
    /// How soundings, ranges and fixes fitted the beliefs before they were used.
    pub innovations: Vec<InnovationRecord>,
    /// (vehicle, TOL, bytes) of every packet sent; an answer to a poll with what it carries beside the packet.
    pub sent: Vec<(VehicleId, i64, u32)>,
    /// Every poll of two-way ranging, heard or not.
    pub polls: Vec<Poll>,
    /// Every packet at every receiver.
    pub packets: Vec<PacketRecord>,
    /// Particles.
    pub clouds: Vec<CloudRecord>,
}

/// The record while it grows.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Record {
    tracks: Tracks,
    sample_ns: Arc<[i64]>,
    cloud_every: usize,
    /// By vehicle, slots left silent so far.
    unsent: Vec<u64>,
}

impl Record {
    /// An empty record.
    #[must_use]
    pub fn new(vehicles: usize, sample_ns: Arc<[i64]>, cloud_every: usize) -> Self {
        let n = vehicles * sample_ns.len();
        let tracks = Tracks {
            vehicles,
            t_ns: sample_ns.to_vec(),
            mean_m: vec![[f64::NAN; 2]; n],
            covariance_m2: vec![[f64::NAN; 3]; n],
            yaw_rad: vec![f64::NAN; n],
            yaw_covariance: vec![[f64::NAN; 3]; n],
            ess: vec![f64::NAN; n],
            rejected: vec![0; n],
            unsent: vec![0; n],
            off_chart: vec![false; n],
            acquiring: vec![false; n],
            ..Tracks::default()
        };
        Self { tracks, sample_ns, cloud_every, unsent: vec![0; vehicles] }
    }

    /// The next instant to record.
    #[must_use]
    pub fn sample_at(&self, cursor: usize) -> Option<i64> {
        self.sample_ns.get(cursor).copied()
    }

    /// Whether both records are of the same instants.
    #[must_use]
    pub fn fits(&self, other: &Self) -> bool {
        self.sample_ns == other.sample_ns && self.tracks.vehicles == other.tracks.vehicles
    }

    /// Writes down every vehicle's estimate at the cursor's instant and moves the cursor.
    pub fn sample(&mut self, team: &Estimators, cursor: &mut usize) {
        let t_ns = self.sample_ns[*cursor];
        for vehicle in 0..self.tracks.vehicles {
            let at = vehicle * self.sample_ns.len() + *cursor;
            self.put(at, &team.estimate(vehicle, t_ns));
            self.tracks.unsent[at] = self.unsent[vehicle];
            self.diagnose(at, &team.diagnostics(vehicle));
            if self.cloud_every > 0 && cursor.is_multiple_of(self.cloud_every) {
                self.cloud(team, vehicle, t_ns);
            }
        }
        *cursor += 1;
    }

    fn put(&mut self, at: usize, estimate: &Estimate) {
        let tracks = &mut self.tracks;
        tracks.mean_m[at] = estimate.mean_m;
        tracks.covariance_m2[at] = estimate.covariance_m2;
        if let Some((yaw_rad, covariance)) = estimate.yaw {
            tracks.yaw_rad[at] = yaw_rad;
            tracks.yaw_covariance[at] = covariance;
        }
        tracks.ess[at] = estimate.ess.unwrap_or(f64::NAN);
        tracks.rejected[at] = estimate.rejected;
        tracks.off_chart[at] = estimate.status == Status::OffChart;
        tracks.acquiring[at] = estimate.status == Status::Acquiring;
    }

    fn diagnose(&mut self, at: usize, columns: &[(&'static str, f64)]) {
        let samples = self.tracks.mean_m.len();
        for (name, value) in columns {
            // Looked up before it is inserted: the name is copied once for each column, not for each sample.
            if !self.tracks.diagnostics.contains_key(*name) {
                self.tracks.diagnostics.insert((*name).to_owned(), vec![f64::NAN; samples]);
            }
            if let Some(column) = self.tracks.diagnostics.get_mut(*name) {
                column[at] = *value;
            }
        }
    }

    fn cloud(&mut self, team: &Estimators, vehicle: usize, t_ns: i64) {
        let Some(particles) = team.particles(vehicle) else { return };
        self.tracks.clouds.push(CloudRecord {
            t_ns,
            vehicle: vehicle as VehicleId,
            positions_m: particles
                .east
                .iter()
                .zip(&particles.north)
                .map(|(e, n)| [*e as f32, *n as f32])
                .collect(),
            weights: particles.weights.iter().map(|w| *w as f32).collect(),
        });
    }

    /// Writes down that a packet was launched.
    pub fn sent(&mut self, sender: VehicleId, tol_ns: i64, bytes: usize) {
        self.tracks.sent.push((sender, tol_ns, bytes as u32));
    }

    /// Records that a slot stayed silent because the sender's packet did not fit.
    pub fn unsent(&mut self, sender: VehicleId) {
        if let Some(count) = self.unsent.get_mut(usize::from(sender)) {
            *count = count.saturating_add(1);
        }
    }

    /// Counts an event of a kind that its navigator does not use.
    pub fn unused(&mut self, kind: Kind) {
        if !self.tracks.unused.contains_key(kind.name()) {
            self.tracks.unused.insert(kind.name().to_owned(), 0);
        }
        if let Some(count) = self.tracks.unused.get_mut(kind.name()) {
            *count = count.saturating_add(1);
        }
    }

    /// Counts what became of an event, and writes down how it fitted.
    pub fn judged(
        &mut self,
        vehicle: VehicleId,
        kind: Kind,
        outcome: Outcome,
        seen: Option<InnovationRecord>,
    ) {
        let vehicles = self.tracks.vehicles;
        if !self.tracks.outcomes.contains_key(kind.name()) {
            self.tracks.outcomes.insert(kind.name().to_owned(), vec![[0; 4]; vehicles]);
        }
        let counts = self.tracks.outcomes.get_mut(kind.name()).and_then(|v| v.get_mut(usize::from(vehicle)));
        if let Some(counts) = counts {
            counts[place_of(outcome)] = counts[place_of(outcome)].saturating_add(1);
        }
        self.tracks.innovations.extend(seen);
    }

    /// Writes down that a slot was polled.
    pub fn polled(&mut self, poll: Poll) {
        self.tracks.polls.push(poll);
    }

    /// Writes down a packet at one receiver; the index is for [`Record::accepted`].
    pub fn packet(&mut self, packet: PacketRecord) -> usize {
        self.tracks.packets.push(packet);
        self.tracks.packets.len() - 1
    }

    /// Records that the receiver used it, and the information gained.
    pub fn accepted(&mut self, index: usize, information_nat: f64) {
        if let Some(packet) = self.tracks.packets.get_mut(index) {
            packet.accepted = true;
            packet.information_nat = information_nat;
        }
    }

    /// The finished record.
    #[must_use]
    pub fn into_tracks(self) -> Tracks {
        self.tracks
    }
}
