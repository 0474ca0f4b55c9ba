//! What both ends of an acoustic link agree on.
//!
//! * [`LinkConfig`]: frames, air time and sound speed of the modem.
//! * [`SlotTable`]: who may launch when, and how much fits (TDMA).
//! * [`Sequencer`], [`ReceiveWindow`], [`AckBitmap`]: packet counters at the sender and the receiver, and which packets
//!   of a peer arrived.
//! * [`Authenticator`], [`ReplayGuard`], [`FailedTags`]: tags that only holders of the team's key can make, each good for
//!   one slot, and a bound on how often one is guessed.
//! * [`range_m`], [`slant_to_horizontal`], [`depth_rounding_m2`]: from times to distances.
//!
//! Everything here is plain state without clock or random numbers and serialises with serde, checked on the way in,
//! for snapshots.

mod acknowledge;
mod authenticate;
mod config;
mod error;
mod failed_tags;
mod geometry;
mod sequence;
mod slots;
#[cfg(test)]
mod tests;

pub use acknowledge::AckBitmap;
pub use authenticate::{Authenticator, ReplayGuard};
pub use config::LinkConfig;
pub use error::LinkError;
pub use failed_tags::FailedTags;
pub use geometry::{HorizontalRange, depth_rounding_m2, range_m, slant_to_horizontal};
pub use sequence::{Admission, ReceiveWindow, Sequencer};
pub use slots::{Slot, SlotTable};
