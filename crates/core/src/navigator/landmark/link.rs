//! A vehicle's side of the role exchanges: what was sent, what was accepted, who is the landmark.

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::event::{Payload, VehicleId};
use crate::packet::landmark::ExchangePacket;

use super::options::PacketOptions;

/// Sequence numbers, the newest packet of each teammate, roles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Exchanges {
    own: VehicleId,
    newest_tol_ns: Vec<Option<i64>>,
    sequence: u8,
    /// Whether this vehicle is the landmark.
    pub is_landmark: bool,
    /// Whom positionings are with.
    pub landmark: Option<VehicleId>,
    /// Whether the landmark's pose is the first one, known to all before anybody is heard.
    pub first: bool,
}

impl Exchanges {
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
            is_landmark: false,
            landmark: None,
            first: true,
        })
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

    /// Reads a packet; `None` (and no change) for one that does not decode or is not newer than the last of its sender.
    pub fn receive(
        &mut self,
        sender: VehicleId,
        tol_ns: i64,
        bytes: &[u8],
        landmark_m: [f64; 2],
        options: &PacketOptions,
    ) -> Option<ExchangePacket> {
        let newest = self.newest_tol_ns.get_mut(usize::from(sender))?;
        if newest.is_some_and(|newest| tol_ns <= newest) || bytes.len() != options.size.bytes() {
            return None;
        }
        let packet = ExchangePacket::decode(bytes, options.format, landmark_m, sender, tol_ns).ok()?;
        *newest = Some(tol_ns);
        Some(packet)
    }

    /// The number of the next packet, modulo 16.
    #[must_use]
    pub fn sequence(&self) -> u8 {
        self.sequence & 15
    }

    /// Counts a packet as sent.
    pub fn sent(&mut self) {
        self.sequence = self.sequence.wrapping_add(1);
    }
}
