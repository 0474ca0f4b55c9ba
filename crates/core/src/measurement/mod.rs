//! One function for each measurement model that is used in several places: navigators, their kernels and the bound.
//!
//! Scalar functions are written without branches on data and inlined, so that a loop over particles still vectorises.

pub mod angle;
pub mod fix;
pub mod range;
pub mod sounding;

#[cfg(test)]
mod tests;
