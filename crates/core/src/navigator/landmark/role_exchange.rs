//! Role exchanges of one vehicle: counters of sent and received packets, and which vehicle is the landmark.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::options::PacketOptions;
use crate::error::Error;
use crate::event::{Payload, VehicleId};
use crate::link::slant_to_horizontal;
use crate::mixture::Mode;
use crate::packet::PacketError;
use crate::packet::landmark::ExchangePacket;

/// Sequence numbers, the newest packet of each teammate, roles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RoleExchange {
    own: VehicleId,
    newest_tol_ns: Vec<Option<i64>>,
    sequence: u8,
    /// Slots in which nothing was sent because the belief does not fit the packet's fields.
    pub untold: u64,
    /// Whether this vehicle is the landmark.
    pub is_landmark: bool,
    /// The vehicle that positionings are measured to.
    pub landmark: Option<VehicleId>,
    /// Whether the landmark is still at its first pose, which all vehicles know before any packet.
    pub first: bool,
    /// Own depth below the surface, once measured, m.
    pub depth_m: Option<f64>,
}

/// A slant range so many standard deviations shorter than the difference of the depths is none.
const SLANT_GATES: f64 = 6.0;

impl RoleExchange {
    /// Of vehicle `own` in a team of `vehicles`.
    ///
    /// # Errors
    /// [`Error::UnknownVehicle`].
    pub fn new(own: VehicleId, vehicles: usize) -> Result<Self, Error> {
        if usize::from(own) >= vehicles {
            return Err(Error::UnknownVehicle { vehicle: own, count: vehicles });
        }
        Ok(Self {
            own,
            newest_tol_ns: vec![None; vehicles],
            sequence: 0,
            untold: 0,
            is_landmark: false,
            landmark: None,
            first: true,
            depth_m: None,
        })
    }

    /// A measured slant range as the horizontal one that the poses are about; as it is where a depth is not known. `None`
    /// for a range that is shorter than the difference of the depths.
    #[must_use]
    pub fn horizontal(&self, slant_m: Option<f64>, peer_depth_m: Option<f64>, sigma_m: f64) -> Option<f64> {
        let (Some(slant_m), Some(own_m), Some(peer_m)) = (slant_m, self.depth_m, peer_depth_m) else {
            return slant_m;
        };
        slant_to_horizontal(slant_m, own_m, peer_m, sigma_m, SLANT_GATES).ok().map(|reduced| reduced.range_m)
    }

    /// Refuses a vehicle that the team does not have, or that is this one.
    ///
    /// # Errors
    /// [`Error::UnknownVehicle`], [`Error::WrongVehicle`].
    pub fn check(&self, payload: &Payload) -> Result<(), Error> {
        let other = match payload {
            Payload::Reception { sender, .. } => *sender,
            Payload::AcousticFix { peer, .. } => *peer,
            _ => return Ok(()),
        };
        if other == self.own {
            return Err(Error::WrongVehicle { event: other, own: self.own });
        }
        if usize::from(other) >= self.newest_tol_ns.len() {
            return Err(Error::UnknownVehicle { vehicle: other, count: self.newest_tol_ns.len() });
        }
        Ok(())
    }

    /// Reads a packet; `None` for one that does not decode or is not newer than the last accepted of its sender.
    #[must_use]
    pub fn read(
        &self,
        sender: VehicleId,
        tol_ns: i64,
        bytes: &[u8],
        landmark_m: [f64; 2],
        options: &PacketOptions,
    ) -> Option<ExchangePacket> {
        let newest = self.newest_tol_ns.get(usize::from(sender))?;
        if newest.is_some_and(|newest| tol_ns <= newest) || !options.size.admits(bytes.len()) {
            return None;
        }
        ExchangePacket::decode(bytes, options.format, landmark_m, sender, tol_ns).ok()
    }

    /// Takes down that a packet was used, so that none of its sender before it is.
    pub fn accept(&mut self, sender: VehicleId, tol_ns: i64) {
        if let Some(newest) = self.newest_tol_ns.get_mut(usize::from(sender)) {
            *newest = Some(tol_ns);
        }
    }

    /// The packet of these modes in the shortest size that holds them, with the number of the next one.
    ///
    /// # Errors
    /// As [`ExchangePacket::encode`].
    pub fn packet(
        &self,
        modes: Vec<Mode<6>>,
        options: &PacketOptions,
        tol_ns: i64,
    ) -> Result<Vec<u8>, PacketError> {
        let size = options.size.least_for(modes.len());
        let packet = ExchangePacket { sequence: Some(self.sequence & 15), modes };
        packet.encode(options.format, size, self.own, tol_ns)
    }

    fn sent(&mut self) {
        self.sequence = self.sequence.wrapping_add(1);
    }

    /// The encoded packet, counted as sent. A belief outside the packet's fields is not sent: a value that fits would be
    /// wrong, and a vehicle that receives no packet locates the new landmark by its own positionings. Other errors are
    /// returned.
    ///
    /// # Errors
    /// [`Error::Packet`] for a belief that is no belief; [`Error::PacketTooLong`] for a slot too short.
    pub fn checked_packet(
        &mut self,
        packet: Result<Vec<u8>, PacketError>,
        capacity_bytes: usize,
    ) -> Result<Option<Arc<[u8]>>, Error> {
        match packet {
            Ok(bytes) if bytes.len() > capacity_bytes => {
                Err(Error::PacketTooLong { bytes: bytes.len(), capacity: capacity_bytes })
            }
            Ok(bytes) => {
                self.sent();
                Ok(Some(bytes.into()))
            }
            Err(PacketError::OutOfRange { .. }) => {
                self.untold += 1;
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }
}
