//! The contract of a navigator, and one module for each method.

pub mod authenticated;
pub mod clock;
pub mod dead_reckoning;
pub mod delayed;
pub mod diagnostics;
pub mod dmpf;
pub mod drift;
pub mod from_outside;
pub mod innovation;
pub mod landmark;
pub mod last_heard;
pub mod mpf;
pub mod origin;
pub mod packaged;
pub mod particle_core;
mod particle_motion;
mod particle_prediction;
pub mod profile;
pub mod radio;
pub mod range;
pub mod range_novelty;
pub mod settings;
pub mod snapshot;
pub mod team;
pub mod terrain_core;
pub mod trajectory;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use innovation::{Innovation, LastInnovation};
pub use profile::{Kinds, Profile};

use crate::error::Error;
use crate::event::{Event, VehicleId};

/// What became of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// It changed the estimate.
    Fused,
    /// It only advanced the time, or this navigator does not use it.
    Noted,
    /// It contradicts the belief, or has no likelihood; counted, the estimate is as it was.
    Gated,
    /// A packet that does not decode, is a copy, or is too old; counted, the estimate is as it was.
    Rejected,
}

/// Whether a vehicle has started, and whether it is over its chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Status {
    /// No position fix yet: the mean is NaN, the covariance infinite.
    #[default]
    NotStarted,
    /// Navigating normally.
    Navigating,
    /// Off the chart or over a hole: dead reckoning until the chart is back.
    OffChart,
    /// The position is known too little to navigate by: the whole region where the vehicle may be is searched.
    Acquiring,
}

/// Belief of one vehicle about its own pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Time it holds for, ns.
    pub t_ns: i64,
    /// [east, north], m.
    pub mean_m: [f64; 2],
    /// [ee, en, nn], m².
    pub covariance_m2: [f64; 3],
    /// Yaw and the lower triangle [yaw–east, yaw–north, yaw–yaw] of the pose covariance, where estimated.
    pub yaw: Option<(f64, [f64; 3])>,
    /// Effective sample size, for particle navigators.
    pub ess: Option<f64>,
    /// Measurements gated and packets rejected so far.
    pub rejected: u64,
    /// Whether the chart helps now.
    pub status: Status,
}

/// A copy of a navigator's particles: positions and weights.
#[derive(Debug, Clone, PartialEq)]
pub struct Particles {
    /// Easting, m.
    pub east: Vec<f64>,
    /// Northing, m.
    pub north: Vec<f64>,
    /// Normalised weights.
    pub weights: Vec<f64>,
}

/// The navigator of one vehicle: it sees its own events and the bytes that reach it, nothing else.
pub trait Navigator: Send {
    /// Advances to the event's time, then fuses it.
    ///
    /// # Errors
    /// An event that no honest source could send. Nothing has changed then.
    fn handle(&mut self, event: &Event) -> Result<Outcome, Error>;

    /// What to broadcast in the slot that starts at `tol_ns`; `None` keeps silent.
    ///
    /// # Errors
    /// A packet that cannot be built, or exceeds `capacity_bytes`.
    fn transmit(&mut self, tol_ns: i64, capacity_bytes: usize) -> Result<Option<Arc<[u8]>>, Error>;

    /// The belief predicted to `t_ns`, without changing anything.
    fn estimate(&self, t_ns: i64) -> Estimate;

    /// Everything that determines what comes next: state, random streams, replay counters.
    ///
    /// # Errors
    /// [`Error::Snapshot`], [`Error::External`].
    fn snapshot(&self) -> Result<Vec<u8>, Error>;

    /// Takes up a snapshot of a navigator that was configured the same.
    ///
    /// # Errors
    /// [`Error::Snapshot`]; nothing has changed then.
    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error>;

    /// What it asks of the mission around it, and what it uses. The same for the whole life of the navigator.
    fn profile(&self) -> Profile;

    /// Gives up its window of late events, if it has one: for a layer that must lie within the window.
    fn give_up_window(&mut self) -> Option<delayed::DelayedOptions> {
        None
    }

    /// Information that the last fused range gave on the own position, nat; NaN for a navigator that does not compute
    /// it.
    fn information_nat(&self) -> f64 {
        f64::NAN
    }

    /// How the sounding or the range that was handled last fitted the belief before it was used; `None` where it was not
    /// compared with it.
    fn innovation(&self) -> Option<Innovation> {
        None
    }

    /// Particles for pictures.
    fn particles(&self) -> Option<Particles> {
        None
    }

    /// Further diagnostics of the method, by name with unit (`origin_age_s`): a column each in the record. Counts
    /// start at 0; what does not apply yet is NaN.
    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}

/// A centralised reference: fed the events of the whole team, transmits nothing.
pub trait CentralEstimator: Send {
    /// As [`Navigator::handle`], for any vehicle. A reception has no bytes.
    ///
    /// # Errors
    /// As [`Navigator::handle`].
    fn handle(&mut self, vehicle: VehicleId, event: &Event) -> Result<Outcome, Error>;

    /// The belief about one vehicle.
    fn estimate(&self, vehicle: VehicleId, t_ns: i64) -> Estimate;

    /// A slot of `vehicle` begins at `tol_ns`: the ranges that follow are to where it is now. False: it keeps silent.
    ///
    /// # Errors
    /// An unknown vehicle, or a time in its past. Nothing has changed then.
    fn launch(&mut self, vehicle: VehicleId, tol_ns: i64) -> Result<bool, Error>;

    /// As [`Navigator::profile`].
    fn profile(&self) -> Profile;

    /// Bytes of the packet that a slot is assumed to carry, for loss and air time.
    fn assumed_packet_bytes(&self) -> usize;

    /// As [`Navigator::innovation`], of whichever vehicle's event was handled last.
    fn innovation(&self) -> Option<Innovation> {
        None
    }

    /// As [`Navigator::diagnostics`], about one vehicle.
    fn diagnostics(&self, _vehicle: VehicleId) -> Vec<(&'static str, f64)> {
        Vec::new()
    }

    /// As [`Navigator::snapshot`].
    ///
    /// # Errors
    /// As [`Navigator::snapshot`].
    fn snapshot(&self) -> Result<Vec<u8>, Error>;

    /// As [`Navigator::restore`].
    ///
    /// # Errors
    /// As [`Navigator::restore`].
    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error>;
}

/// Whose event it is and whether it is in order, before anything changes.
///
/// # Errors
/// [`Error::WrongVehicle`], [`Error::FromThePast`], or what [`Event::validate`] says.
pub fn check_event(event: &Event, own: VehicleId, now_ns: Option<i64>) -> Result<(), Error> {
    if event.vehicle != own {
        return Err(Error::WrongVehicle { event: event.vehicle, own });
    }
    if let Some(now_ns) = now_ns
        && event.t_ns < now_ns
    {
        return Err(Error::FromThePast { event_ns: event.t_ns, now_ns });
    }
    event.validate()
}

/// Refuses a sender that is the receiver itself, or that the team does not have.
///
/// # Errors
/// [`Error::WrongVehicle`], [`Error::UnknownVehicle`].
pub fn check_sender(sender: VehicleId, own: VehicleId, vehicles: usize) -> Result<(), Error> {
    if sender == own {
        return Err(Error::WrongVehicle { event: sender, own });
    }
    if usize::from(sender) >= vehicles {
        return Err(Error::UnknownVehicle { vehicle: sender, count: vehicles });
    }
    Ok(())
}
