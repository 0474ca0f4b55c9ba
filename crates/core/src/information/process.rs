//! White acceleration: the process model of a vehicle without odometry.

use super::NodeMatrix;

/// F(dt) of [x, y, ẋ, ẏ]; dt in s, negative for looking back.
#[must_use]
pub fn transition(dt_s: f64) -> NodeMatrix {
    let mut f = NodeMatrix::identity();
    f[(0, 2)] = dt_s;
    f[(1, 3)] = dt_s;
    f
}

/// Q(dt) for a white acceleration of spectral density `q_m2_per_s3` per axis: dt³/3, dt²/2 and dt times it. Zero for
/// dt ≤ 0.
#[must_use]
pub fn noise(dt_s: f64, q_m2_per_s3: f64) -> NodeMatrix {
    let dt = dt_s.max(0.0);
    let (xx, xv, vv) = (q_m2_per_s3 * dt * dt * dt / 3.0, q_m2_per_s3 * dt * dt / 2.0, q_m2_per_s3 * dt);
    NodeMatrix::new(
        xx, 0.0, xv, 0.0, //
        0.0, xx, 0.0, xv, //
        xv, 0.0, vv, 0.0, //
        0.0, xv, 0.0, vv,
    )
}
