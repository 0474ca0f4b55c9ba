//! Numerics and navigators of uwcoop.
//!
//! A vehicle computer can depend on this crate alone: it reads no files, keeps no clock and prints nothing.
//! The path of a sounding: [`event::Event`] → [`navigator::Navigator::handle`] → [`kernels`] → [`cloud::Cloud`] →
//! [`navigator::Estimate`].
//!
//! Conventions: local east–north frame in metres, depth positive down, yaw in radians counter-clockwise from east,
//! time in integer nanoseconds since the mission's epoch.

pub mod bound;
pub mod chart;
pub mod cloud;
pub mod error;
pub mod event;
pub mod information;
pub mod kernels;
pub mod link;
pub mod measurement;
pub mod mixture;
pub mod navigator;
pub mod packet;
pub mod random;
pub mod replay;
