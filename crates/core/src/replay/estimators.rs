//! A team is one navigator per vehicle, or one centralised estimator that is fed all of them.

use std::sync::Arc;

use crate::error::Error;
use crate::event::{Event, VehicleId};
use crate::link::Slot;
use crate::navigator::{CentralEstimator, Estimate, Innovation, Navigator, Outcome, Particles, Profile};

/// Who estimates.
pub enum Estimators {
    /// One navigator for each vehicle, in the vehicles' order.
    Each(Vec<Box<dyn Navigator>>),
    /// A centralised reference.
    Central(Box<dyn CentralEstimator>),
}

impl Estimators {
    /// Number of navigators; a centralised estimator fits any mission.
    #[must_use]
    pub fn size(&self) -> Option<usize> {
        match self {
            Self::Each(navigators) => Some(navigators.len()),
            Self::Central(_) => None,
        }
    }

    fn each(navigators: &mut [Box<dyn Navigator>], vehicle: VehicleId) -> Result<&mut dyn Navigator, Error> {
        let count = navigators.len();
        match navigators.get_mut(usize::from(vehicle)) {
            Some(navigator) => Ok(navigator.as_mut()),
            None => Err(Error::UnknownVehicle { vehicle, count }),
        }
    }

    /// Passes an event to its vehicle's navigator.
    ///
    /// # Errors
    /// What the navigator refuses.
    pub fn handle(&mut self, event: &Event) -> Result<Outcome, Error> {
        match self {
            Self::Each(navigators) => Self::each(navigators, event.vehicle)?.handle(event),
            Self::Central(team) => team.handle(event.vehicle, event),
        }
    }

    /// The packet for a slot. A centralised estimator sends none, but its ranges need one to ride on.
    ///
    /// # Errors
    /// What the navigator refuses.
    pub fn transmit(&mut self, slot: &Slot) -> Result<Option<Arc<[u8]>>, Error> {
        match self {
            Self::Each(navigators) => {
                Self::each(navigators, slot.sender)?.transmit(slot.tol_ns, slot.capacity_bytes)
            }
            Self::Central(team) => {
                let speaks = team.launch(slot.sender, slot.tol_ns)?;
                Ok(speaks.then(|| Arc::from([].as_slice())))
            }
        }
    }

    /// Bytes that a packet counts for on the channel.
    #[must_use]
    pub fn packet_length(&self, bytes: &[u8]) -> usize {
        match self {
            Self::Each(_) => bytes.len(),
            Self::Central(team) => team.assumed_packet_bytes(),
        }
    }

    /// Belief about one vehicle.
    #[must_use]
    pub fn estimate(&self, vehicle: usize, t_ns: i64) -> Estimate {
        match self {
            Self::Each(navigators) => navigators[vehicle].estimate(t_ns),
            Self::Central(team) => team.estimate(vehicle as VehicleId, t_ns),
        }
    }

    /// Particles of one vehicle.
    #[must_use]
    pub fn particles(&self, vehicle: usize) -> Option<Particles> {
        match self {
            Self::Each(navigators) => navigators[vehicle].particles(),
            Self::Central(_) => None,
        }
    }

    /// Diagnostics of the method at one vehicle.
    #[must_use]
    pub fn diagnostics(&self, vehicle: usize) -> Vec<(&'static str, f64)> {
        match self {
            Self::Each(navigators) => navigators[vehicle].diagnostics(),
            Self::Central(team) => team.diagnostics(vehicle as VehicleId),
        }
    }

    /// What this vehicle's navigator asks for; `None` for a vehicle that the team does not have.
    #[must_use]
    pub fn profile(&self, vehicle: VehicleId) -> Option<Profile> {
        match self {
            Self::Each(navigators) => navigators.get(usize::from(vehicle)).map(|n| n.profile()),
            Self::Central(team) => Some(team.profile()),
        }
    }

    /// How the event that was handled last fitted, as far as its navigator says.
    #[must_use]
    pub fn innovation(&self, vehicle: VehicleId) -> Option<Innovation> {
        match self {
            Self::Each(navigators) => navigators.get(usize::from(vehicle))?.innovation(),
            Self::Central(team) => team.innovation(),
        }
    }

    /// Information that the last fused range gave a vehicle, nat; NaN where it is not computed.
    #[must_use]
    pub fn information_nat(&self, vehicle: VehicleId) -> f64 {
        match self {
            Self::Each(navigators) => {
                navigators.get(usize::from(vehicle)).map_or(f64::NAN, |n| n.information_nat())
            }
            Self::Central(_) => f64::NAN,
        }
    }

    /// Snapshots of all members.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn snapshot(&self) -> Result<Vec<Vec<u8>>, Error> {
        match self {
            Self::Each(navigators) => navigators.iter().map(|n| n.snapshot()).collect(),
            Self::Central(team) => Ok(vec![team.snapshot()?]),
        }
    }

    /// Takes up snapshots of all members.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn restore(&mut self, snapshots: &[Vec<u8>]) -> Result<(), Error> {
        match self {
            Self::Each(navigators) => {
                if navigators.len() != snapshots.len() {
                    return Err(Error::Length {
                        quantity: "snapshots of navigators",
                        found: snapshots.len(),
                        expected: navigators.len(),
                    });
                }
                navigators.iter_mut().zip(snapshots).try_for_each(|(n, s)| n.restore(s))
            }
            Self::Central(team) => match snapshots {
                [one] => team.restore(one),
                _ => Err(Error::Length {
                    quantity: "snapshots of a centralised estimator",
                    found: snapshots.len(),
                    expected: 1,
                }),
            },
        }
    }
}
