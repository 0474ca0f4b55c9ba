#![doc = include_str!("../README.md")]
//!
//! The path of a sounding: [`event::Event`] → [`navigator::Navigator::handle`] → [`kernels`] → [`cloud::Cloud`] →
//! [`navigator::Estimate`].

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
pub mod motion;
pub mod navigator;
pub mod packet;
pub mod random;
pub mod replay;
