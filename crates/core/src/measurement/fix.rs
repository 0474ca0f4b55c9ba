//! A position fix: the floor of its noise, and when it contradicts a belief.

/// A fix that contradicts the belief by more than this is gated: χ² of two degrees of freedom, 6e-6.
pub const GATE: f64 = 24.0;

/// No fix is better than a decimetre per axis, m².
const FLOOR_M2: f64 = 0.01;

/// Covariance [ee, en, nn] of a fix as a navigator takes it, m².
#[must_use]
pub fn floored([ee, en, nn]: [f64; 3]) -> [f64; 3] {
    [ee.max(FLOOR_M2), en, nn.max(FLOOR_M2)]
}

/// Whether a fix that lies `innovation_m` from the belief contradicts it; `covariance_m2` [ee, en, nn] is that of fix and
/// belief together. `None` for one that is not positive definite.
#[must_use]
pub fn contradicts([e, n]: [f64; 2], [ee, en, nn]: [f64; 3]) -> Option<bool> {
    let determinant = ee * nn - en * en;
    if !(determinant > 0.0 && ee > 0.0) {
        return None;
    }
    let square = (nn * e * e - 2.0 * en * e * n + ee * n * n) / determinant;
    Some(square > GATE)
}
