//! Cooperative navigation by exchanged pose graphs (Walls & Eustice 2012), and its references.
//!
//! * [`local`]: own sensors and ranges, as every navigator of this family uses them.
//! * [`server`]: a vehicle's local-only graph, which it broadcasts.
//! * [`joint_filter`]: the joint filter of the own state and each peer's newest node.
//! * [`mdeif`], [`deif`]: the navigators.
//! * [`belief`], [`interleaved`]: references that exchange positions instead of graphs.
//! * [`lasting`]: errors of ranges and of a gyro that last, as states, and noise that fits the day.
//! * [`odometry`]: vehicles with odometry; [`heading_bank`]: whose heading at the start is not known.
//! * [`graph`], [`central`]: references that use more information than a vehicle has.

pub mod belief;
pub mod central;
pub mod deif;
pub mod graph;
pub mod heading_bank;
pub mod interleaved;
pub mod joint_filter;
pub mod lasting;
pub mod local;
pub mod local_options;
pub mod mdeif;
mod mdeif_counts;
mod mdeif_options;
pub mod odometry;
pub mod range;
pub mod sensors;
pub mod server;
