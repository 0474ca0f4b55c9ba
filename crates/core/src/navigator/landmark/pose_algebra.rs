//! Poses in the plane [x, y, yaw]: composition, differences, and their derivatives.

use nalgebra::{Matrix3, Rotation2, Vector2, Vector3};

use super::model::{Measurement, Pose};
use super::odometry::Increment;
use crate::measurement::angle::wrap;

/// a ⊕ b: b's pose in the world, given in a's frame.
pub(super) fn compose(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    let arm = Rotation2::new(a.z) * Vector2::new(b.x, b.y);
    Vector3::new(a.x + arm.x, a.y + arm.y, wrap(a.z + b.z))
}

/// Derivatives of a ⊕ b by a and by b.
pub(super) fn composed_by(a: &Vector3<f64>, b: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let turn = Rotation2::new(a.z);
    let arm = turn * Vector2::new(b.x, b.y);
    let mut by_a = Matrix3::identity();
    by_a[(0, 2)] = -arm.y;
    by_a[(1, 2)] = arm.x;
    let mut by_b = Matrix3::identity();
    by_b.fixed_view_mut::<2, 2>(0, 0).copy_from(turn.matrix());
    (by_a, by_b)
}

/// a⁻¹ ⊕ b: b as a sees it.
pub(super) fn between(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    let arm = Rotation2::new(-a.z) * Vector2::new(b.x - a.x, b.y - a.y);
    Vector3::new(arm.x, arm.y, wrap(b.z - a.z))
}

/// Derivatives of a⁻¹ ⊕ b by a and by b.
pub(super) fn between_by(a: &Vector3<f64>, b: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let back = Rotation2::new(-a.z);
    let arm = back * Vector2::new(b.x - a.x, b.y - a.y);
    let mut by_b = Matrix3::identity();
    by_b.fixed_view_mut::<2, 2>(0, 0).copy_from(back.matrix());
    let mut by_a = -by_b;
    by_a[(0, 2)] = arm.y;
    by_a[(1, 2)] = -arm.x;
    (by_a, by_b)
}

/// Derivative of z⁻¹ by z.
pub(super) fn inverse_by(z: &Vector3<f64>) -> Matrix3<f64> {
    between_by(z, &Vector3::zeros()).0
}

/// a − b, the yaw wrapped.
pub(super) fn difference(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(a.x - b.x, a.y - b.y, wrap(a.z - b.z))
}

/// Where the mover was at transmission.
#[must_use]
pub fn at_transmit(own: Pose, delay: &Increment, bias: &Vector3<f64>) -> Pose {
    let (displacement, yaw) = delay.corrected(bias);
    let before = own[2] - yaw;
    let moved = Rotation2::new(before) * displacement;
    [own[0] - moved.x, own[1] - moved.y, wrap(before)]
}

/// One positioning as the own pose at reception in the landmark's frame (23)–(25), with its covariance.
///
/// `None` unless all three channels were measured.
#[must_use]
pub fn seen(
    measured: &Measurement,
    sigma: [f64; 3],
    delay: &Increment,
    bias: &Vector3<f64>,
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let (range, own, peer) = (measured.range_m?, measured.own_rad?, measured.peer_rad?);
    let (displacement, yaw) = delay.corrected(bias);
    let there = Vector2::new(range * peer.cos(), range * peer.sin());
    let turned = peer - own - std::f64::consts::PI;
    let here = there + Rotation2::new(turned - yaw) * displacement;
    // The direction at reception, which θ_ML looks along.
    let turned = wrap(here.y.atan2(here.x) - own - std::f64::consts::PI);
    let j = Matrix3::new(peer.cos(), 0.0, -there.y, peer.sin(), 0.0, there.x, 0.0, -1.0, 1.0); // by range, θ_ML, θ_LM
    let noise = Matrix3::from_diagonal(&Vector3::from(sigma.map(|s| s * s)));
    Some((Vector3::new(here.x, here.y, turned), j * noise * j.transpose()))
}

/// Composes a pose seen in some frame with later motion.
#[must_use]
pub fn carried(
    pose: &Vector3<f64>,
    covariance: &Matrix3<f64>,
    increment: &Increment,
    bias: &Vector3<f64>,
) -> (Vector3<f64>, Matrix3<f64>) {
    let turn = Rotation2::new(pose.z);
    let (displacement, yaw) = increment.corrected(bias);
    let moved = turn * displacement;
    let mut transition = Matrix3::identity();
    transition[(0, 2)] = -moved.y;
    transition[(1, 2)] = moved.x;
    let mut frame = Matrix3::identity();
    frame.fixed_view_mut::<2, 2>(0, 0).copy_from(turn.matrix());
    let p =
        transition * covariance * transition.transpose() + frame * increment.covariance * frame.transpose();
    (Vector3::new(pose.x + moved.x, pose.y + moved.y, wrap(pose.z + yaw)), p)
}
