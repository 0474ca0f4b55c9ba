//! Pose graphs as packets.
//!
//! * [`GraphMessage`]: the packet of `mdeif`, by its [`GraphForm`] in float64 (`exact`) or rounded ([`rounded`]).
//! * [`DeltaMessage`]: the packet of the DEIF, in float64.

mod delta;
mod exact;
mod form;
mod lag;
mod message;
mod origin_field;
pub mod rounded;
#[cfg(test)]
mod tests;

pub use delta::{DeltaMessage, JOINT_F64_BYTES};
pub use form::GraphForm;
pub use message::{GraphLink, GraphMessage};
pub use origin_field::{lag_ids, rounded_lag_ids};
