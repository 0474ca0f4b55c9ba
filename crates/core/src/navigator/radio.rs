//! A navigator's side of the acoustic link: beliefs as packets, sequence numbers, and what was received from whom.

use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::clock::ClockOptions;
use super::{Estimate, Particles, check_sender};
use crate::error::{Error, positive};
use crate::event::{Payload, VehicleId, seconds};
use crate::link::{ReceiveWindow, Sequencer, depth_rounding_m2, range_m, slant_to_horizontal};
use crate::packet::{
    Belief, BeliefPacket, CloudPacket, Header, HeardBitmap, MixturePacket, PacketKind, check_crc,
};

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
pub(in crate::navigator) const SLANT_GATES: f64 = 4.0;

/// A teammate's belief about its own position at launch, as its packet holds it.
#[derive(Debug, Clone, PartialEq)]
pub enum BroadcastBelief {
    /// A Gaussian.
    Gaussian(Belief),
    /// All its particles.
    Cloud(CloudPacket),
    /// A few Gaussian modes with their shares.
    Mixture(Vec<(f64, Belief)>),
}

/// A teammate's belief with the measured horizontal range to where it was.
#[derive(Debug, Clone, PartialEq)]
pub struct HeardBelief {
    /// The teammate's belief at launch.
    pub belief: BroadcastBelief,
    /// Horizontal range from the teammate at launch to this vehicle at arrival, m.
    pub range_m: f64,
    /// Variance of that range from the rounding of the teammate's depth, m²; zero above 51.2 m.
    pub depth_rounding_m2: f64,
}

impl Radio {
    /// A radio of vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// [`Error::OutOfBound`] for a sound speed that is not one.
    pub fn new(own: VehicleId, vehicles: usize, sound_speed_mps: f64) -> Result<Self, Error> {
        positive("sound_speed_mps", sound_speed_mps)?;
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

    /// A packet with this belief.
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

    /// A packet with all particles.
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

    /// A packet with a few modes.
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

    /// Variance of what clocks and sound speed do to the range of a packet, m².
    #[must_use]
    pub fn standing_m2(&self, clock: &ClockOptions, tol_ns: i64, toa_ns: i64) -> f64 {
        let range_m = range_m(tol_ns, toa_ns, self.sound_speed_mps).unwrap_or(0.0);
        clock.standing_m2(self.sound_speed_mps, range_m, seconds(toa_ns))
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
    ) -> Option<HeardBelief> {
        let window = self.windows.get_mut(usize::from(sender))?;
        let (header, belief) = match check_crc(bytes, sender, tol_ns).and_then(Header::peek_kind).ok()? {
            PacketKind::Cloud => {
                let packet = CloudPacket::decode(bytes, sender, tol_ns).ok()?;
                (packet.header, BroadcastBelief::Cloud(packet))
            }
            PacketKind::Mixture => {
                let packet = MixturePacket::decode(bytes, sender, tol_ns).ok()?;
                (packet.header, BroadcastBelief::Mixture(packet.modes))
            }
            PacketKind::Belief | PacketKind::BeliefF64 => {
                let packet = BeliefPacket::decode(bytes, sender, tol_ns).ok()?;
                (packet.header, BroadcastBelief::Gaussian(packet.belief))
            }
            // Packets of other families of navigators.
            _ => return None,
        };
        let step_m = Header::coarse_depth_step_m(header.depth_m);
        let range = range_m(tol_ns, toa_ns, self.sound_speed_mps).and_then(|slant_m| {
            let sigma_m = if step_m > 0.0 { sigma_range_m.hypot(step_m) } else { sigma_range_m };
            slant_to_horizontal(slant_m, self.depth_m, header.depth_m, sigma_m, SLANT_GATES)
        });
        let mut heard = self.heard;
        let range_m = range.ok()?.range_m;
        let depth_rounding_m2 = depth_rounding_m2(range_m, self.depth_m - header.depth_m, step_m);
        // The bitmap names the first vehicles of a larger team; no navigator with a radio reads it.
        let _ = heard.insert(sender);
        window.accept(header.sequence, tol_ns).ok()?;
        self.heard = heard;
        Some(HeardBelief { belief, range_m, depth_rounding_m2 })
    }
}
