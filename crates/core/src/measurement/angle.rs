//! Angles on their circle.

use std::f64::consts::{PI, TAU};

/// Adding and subtracting it rounds to an integer.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// An angle in [−π, π).
#[must_use]
pub fn wrap(angle: f64) -> f64 {
    let wrapped = (angle + PI).rem_euclid(TAU) - PI;
    // A tiny negative angle plus 2π rounds to 2π itself.
    if wrapped >= PI { -PI } else { wrapped }
}

/// An angle in [−π, π], by a rounding that vectorises.
#[inline(always)]
#[must_use]
pub fn wrap_fast(angle: f64) -> f64 {
    let turns = angle * (1.0 / TAU);
    angle - ((turns + ROUND) - ROUND) * TAU
}
