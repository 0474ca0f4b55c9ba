//! Cooperative navigation by exchanged pose graphs (Walls & Eustice 2012) and what it is compared with.
//!
//! * [`local`]: own sensors and ranges, as every navigator of this family uses them.
//! * [`server`]: a vehicle's local-only graph, which it broadcasts.
//! * [`team`]: the joint filter of the own state and each peer's newest node.

pub mod local;
pub mod server;
pub mod team;
