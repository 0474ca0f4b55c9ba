//! Cooperative navigation by exchanged pose graphs (Walls & Eustice 2012) and what it is compared with.
//!
//! * [`local`]: own sensors and ranges, as every navigator of this family uses them.

pub mod local;
